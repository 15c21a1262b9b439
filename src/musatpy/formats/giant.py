"""GIANT: ground control, image and frame files (NOAA and Elassal's General Integrated Analytical Triangulation).

The layouts, their sources and what no public source settles stand in card_formats/giant.
"""

from musatpy.formats.recordset import RecordSet

FAMILY = RecordSet.of("giant")
PATTERNS = FAMILY.patterns
load_one = FAMILY.load_one
dump_one = FAMILY.dump_one
left_out = FAMILY.left_out
