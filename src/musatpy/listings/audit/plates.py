"""Plate residuals per frame, frames across: rows of RMS, and rows of stars that mean the frame above them.

Of a frame with RMS t of its triangulated points, n of the others and a of all, a^2 = (1 - w) t^2 + w n^2, where w
is the share of the others: within 0 and 1, and the same in x and in y.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from musatpy.listings.audit.analyses import run_name
from musatpy.listings.audit.cells import Misprint, Printed, RepairKind, Suspect, printed
from musatpy.listings.audit.samples import Interval
from musatpy.listings.audit.scan import Line, Notes, StandardReport, canonical, found, rows_of

_POINTS = {
    "trig": ("Trig Points", "Trig Pts"),
    "nontrig": ("Points Not Trig", "Pts Not Trig", "Non Trig Points", "Non Trig Pts"),
    "all": ("All Points", "All Pts"),
}
GROUPS = tuple(_POINTS)
AXES = ("x", "y")
# Labels of the rows by group and axis.
RMS_LABELS = {
    (group, axis): "|".join(f"RMS of {name} {axis}" for name in names)
    for group, names in _POINTS.items()
    for axis in AXES
}
_STAR_LABELS = {
    (group, "star"): "|".join(f"Frame With Max RMS {name}" for name in names) for group, names in _POINTS.items()
}
_NAMES = {"trig": "RMS of triangulated", "nontrig": "RMS of not triangulated", "all": "RMS of all"}
_PLACES = 3  # decimals, mm
_STAR = "****"  # exactly four: longer runs are rulings
_PUNCTUATION = ",;:.'\"`_-"
_REACH = 4  # columns of print that a star may stand beside its frame: half a column of the table
_SLACK = 1e-9  # mm^2 relative: a number exactly between two prints may have gone either way


@dataclass(frozen=True, kw_only=True)
class PlateTable:
    """RMS plate residuals per frame, mm (ETL-0306, Tables 6-4 and 6-8)."""

    refracted: bool | None
    line: int
    frames: tuple[str, ...]
    rms: dict[tuple[str, str], dict[str, Printed]]  # (trig, nontrig or all; x or y) -> frame -> mm
    stars: dict[str, tuple[tuple[str, int], ...]]  # trig, nontrig, all -> starred frames, with their lines

    @property
    def name(self) -> str:
        """How messages call it."""
        return f"plate residuals{run_name(self.refracted)}"

    def along(self, group: str, frame: str) -> list[Printed | None]:
        """Return the RMS of a frame in x and y."""
        return [self.rms.get((group, axis), {}).get(frame) for axis in AXES]

    def joined(self, other: PlateTable) -> PlateTable:
        """Return this table and the other frames of the same run that follow it."""
        return PlateTable(
            refracted=self.refracted,
            line=self.line,
            frames=self.frames + other.frames,
            rms={key: row | other.rms.get(key, {}) for key, row in self.rms.items()},
            stars={key: stars + other.stars.get(key, ()) for key, stars in self.stars.items()},
        )


def read_plates(reports: Sequence[StandardReport], notes: Notes) -> Iterator[PlateTable]:
    """Yield the tables; those of the same run between which no other report stands are one, ten frames on each."""
    last: PlateTable | None = None
    for report in reports:
        table = _read(report, notes) if report.kind == "plates" else None
        if last and table and last.refracted == table.refracted and not set(last.frames) & set(table.frames):
            last = last.joined(table)
        elif table or report.kind != "plates":
            if last:
                yield last
            last = table
    if last:
        yield last


def _read(report: StandardReport, notes: Notes) -> PlateTable | None:
    """Return the table of a report; None where no row of one is below the title, or its frames are not legible."""
    rows = rows_of(report, RMS_LABELS | _STAR_LABELS, notes)
    heading = next((line for line in report.lines if _is_heading(line)), None)
    if not rows or heading is None:
        if rows:
            notes.lost(report.lines[0], "no row 'Frame' is legible below")
        return None
    rest = notes.after("Frame", heading) or ""
    counts = Counter(len(re.findall(r"\S*\w\S*", rows[key][1])) for key in RMS_LABELS if key in rows)
    number = counts.most_common(1)[0][0] if counts else len(rest.split())
    frames = notes.cells(heading, rest, ["id"] * number, "Frame")
    if not frames:
        return None
    rms, stars = {}, {}
    for (group, what), (line, text) in rows.items():
        if what in AXES:
            name = f"RMS, {group}, {what}"
            cells = notes.cells(line, text, ["number"] * len(frames), name, [_PLACES] * len(frames))
            if cells:
                rms[group, what] = dict(zip(frames, (printed(cell, line.number) for cell in cells), strict=True))
        elif (starred := _starred(line, text, heading, frames, notes)) is not None:
            stars[group] = starred
    return PlateTable(refracted=report.refracted, line=report.lines[0].number, frames=frames, rms=rms, stars=stars)


def _is_heading(line: Line) -> bool:
    """Tell whether a line has the frames; `Frame With Max. RMS` has stars."""
    match = found("Frame", line)
    return bool(match and re.search(r"\w", match["rest"]) and not canonical(match["rest"]).startswith("w1th"))


def _starred(
    line: Line, text: str, heading: Line, frames: tuple[str, ...], notes: Notes
) -> tuple[tuple[str, int], ...] | None:
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
            distance, frame = min((abs(where - place), frame) for frame, where in places)
            if distance <= (0 if grid else _REACH):
                stars.append((frame, line.number))
            else:
                notes.lost(line, "a star that stands below no frame")
        elif re.search(r"\w", word) or re.fullmatch(r"\*{1,3}", word):
            notes.lost(line, f"'{word}' in a row of stars")
            return None
        else:
            notes.repair(line, RepairKind.STRAY, word)
    return tuple(stars)


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
            text += canonical(word)
            if waiting and text.endswith(canonical(waiting[0])):
                yield waiting.pop(0), where
                text = ""


def check_plates(tables: Sequence[PlateTable]) -> Iterator[Misprint]:
    """Yield what contradicts in the plate tables of a listing."""
    for table in tables:
        for frame, count in Counter(table.frames).items():
            if count > 1:
                yield Misprint(table.line, table.name, f"frame {frame}", f"is there {count} times")
            yield from _negative(table, frame)
            yield from _frame(table, frame)
        for group, stars in table.stars.items():
            yield from _stars(table, group, stars)


def _negative(table: PlateTable, frame: str) -> Iterator[Misprint]:
    """Yield cells below zero."""
    for (group, axis), row in table.rms.items():
        cell = row.get(frame)
        if cell and cell.high < 0.0:
            suspect = Suspect.of(f"{_NAMES[group]}, {axis}", cell)
            yield Misprint(cell.line, table.name, f"frame {frame}", "an RMS is never negative", (suspect,))


def _frame(table: PlateTable, frame: str) -> Iterator[Misprint]:
    """Yield the contradiction between the RMS of all points of a frame and those of its two parts."""
    by_axis = zip(AXES, zip(*(table.along(group, frame) for group in GROUPS), strict=True), strict=True)
    cells = {axis: [cell for cell in trio if cell and cell.high >= 0.0] for axis, trio in by_axis}
    shares = {axis: _share(*trio) for axis, trio in cells.items() if len(trio) == len(GROUPS)}
    known = [share for share in shares.values() if share]
    lows, highs = [0.0, *(low for low, _ in known)], [1.0, *(high for _, high in known)]
    if len(known) == len(shares) and max(lows) <= min(highs):
        return
    doubtful = [axis for axis in shares if not shares[axis]] or list(shares)
    suspects = []
    for axis in doubtful:
        for group, cell in zip(GROUPS, cells[axis], strict=True):
            suspects.append(Suspect.of(f"{_NAMES[group]}, {axis}", cell))
    message = f"the RMS of all points, {' and '.join(doubtful)}, is no mean of the two parts"
    yield Misprint(suspects[0].line, table.name, f"frame {frame}", message, tuple(suspects))


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


def _stars(table: PlateTable, group: str, stars: tuple[tuple[str, int], ...]) -> Iterator[Misprint]:
    """Yield stars that are missing, too many, or not at the frame with the largest sqrt(x^2 + y^2)."""
    bounds = {}
    for frame in table.frames:
        x, y = table.along(group, frame)
        if x is None or y is None:
            return
        low, high = (math.hypot(max(x.low, 0.0), max(y.low, 0.0)), math.hypot(x.high, y.high))
        bounds[frame] = (low, high) if x.value or y.value else (0.0, high)
    largest = max(bounds, key=lambda frame: bounds[frame][0])
    message = ""
    if not stars and bounds[largest][0] > 0.0:
        message = f"no frame is starred, though {largest} has an RMS"
    elif len(stars) > 1:
        message = f"{len(stars)} frames are starred: {', '.join(frame for frame, _ in stars)}"
    elif stars and bounds[stars[0][0]][1] * (1.0 + _SLACK) < bounds[largest][0]:
        message = f"frame {stars[0][0]} is starred, the largest RMS is that of {largest}"
    if message:
        item = f"star of {_NAMES[group].removeprefix('RMS of ')} points"
        yield Misprint(stars[0][1] if stars else table.line, table.name, item, message)
