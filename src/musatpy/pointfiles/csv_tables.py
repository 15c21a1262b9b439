"""Comma-separated values under a line of names: what all files of points and stations have in common."""

from __future__ import annotations

import csv
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from musatpy.errors import Problem, ProblemsError

csv.field_size_limit(2**31 - 1)  # what is no number is told with its line, and not as an error of the package
FAR = 1e15  # m, and whatever else files of points and stations hold
ENCODING = {"encoding": "utf-8", "errors": "surrogateescape"}  # whatever the texts are, they come out as they were
_WORDS = {
    "latitude": "lat",
    "longitude": "lon",
    "long": "lon",
    "easting": "x",
    "east": "x",
    "northing": "y",
    "north": "y",
    "z": "height",
    "elevation": "height",
    "id": "name",
}
_OTHERS = {";": "semicolons", "\t": "tabs", "|": "bars"}


def common_name(name: str) -> str:
    """Return the name of a column by which all its names are known: `lat` for `Latitude`."""
    lower = name.strip().lower()
    return _WORDS.get(lower, lower)


def names_of(line: str) -> list[str]:
    """Return the names in the first line of a file."""
    return [name.strip() for name in next(csv.reader([line.removeprefix("\ufeff").rstrip("\r\n")]), [])]


def separator_faults(names: Sequence[str]) -> list[str]:
    """Return what is wrong where a line of names, read by commas, is one of another separator."""
    separators = [what for sign, what in _OTHERS.items() if any(sign in name for name in names)]
    return [f"values are parted by {separators[0]}: commas are needed, and points in numbers"] if separators else []


def column_faults(names: Sequence[str], wanted: Sequence[str], added: Collection[str]) -> list[str]:
    """Return what is wrong with the names of a file of which some are wanted, in any case, and others are added."""
    if separators := separator_faults(names):
        return separators
    lower = [name.lower() for name in names]
    faults = [
        f"{'no' if name.lower() not in lower else 'more than one'} column {name} among {', '.join(names)}"
        for name in wanted
        if lower.count(name.lower()) != 1
    ]
    return faults + [f"there is a column {name} already" for name in names if name.lower() in added]


def number(text: str) -> float:
    """Return the number that a text is, infinite or not; NaN where it is none.

    Python takes 1_000 for a number, and digits of any script: here only what other programs read is one. What is
    farther than `FAR` is as good as infinite, and what is smaller than its inverse is zero: their squares and
    products would be, in the middle of a computation.
    """
    try:
        value = float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        return math.nan
    if abs(value) > FAR:
        return math.copysign(math.inf, value)
    return 0.0 if abs(value) < 1.0 / FAR else value


@dataclass(frozen=True, kw_only=True)
class Layout:
    """The names of the columns of a file of points, as given, and where its coordinates stand among them."""

    source: str
    header: str
    names: tuple[str, ...]
    places: tuple[int, ...]

    @classmethod
    def of(
        cls, source: Path, first: str, columns: Sequence[str], added: Collection[str], error: type[ProblemsError]
    ) -> Layout:
        """Return the layout that the first line says; raises `error` where columns are missing or there already."""
        header = first.removeprefix("\ufeff").rstrip("\r\n")
        names = tuple(names_of(header))
        if faults := column_faults(names, columns, added):
            raise error([Problem(file=str(source), line=1, message=message) for message in faults])
        lower = [name.lower() for name in names]
        places = tuple(lower.index(name.lower()) for name in columns)
        return cls(source=str(source), header=header, names=names, places=places)

    def header_with(self, added: Sequence[str]) -> bytes:
        """Return the first line of the file with columns added."""
        return f"{self.header},{','.join(added)}\n".encode(**ENCODING)
