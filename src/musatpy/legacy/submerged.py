"""Computed coordinates of submerged points: three rows X, Y, Z for each, its number in the row of Y."""

from __future__ import annotations

import re
from collections.abc import Iterator

from musatpy.errors import Problem
from musatpy.legacy.layout import Line, Section
from musatpy.legacy.notes import Notes
from musatpy.legacy.structures import Printed, Repair, RepairKind, SubmergedPoint, SubmergedTable
from musatpy.legacy.words import Kind, Reading, printed, read_cells, words_of

COLUMNS = ("none", "predicted", "refraction")
AXES = "XYZ"
_ID = re.compile(r"[A-Za-z0-9][\w./+-]*")
_DIGITS = 3  # a row of coordinates has a number of at least as many digits before its point
_END = re.compile(r"^\W*\*?\*?\s*Point (?:not|is)\b", re.I)


def read_submerged(section: Section, notes: Notes) -> SubmergedTable | None:
    """Return the table; None where no coordinates are below the title."""
    rows = list(_rows(section))
    columns: tuple[str, ...] = COLUMNS
    if rows and all(count == 2 for *_, count in rows):
        columns = COLUMNS[:2]  # a run without refraction
    points: list[SubmergedPoint] = []
    group: list[tuple[Line, str, Reading | None]] = []
    for line, label, rest, _ in rows:
        reading = notes.cells(line, rest, ["number"] * len(columns), "coordinates")
        group.append((line, label, reading))
        if len(group) == 3:
            points += _point(group, columns, notes)
            group = []
    if group:
        message = f"{len(group)} rows of coordinates are left over: a row of X, Y or Z is missing above"
        notes.unreadable.append(Problem(file=notes.file, line=group[0][0].number, message=message))
    return SubmergedTable(line=section.line, points=tuple(points)) if points else None


def _rows(section: Section) -> Iterator[tuple[Line, str, str, int]]:
    """Yield line, label, the text right of it, and the number of coordinates."""
    for line in section.lines:
        if _END.match(line.text):
            return
        first = re.search(rf"-?\d{{{_DIGITS},}}\s?[.\u2022\u00b7-]\d", line.text)
        if first is None and not re.match(r"^\s*(\S+\s+)?\**\s*[XYZ]\s+-?\d*\.\d", line.text):
            continue
        split = first.start() if first else _after_axis(line.text)
        label, rest = line.text[:split], line.text[split:]
        for count in (3, 2):
            kinds: list[Kind] = ["number"] * count
            if read_cells(words_of(rest), kinds) is not None:
                yield line, label, rest, count
                break
        else:
            yield line, label, rest, 3


def _after_axis(text: str) -> int:
    match = re.match(r"^\s*(\S+\s+)?\**\s*[XYZ]\s+", text)
    return match.end() if match else 0


def _point(
    group: list[tuple[Line, str, Reading | None]], columns: tuple[str, ...], notes: Notes
) -> Iterator[SubmergedPoint]:
    """Yield the point of three rows, where its number can be read."""
    xyz: dict[tuple[str, str], Printed] = {}
    for axis, (line, label, reading) in zip(AXES, group, strict=True):
        _check_axis(axis, line, label, notes)
        for column, text in zip(columns, reading.texts if reading else (), strict=False):
            xyz[column, axis] = printed(text, line.number)
    line, label, _ = group[1]
    words = label.replace("*", " * ").split()
    name = next((word for word in words if _ID.fullmatch(word) and word.upper() != "Y"), "")
    if not name:
        notes.unreadable.append(
            Problem(file=notes.file, line=line.number, message="a point without a legible number", text=line.text)
        )
        return
    yield SubmergedPoint(name=name, mark="*" * words.count("*"), xyz=xyz)


def _check_axis(axis: str, line: Line, label: str, notes: Notes) -> None:
    """Note where the letter of an axis is not legible; its place tells it."""
    words = label.split()
    found = words[-1].strip("[]|") if words else ""
    if found.upper() != axis:
        notes.repairs.append(Repair(line=line.number, kind=RepairKind.LABEL, found=found, read=axis))
