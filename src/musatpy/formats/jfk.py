"""JFK/ALBANY measurement cards: comparator readings, the fiducial marks of each photo first.

The layouts, their sources and what no public source settles stand in card_formats/jfk.
"""

from musatpy.formats.recordset import RecordSet

FAMILY = RecordSet.of("jfk")
PATTERNS = FAMILY.patterns
load_one = FAMILY.load_one
dump_one = FAMILY.dump_one
left_out = FAMILY.left_out
