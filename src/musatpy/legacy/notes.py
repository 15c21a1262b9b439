"""What the readers of the reports note while they read: repairs made, rows that cannot be read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from musatpy.errors import Problem
from musatpy.legacy.layout import Line
from musatpy.legacy.structures import Repair, RepairKind
from musatpy.legacy.words import Kind, Reading, read_cells, words_of

_NOISE = r"(?:[^\w]|[\d_lI]|[^\x00-\x7f])*"  # what may stand left of a label: no word


@dataclass(frozen=True)
class Notes:
    """Repairs and problems of one listing, gathered by its readers."""

    file: str
    repairs: list[Repair] = field(default_factory=list)
    unreadable: list[Problem] = field(default_factory=list)

    def cells(
        self, line: Line, rest: str, kinds: Sequence[Kind], what: str, decimals: int | None = None
    ) -> Reading | None:
        """Return the cells right of the label of a row; None, and a problem noted, where they are unreadable."""
        reading = read_cells(words_of(rest), kinds, decimals)
        if reading is None:
            expected = f"the {len(kinds)} {'cell' if len(kinds) == 1 else 'cells'} of '{what}'"
            problem = Problem(
                file=self.file, line=line.number, found=rest.strip(), expected=expected, text=line.text
            )
            self.unreadable.append(problem)
            return None
        self.repairs.extend(reading.repairs(line.number))
        return reading

    def missing(self, line: int, what: str) -> None:
        """Note a row that a report must have and that is not there, or has no legible label."""
        self.unreadable.append(Problem(file=self.file, line=line, message=f"no row '{what}' is legible below"))

    def after(self, label: str, line: Line) -> str | None:
        """Return what stands right of a label, noise left of it noted; None where the row has not this label."""
        match = re.match(rf"(?P<noise>{_NOISE}){label}\.?(?=\s|$)(?P<rest>.*)$", line.text, re.I)
        if match is None:
            return None
        noise = match["noise"].strip()
        if noise:
            self.repairs.append(Repair(line=line.number, kind=RepairKind.BORDER, found=noise, read=""))
        return match["rest"]


def phrase(text: str) -> str:
    """Return a pattern of a phrase with any blanks, points and hyphens between its words."""
    return r"[\s.\-]*".join(text.split())
