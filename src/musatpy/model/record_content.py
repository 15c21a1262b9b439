"""What of a job is recorded."""

from __future__ import annotations

from enum import StrEnum


class RecordContent(StrEnum):
    """What of a job its JSON record has."""

    FULL = "full"
    TABLES = "tables"  # all but the tables of images
    NONE = "none"
