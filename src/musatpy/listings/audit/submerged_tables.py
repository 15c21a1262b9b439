"""Computed coordinates of submerged points: three rows X, Y, Z for each, its number in the row of Y."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from musatpy.listings.audit.cells import Kind, Reading, printed, read_cells, words_of
from musatpy.listings.audit.notes import Notes
from musatpy.listings.audit.scan import Line, StandardReport
from musatpy.listings.audit.structures import Printed, RepairKind, SubmergedPoint, SubmergedTable

COLUMNS = ("none", "predicted", "refraction")
AXES = "XYZ"
_DIGITS = 3  # a row of coordinates has a number of at least as many digits before its point
_PLACES = 1  # decimals, m
# Possessive: what stands left of a word or a letter is tried at its full length only, as no other can match.
_AXIS = re.compile(r"^\W*+(?:\S*\w\W++)?[XYZ]\s+(?=-?\s?\S*\d)")
_FIRST = re.compile(rf"(?:-|(?<!\d))\d{{{_DIGITS},}}+\s?[.\u2022\u00b7-]\d")  # of the numbers of a row
_RULING = re.compile(r".|[\W_]+")  # what an edge of the table is read as
_END = re.compile(r"^\W*+Point (?:not|is)\b", re.I)


_MISSING = "the row of {} of a point is missing here"


@dataclass(frozen=True)
class Labelled:
    """One row: the words left of its coordinates, and these."""

    line: Line
    words: list[str]
    reading: Reading | None

    @property
    def axis(self) -> str:
        """X, Y or Z, or nothing where the letter is not legible."""
        last = self.words[-1].strip("[]|").upper() if self.words else ""
        return last if last in ("X", "Y", "Z") else ""


def read_submerged(reports: list[StandardReport], notes: Notes) -> list[SubmergedTable]:
    """Return the tables; pages that follow one another without a point twice are of one."""
    tables: list[tuple[int, list[SubmergedPoint]]] = []
    names: set[str] = set()  # in the last of them
    for report in (report for report in reports if report.kind == "submerged"):
        table = _read(report, notes)
        if table is None:
            continue
        points = {point.name for point in table.points}
        if tables and names.isdisjoint(points):
            tables[-1][1].extend(table.points)
            names |= points
        else:
            tables.append((table.line, list(table.points)))
            names = points
    return [SubmergedTable(line=line, points=tuple(points)) for line, points in tables]


def _read(report: StandardReport, notes: Notes) -> SubmergedTable | None:
    """Return the table; None where no coordinates are below the title."""
    rows = list(_rows(report))
    notes.titled.update(line.number for line, *_ in rows)
    columns: tuple[str, ...] = COLUMNS
    if rows and all(_count(rest) == 2 for *_, rest in rows):
        columns = COLUMNS[:2]  # a run without refraction
    points: list[SubmergedPoint] = []
    width = _usual_width(rows)
    group: list[Labelled] = []
    broken = False  # said so already of a row before, of the same point
    for line, label, rest in rows:
        reading = notes.cells(line, rest, ["number"] * len(columns), "coordinates", places=[_PLACES] * len(columns))
        row = Labelled(line, label.replace("*", " * ").split(), reading)
        if row.axis and row.axis != AXES[len(group)]:
            if not broken:
                notes.lost(line, _MISSING.format(AXES[len(group)]))
            group, broken = [], True
            if row.axis != "X":
                continue
        broken = False
        group.append(row)
        if len(group) == 3:
            points += _point(group, columns, width, notes)
            group = []
    if group:
        notes.lost(group[-1].line, _MISSING.format(AXES[len(group)]))
    return SubmergedTable(line=report.line, points=tuple(points)) if points else None


def _rows(report: StandardReport) -> Iterator[tuple[Line, str, str]]:
    """Yield line, label, and the text right of it."""
    for line in (line for line in report.lines if line.text):
        if _END.match(line.text):
            return
        first, axis = _FIRST.search(line.text), _AXIS.match(line.text)
        if first is None and not (axis and re.search(r"[.\u2022\u00b7]\d", line.text)):
            continue
        split = axis.end() if axis else first.start() if first else 0
        yield line, line.text[:split], line.text[split:]


def _count(rest: str) -> int:
    """Return how many coordinates a row has, 0 where they are not legible."""
    for count in (3, 2):
        kinds: list[Kind] = ["number"] * count
        if read_cells(words_of(rest), kinds, None, [_PLACES] * count) is not None:
            return count
    return 0


def _usual_width(rows: Sequence[tuple[Line, str, str]]) -> int | None:
    """Return how long most ids are that stand alone left of their Y."""
    labels = (label.replace("*", " ").split() for _, label, _ in rows)
    widths = Counter(len(words[0]) for words in labels if len(words) == 2 and words[1] == AXES[1])
    return widths.most_common(1)[0][0] if widths else None


def _point(
    group: list[Labelled], columns: tuple[str, ...], width: int | None, notes: Notes
) -> Iterator[SubmergedPoint]:
    """Yield the point of three rows, where its number can be read."""
    xyz: dict[tuple[str, str], Printed] = {}
    for axis, row in zip(AXES, group, strict=True):
        for column, text in zip(columns, row.reading.texts if row.reading else (), strict=False):
            xyz[column, axis] = printed(text, row.line.number)
    named = group[1]
    words = [word for word in named.words[:-1] if word != "*"]
    name = notes.id_of(words, width)
    if name is None:
        notes.lost(named.line, f"a point with no legible number: '{' '.join(words)}'")
        return
    notes.repairs.extend(name.repairs(named.line.number))
    for axis, row in zip(AXES, group, strict=True):
        _note_repairs(axis, row, [] if row is named else row.words[:-1], notes)
    yield SubmergedPoint(name=name.texts[0], mark="*" * named.words.count("*"), xyz=xyz)


def _note_repairs(axis: str, row: Labelled, others: Sequence[str], notes: Notes) -> None:
    """Note what is left out beside the letter of a row, and where its place tells its axis."""
    for word in others:
        if re.fullmatch(_RULING, word):
            notes.repair(row.line.number, RepairKind.BORDER, word)
        else:
            notes.lost(row.line, f"'{word}' beside the {axis} of a point")
    last = row.words[-1] if row.words else ""
    left = re.sub(row.axis, "", last, count=1, flags=re.I) if last != axis else ""
    if row.axis and left:
        notes.repair(row.line.number, RepairKind.BORDER, left)
    if not row.axis:
        notes.repair(row.line.number, RepairKind.LABEL, last, axis)
