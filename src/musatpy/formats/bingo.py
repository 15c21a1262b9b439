"""BINGO: image.dat, geoin.dat and itera.dat.

The layouts, their sources and what no public source settles stand in card_formats/bingo.
"""

from musatpy.formats.recordset import RecordSet

FAMILY = RecordSet.of("bingo")
PATTERNS = FAMILY.patterns
load_one = FAMILY.load_one
dump_one = FAMILY.dump_one
left_out = FAMILY.left_out
