"""Tables of a listing as CSV: one file for each, at full precision, with the units of the record in their heads."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from musatpy.reports.pages import Cells, Section

_FORMULA = re.compile(r"\s*[=+\-@]")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def csv_files(sections: Iterable[Section], listing: Path) -> dict[Path, bytes]:
    """Return the files in a folder beside a `listing`: tables by their titles, `Air Bases` in `air_bases.csv`."""
    folder = listing.with_name(f"{listing.stem}_tables")
    tables = ((section.title, section.values) for section in sections if section.values is not None)
    return {folder / f"{_name(title)}.csv": _text(values()).encode() for title, values in tables}


def _name(title: str) -> str:
    text = re.sub(r": \d+$", "", title.split("\n")[0])  # how many rows there are
    return "_".join(re.findall(r"[a-z0-9.]+", text.lower()))


def _text(rows: Cells) -> str:
    """Return the rows of a table below its heads; a second head of a name is numbered."""
    file = io.StringIO()
    heads, *values = rows
    counts = [heads[:number].count(head) + 1 for number, head in enumerate(heads)]
    names = [f"{head} {count}" if count > 1 else head for head, count in zip(heads, counts, strict=True)]
    csv.writer(file, lineterminator="\n").writerows([names, *([_cell(value) for value in row] for row in values)])
    return file.getvalue()


def _cell(value: Any) -> Any:
    """Return what stands in a cell: nothing for a number that does not exist, and a text that stays one."""
    if isinstance(value, str):
        return as_text(value)
    return "" if value is None or (isinstance(value, float) and not math.isfinite(value)) else value


def as_text(text: str) -> str:
    """Return a text as spreadsheets take it for one: a blank stands before what they would compute.

    No id begins with a blank, and who strips them, as every reader of this program does, has the text again.
    """
    return f" {text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text
