"""Files of records without mnemonic, as other agencies write them: their layout stands in TOML files only."""

from musatpy.formats.records.fields import RecordField
from musatpy.formats.records.spec import FileSpec, RecordSpec, is_record_folder, load_files

__all__ = ["FileSpec", "RecordField", "RecordSpec", "is_record_folder", "load_files"]
