"""What the search for blunders found: test value, estimated size, action; and the causes that compete."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from musatpy.model import Cause, Editing, Solution
from musatpy.reports.pages import Section
from musatpy.reports.quality_record import CAUSES, FINDINGS
from musatpy.reports.table import Column, Report, key
from musatpy.reports.text import wrapped
from musatpy.statistics import Statistics

_EDITS = {"um": "F10.1", "m": "F10.3", "arc sec": "F10.1"}
_SHOWN = 2  # ids of one cause
FINDING: tuple[Column[Statistics], ...] = (  # what is wrong, and where
    key("Blunder", "A21", "blunder"),
    key("Photo", "A17", "photo"),
    key("Point", "A17", "point"),
)
_TITLES = {"um": "Blunders: Images", "m": "Blunders: Control, Stations, Water", "arc sec": "Blunders: Attitudes"}


def sections(statistics: Statistics) -> list[Section]:
    """Return the list of blunders, nothing where none were looked for."""
    solution = statistics.solution
    causes = _causes(statistics)
    if solution.edited is None:
        return causes
    if not solution.findings:
        text = f"EDIT has edited nothing: {solution.unedited}." if solution.unedited else "None were found."
        return [*causes, Section(title="Blunders", lines=wrapped([text]))]
    units = dict.fromkeys(finding.kind.unit for finding in solution.findings)
    tables = [_findings(statistics, unit) for unit in units]
    return [*causes, *tables, Section(title="Blunders: What Was Done", lines=wrapped(_summary(solution)))]


def _findings(statistics: Statistics, unit: str) -> Section:
    """Return the findings whose sizes have a unit, with their notes below."""
    findings = statistics.solution.findings
    rows = [row for row, finding in enumerate(findings) if finding.kind.unit == unit]
    texts = dict.fromkeys(findings[row].note for row in rows)
    notes = {note: f"{number:4d}" for number, note in enumerate(filter(None, texts), 1)}

    def component(axis: int) -> Column[Statistics]:
        return Column(f"Size\n{unit}", _EDITS[unit], lambda s: [_at(findings[row].size, axis) for row in rows])

    report: Report[Statistics] = Report(
        title=_TITLES[unit],
        table=FINDINGS,
        rows=lambda s: np.array(rows),
        columns=(
            *FINDING,
            Column("Test\nvalue", "F9.1", shows="test"),
            *(component(axis) for axis in range(max(len(findings[row].size) for row in rows))),
            Column("Action", "A11", shows="action"),
            Column("Note", "A4", lambda s: [notes.get(findings[row].note, "") for row in rows]),
        ),
    )
    return report.section(statistics, ["", *(f"{number}  {note}" for note, number in notes.items())])


def _causes(statistics: Statistics) -> list[Section]:
    """Return the ranked causes, and what to check; nothing where there are none."""
    causes = statistics.solution.causes
    if not causes:
        return []
    advice = dict.fromkeys(cause.advice for cause in causes)
    numbers = {text: f"{number:4d}" for number, text in enumerate(advice, 1)}
    notes = wrapped([f"{number}  {text}" for text, number in numbers.items()])
    return [_cause_report(causes, numbers).section(statistics, ["", *notes, "", *wrapped(_CAUSES_SAY)])]


_CAUSES_SAY = [
    "Causes of one group explain the same misfit; those of one rank explain it equally well, the cheaper to check "
    "first. The test is the root of what the weighted sum of squares loses by it, for each parameter, in sigma0; "
    "the size, given minus true as all else says, that of the component that is largest in its sigmas.",
]


def _cause_report(causes: tuple[Cause, ...], numbers: Mapping[str, str]) -> Report[Statistics]:
    """Return the table of causes; `numbers` are those of what is to be checked."""
    largest = [_largest(cause) for cause in causes]

    def each(value: Callable[[Cause, int], Any]) -> Callable[[Statistics], list[Any]]:
        return lambda s: [value(cause, axis) for cause, axis in zip(causes, largest, strict=True)]

    return Report(
        title="Blunders: Causes",
        table=CAUSES,
        columns=(
            Column("Group", "I5", shows="group"),
            Column("Rank", "I4", shows="rank"),
            Column("Cause", "A27", shows="cause"),
            Column("Photo, point", "A20", each(lambda cause, axis: _owner(cause))),
            Column("Of", "A17", each(_component)),
            Column("Size", "F12.3", each(lambda cause, axis: _at(cause.size, axis))),
            Column("Sigma", "F9.3", each(lambda cause, axis: _at(cause.sigma, axis))),
            Column("Unit", "A7", shows="unit"),
            Column("Test", "F9.1", shows="test"),
            Column("Note", "A4", each(lambda cause, axis: numbers[cause.advice])),
        ),
    )


def _largest(cause: Cause) -> int:
    """Return which component of a size is the largest one in its sigmas."""
    sizes = [abs(size) / (_at(cause.sigma, axis) or 1.0) for axis, size in enumerate(cause.size)]
    known = [size if size == size else abs(cause.size[axis]) for axis, size in enumerate(sizes)]
    return max(range(len(known)), key=known.__getitem__, default=0)


def _at(values: tuple[float, ...], axis: int) -> float:
    return values[axis] if axis < len(values) else float("nan")


def _component(cause: Cause, axis: int) -> str:
    return cause.kind.axes[axis] if cause.kind.axes and cause.size else cause.component


def _owner(cause: Cause) -> str:
    return " ".join(_names(ids) for ids in (cause.photos, cause.points) if ids)


def _names(ids: tuple[str, ...]) -> str:
    """Return some ids with hyphens; of many the first and the last."""
    return "-".join(ids) if len(ids) <= _SHOWN else f"{ids[0]}...{ids[-1]}"


def _summary(solution: Solution) -> list[str]:
    findings = solution.findings
    done = solution.block.options.editing is Editing.EDIT and not solution.unedited
    nothing = f"EDIT has edited nothing: {solution.unedited}. " if solution.unedited else ""
    counts = Counter(finding.action.value for finding in findings)
    actions = ", ".join(f"{action} {count}" for action, count in counts.items())
    return [
        f"{len(findings)} findings: {actions}.",
        "The solution is that of the edited deck."
        if done
        else f"{nothing}Nothing of this was done: the solution is that of the deck as it stands, blunders and all.",
        "Sizes are given minus what all else says. Images with a test value and no size cannot be told apart from "
        "others of their point: the value is the misfit of the point.",
    ]
