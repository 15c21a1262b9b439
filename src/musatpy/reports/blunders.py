"""What the search for blunders found: test value, estimated size, action; and the causes that compete."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from musatpy.model import Cause, CauseKind, Editing, Finding, Solution
from musatpy.reports.pages import Section
from musatpy.reports.quality_record import UNITS
from musatpy.reports.table import Column, Report
from musatpy.reports.text import wrapped
from musatpy.statistics import Statistics

_EDITS = {"um": "F10.1", "m": "F10.3", "arc sec": "F10.1"}
_SHOWN = 2  # ids of one cause
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
    found = []
    for unit in dict.fromkeys(UNITS[one.blunder] for one in solution.findings):
        rows = [one for one in solution.findings if UNITS[one.blunder] == unit]
        notes = {note: number for number, note in enumerate(dict.fromkeys(one.note for one in rows if one.note), 1)}
        report: Report[Statistics] = Report(title=_TITLES[unit], columns=_columns(rows, unit, notes))
        below = ["", *(f"{number:4d}  {note}" for note, number in notes.items())]
        found.append(report.section(statistics, below))
    return [*causes, *found, Section(title="Blunders: What Was Done", lines=wrapped(_summary(solution)))]


def _causes(statistics: Statistics) -> list[Section]:
    """Return the ranked causes, and what to check; nothing where there are none."""
    causes = statistics.solution.causes
    if not causes:
        return []
    report: Report[Statistics] = Report(title="Blunders: Causes", columns=_cause_columns(causes))
    advice = dict.fromkeys(cause.advice for cause in causes)
    numbers = {text: number for number, text in enumerate(advice, 1)}
    notes = [line for text, number in numbers.items() for line in wrapped([f"{number:4d}  {text}"])]
    return [report.section(statistics, ["", *notes, "", *wrapped(_CAUSES_SAY)])]


_CAUSES_SAY = [
    "Causes of one group explain the same misfit; those of one rank explain it equally well, the cheaper to check "
    "first. The test is the root of what the weighted sum of squares loses by it, for each parameter, in sigma0; "
    "the size, given minus true as all else says, that of the component that is largest in its sigmas.",
]


def _cause_columns(causes: tuple[Cause, ...]) -> tuple[Column[Statistics], ...]:
    advice = list(dict.fromkeys(cause.advice for cause in causes))

    largest = [_largest(one) for one in causes]
    return (
        Column("Group", "I5", lambda s: [one.group for one in causes]),
        Column("Rank", "I4", lambda s: [one.rank for one in causes]),
        Column("Cause", "A27", lambda s: [one.kind.value for one in causes]),
        Column("Photo, point", "A20", lambda s: [_owner(one) for one in causes]),
        Column("Of", "A17", lambda s: [_component(one, axis) for one, axis in zip(causes, largest, strict=True)]),
        Column("Size", "F12.3", lambda s: [_at(one.size, axis) for one, axis in zip(causes, largest, strict=True)]),
        Column(
            "Sigma", "F9.3", lambda s: [_at(one.sigma, axis) for one, axis in zip(causes, largest, strict=True)]
        ),
        Column("Unit", "A7", lambda s: [one.unit for one in causes]),
        Column("Test", "F9.1", lambda s: [one.test for one in causes]),
        Column("Note", "A4", lambda s: [f"{advice.index(one.advice) + 1:4d}" for one in causes]),
    )


_AXES = {
    CauseKind.HORIZONTAL: ("east", "north"),
    CauseKind.CONTROL: ("east", "north", "up"),
    CauseKind.POSITION: ("east", "north", "up"),
    CauseKind.STATION: ("east", "north", "up"),
    CauseKind.ATTITUDE: ("omega", "phi", "kappa"),
    CauseKind.IMAGE: ("x", "y"),
}


def _largest(cause: Cause) -> int:
    """Return which component of a size is the largest one in its sigmas."""
    sizes = [abs(size) / (_at(cause.sigma, axis) or 1.0) for axis, size in enumerate(cause.size)]
    known = [size if size == size else abs(cause.size[axis]) for axis, size in enumerate(sizes)]
    return max(range(len(known)), key=known.__getitem__, default=0)


def _at(values: tuple[float, ...], axis: int) -> float:
    return values[axis] if axis < len(values) else float("nan")


def _component(cause: Cause, axis: int) -> str:
    return _AXES[cause.kind][axis] if cause.kind in _AXES and cause.size else cause.component


def _owner(cause: Cause) -> str:
    return " ".join(_names(ids) for ids in (cause.photos, cause.points) if ids)


def _names(ids: tuple[str, ...]) -> str:
    """Return some ids with hyphens; of many the first and the last."""
    return "-".join(ids) if len(ids) <= _SHOWN else f"{ids[0]}...{ids[-1]}"


def _summary(solution: Solution) -> list[str]:
    findings = solution.findings
    done = solution.block.options.editing is Editing.EDIT and not solution.unedited
    nothing = f"EDIT has edited nothing: {solution.unedited}. " if solution.unedited else ""
    counts = Counter(one.action.value for one in findings)
    actions = ", ".join(f"{action} {count}" for action, count in counts.items())
    return [
        f"{len(findings)} findings: {actions}.",
        "The solution is that of the edited deck."
        if done
        else f"{nothing}Nothing of this was done: the solution is that of the deck as it stands, blunders and all.",
        "Sizes are given minus what all else says. Images with a test value and no size cannot be told apart from "
        "others of their point: the value is the misfit of the point.",
    ]


def _columns(rows: list[Finding], unit: str, notes: dict[str, int]) -> tuple[Column[Statistics], ...]:
    def component(axis: int) -> Callable[[Statistics], list[float]]:
        return lambda s: [one.size[axis] if axis < len(one.size) else float("nan") for one in rows]

    width = max(len(one.size) for one in rows)
    return (
        Column("Blunder", "A21", lambda s: [one.blunder.value for one in rows]),
        Column("Photo", "A17", lambda s: [one.photo for one in rows]),
        Column("Point", "A17", lambda s: [one.point for one in rows]),
        Column("Test\nvalue", "F9.1", lambda s: [one.test for one in rows]),
        *(Column(f"Size\n{unit}", _EDITS[unit], component(axis)) for axis in range(width)),
        Column("Action", "A11", lambda s: [one.action.value for one in rows]),
        Column("Note", "A4", lambda s: [f"{notes[one.note]:4d}" if one.note else "" for one in rows]),
    )
