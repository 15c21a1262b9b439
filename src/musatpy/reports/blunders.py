"""What the search for blunders found: test value, estimated size, action."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from musatpy.model import Blunder, Editing, Finding
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Table
from musatpy.reports.text import wrapped
from musatpy.statistics import Statistics

UNITS = dict.fromkeys(Blunder, "m") | {
    Blunder.MISNAMED: "um",
    Blunder.PLATE: "um",
    Blunder.ATTITUDE: "arc sec",
}
_EDITS = {"um": "F10.1", "m": "F10.3", "arc sec": "F10.1"}
_TITLES = {"um": "Blunders: Images", "m": "Blunders: Control, Stations, Water", "arc sec": "Blunders: Attitudes"}


def sections(statistics: Statistics) -> list[Section]:
    """Return the list of blunders, nothing where none were looked for."""
    solution = statistics.solution
    if solution.edited is None:
        return []
    if not solution.findings:
        return [Section(title="Blunders", lines=["None were found."])]
    found = []
    for unit in dict.fromkeys(UNITS[one.blunder] for one in solution.findings):
        rows = [one for one in solution.findings if UNITS[one.blunder] == unit]
        notes = {note: number for number, note in enumerate(dict.fromkeys(one.note for one in rows if one.note), 1)}
        table = Table(_columns(rows, unit, notes))
        lines = [*table.lines(statistics), "", *(f"{number:4d}  {note}" for note, number in notes.items())]
        found.append(Section(title=_TITLES[unit], head=table.head(), lines=lines))
    done = solution.block.options.editing is Editing.EDIT
    return [*found, Section(title="Blunders: What Was Done", lines=wrapped(_summary(solution.findings, done)))]


def _summary(findings: tuple[Finding, ...], done: bool) -> list[str]:
    counts = Counter(one.action.value for one in findings)
    actions = ", ".join(f"{action} {count}" for action, count in counts.items())
    return [
        f"{len(findings)} findings: {actions}.",
        "The solution is that of the edited deck."
        if done
        else "Nothing of this was done: the solution is that of the deck as it stands, blunders and all.",
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
