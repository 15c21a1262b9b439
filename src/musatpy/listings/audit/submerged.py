"""Computed coordinates of submerged points: three rows X, Y, Z for each, its number in the row of Y; checked."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import product
from statistics import median
from typing import NamedTuple

from musatpy.listings.audit.cells import RepairKind, read_cells
from musatpy.listings.audit.report import Misprint, PrintedNumber, StandardReport, Suspect, printed, text_like
from musatpy.listings.audit.scan import Excerpt, Notes
from musatpy.listings.lines import PrintedLine

Cells = Iterator[tuple[tuple[str, str], PrintedNumber]]
COLUMNS = ("none", "predicted", "refraction")
AXES = "XYZ"
NAME = "bathymetric points"
_DIGITS = 3  # a row of coordinates has a number of at least as many digits before its point
_PLACES = 1  # decimals, m
_MISSING = "the row of {} of a point is missing here"
# Possessive: what stands left of a word or a letter is tried at its full length only, as no other can match.
_AXIS = re.compile(r"^\W*+(?:\S*\w\W++)?[XYZ]\s+(?=-?\s?\S*\d)")
_FIRST = re.compile(rf"(?:-|(?<!\d))\d{{{_DIGITS},}}+\s?[.\u2022\u00b7-]\d")  # of the numbers of a row
_RULING = re.compile(r".|[\W_]+")  # what an edge of the table is read as
_END = re.compile(r"^\W*+Point (?:not|is)\b", re.I)
_FACTOR = 20.0  # on the median shift of the other points
_FLOOR = 20.0  # m: a job of mostly dry or shallow points; refraction shifts a point of 60 m depth by as much
_FEW = 3  # other points that make a median


class _Row(NamedTuple):
    """One row: its axis, nothing where that is not legible, the words left of its coordinates, and these."""

    line: PrintedLine
    axis: str
    words: list[str]
    cells: dict[str, PrintedNumber]


def read_submerged(excerpt: Excerpt, notes: Notes) -> StandardReport | None:
    """Return the coordinates, m (ETL-0306, Table 6-9); None where no point has all its rows."""
    cells = dict(_points(excerpt, notes))
    return StandardReport(name=NAME, refracted=None, line=excerpt.lines[0].number, cells=cells) if cells else None


def _points(excerpt: Excerpt, notes: Notes) -> Cells:
    """Yield the cells of the points of which the three rows are there."""
    rows = list(_rows(excerpt))
    is_without_refraction = bool(rows) and all(_count(text) == 2 for *_, text in rows)
    columns = COLUMNS[:2] if is_without_refraction else COLUMNS
    labels = (label.replace("*", " ").split() for _, label, _ in rows)
    widths = Counter(len(words[0]) for words in labels if len(words) == 2 and words[1] == "Y")
    width = widths.most_common(1)[0][0] if widths else None  # of most ids that stand alone left of their Y
    group: list[_Row] = []
    broken = False  # said so already of a row before, of the same point
    for line, label, text in rows:
        notes.used.add(line.number)
        texts = notes.cells(line, text, ["number"] * len(columns), "coordinates", [_PLACES] * len(columns))
        cells = {column: printed(cell, line.number, "m") for column, cell in zip(columns, texts, strict=False)}
        words = label.replace("*", " * ").split()
        axis = words[-1].strip("[]|").upper() if words else ""
        row = _Row(line, axis if axis in ("X", "Y", "Z") else "", words, cells)
        if row.axis and row.axis != AXES[len(group)]:
            if not broken:
                notes.lost(line, _MISSING.format(AXES[len(group)]))
            group, broken = [], True
            if row.axis != "X":
                continue
        broken = False
        group.append(row)
        if len(group) == len(AXES):
            yield from _point(group, width, notes)
            group = []
    if group:
        notes.lost(group[-1].line, _MISSING.format(AXES[len(group)]))


def _rows(excerpt: Excerpt) -> Iterator[tuple[PrintedLine, str, str]]:
    """Yield line, label, and the text right of it."""
    for line in excerpt.lines:
        if _END.match(line.text):
            return
        first, axis = _FIRST.search(line.text), _AXIS.match(line.text)
        if first is None and not (axis and re.search(r"[.\u2022\u00b7]\d", line.text)):
            continue
        split = axis.end() if axis else first.start() if first else 0
        yield line, line.text[:split], line.text[split:]


def _count(text: str) -> int:
    """Return how many coordinates a row has, 0 where they are not legible."""
    return next((n for n in (3, 2) if read_cells(text, ["number"] * n, [_PLACES] * n) is not None), 0)


def _point(group: list[_Row], width: int | None, notes: Notes) -> Cells:
    """Yield the cells of the point of three rows, where its number can be read."""
    named = group[1]
    words = [word for word in named.words[:-1] if word != "*"]
    name = notes.ids(" ".join(words), 1, width)
    if name is None:
        notes.lost(named.line, f"a point with no legible number: '{' '.join(words)}'")
        return
    notes.repairs.extend(name.repairs(named.line.number))
    for axis, row in zip(AXES, group, strict=True):
        _note_repairs(axis, row, [] if row is named else row.words[:-1], notes)
        for column, cell in row.cells.items():
            yield (name.texts[0], f"{axis}, {column}"), cell


def _note_repairs(axis: str, row: _Row, others: Sequence[str], notes: Notes) -> None:
    """Note what is left out beside the letter of a row, and where its place tells its axis."""
    for word in others:
        if _RULING.fullmatch(word):
            notes.repair(row.line, RepairKind.BORDER, word)
        else:
            notes.lost(row.line, f"'{word}' beside the {axis} of a point")
    last = row.words[-1] if row.words else ""
    if not row.axis:
        notes.repair(row.line, RepairKind.LABEL, last, axis)
    elif left := re.sub(axis, "", last, count=1, flags=re.I):
        notes.repair(row.line, RepairKind.BORDER, left)


def check_submerged(table: StandardReport) -> Iterator[Misprint]:
    """Yield coordinates that refraction cannot have put where they are.

    No column may leave the apparent position by much more than it does at the other points.
    """
    for column, axis in product(COLUMNS[1:], AXES):
        shifts = {point: _shift(table, point, column, axis) for point in table.items}
        known = {point: shift for point, shift in shifts.items() if shift is not None}
        if len(known) <= _FEW:
            continue
        # Of all but the largest: that of the others of each outlier, which is in the upper half.
        limit = max(_FLOOR, _FACTOR * median(sorted(map(abs, known.values()))[:-1]))
        for point, shift in known.items():
            if abs(shift) <= limit:
                continue
            cell, straight = table.cells[point, f"{axis}, {column}"], table.cells[point, f"{axis}, none"]
            near = straight.value + median(size for other, size in known.items() if other != point)
            suspects = [Suspect(f"{axis}, {column}", cell.line, cell.text, f"about {text_like(near, cell.text)}")]
            both = (_shift(table, point, name, axis) for name in COLUMNS[1:])
            if all(abs(one) > limit for one in both if one is not None):
                # As far away in both other columns: the first one may be wrong.
                suspects.append(Suspect(f"{axis}, no refraction", straight.line, straight.text))
            message = f"{axis}, {column}, is {abs(shift):.1f} m from where it seems to be: more than {limit:.0f} m"
            yield Misprint(cell.line, table.title, f"point {point}", message, tuple(suspects))


def _shift(table: StandardReport, point: str, column: str, axis: str) -> float | None:
    """Return how far a column is from the coordinate without refraction, m; None where one is not legible."""
    cell, straight = (table.cells.get((point, f"{axis}, {name}")) for name in (column, "none"))
    return cell.value - straight.value if cell and straight else None
