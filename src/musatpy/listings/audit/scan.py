"""Text -> lines, titles and labels of the standard reports; what their readers note.

Titles and labels are known beforehand, phrases of one reading or of several (`this one|that one`), in any case and
with any blanks, points, commas and hyphens between their words. Noise of a scan is repaired in cells alone.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import chain, pairwise
from typing import TypeVar

from musatpy.errors import Problem
from musatpy.listings.audit.cells import Kind, Reading, Repair, RepairKind, read_cells
from musatpy.listings.lines import PrintedLine, paper_of
from musatpy.listings.rules import ListingLayout

WIDEST = 10_000  # characters of a row: no paper is so wide, nor a paragraph that a scan has as a row
_PAGE_HEADER = re.compile(r"\bPAGE\s+[\dlI|!Oo]+\s*$")
_TITLES = (
    ("station position", "Camera Station Position Analysis", ""),
    ("station attitude", "Camera Station Attitude Analysis", ""),
    ("ground point", "Ground Point Analysis", ""),
    ("check point", "Check Point Analysis", ""),
    ("plates", "Plate Residuals", r"(?=\W*$|\s+(?:Standard|Modified))"),
    ("submerged", "Comparison of Computed", r"(?=.*[CG]oord)"),
)
_RUNS = ((False, ("No Refraction Correction", "Standard")), (True, ("Refraction Correction Applied", "Modified")))
_NEAR = 6  # lines below a title that still belong to it
_OFTEN = 3  # a word that stands in as many places is not made by noise
_NOISE = r"[^A-HJKM-Za-hjkm-z]*"  # what may stand left of a label: no word; l and I may be a border
_CELLS = r"\.?(?=\s|$)"  # what stands right of it

Name = TypeVar("Name")  # of a row


@dataclass(frozen=True)
class Excerpt:
    """The lines of a standard report, from its title to the next title."""

    kind: str
    refracted: bool | None
    lines: tuple[PrintedLine, ...]


def found(phrase: str, line: PrintedLine, before: str = _NOISE, after: str = _CELLS) -> re.Match[str] | None:
    """Return the match of a phrase at the head of a line: groups before, rest."""
    return _pattern(phrase, before, after).match(line.text)


@lru_cache(maxsize=256)
def _pattern(phrase: str, before: str, after: str) -> re.Pattern[str]:
    words = r"[\s.,\-]*".join(phrase.split()).replace("|", r"\.?|")
    return re.compile(rf"(?P<before>{before})(?:{words})\.?{after}(?P<rest>.*)$", re.I)


@dataclass(frozen=True)
class Notes:
    """Repairs and problems of one listing, gathered by the readers of its reports."""

    file: str
    text: str
    repairs: list[Repair] = field(default_factory=list)
    unreadable: list[Problem] = field(default_factory=list)
    used: set[int] = field(default_factory=set)  # lines of rows below a legible title, whether legible or not

    def cells(
        self,
        line: PrintedLine,
        text: str,
        kinds: Sequence[Kind],
        what: str,
        places: Sequence[int | None] | None = None,
    ) -> tuple[str, ...]:
        """Return the cells of the row of `what`; none, and a problem noted, where they are not legible."""
        reading = self.ids(text, len(kinds)) if set(kinds) == {"id"} else read_cells(text, kinds, places)
        if reading is None:
            expected = f"the {len(kinds)} {'cell' if len(kinds) == 1 else 'cells'} of '{what}'"
            problem = Problem(
                file=self.file, line=line.number, found=text.strip(), expected=expected, text=line.text
            )
            self.unreadable.append(problem)
            return ()
        self.repairs.extend(reading.repairs(line.number))
        return reading.texts

    def ids(self, text: str, number: int, width: int | None = None) -> Reading | None:
        """Return so many ids, as they stand where they do so in other places too; most have a `width`."""
        words, reading = text.split(), read_cells(text, ["id"] * number, width=width)
        if reading is not None and not reading.changes:
            return reading
        are_frequent = len(words) == number and all(self._frequency[word] >= _OFTEN for word in words)
        return Reading(tuple(words)) if are_frequent else reading

    @cached_property
    def _frequency(self) -> Counter[str]:
        return Counter(self.text.split())

    def after(self, label: str, line: PrintedLine) -> str | None:
        """Return what stands right of a label, noise left of it noted; None where the row has another."""
        match = found(label, line)
        if match and (noise := match["before"].strip()):
            self.repair(line, RepairKind.BORDER, noise)
        return match["rest"] if match else None

    def repair(self, line: PrintedLine, kind: RepairKind, printed: str, read: str = "") -> None:
        """Note a repair of a line; with nothing to be read, what is left out."""
        self.repairs.append(Repair(line.number, kind, printed, read))

    def lost(self, line: PrintedLine, message: str) -> None:
        """Note a line that must mean something, but whose meaning is not legible."""
        self.unreadable.append(Problem(file=self.file, line=line.number, message=message, text=line.text))


def lines_of(text: str, notes: Notes) -> list[PrintedLine]:
    """Return the lines of a text: page headers are blank, form feeds and carriage control are gone.

    What is wider than `WIDEST` is blank too, and noted: no row of print.
    """
    lines = []
    for line in chain.from_iterable(paper_of(text, ListingLayout()).pages):
        width = len(line.text)
        if width > WIDEST:
            notes.lost(line._replace(text=line.text[:WIDEST]), f"a row of {width} characters: no listing has any")
        is_blank = width > WIDEST or ("PAGE" in line.text and _PAGE_HEADER.search(line.text))
        lines.append(line._replace(text="") if is_blank else line)
    return lines


def excerpts_of(lines: Sequence[PrintedLine]) -> Iterator[Excerpt]:
    """Yield the standard reports in their order; a title without a report below it makes an empty one."""
    starts = [
        (at, kind)
        for at, line in enumerate(lines)
        for kind, title, after in _TITLES
        if found(title, line, r"\W*", after)
    ]
    for (at, kind), (end, _) in pairwise([*starts, (len(lines), "")]):
        excerpt = Excerpt(kind, None, tuple(lines[at:end]))
        run = next((run for run, phrases in _RUNS if any(says(excerpt, one) for one in phrases)), None)
        yield replace(excerpt, refracted=run)


def says(excerpt: Excerpt, phrase: str) -> bool:
    """Tell whether one of the lines of a title has a phrase."""
    return any(found(phrase, line, r".*?\b", r"\b") for line in excerpt.lines[:_NEAR])


def rows_of(excerpt: Excerpt, labels: Mapping[Name, str], notes: Notes) -> dict[Name, tuple[PrintedLine, str]]:
    """Return the rows of a report by the names of their labels: the line, and what stands right of the label.

    They end where a label stands again: below it is a report whose title is not legible. Where there are rows, each
    that is not there, or has no legible label, is noted.
    """
    rows: dict[Name, tuple[PrintedLine, str]] = {}
    for line in excerpt.lines:
        rests = ((name, notes.after(label, line)) for name, label in labels.items())
        name, rest = next(((name, rest) for name, rest in rests if rest is not None), (None, ""))
        if name in rows:
            break
        if name is not None:
            rows[name] = (line, rest)
    notes.used.update(line.number for line, _ in rows.values())
    for name in labels if rows else ():
        if name not in rows:
            notes.lost(excerpt.lines[0], f"no row '{labels[name].split('|')[0]}' is legible below")
    return rows
