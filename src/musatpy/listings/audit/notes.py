"""What the readers of the reports note while they read: repairs made, rows that cannot be read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

from musatpy.errors import Problem
from musatpy.listings.audit.cells import Kind, Reading, markup_of, read_cells, words_of
from musatpy.listings.audit.scan import Line
from musatpy.listings.audit.spelling import noisy_pattern, pattern, plain, required, respelt
from musatpy.listings.audit.structures import Repair, RepairKind

_OFTEN = 3  # places where a word stands as it is
_NOISE = r"[^A-HJKM-Za-hjkm-z]*"  # what may stand left of a label: no word; l and I may be a border


@dataclass(frozen=True)
class Notes:
    """Repairs and problems of one listing, gathered by its readers."""

    file: str
    text: str
    repairs: list[Repair] = field(default_factory=list)
    unreadable: list[Problem] = field(default_factory=list)
    titled: set[int] = field(default_factory=set)  # lines of rows below a legible title, whether read or not

    def cells(
        self,
        line: Line,
        rest: str,
        kinds: Sequence[Kind],
        what: str,
        decimals: int | None = None,
        places: Sequence[int | None] | None = None,
    ) -> Reading | None:
        """Return the cells right of the label of a row; None, and a problem noted, where they are unreadable."""
        words = words_of(rest)
        if set(kinds) == {"id"} and len(words) == len(kinds) and all(map(self.stands, words)):
            return Reading.of(words)
        reading = read_cells(words, kinds, decimals, places)
        if reading is None:
            expected = f"the {len(kinds)} {'cell' if len(kinds) == 1 else 'cells'} of '{what}'"
            problem = Problem(
                file=self.file, line=line.number, found=rest.strip(), expected=expected, text=line.text
            )
            self.unreadable.append(problem)
            return None
        self.repairs.extend([*markup_of(rest, line.number), *reading.repairs(line.number)])
        return reading

    def id_of(self, words: Sequence[str], width: int | None) -> Reading | None:
        """Return the id that words are, as it is where the listing has it elsewhere too; most have a `width`."""
        if len(words) == 1 and self.stands(words[0]):
            return Reading.of(words)
        return read_cells(words, ["id"], width=width)

    def stands(self, word: str) -> bool:
        """Tell whether a word is in the listing so often that noise alone cannot have made it."""
        return len(re.findall(rf"(?<!\S){re.escape(word)}(?!\S)", self.text)) >= _OFTEN

    def repair(self, line: int, kind: RepairKind, printed: str, read: str = "") -> None:
        """Note a repair of a line; with nothing to be read, what is left out."""
        self.repairs.append(Repair(line, kind, printed, read))

    def missing(self, line: int, what: str) -> None:
        """Note a row that a report must have and that is not there, or has no legible label."""
        self.unreadable.append(Problem(file=self.file, line=line, message=f"no row '{what}' is legible below"))

    def after(self, label: str, line: Line) -> str | None:
        """Return what stands right of a label (see `spelling.pattern`); None where the row has not this label.

        Noise in it and left of it is noted.
        """
        match, read = labelled(label, line)
        if match is None:
            return None
        noise = match["noise"].strip()
        if noise:
            self.repair(line.number, RepairKind.BORDER, noise)
        if read is not None:
            self.repairs.extend(respelt(line.number, match["label"], read))
        return match["rest"]

    def lost(self, line: Line, message: str) -> None:
        """Note a line that must mean something, but whose meaning is not legible."""
        self.unreadable.append(Problem(file=self.file, line=line.number, message=message, text=line.text))


def labelled(label: str, line: Line) -> tuple[re.Match[str] | None, str | None]:
    """Return the match of a label in a row (noise, label, rest), and how it is read where it takes repairs."""
    if required(label) not in line.canonical:
        return None, None
    match = _row(pattern(label)).match(line.text)
    if match is not None:
        return match, None
    return _row(noisy_pattern(label)).match(line.text), plain(label)


@lru_cache(maxsize=256)
def _row(label: str) -> re.Pattern[str]:
    return re.compile(rf"(?P<noise>{_NOISE})(?P<label>{label})\.?(?=\s|$)(?P<rest>.*)$", re.I)
