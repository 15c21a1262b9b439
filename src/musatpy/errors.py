"""What can be wrong, as data: a `Problem` knows its file, line, columns and field; exceptions carry problems."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal, Self

_RULER = "".join(f"----+----{tens}" for tens in range(1, 9))
_SHOWN = 120  # columns of a card: a file without line ends is not printed whole
_OF_A_KIND, _ON_LINES = 100, 3  # problems that are printed, and how many more there are
_MOST_RANGES = 20  # of lines that are named
_QUOTED = re.compile(r"(?<!\w)'([^']{80})[^']+'")  # what is quoted from a file: where it begins says enough
_LONGEST = 2000  # characters of a message
_LIKE = 0.6  # of the letters of both: names that are taken for each other
_NAMES = re.compile(r"\b(photo|point|group|wave|camera|crest of) \S+|'[^']*'|(?<!\S)[^\s\d]*\d\S*")


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One thing wrong in the input.

    A problem of one card has `file`, `line` (1-based), `columns` (first and last, 1-based, inclusive),
    `card` (mnemonic), `field`, `found`, `expected` and `text` (the card image); a problem that only shows
    between cards (an unknown reference, a weak datum) has a `message` and whichever of these apply.
    """

    message: str = ""
    severity: Literal["error", "warning"] = "error"
    file: str | None = None
    line: int | None = None
    columns: tuple[int, int] | None = None
    card: str | None = None
    field: str | None = None
    found: str | None = None
    expected: str | None = None
    text: str | None = None

    def headline(self) -> str:
        """Return the problem in one line: `file:line cols 21-30 STA.heading: '1l.345' is not F10.3`."""
        place = self.file or ""
        if self.line is not None:
            place += f":{self.line}"
        if self.columns is not None:
            first, last = self.columns
            place += f" cols {first}-{last}" if last > first else f" col {first}"
        name = self.card or ""
        if self.field:
            name = f"{name}.{self.field}" if name else self.field
        what = shortened(self.message or f"'{self.found}' is not {self.expected}")
        head = " ".join(part for part in (place, name) if part)
        if self.severity == "warning":
            what = f"warning: {what}"
        return f"{head}: {what}" if head else what

    @property
    def kind(self) -> tuple[str, str | None, str | None, str]:
        """What it has in common with others that differ in names and numbers only."""
        return self.severity, self.card, self.field, without_names(self.message)

    def render(self) -> str:
        """Return the headline and, where the card is known, ruler, card image and carets below it."""
        lines = [self.headline()]
        if self.text is not None:
            shown = self.text if len(self.text) <= _SHOWN else f"{self.text[:_SHOWN]}..."
            shown = "".join(letter if letter.isprintable() else "?" for letter in shown)  # one each: carets follow
            lines += [f"    {_RULER}", f"    {shown}"]
            if self.columns is not None and self.columns[0] <= _SHOWN:
                first, last = self.columns
                lines.append("    " + " " * (first - 1) + "^" * (min(last, _SHOWN) - first + 1))
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.headline()


class MusatError(Exception):
    """Base of every error that musatpy raises on purpose; a command prints it and exits without a traceback."""


class ProblemsError(MusatError):
    """The input cannot be used; `problems` lists every reason, worst information first as found."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems: tuple[Problem, ...] = tuple(problems)
        super().__init__("\n".join(problem.headline() for problem in self.problems))

    @classmethod
    def of(cls, message: object, file: object = None, **place: Any) -> Self:
        """Return the error of one problem: its message, its file, and where it is there as `Problem` has it."""
        return cls([Problem(message=str(message), file=None if file is None else str(file), **place)])


class DeckError(ProblemsError):
    """A deck that cannot be read, or that contradicts itself."""


class PlatesError(DeckError):
    """Raw plates that cannot be reduced; `refusals` says of each photo why, `by_heights` whom heights refuse."""

    def __init__(self, refusals: Mapping[str, str], by_heights: Iterable[str] = ()) -> None:
        self.refusals = dict(refusals)
        self.by_heights = frozenset(by_heights)
        super().__init__(Problem(message=f"photo {photo}: {why}") for photo, why in self.refusals.items())


class AdjustmentError(ProblemsError):
    """A block that reads well but cannot be adjusted (no datum, a singular system, ...)."""


class NumericalError(AdjustmentError):
    """Equations that linear algebra cannot solve, or numbers beyond those of the machine."""


@contextmanager
def numerics(what: str) -> Iterator[None]:
    """Turn what arithmetic and LAPACK's callers raise into a `NumericalError`: `what` cannot be computed."""
    try:
        yield
    except (ArithmeticError, ValueError) as error:
        refused = numerical(error, what)
        if refused is None:
            raise
        raise refused from error


def numerical(error: Exception, what: str) -> NumericalError | None:
    """Return the error of arithmetic or of LAPACK's callers as a `NumericalError`, None where it is another one.

    numpy's error goes by its name, for numpy is not loaded where nothing is computed; scipy's has only its text.
    """
    if isinstance(error, NumericalError):
        return error
    refused = type(error).__name__ == "LinAlgError" or "infs or NaNs" in str(error)
    if not refused and not isinstance(error, ArithmeticError):
        return None
    why = "points or stations have run away, as gross errors make them"
    return NumericalError([Problem(message=f"{what} cannot be computed: {why}")])


