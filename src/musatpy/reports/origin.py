"""What of the record a column of the echo shows."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Origin:
    """A field of the record, and what is printed for what it says."""

    field: str
    true: str = ""  # what stands for true; nothing stands for false
    false: str = ""  # what stands for false; nothing stands for true
    blank: bool = False  # may be left blank whatever the value is
