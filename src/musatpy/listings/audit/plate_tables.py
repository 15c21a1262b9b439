"""Plate residuals per frame, frames across: RMS rows, and rows of stars that mean something by where they stand."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

from musatpy.listings.audit.cells import printed, words_of
from musatpy.listings.audit.notes import Notes, labelled
from musatpy.listings.audit.scan import Line, StandardReport
from musatpy.listings.audit.spelling import any_of, canonical, required
from musatpy.listings.audit.structures import PlateTable, Printed, RepairKind

_POINTS = "(?:Points|Pts)"
GROUPS = {
    "trig": f"Trig {_POINTS}",
    "nontrig": f"(?:{_POINTS} Not Trig|Non Trig {_POINTS})",
    "all": f"All {_POINTS}",
}
AXES = ("x", "y")
# Labels of the rows of RMS by group and axis.
RMS_LABELS = {(group, axis): f"RMS of {points} {axis}" for group, points in GROUPS.items() for axis in AXES}
_STAR_LABELS = {group: f"Frame With Max RMS {points}" for group, points in GROUPS.items()}
_FRAME, _WITH = "Frame", canonical("With")
_HAS_LABEL = any_of(required(label) for label in (*RMS_LABELS.values(), *_STAR_LABELS.values(), _FRAME))
_PLACES = 3  # decimals, mm
_STAR = "****"  # exactly four: longer runs are rulings
_TORN_STAR = re.compile(r"\*{1,3}")
_PUNCTUATION = ",;:.'\"`_-"


def read_plates(reports: list[StandardReport], notes: Notes) -> list[PlateTable]:
    """Return the tables; those of the same run that follow one another are one, ten frames on each."""
    tables: list[PlateTable] = []
    last: PlateTable | None = None  # where no other report stands between
    for report in reports:
        if report.kind != "plates":
            last = None
            continue
        table = _read(_with_labels(report), notes)
        if table is None:
            continue
        if last and last.refracted == table.refracted and not set(last.frames) & set(table.frames):
            tables[-1] = _together(last, table)
        else:
            tables.append(table)
        last = tables[-1]
    return tables


def _together(first: PlateTable, second: PlateTable) -> PlateTable:
    return PlateTable(
        refracted=first.refracted,
        line=first.line,
        frames=first.frames + second.frames,
        rms={key: row | second.rms.get(key, {}) for key, row in first.rms.items()},
        stars={key: stars + second.stars.get(key, ()) for key, stars in first.stars.items()},
    )


def _with_labels(report: StandardReport) -> StandardReport:
    """Return a report without the lines that none of its labels can stand on: there are many up to the next one."""
    lines = (line for line in report.lines if line.canonical and _HAS_LABEL(line.canonical))
    return replace(report, lines=tuple(lines))


def _read(report: StandardReport, notes: Notes) -> PlateTable | None:
    """Return the table of a report; None where no row of one is below the title, or its frames are not legible."""
    heading = next((line for line in report.lines if _is_heading(line)), None)
    rest = notes.after(_FRAME, heading) if heading else None
    if heading is None and _count(report):
        notes.missing(report.line, _FRAME)
    labels = RMS_LABELS.values()
    notes.titled.update(line.number for line in report.lines if any(labelled(label, line)[0] for label in labels))
    if heading is None or rest is None:
        return None
    reading = notes.cells(heading, rest, ["id"] * (_count(report) or len(_ids(rest))), _FRAME)
    if reading is None:
        return None
    frames = reading.texts
    rms = dict(_rms(report, frames, notes))
    starred = {group: _starred(report, group, heading, frames, notes) for group in GROUPS}
    stars = {group: places for group, places in starred.items() if places is not None}
    return PlateTable(refracted=report.refracted, line=report.line, frames=frames, rms=rms, stars=stars)


def _is_heading(line: Line) -> bool:
    """Tell whether a line has the frames; `Frame With Max. RMS` has stars."""
    match, _ = labelled(_FRAME, line)
    return bool(match and re.search(r"\w", match["rest"]) and not canonical(match["rest"]).startswith(_WITH))


def _ids(rest: str) -> list[str]:
    return [word for word in words_of(rest) if re.search(r"\w", word)]


def _count(report: StandardReport) -> int:
    """Return how many frames the rows of RMS have, by most of them; 0 where none is legible."""
    rests = (labelled(label, line)[0] for line in report.lines for label in RMS_LABELS.values())
    counts = Counter(len(_ids(match["rest"])) for match in rests if match)
    return counts.most_common(1)[0][0] if counts else 0


def _rms(
    report: StandardReport, frames: tuple[str, ...], notes: Notes
) -> Iterator[tuple[tuple[str, str], dict[str, Printed]]]:
    for (group, axis), label in RMS_LABELS.items():
        row, what = _row(report, label, notes), f"RMS, {group}, {axis}"
        if row is None:
            notes.missing(report.line, what)
            continue
        reading = notes.cells(*row, ["number"] * len(frames), what, places=[_PLACES] * len(frames))
        if reading is not None:
            cells = (printed(text, row[0].number) for text in reading.texts)
            yield (group, axis), dict(zip(frames, cells, strict=True))


def _row(report: StandardReport, label: str, notes: Notes) -> tuple[Line, str] | None:
    """Return the first row of a label, and what stands right of it."""
    rows = ((line, notes.after(label, line)) for line in report.lines)
    return next(((line, rest) for line, rest in rows if rest is not None), None)


def _starred(
    report: StandardReport, group: str, heading: Line, frames: tuple[str, ...], notes: Notes
) -> tuple[tuple[str, int], ...] | None:
    """Return the starred frames of one kind, None without such a row, or with one that is not legible."""
    row = _row(report, _STAR_LABELS[group], notes)
    if row is None:
        notes.missing(report.line, f"Frame With Max. RMS, {group}")
        return None
    line, rest = row
    grid = _is_grid(heading)
    places = list(_frame_places(heading, frames, grid))
    stars = []
    for place, word in _placed(line, grid, len(line.text) - len(rest)):
        if _is_star(line, word, notes):
            stars.append((_frame_at(place, line, places, grid, notes), line.number))
        elif re.search(r"\w", word) or re.fullmatch(_TORN_STAR, word):
            notes.lost(line, f"'{word}' in a row of stars")
            return None
        else:
            notes.repair(line.number, RepairKind.STRAY, word)
    return tuple((frame, number) for frame, number in stars if frame)


def _is_star(line: Line, word: str, notes: Notes) -> bool:
    """Tell whether a word is a star; punctuation beside it is noted."""
    if word.strip(_PUNCTUATION) != _STAR:
        return False
    if word != _STAR:
        notes.repair(line.number, RepairKind.STRAY, word, _STAR)
    return True


def _is_grid(heading: Line) -> bool:
    """Tell whether tabs part the cells of a table; otherwise they stand for the blanks up to columns of eight."""
    cells = heading.text.split("\t")
    return len(cells) > 1 and not any(cell.startswith(" ") or "  " in cell.strip() for cell in cells)


def _placed(line: Line, grid: bool, start: int = 0) -> Iterator[tuple[int, str]]:
    """Yield the words from a character on with their places: cell of a grid, last column of a printed text."""
    for match in re.finditer(r"[^\t]+" if grid else r"\S+", line.text[start:]):
        before = line.text[: start + match.end()]
        if word := match[0].strip():
            yield (before.count("\t") if grid else len(before.expandtabs())), word


def _frame_at(place: int, line: Line, places: list[tuple[str, int]], grid: bool, notes: Notes) -> str:
    """Return the frame whose id stands nearest above a star; none, and a problem, where none is near."""
    near = {frame: abs(where - place) for frame, where in places}
    reach = 0 if grid else 4  # columns: half a column of the table
    frame = min(near, key=lambda name: near[name], default="")
    if not frame or near[frame] > reach:
        notes.lost(line, "a star that stands below no frame")
        return ""
    return frame


def _frame_places(heading: Line, frames: tuple[str, ...], grid: bool) -> Iterator[tuple[str, int]]:
    """Yield where the ids of the frames stand, in their order, however they are broken or misspelt."""
    waiting, text = list(frames), ""
    for where, words in _placed(heading, grid):
        for word in words.split():
            text += canonical(word)
            if waiting and text.endswith(canonical(waiting[0])):
                yield waiting.pop(0), where
                text = ""
