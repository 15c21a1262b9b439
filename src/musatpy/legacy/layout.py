"""Text -> lines without page headers and carriage control, and the titles of the standard reports among them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

_PAGE_HEADER = re.compile(r"\bPAGE\s+\d+\s*$")
_SKIPPED = {" ": 0, "0": 1, "-": 2, "1": 0, "+": 0}  # blank lines that a control character asks for

_TITLES = (
    ("station position", r"Camera\s+Station\s+Position\s+Analysis"),
    ("station attitude", r"Camera\s+Station\s+Attitude\s+Analysis"),
    ("ground point", r"Ground\s+Point\s+Analysis"),
    ("check point", r"Check\s+Point\s+Analysis"),
    ("plates", r"Plate\s+Residuals(?=\s*$|\s+(?:Standard|Modified))"),
    ("submerged", r"Comparison\s+of\s+Computed\b.*\bCoordinates"),
)
_TITLE = re.compile(r"^\W*(?:" + "|".join(f"(?P<t{n}>{p})" for n, (_, p) in enumerate(_TITLES)) + ")", re.I)
_NEAR = 6  # lines below a title that still belong to it


@dataclass(frozen=True)
class Line:
    """One line of print with its number in the file."""

    number: int
    text: str


@dataclass(frozen=True, kw_only=True)
class Section:
    """A standard report: its lines from the title to the next title."""

    kind: str
    line: int
    refracted: bool | None
    sexagesimal: bool
    lines: tuple[Line, ...]


def lines_of(text: str) -> list[Line]:
    """Return the lines of a listing; page headers are blank, form feeds gone, carriage control is carried out."""
    # Not splitlines(): it parts lines at characters that editors, and so their line numbers, do not.
    rows = text.replace("\f", "").replace("\r\n", "\n").split("\n")
    printed = [row for row in rows if row]
    controlled = bool(printed) and printed[0].startswith("1") and all(row[0] in _SKIPPED for row in printed)
    lines = []
    for number, row in enumerate(rows, start=1):
        if controlled and row:
            lines += [Line(number, "")] * _SKIPPED[row[0]]
            row = row[1:]
        lines.append(Line(number, "" if _PAGE_HEADER.search(row) else row.rstrip()))
    return lines


def sections(lines: Sequence[Line]) -> Iterator[Section]:
    """Yield the standard reports in their order; a title without a report below it makes an empty section."""
    starts = [(at, match) for at, line in enumerate(lines) if (match := _TITLE.match(line.text))]
    for (at, match), (end, _) in pairwise([*starts, (len(lines), None)]):
        if match is None:
            return
        kind = next(kind for n, (kind, _) in enumerate(_TITLES) if match[f"t{n}"])
        title = " ".join(line.text for line in lines[at : min(at + _NEAR, end)])
        yield Section(
            kind=kind,
            line=lines[at].number,
            refracted=_refracted(title),
            sexagesimal="Degrees, Minutes" in title,
            lines=tuple(lines[at:end]),
        )


def _refracted(title: str) -> bool | None:
    if re.search(r"No\s+Refraction\s+Correction|\bStandard\b", title, re.I):
        return False
    return True if re.search(r"Refraction\s+Correction\s+Applied|\bModified\b", title, re.I) else None
