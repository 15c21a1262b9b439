"""Plate residuals per frame, frames across: rows of RMS, and rows of stars that mean the frame above them.

Of a frame with RMS t of its triangulated points, n of the others and a of all, a^2 = (1 - w) t^2 + w n^2, where w
is the share of the others: within 0 and 1, and the same in x and in y.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import product

from musatpy.listings.audit.analyses import Interval
from musatpy.listings.audit.cells import RepairKind
from musatpy.listings.audit.report import Misprint, Printed, Report, Suspect, pages_joined, printed, printed_id
from musatpy.listings.audit.scan import Excerpt, Line, Notes, found, rows_of

_POINTS = {
    "trig": ("Trig Points", "Trig Pts"),
    "nontrig": ("Points Not Trig", "Pts Not Trig", "Non Trig Points", "Non Trig Pts"),
    "all": ("All Points", "All Pts"),
}
GROUPS = tuple(_POINTS)
AXES = ("x", "y")
NAME, STAR = "plate residuals", "largest at"
# Labels of the rows by group and axis.
RMS_LABELS = {
    (group, axis): "|".join(f"RMS of {name} {axis}" for name in names)
    for group, names in _POINTS.items()
    for axis in AXES
}
_STAR_LABELS = {
    (group, STAR): "|".join(f"Frame With Max RMS {name}" for name in names) for group, names in _POINTS.items()
}
_NAMES = {"trig": "RMS of triangulated", "nontrig": "RMS of not triangulated", "all": "RMS of all"}
_PLACES = 3  # decimals, mm
_STAR = "****"  # exactly four: longer runs are rulings
_ALIKE = str.maketrans("lI|!oO", "111100")  # in ids
_PUNCTUATION = ",;:.'\"`_-"
_REACH = 4  # columns of print that a star may stand beside its frame: half a column of the table
_SLACK = 1e-9  # mm^2 relative: a number exactly between two prints may have gone either way


def read_plates(excerpts: Sequence[Excerpt], notes: Notes) -> list[Report]:
    """Return the tables of RMS by frame, mm, ten frames on each page (ETL-0306, Tables 6-4 and 6-8)."""
    return pages_joined(_read(excerpt, notes) if excerpt.kind == "plates" else None for excerpt in excerpts)


def _read(excerpt: Excerpt, notes: Notes) -> Report | None:
    """Return the table of an excerpt; None where no row of one is there, or its frames are not legible."""
    rows = rows_of(excerpt, RMS_LABELS | _STAR_LABELS, notes)
    heading = next((line for line in excerpt.lines if _is_heading(line)), None)
    if not rows or heading is None:
        if rows:
            notes.lost(excerpt.lines[0], "no row 'Frame' is legible below")
        return None
    rest = notes.after("Frame", heading) or ""
    counts = Counter(len(re.findall(r"\S*\w\S*", rows[key][1])) for key in RMS_LABELS if key in rows)
    number = counts.most_common(1)[0][0] if counts else len(rest.split())
    frames = notes.cells(heading, rest, ["id"] * number, "Frame")
    if len(set(frames)) < len(frames):
        notes.lost(heading, "a frame is there twice")
        frames = ()
    cells: dict[tuple[str, str], Printed] = {}
    for (group, what), (line, text) in rows.items() if frames else ():
        if what == STAR:
            starred = _starred(line, text, heading, frames, notes)
            if starred is not None:
                cells[group, STAR] = printed_id(", ".join(starred), line.number)
        else:
            name = f"RMS, {group}, {what}"
            texts = notes.cells(line, text, ["number"] * len(frames), name, [_PLACES] * len(frames))
            for frame, cell in zip(frames, texts, strict=False):
                cells[frame, f"{group}, {what}"] = printed(cell, line.number, "mm")
    if not cells:
        return None
    return Report(name=NAME, refracted=excerpt.refracted, line=excerpt.lines[0].number, cells=cells)


def _is_heading(line: Line) -> bool:
    """Tell whether a line has the frames; `Frame With Max. RMS` has stars."""
    match = found("Frame", line)
    return bool(match and re.search(r"\w", match["rest"]) and not match["rest"].strip().lower().startswith("with"))


def _starred(line: Line, text: str, heading: Line, frames: tuple[str, ...], notes: Notes) -> list[str] | None:
    """Return the starred frames of a row; None where a word in it is no star."""
    cells = heading.text.split("\t")
    # Tabs part the cells of a table; otherwise they stand for the blanks up to columns of eight.
    grid = len(cells) > 1 and not any(cell.startswith(" ") or "  " in cell.strip() for cell in cells)
    places = list(_frame_places(heading, frames, grid))
    stars = []
    for place, word in _placed(line, grid, len(line.text) - len(text)):
        if word.strip(_PUNCTUATION) == _STAR:
            if word != _STAR:
                notes.repair(line, RepairKind.STRAY, word, _STAR)
            near = [(abs(where - place), frame) for frame, where in places]
            distance, frame = min(near, default=(math.inf, ""))
            if distance <= (0 if grid else _REACH):
                stars.append(frame)
            else:
                notes.lost(line, "a star that stands below no frame")
        elif re.search(r"\w", word) or re.fullmatch(r"\*{1,3}", word):
            notes.lost(line, f"'{word}' in a row of stars")
            return None
        else:
            notes.repair(line, RepairKind.STRAY, word)
    return stars


def _placed(line: Line, grid: bool, start: int = 0) -> Iterator[tuple[int, str]]:
    """Yield the words from a character on with their places: cell of a grid, last column of a printed text."""
    for match in re.finditer(r"[^\t]+" if grid else r"\S+", line.text[start:]):
        before = line.text[: start + match.end()]
        if word := match[0].strip():
            yield (before.count("\t") if grid else len(before.expandtabs())), word


def _frame_places(heading: Line, frames: tuple[str, ...], grid: bool) -> Iterator[tuple[str, int]]:
    """Yield where the ids of the frames stand, in their order, however they are broken or misspelt."""
    waiting, text = list(frames), ""
    for where, words in _placed(heading, grid):
        for word in words.split():
            text += re.sub(r"\W", "", word.translate(_ALIKE))
            if waiting and text.endswith(re.sub(r"\W", "", waiting[0].translate(_ALIKE))):
                yield waiting.pop(0), where
                text = ""


def check_plates(tables: Sequence[Report]) -> Iterator[Misprint]:
    """Yield what contradicts in the plate tables of a listing."""
    for table in tables:
        for frame in _frames(table):
            yield from _frame(table, frame)
        for group in GROUPS:
            if (group, STAR) in table.cells:
                yield from _stars(table, group, table.cells[group, STAR])


def _frames(table: Report) -> list[str]:
    return [item for item in table.items if item not in GROUPS]


def _frame(table: Report, frame: str) -> Iterator[Misprint]:
    """Yield RMS below zero, and a contradiction between the RMS of all points of a frame and those of its parts."""
    cells: dict[str, list[Printed]] = {axis: [] for axis in AXES}
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


def _share(t: Printed, n: Printed, a: Printed) -> Interval | None:
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


def _stars(table: Report, group: str, star: Printed) -> Iterator[Misprint]:
    """Yield stars that are missing, too many, or not at the frame with the largest sqrt(x^2 + y^2)."""
    bounds = {}
    for frame in _frames(table):
        cells = [table.cells.get((frame, f"{group}, {axis}")) for axis in AXES]
        legible = [cell for cell in cells if cell]
        if len(legible) < len(AXES):
            return
        low = math.hypot(*(max(cell.low, 0.0) for cell in legible)) if any(cell.value for cell in legible) else 0.0
        bounds[frame] = low, math.hypot(*(cell.high for cell in legible))
    if not bounds:
        return
    largest = max(bounds, key=lambda frame: bounds[frame][0])
    stars, message = star.text.split(", ") if star.text else [], ""
    if not stars and bounds[largest][0] > 0.0:
        message = f"no frame is starred, though {largest} has an RMS"
    elif len(stars) > 1:
        message = f"{len(stars)} frames are starred: {star.text}"
    elif stars and bounds[star.text][1] * (1.0 + _SLACK) < bounds[largest][0]:
        message = f"frame {star.text} is starred, the largest RMS is that of {largest}"
    if message:
        item = f"star of {_NAMES[group].removeprefix('RMS of ')} points"
        yield Misprint(star.line, table.title, item, message)
