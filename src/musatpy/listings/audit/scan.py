"""Text -> lines without page headers and carriage control, and the titles of the standard reports among them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count, pairwise
from typing import NamedTuple

from musatpy.listings.audit.spelling import (
    any_of,
    canonical_rows,
    noisy_pattern,
    pattern,
    required,
    respelt,
)
from musatpy.listings.audit.structures import Repair
from musatpy.listings.lines import SKIPPED

PAGE_HEADER = re.compile(r"\bPAGE\s+(?P<page>[\dlI|!Oo]+)\s*$")

_TITLES = (
    ("station position", "Camera Station Position Analysis", ""),
    ("station attitude", "Camera Station Attitude Analysis", ""),
    ("ground point", "Ground Point Analysis", ""),
    ("check point", "Check Point Analysis", ""),
    ("plates", "Plate Residuals", r"(?=\W*$|\s+(?:Standard|Modified))"),
    ("submerged", "Comparison of Computed", r"(?=.*[CG]\W?[oO0]\W?[oO0]\W?rd)"),
)
_REQUIRED = {title: required(title) for _, title, _ in _TITLES}
_HAS_TITLE = any_of(_REQUIRED.values())
_RUNS = ((False, ("No Refraction Correction", "Standard")), (True, ("Refraction Correction Applied", "Modified")))
WIDEST = 10_000  # characters of a row: no paper is so wide, nor a paragraph that a scan has as a row
_NEAR = 6  # lines below a title that still belong to it


class Line(NamedTuple):
    """One line of print with its number in the file."""

    number: int
    text: str
    canonical: str = ""  # see `spelling.canonical_rows`: nothing where the line is neither title nor label


@dataclass(frozen=True, kw_only=True)
class StandardReport:
    """A standard report: its lines from the title to the next title."""

    kind: str
    line: int
    refracted: bool | None
    sexagesimal: bool
    lines: tuple[Line, ...]


def lines_of(rows: Sequence[str]) -> list[Line]:
    """Return the rows as lines: page headers are blank, form feeds gone, carriage control is carried out.

    What is wider than `WIDEST` is blank too: no row of print.
    """
    rows = [row.replace("\f", "") if "\f" in row else row for row in rows]
    printed = [row for row in rows if row]
    controlled = bool(printed) and printed[0].startswith("1") and all(row[0] in SKIPPED for row in printed)
    skipped = [SKIPPED[row[0]] if row else 0 for row in rows] if controlled else []
    rows = [row[1:].rstrip() for row in rows] if controlled else [row.rstrip() for row in rows]
    rows = ["" if len(row) > WIDEST or ("PAGE" in row and PAGE_HEADER.search(row)) else row for row in rows]
    lines = list(map(Line, count(1), rows, canonical_rows(rows)))
    if not controlled:
        return lines
    spaced = ([*[Line(line.number, "")] * n, line] for line, n in zip(lines, skipped, strict=True))
    return list(chain.from_iterable(spaced))


def standard_reports(lines: Sequence[Line], repairs: list[Repair]) -> Iterator[StandardReport]:
    """Yield the standard reports in their order; a title without a report below it makes an empty section.

    Repairs of titles are added to `repairs`.
    """
    likely = [(at, line) for at, line in enumerate(lines) if line.canonical and _HAS_TITLE(line.canonical)]
    starts = [(at, kind) for at, line in likely if (kind := _kind(line, repairs))]
    for (at, kind), (end, _) in pairwise([*starts, (len(lines), "")]):
        title = lines[at : min(at + _NEAR, end)]
        yield StandardReport(
            kind=kind,
            line=lines[at].number,
            refracted=next((run for run, phrases in _RUNS if _says(title, phrases, repairs)), None),
            sexagesimal=_says(title, ("Degrees Minutes",), repairs),
            lines=tuple(lines[at:end]),
        )


def _kind(line: Line, repairs: list[Repair]) -> str:
    """Return which report a line is the title of, nothing where it is none."""
    for kind, title, after in _TITLES:
        if _REQUIRED[title] not in line.canonical:
            continue
        if re.match(rf"\W*{pattern(title)}\b{after}", line.text, re.I):
            return kind
        noisy = re.match(rf"\W*(?P<title>{noisy_pattern(title)}){after}", line.text, re.I)
        if noisy:
            repairs.extend(respelt(line.number, noisy["title"], title))
            return kind
    return ""


def _says(title: Sequence[Line], phrases: Sequence[str], repairs: list[Repair]) -> bool:
    """Tell whether one of the lines has one of the phrases, none of them under noise where one has it plainly."""
    if any(re.search(rf"\b{pattern(phrase)}\b", line.text, re.I) for phrase in phrases for line in title):
        return True
    for phrase in phrases:
        for line in title:
            noisy = re.search(rf"\b{noisy_pattern(phrase)}\b", line.text, re.I)
            if noisy:
                repairs.extend(respelt(line.number, noisy[0], phrase))
                return True
    return False
