"""What the search for blunders found: test value, estimated size, action; and the causes that compete."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from musatpy.model import Cause, Editing, Finding, Solution
from musatpy.reports.editing import printed_unit
from musatpy.reports.fields import Each, Field, unrecorded
from musatpy.reports.pages import Section, wrapped
from musatpy.reports.table import Report
from musatpy.statistics import Statistics

FINDINGS = Each[Statistics, Finding](
    "findings", "one row per finding of the search for blunders", of=lambda s: s.solution.findings, fields=(
        Field("blunder", "string", "what is wrong", heading="Blunder", edit="A21", is_id=True),
        Field("photo", "string?", "photo id; of tides also a group, a day, or all", lambda f: f.photo or None,
              "Photo", "A17", is_id=True),
        Field("point", "string?", "point id, as in the deck", lambda f: f.point or None, "Point", "A17",
              is_id=True),
        Field("test", "number?", "test value, null where nothing checks", heading="Test", edit="F9.1"),
        Field("size", "* number?", "estimated: given minus what all else says, by component"),
        Field("unit", "string", "of the size", "kind.unit"),
        Field("action", "string", "what was done, or with LIST would be", heading="Action", edit="A11"),
        Field("note", "string", "explanation", heading="Note", edit="A80"),
    ),
)  # fmt: skip
CAUSES = Each[Statistics, Cause](
    "causes",
    "ranked causes of what does not fit: of a search that was asked for, and of runs that failed or are doubtful",
    of=lambda s: s.solution.causes, fields=(
        Field("group", "integer", "causes of one group explain the same misfit", heading="Group", edit="I5"),
        Field("rank", "integer",
              "in the group; causes of one rank explain it equally well, the cheaper to check first",
              heading="Rank", edit="I4"),
        Field("cause", "string", "what may be wrong", "kind", "Cause", "A27"),
        Field("cards", "* string", "mnemonics of the cards to read again"),
        Field("photos", "* string", "photo ids"),
        Field("points", "* string", "point ids"),
        Field("component", "string", "of the card; empty: none of its own"),
        Field("size", "* number?", "estimated: given minus true, by component"),
        Field("sigma", "* number?", "of the size"),
        Field("unit", "string", "of size and sigma", heading="Unit", edit="A7"),
        Field("parameters", "integer", "that the cause takes"),
        Field("drop", "number?", "of the weighted sum of squares; null where the block fits only under it"),
        Field("test", "number?", "root of the drop for each parameter, in sigma0", heading="Test", edit="F9.1"),
        Field("advice", "string", "what to check"),
    ),
)  # fmt: skip


_EDITS = {"um": "F10.1", "m": "F10.3", "arc sec": "F10.1"}
_SHOWN = 2  # ids of one cause
_TITLES = {"um": "Blunders: Images", "m": "Blunders: Control, Stations, Water", "arc sec": "Blunders: Attitudes"}


UNEDITED = Field[Statistics](
    "unedited", "string", "why EDIT has edited nothing; empty where it has, or was not asked to",
    lambda s: s.solution.unedited,
)  # fmt: skip


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

    def component(axis: int) -> Field[Statistics]:
        heading = f"Size\n{unit}"
        size = np.array([_at(findings[row].size, axis) for row in rows])
        return unrecorded(heading, _EDITS[unit], lambda t: size * printed_unit(heading))

    numbers = [notes.get(findings[row].note, "") for row in rows]
    report = Report(
        _TITLES[unit],
        FINDINGS,
        (
            "blunder photo point",
            FINDINGS.column("test", "Test\nvalue", "F9.1"),
            *(component(axis) for axis in range(max(len(findings[row].size) for row in rows))),
            "action",
            unrecorded("Note", "A4", lambda t: numbers),
        ),
        which=lambda t: np.array(rows),
    )
    return report.section(statistics, ["", *(f"{number}  {note}" for note, number in notes.items())])


_CAUSES_SAY = [
    "Causes of one group explain the same misfit; those of one rank explain it equally well, the cheaper to check "
    "first. The test is the root of what the weighted sum of squares loses by it, for each parameter, in sigma0; "
    "the size, given minus true as all else says, that of the component that is largest in its sigmas."
]


def _causes(statistics: Statistics) -> list[Section]:
    """Return the ranked causes, and what to check; nothing where there are none."""
    causes = statistics.solution.causes
    if not causes:
        return []
    numbers = {text: f"{number:4d}" for number, text in enumerate(dict.fromkeys(of.advice for of in causes), 1)}
    largest = [_largest(cause) for cause in causes]

    def each(heading: str, edit: str, value: Callable[[Cause, int], Any]) -> Field[Statistics]:
        values = [value(cause, axis) for cause, axis in zip(causes, largest, strict=True)]
        return unrecorded(heading, edit, lambda t: values)

    columns = (
        "group rank cause",
        each("Photo, point", "A20", lambda of, axis: f"{_names(of.photos)} {_names(of.points)}".strip()),
        each("Of", "A17", lambda of, axis: of.kind.axes[axis] if of.kind.axes and of.size else of.component),
        each("Size", "F12.3", lambda of, axis: _at(of.size, axis)),
        each("Sigma", "F9.3", lambda of, axis: _at(of.sigma, axis)),
        "unit test",
        each("Note", "A4", lambda of, axis: numbers[of.advice]),
    )
    notes = wrapped([f"{number}  {text}" for text, number in numbers.items()])
    return [
        Report("Blunders: Causes", CAUSES, columns).section(statistics, ["", *notes, "", *wrapped(_CAUSES_SAY)])
    ]


def _largest(cause: Cause) -> int:
    """Return which component of a size is the largest one in its sigmas."""
    sizes = [abs(size) / (_at(cause.sigma, axis) or 1.0) for axis, size in enumerate(cause.size)]
    known = [size if size == size else abs(cause.size[axis]) for axis, size in enumerate(sizes)]
    return max(range(len(known)), key=known.__getitem__, default=0)


def _at(values: tuple[float, ...], axis: int) -> float:
    return values[axis] if axis < len(values) else float("nan")


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
