"""Page 1: what the run is worth and why, its numbers in short, and where each of them shows; an index of pages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

import musatpy
from musatpy.model import Grade, Verdict
from musatpy.reports import blunders, pages, residuals
from musatpy.reports.headline import content_of, headline
from musatpy.reports.pages import Section, by_kind, labelled, wrapped
from musatpy.reports.table import Content, Labels, Report, Texts, count_at, sentences_at
from musatpy.reports.titles import REFRACTION, SYSTEMS
from musatpy.reports.values import at
from musatpy.statistics import Statistics
from musatpy.statistics.verdict import COMMON_ERRORS

INDEX = "Index Of Pages"
ALL_REASONS = "Verdict: All Reasons And Notes"
USE = {
    Grade.ACCEPTED: "no test rejects it",
    Grade.DOUBTFUL: "to be looked at before it is used",
    Grade.REJECTED: "not to be used",
    Grade.FAILED: "not converged, not to be used",
}
MARKS = {
    Grade.DOUBTFUL: "*** DOUBTFUL ***",
    Grade.REJECTED: "*** REJECTED ***",
    Grade.FAILED: "*** NOT CONVERGED ***",
}
_TITLES = ("Title", "Title, card 2")
_WORST = 5  # observations
_LONGEST_PAGE = 99999
_NOTE = "Note: "
_PAD, _BLANK = "\x01", "\x02"  # of references: a page number takes the same room whatever it is
_FLOORS = (6, 4, 3, 3)  # lines of reasons, causes, blunders and warnings at least, where all are long ...
_LEAST = 1  # ... unless all else leaves no room even for that

_CAUSES = "Blunders: Causes"
UNSETTLED = "nothing has converged: what is blamed here may itself be carried away by what is wrong"


def _run_numbers(content: Content) -> dict[str, Sequence[float | None]]:
    """Return the numbers of the run in short by their labels, as a record has them."""
    images = [count_at(content, "plates")] if content.get("content") != "tables" else []
    sizes = [count_at(content, "stations"), count_at(content, "points"), *images]
    return {
        "Photos, points, images, submerged points": sizes,
        "Points flagged D, dry for certain": [count_at(content, "points", "dry")],
        "Iterations": [count_at(content, "iterations"), count_at(content, "water_passes")],
    }


BLUNDERS = Report("Blunders Found", blunders.FINDINGS, "blunder photo point test action")
WORST = Report(
    "Worst Observations",
    residuals.OBSERVATIONS,
    ("kind of component", residuals.UNIT, "residual normal_test estimated_error"),
    which=lambda t: t.source.worst_observations[:_WORST],
    some=True,
)


def _verdict_texts(content: Content) -> Iterator[str]:
    """Yield grade, reasons and notes, as a record has them."""
    grade = str(at(content, "verdict.grade"))
    yield f"{grade}: {USE[Grade(grade)]}" if grade in set(Grade) else grade
    yield from sentences_at(content, "verdict.reasons", "verdict.notes")


STATED = (
    Texts("Verdict", _verdict_texts, "verdict"),
    Labels("Quality In Short", lambda r: {one.label: one.numbers for one in headline(r) if one.numbers}),
    BLUNDERS,
    Texts("Warnings In Short", lambda r: sentences_at(r, "solution.warnings"), "solution"),
    WORST,
    Labels("Run", _run_numbers),
)


def verdict_section(verdict: Verdict, notes: Sequence[str] = ()) -> Section:
    """Return what an answer is worth, with all reasons and notes, as it stands before everything else."""
    reasons = [reason.text for reason in verdict.reasons]
    lines = [f"{verdict.grade}: {USE[verdict.grade]}", *wrapped([*reasons, *notes], lead="- ")]
    return Section(title="Verdict", lines=lines)


PageOf = Callable[[str], int]  # beginning of the title of a section -> its page, 0 where it is not listed


def sections(statistics: Statistics, page_of: PageOf) -> list[Section]:
    """Return the sections of page 1: as many lines as it has, whatever the pages are."""
    return _laid_out(statistics, page_of)[0]


def all_reasons(statistics: Statistics) -> list[Section]:
    """Return every reason and note of the verdict, where page 1 has no room for them all."""
    verdict = statistics.verdict
    lines = wrapped([reason.text for reason in verdict.reasons], lead="- ") + wrapped(verdict.notes, lead=_NOTE)
    whole = not lines or _laid_out(statistics, lambda section: _LONGEST_PAGE)[1]
    return [] if whole else [Section(title=ALL_REASONS, lines=lines)]


def _laid_out(statistics: Statistics, page_of: PageOf) -> tuple[list[Section], bool]:
    """Return the sections of page 1, and whether all reasons and notes are there."""
    verdict, blunder_table = statistics.verdict, BLUNDERS.section(statistics)
    reasons = [_wrapped(f"{reason.text}{_reference(page_of, reason.section)}") for reason in verdict.reasons]
    reasons += [_wrapped(note, lead=_NOTE) for note in verdict.notes]
    tops = {  # with the blocks of lines of each list, and where all of it is
        ALL_REASONS: (Section(title="Verdict", lines=[f"{verdict.grade}: {USE[verdict.grade]}"]), reasons),
        _CAUSES: (Section(title="Likely Causes"), _causes(statistics, page_of)),
        "Blunders": (replace(blunder_table, lines=()), [[row] for row in blunder_table.lines]),
        "Warnings": (Section(title="Warnings In Short"), by_kind(statistics.solution.warnings, shown=1)),
    }
    quality, last = _quality(statistics, page_of), [*_worst(statistics), _run(statistics)]
    others = [top for top, blocks in tops.values() if blocks or top.lines] + [quality, *last]
    used = sum(pages.GAP + len(section.top()) + len(section.lines) for section in others) - pages.GAP
    lengths = [sum(map(len, blocks)) for _, blocks in tops.values()]
    rooms = _rooms(pages.BODY_LINES - used, lengths)
    lists = [
        replace(top, lines=[*top.lines, *_cut(blocks, room, _reference(page_of, where))])
        for (where, (top, blocks)), room in zip(tops.items(), rooms, strict=True)
    ]
    shown = [*lists[:2], quality, *lists[2:], *last]
    return [section for section in shown if section.lines], lengths[0] <= rooms[0]


def _reference(page_of: PageOf, section: str) -> str:
    """Return ` (page 9)`, as wide for every page; nothing for a section that is not listed."""
    page = page_of(section) if section else 0
    return f" (page{_BLANK}{str(page).rjust(len(str(_LONGEST_PAGE)), _PAD)})" if page else ""


def index(titles: Sequence[str], starts: Sequence[int], *, new_page: bool) -> Section:
    """Return the index: the first line of each title and its page; of the longest kinds one line, to fit a page."""
    entries: dict[str, int] = {}
    for title, page in zip(titles, starts, strict=True):
        entries.setdefault(title.split("\n")[0], page)
    while len(entries) > pages.BODY_LINES - 2:
        kind, count = Counter(_kind(title) for title in entries).most_common(1)[0]
        if count == 1:
            break
        merged: dict[str, int] = {}
        for title, page in entries.items():
            merged.setdefault(kind if _kind(title) == kind else title, page)
        entries = merged
    lines = [f"{page:6d}  {title}" for title, page in entries.items()]
    return Section(title=INDEX, lines=lines[: pages.BODY_LINES - 2], new_page=new_page, together=True)


def _kind(title: str) -> str:
    return title.partition(":")[0]


def _wrapped(text: str, lead: str = "- ") -> list[str]:
    """Return the lines of a text, broken as if its reference were that of the longest page."""
    return _printed(wrapped([text], lead=lead))


def _printed(lines: Sequence[str]) -> list[str]:
    """Return lines with their references as they are printed."""
    return [line.replace(_PAD, "").replace(_BLANK, " ") for line in lines]


def _rooms(room: int, wanted: Sequence[int]) -> list[int]:
    """Share lines out: each gets its floor, and of what is left what it wants, the first first."""
    rooms = [min(want, floor) for want, floor in zip(wanted, _FLOORS, strict=True)]
    for place, want in enumerate(wanted):
        rooms[place] += min(max(room - sum(rooms), 0), want - rooms[place])
    while sum(rooms) > room and max(rooms) > _LEAST:
        rooms[rooms.index(max(rooms))] -= 1
    return rooms


def _cut(blocks: Sequence[Sequence[str]], room: int, reference: str) -> list[str]:
    """Return the lines of the blocks that fit, the first in any case, and how many more there are and where."""
    if sum(map(len, blocks)) <= room:
        return [line for block in blocks for line in block]
    shown = next(count for count in range(len(blocks), -1, -1) if sum(map(len, blocks[:count])) < room or not count)
    lines = [line for block in blocks[:shown] for line in block] if shown else list(blocks[0][: room - 1])
    more = len(blocks) - (shown or bool(lines))
    return [*lines, *_printed([f"and {more} more{reference}"])] if more else lines


def _quality(statistics: Statistics, page_of: PageOf) -> Section:
    """Return the figures that say how good the run is, each with its page."""
    lines: list[str] = []
    for figure in headline(content_of(statistics)):
        text = f"{figure.value}{figure.detail}{_reference(page_of, figure.section)}"
        if figure.section == COMMON_ERRORS:
            lines += wrapped([text], lead=labelled({figure.label: ""})[0])
        else:
            lines += labelled({figure.label: text})
    return Section(title="Quality In Short", lines=_printed(lines))


def _causes(statistics: Statistics, page_of: PageOf) -> list[list[str]]:
    """Return the lines of each cause, those together that explain the same; none of an accepted run."""
    causes, verdict = statistics.solution.causes, statistics.verdict
    if not causes or not verdict.reasons:
        return []
    blocks, groups = [], set()
    if verdict.grade is Grade.FAILED and np.isfinite(causes[0].drop):
        blocks.append(_wrapped(UNSETTLED, lead=_NOTE))
    for cause in causes:
        lead = "  or " if cause.group in groups else "- "
        groups.add(cause.group)
        blocks.append(_wrapped(f"{cause}{_reference(page_of, _CAUSES)}", lead=lead))
    return blocks


def _worst(statistics: Statistics) -> list[Section]:
    """Return the observations with the largest test values."""
    if statistics.solution.observed is None:
        return []
    section = WORST.section(statistics)
    return [section if section.lines else replace(section, lines=["None has a test value that is not zero."])]


def _run(statistics: Statistics) -> Section:
    """Return which job it was: nothing of the time, or of the machine."""
    block, solution = statistics.block, statistics.solution
    options, wet = block.options, int(block.points.bathymetric.sum())
    passes = f", water passes {len(solution.passes)}" if solution.passes else ""
    words = statistics.answer_words
    answer = wrapped([words.statement.system.text], lead=labelled({"Answer in": ""})[0]) if words else []
    counts = [len(block.photos.ids), len(block.points.ids), len(block.plates.photo), wet]
    lines = {
        "Program": f"musatpy {musatpy.__version__}, MUSAT-{options.program}",
        **dict(zip(_TITLES, block.titles, strict=False)),
        "Refraction": f"{options.refraction}  {REFRACTION[options.refraction]}",
        "Photos, points, images, submerged points": ", ".join(map(str, counts)),
        **({"Points flagged D, dry for certain": str(dry)} if (dry := int(block.points.dry.sum())) else {}),
        "Iterations": f"{len(solution.iterations)}{passes}",
        "Coordinate system": f"{options.system}  {SYSTEMS[options.system]}",
    }
    return Section(title="Run", lines=[*labelled(lines), *answer])
