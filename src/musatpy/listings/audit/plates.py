"""Plate residuals per frame, frames across: rows of RMS. The stars below the largest ones are not read.

Of a frame with RMS t of its triangulated points, n of the others and a of all, a^2 = (1 - w) t^2 + w n^2, where w
is the share of the others: within 0 and 1, and the same in x and in y.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from itertools import product

from musatpy.listings.audit.analyses import Interval
from musatpy.listings.audit.report import Misprint, PrintedNumber, StandardReport, Suspect, printed
from musatpy.listings.audit.scan import Excerpt, Notes, found, rows_of
from musatpy.listings.lines import PrintedLine

_POINTS = {
    "trig": ("Trig Points", "Trig Pts"),
    "nontrig": ("Points Not Trig", "Pts Not Trig", "Non Trig Points", "Non Trig Pts"),
    "all": ("All Points", "All Pts"),
}
GROUPS = tuple(_POINTS)
AXES = ("x", "y")
NAME = "plate residuals"
# Labels of the rows by group and axis.
RMS_LABELS = {
    (group, axis): "|".join(f"RMS of {name} {axis}" for name in names)
    for group, names in _POINTS.items()
    for axis in AXES
}
_NAMES = {"trig": "RMS of triangulated", "nontrig": "RMS of not triangulated", "all": "RMS of all"}
_PLACES = 3  # decimals, mm
_SLACK = 1e-9  # mm^2 relative: a number exactly between two prints may have gone either way


def read_plates(excerpt: Excerpt, notes: Notes) -> StandardReport | None:
    """Return the RMS by frame, mm, ten frames on each page (ETL-0306, Tables 6-4 and 6-8).

    None where there is no table, or its frames or all its rows are not legible.
    """
    rows = rows_of(excerpt, RMS_LABELS, notes)
    heading = next((line for line in excerpt.lines if _is_heading(line)), None)
    if not rows or heading is None:
        if rows or heading:
            notes.lost(excerpt.lines[0], f"no row '{'Frame' if rows else 'RMS of Trig Points x'}' is legible below")
        return None
    counts = Counter(len(re.findall(r"\S*\w\S*", text)) for _, text in rows.values())
    number = counts.most_common(1)[0][0]
    frames = notes.cells(heading, notes.after("Frame", heading) or "", ["id"] * number, "Frame")
    if len(set(frames)) < len(frames):
        notes.lost(heading, "a frame is there twice")
        frames = ()
    cells: dict[tuple[str, str], PrintedNumber] = {}
    for (group, axis), (line, text) in rows.items() if frames else ():
        name = f"RMS, {group}, {axis}"
        texts = notes.cells(line, text, ["number"] * len(frames), name, [_PLACES] * len(frames))
        for frame, cell in zip(frames, texts, strict=False):
            cells[frame, f"{group}, {axis}"] = printed(cell, line.number, "mm")
    if not cells:
        return None
    return StandardReport(name=NAME, refracted=excerpt.refracted, line=excerpt.lines[0].number, cells=cells)


def _is_heading(line: PrintedLine) -> bool:
    """Tell whether a line has the frames; `Frame With Max. RMS` has stars."""
    match = found("Frame", line)
    return bool(match and re.search(r"\w", match["rest"]) and not match["rest"].strip().lower().startswith("with"))


def check_plates(table: StandardReport) -> Iterator[Misprint]:
    """Yield what contradicts in the plate residuals of a listing."""
    for frame in table.items:
        yield from _frame(table, frame)


def _frame(table: StandardReport, frame: str) -> Iterator[Misprint]:
    """Yield RMS below zero, and a contradiction between the RMS of all points of a frame and those of its parts."""
    cells: dict[str, list[PrintedNumber]] = {axis: [] for axis in AXES}
    for axis, group in product(AXES, GROUPS):
        cell = table.cells.get((frame, f"{group}, {axis}"))
        if cell and cell.high < 0.0:
            suspects = [Suspect(f"{_NAMES[group]}, {axis}", cell.line, cell.text)]
            message = "an RMS is never negative"
            yield Misprint(cell.line, table.title, f"frame {frame}", message, tuple(suspects))
        elif cell:
            cells[axis].append(cell)
    shares = {axis: _share(*trio) for axis, trio in cells.items() if len(trio) == len(GROUPS)}
    known = [share for share in shares.values() if share]
    lows, highs = [0.0, *(low for low, _ in known)], [1.0, *(high for _, high in known)]
    if len(known) == len(shares) and max(lows) <= min(highs):
        return
    doubtful = [axis for axis in shares if not shares[axis]] or list(shares)
    suspects = [
        Suspect(f"{_NAMES[group]}, {axis}", cell.line, cell.text)
        for axis in doubtful
        for group, cell in zip(GROUPS, cells[axis], strict=True)
    ]
    message = f"the RMS of all points, {' and '.join(doubtful)}, is no mean of the two parts"
    yield Misprint(suspects[0].line, table.title, f"frame {frame}", message, tuple(suspects))


def _share(t: PrintedNumber, n: PrintedNumber, a: PrintedNumber) -> Interval | None:
    """Return within what the share w of points not triangulated is; None where there is no such share."""
    low, high = 0.0, 1.0
    # (1 - w) t^2 + w n^2 <= a^2 for the smallest t and n, >= for the largest: each is linear in w.
    for sign, (t2, n2, a2) in (
        (1.0, (max(t.low, 0.0) ** 2, max(n.low, 0.0) ** 2, a.high**2 * (1.0 + _SLACK))),
        (-1.0, (t.high**2, n.high**2, max(a.low, 0.0) ** 2 * (1.0 - _SLACK))),
    ):
        slope, room = sign * (n2 - t2), sign * (a2 - t2)  # slope w <= room
        if slope > 0.0:
            high = min(high, room / slope)
        elif slope < 0.0:
            low = max(low, room / slope)
        elif room < 0.0:
            return None
    return (low, high) if low <= high else None