class MissingPackageError(MusatError):
    """A package of an extra that is not installed; `use` is what needs it: `pictures need`."""

    def __init__(self, use: str, package: str, extra: str) -> None:
        super().__init__(f"{use} the package {package}: pip install 'musatpy[{extra}]'")


class CardFormatError(MusatError):
    """A card format file (TOML) that is wrong: overlap, unknown key, a width that does not fit the descriptor."""


class RecordError(ProblemsError):
    """A file of JSON that is none, or the record of a run that is not as its schema says."""


class SpecError(ProblemsError):
    """A spec (of a simulation, of waves) that cannot be read or that asks for something impossible."""


class DepthError(ProblemsError):
    """A file of cameras or points that cannot be used, or an extra package that is not installed."""


class CompilationError(ProblemsError):
    """A triangulation, a stereomodel or readings in one that cannot be used."""


class SoundingError(ProblemsError):
    """A file of soundings that cannot be used."""


class SurfaceError(ProblemsError):
    """Points that make no surface, or contours that cannot be drawn."""


class SystemsError(ProblemsError):
    """A coordinate system that cannot be used, or something that cannot be stated in it."""


class CollocationError(ProblemsError):
    """Points or control points that cannot be read, or between which nothing can be interpolated."""


class SeaError(ProblemsError):
    """A file of points on the water, or of a surface, that cannot be used."""


class InterchangeError(ProblemsError):
    """A file of another program that cannot be read, or written as asked, or an extra package that is missing."""


def count_of(number: int, noun: str) -> str:
    """Return a number with its noun, in the plural where it needs it."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def without_names(text: str) -> str:
    """Return what a message has in common with others of its kind: all but names, quoted text and numbers."""
    return _NAMES.sub("", text)


def nearest(name: str, known: Iterable[str]) -> str:
    """Return what may be meant by a name that there is not, the first of equally likely ones; empty for nothing."""
    from difflib import SequenceMatcher  # names are rarely wrong

    likeness = {other: SequenceMatcher(None, name, other).ratio() for other in known}
    best = max(likeness, key=lambda other: likeness[other], default="")
    return best if likeness.get(best, 0.0) >= _LIKE else ""


def nearest_or_all(name: str, known: Iterable[str]) -> str:
    """Return the end of a message about a name that there is not: what may be meant, or else all that there are."""
    names = list(known)
    likely = nearest(name, names)
    return f"; did you mean {likely}?" if likely else f"; there are {', '.join(names)}"


def shortened(text: str) -> str:
    """Return a message of which quoted texts have 80 characters at most, and all of it some thousand."""
    text = _QUOTED.sub(r"'\1...'", text)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def in_order(problems: Iterable[Problem]) -> tuple[Problem, ...]:
    """Return problems by line and column, those of all of a file first."""
    return tuple(sorted(problems, key=lambda problem: (problem.line or 0, problem.columns or (0, 0))))


def of_each_kind(problems: Iterable[Problem]) -> Iterator[Problem]:
    """Yield the first problems of every kind, and after them how many more of it there are, and on which lines.

    Three where they stand on lines, else a hundred, whose names stand nowhere else.
    """
    every = tuple(problems)
    totals, printed = Counter(problem.kind for problem in every), Counter[tuple[str, str | None, str | None, str]]()
    lines: dict[tuple[str, str | None, str | None, str], list[int]] = {}
    for problem in every:
        kind, most = problem.kind, _OF_A_KIND if problem.line is None else _ON_LINES
        printed[kind] += 1
        if printed[kind] <= most:
            yield problem
            continue
        if problem.line is not None:
            lines.setdefault(kind, []).append(problem.line)
        if printed[kind] == totals[kind]:
            where = f", on line{'s' * (len(lines[kind]) > 1)} {_ranges(lines[kind])}" if kind in lines else ""
            message = f"... and {totals[kind] - most:,} more of this kind{where}"
            yield replace(problem, message=message, line=None, columns=None, found=None, expected=None, text=None)


def _ranges(lines: Iterable[int]) -> str:
    """Return numbers as people write them: 3, 5-9, 12; of many the first ones and the last."""
    every = sorted(set(lines))
    starts = [
        line for line, before in zip(every, [None, *every], strict=False) if before is None or line > before + 1
    ]
    ends = [
        line for line, after in zip(every, [*every[1:], None], strict=True) if after is None or after > line + 1
    ]
    parts = [f"{first}-{last}" if last > first else f"{first}" for first, last in zip(starts, ends, strict=True)]
    return ", ".join(parts if len(parts) <= _MOST_RANGES else [*parts[:_MOST_RANGES], "...", parts[-1]])


def and_warnings(problems: Iterable[Problem], texts: Iterable[str], file: str | None = None) -> list[Problem]:
    """Return problems, and warnings with these texts after them, about a file where one is named."""
    return [*problems, *(Problem(file=file, message=text, severity="warning") for text in texts)]


def printable(text: str) -> str:
    """Return a text with an escape (`\\x1b`) for each character that disturbs a terminal, XML or a comparison.

    These are control characters but line ends and tabs, marks of direction and the like, and what is no character.
    """
    disturbing = [character for character in set(text) if not (character.isprintable() or character in "\n\t")]
    return text.translate({ord(character): character.encode("unicode_escape").decode() for character in disturbing})
