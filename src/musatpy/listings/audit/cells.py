"""Words of a row -> cells: the reading with the fewest repairs, and none where two readings are equally good.

A row is read by what its cells must be (a count, an id, a number, a sexagesimal angle), never by columns. Scanned
words may be broken (`84 6`) or run together (`00.454`); each departure from the text has a cost, and the cheapest
division of the words into cells is taken.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Literal, NamedTuple

from musatpy.listings.audit.structures import Printed, Repair, RepairKind

Kind = Literal["count", "id", "number", "angle"]

_TAGS = re.compile(r"</?\w+>")
_BULLETS = "\u2022\u00b7\u2219"
_ONES, _ZEROS = "lI|!", "Oo"
EDGES = frozenset("1lI|![]{}")  # what a vertical rule at the edge of a row is read as
_ID = re.compile(r"[^\W_][\w./+-]*")
_EDGE = re.compile(r"^[|!](?=\d)|(?<=\d)[|!]$")
_COUNT = re.compile(r"0|[1-9]\d{0,14}")  # exact as a number
_NUMBER = re.compile(r"-?(?:0|[1-9]\d{0,14})?\.\d{1,15}")
_DEGREES, _MINUTES, _SECONDS = (re.compile(p) for p in (r"-?\d{1,3}", r"\d{1,2}", r"\d{0,2}\.\d{1,15}"))
_JOINED = re.compile(r"(?P<degrees>-?0)(?P<rest>\d{1,4})(?P<decimals>\.\d+)?")  # degrees lost, were they not 0
_ANGLE: tuple[Kind, ...] = ("count", "count", "number")  # degrees, minutes, seconds
_MOST_WORDS = 4  # of a cell
_UNEVEN = 2  # per character that an id or a count is longer or shorter than those beside it; for other decimals
_CHEAP, _DEAR = 1, 3  # joining words one of which is a fragment, or two whole ones


Change = tuple[RepairKind, str, str]  # what stood there, and what is read


class Cell(NamedTuple):
    """One cell: its text with blanks between fields, the repairs, and what they cost."""

    text: str
    repairs: tuple[Change, ...] = ()
    cost: int = 0

    def after(self, before: Cell) -> Cell:
        """Return a cell that was repaired before, with all its repairs."""
        return Cell(self.text, (*before.repairs, *self.repairs), before.cost + self.cost)


class Reading(NamedTuple):
    """A row divided into cells."""

    cells: tuple[Cell, ...]
    dropped: tuple[Change, ...] = ()
    cost: int = 0

    @classmethod
    def of(cls, words: Iterable[str]) -> Reading:
        """Return words that are cells as they stand."""
        return cls(tuple(map(Cell, words)))

    @property
    def texts(self) -> tuple[str, ...]:
        """The cells as they are read."""
        return tuple(cell.text for cell in self.cells)

    def repairs(self, line: int) -> list[Repair]:
        """Return all repairs of the row."""
        changes = [*self.dropped, *(repair for cell in self.cells for repair in cell.repairs)]
        return [Repair(line, *change) for change in changes]


def words_of(text: str) -> tuple[str, ...]:
    """Return the words of a row, mark-up left out."""
    return tuple(_TAGS.sub(" ", text).split())


def markup_of(text: str, line: int) -> list[Repair]:
    """Return the mark-up that `words_of` leaves out."""
    return [Repair(line, RepairKind.STRAY, tag, "") for tag in _TAGS.findall(text)]


def read_cells(
    words: Sequence[str],
    kinds: Sequence[Kind],
    decimals: int | None = None,
    places: Sequence[int | None] | None = None,
    width: int | None = None,
) -> Reading | None:
    """Return the cheapest reading of a row; None where there is none, or two that differ cost the same.

    With `decimals`, a number without a point is taken to have lost it before that many last digits. With `places`,
    a cell with other decimals than its column has costs more. So does an id or count of another `width`, which is
    that of most of the row where it is not given.
    """
    places = tuple(places or [None] * len(kinds))
    if _is_whole(words, kinds, places):
        return Reading.of(words)
    best = _readings(tuple(words), tuple(kinds), decimals, places, width)
    if not best or (len(best) > 1 and best[0].cost == best[1].cost):
        return None
    return best[0]


def _is_whole(words: Sequence[str], kinds: Sequence[Kind], places: Sequence[int | None]) -> bool:
    """Tell whether words are numbers as they should be, or one count: any other reading is dearer."""
    if len(words) == 1 and tuple(kinds) == ("count",):
        return _COUNT.fullmatch(words[0]) is not None
    return len(words) == len(kinds) and all(
        kind == "number" and _NUMBER.fullmatch(word) and place in (None, len(word.partition(".")[2]))
        for word, kind, place in zip(words, kinds, places, strict=True)
    )


@lru_cache(maxsize=4096)
def _readings(
    words: tuple[str, ...],
    kinds: tuple[Kind, ...],
    decimals: int | None,
    places: tuple[int | None, ...],
    width: int | None,
) -> list[Reading]:
    """Return at most two readings with different texts, the cheapest first."""
    if len(words) > _MOST_WORDS * len(kinds) + 6:
        return []
    # (words used, cells read) -> partial readings; a handful of the cheapest of each is kept.
    states: dict[tuple[int, int], list[Reading]] = {(0, 0): [Reading(())]}
    for used in range(len(words) + 1):
        for done in range(len(kinds) + 1):
            for reading in states.get((used, done), ()):
                for step, cells, following in _steps(words, used, kinds, done, reading, decimals):
                    states.setdefault((used + step, cells), []).append(following)
        for done in range(len(kinds) + 1):
            if (used + 1, done) in states:
                states[used + 1, done] = _cheapest(states[used + 1, done])
    finished = [_with_widths(reading, kinds, places, width) for reading in states.get((len(words), len(kinds)), ())]
    return _cheapest(finished)[:2]


def _steps(
    words: tuple[str, ...],
    used: int,
    kinds: tuple[Kind, ...],
    done: int,
    reading: Reading,
    decimals: int | None,
) -> Iterator[tuple[int, int, Reading]]:
    """Yield what can follow: a word dropped, or a cell of one or more words."""
    if used == len(words):
        return
    word = words[used]
    edge = used in (0, len(words) - 1) and word in EDGES
    mark = not re.search(r"[^\W_]", word)
    if edge or mark:
        kind = RepairKind.BORDER if edge else RepairKind.STRAY
        cost = reading.cost + (1 if mark else 2)
        yield 1, done, Reading(reading.cells, (*reading.dropped, (kind, word, "")), cost)
    if done < len(kinds):
        for count in range(1, min(_MOST_WORDS, len(words) - used) + 1):
            for cell in _cells(words[used : used + count], kinds[done], decimals):
                yield count, done + 1, Reading((*reading.cells, cell), reading.dropped, reading.cost + cell.cost)


def _cheapest(readings: list[Reading]) -> list[Reading]:
    unique: dict[tuple[str, ...], Reading] = {}
    for reading in sorted(readings, key=lambda r: r.cost):
        unique.setdefault(reading.texts, reading)
    return list(unique.values())[:8]


def _with_widths(
    reading: Reading, kinds: tuple[Kind, ...], places: tuple[int | None, ...], usual: int | None
) -> Reading:
    """Return the reading, dearer where its ids or counts are of unequal width, or its decimals unusual."""
    widths = sorted(
        len(cell.text) for cell, kind in zip(reading.cells, kinds, strict=True) if kind in ("id", "count")
    )
    if usual is None and widths:
        usual = widths[len(widths) // 2]
    uneven = sum(abs(width - (usual or 0)) for width in widths)
    uneven += sum(
        place is not None and len(cell.text.partition(".")[2]) != place
        for cell, place in zip(reading.cells, places, strict=True)
    )
    return Reading(reading.cells, reading.dropped, reading.cost + _UNEVEN * uneven)


@lru_cache(maxsize=4096)
def _cells(words: tuple[str, ...], kind: Kind, decimals: int | None) -> tuple[Cell, ...]:
    """Return what `words` can be as one cell."""
    if kind == "angle":
        return tuple(_angles(words))
    joined = _join(words)
    if kind == "id":
        return tuple(_ids(joined))
    cell = _clean(joined.text, kind).after(joined)
    if kind == "number" and decimals and re.fullmatch(rf"-?\d{{{decimals}}}", cell.text):
        pointed = re.sub(r"(?=\d)", ".", cell.text, count=1)
        return (Cell(pointed, ((RepairKind.POINT, cell.text, pointed),), 2).after(cell),)
    pattern = {"count": _COUNT, "number": _NUMBER}[kind]
    return (cell,) if pattern.fullmatch(cell.text) else ()


def _ids(joined: Cell) -> Iterator[Cell]:
    """Yield what an id can be: a bar at its end is a ruling, or a 1."""
    ended = re.sub(_EDGE, "1", joined.text)
    barred = Cell(ended, ((RepairKind.ONE, joined.text, ended),), 1).after(joined)
    for cell in (joined, barred) if ended != joined.text else (joined,):
        cleaned = _clean(cell.text, "id")
        if _ID.fullmatch(cleaned.text):
            yield cleaned.after(cell)


def _join(words: tuple[str, ...]) -> Cell:
    """Return words as one, at the cost of joining them."""
    text = "".join(words)
    if len(words) == 1:
        return Cell(text)
    cost = 0
    for left, right in pairwise(words):
        fragment = len(right) == 1 or len(left) == 1 or right[0] in f".{_BULLETS}" or left[-1] == "."
        cost += _CHEAP if fragment else _DEAR
    return Cell(text, ((RepairKind.SPLIT, " ".join(words), text),), cost)


def _clean(word: str, kind: Kind) -> Cell:
    """Return a word with the characters of a number put right; ids with letters stay as they are."""
    text, repairs = word, []
    for pattern, new, what in _replacements(kind):
        repaired = re.sub(pattern, new, text)
        if repaired != text:
            repairs.append((what, text, repaired))
            text = repaired
    return Cell(text, tuple(repairs), len(repairs))


def _replacements(kind: Kind) -> Iterator[tuple[str, str, RepairKind]]:
    if kind == "id":
        yield r"^[\W_]+|[\W_]+$", "", RepairKind.STRAY
        yield rf"(?<=\d)[{_ONES}]|[{_ONES}](?=\d)", "1", RepairKind.ONE
        yield rf"(?<=\d)[{_ZEROS}]|[{_ZEROS}](?=\d)", "0", RepairKind.ZERO
        return
    yield rf"[{_BULLETS}]", ".", RepairKind.BULLET
    yield rf"[{_ONES}]", "1", RepairKind.ONE
    yield rf"[{_ZEROS}]", "0", RepairKind.ZERO
    yield r"""^[,;:'"`_*]+|[,;:'"`_*]+$""", "", RepairKind.STRAY
    if kind == "count":
        yield r"[.]", "", RepairKind.STRAY
    else:
        yield r"(?<=\d)-(?=\d+$)", ".", RepairKind.HYPHEN


def _angles(words: tuple[str, ...]) -> Iterator[Cell]:
    """Yield degrees, minutes, seconds from two to four words, or from fields run together."""
    yield from _joined_angles(words)
    for groups in _divisions(words):
        joined = [_join(group) for group in groups]
        cells = [_clean(cell.text, kind) for cell, kind in zip(joined, _ANGLE, strict=True)]
        patterns = (_DEGREES, _MINUTES, _SECONDS)
        if all(pattern.fullmatch(cell.text) for pattern, cell in zip(patterns, cells, strict=True)):
            repairs = sum((cell.repairs for cell in (*joined, *cells)), ())
            yield Cell(" ".join(cell.text for cell in cells), repairs, sum(cell.cost for cell in (*joined, *cells)))


def _joined_angles(words: tuple[str, ...]) -> Iterator[Cell]:
    """Yield degrees, minutes, seconds of fields run together: all three, the first two, or the last two.

    Where the minutes may end after one digit or after two, both are yielded, and so none is taken.
    """
    if len(words) > 2:
        return
    first, *rest = [_clean(word, "number") for word in words]
    alone = first.text in ("0", "-0")
    match = _JOINED.fullmatch(first.text + (rest[0].text if rest and alone else ""))
    if match is None or (rest and alone and len(match["rest"]) < 2):  # with one digit, minutes or seconds are lost
        return
    digits, decimals = match["rest"], match["decimals"] or ""
    fields = [(match["degrees"], digits, rest[0].text)] if rest and not alone else []
    if decimals and (alone or not rest):
        fields = [(match["degrees"], digits[:n], digits[n:] + decimals) for n in (1, 2)]
    repairs = sum((cell.repairs for cell in (first, *rest)), ())
    for degrees, minutes, seconds in dict.fromkeys(fields):
        if _MINUTES.fullmatch(minutes) and int(minutes) < 60 and _SECONDS.fullmatch(seconds):
            text = f"{degrees} {minutes} {seconds}"
            yield Cell(text, (*repairs, (RepairKind.JOINED, " ".join(words), text)), len(repairs) + 1)


def _divisions(words: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], ...]]:
    for first in range(1, len(words) - 1):
        for second in range(first + 1, len(words)):
            yield words[:first], words[first:second], words[second:]


def printed(text: str, line: int) -> Printed:
    """Return the number of a cell: seconds of `-0 8 46.908`, or the number itself, with half its last digit."""
    parts = text.split()
    value, decimals = float(parts[-1]), len(parts[-1].partition(".")[2])
    if len(parts) == 3:
        value = abs(int(parts[0])) * 3600.0 + int(parts[1]) * 60.0 + value
        value = -value if parts[0].startswith("-") else value
    return Printed(value=value, half=0.5 * 10.0**-decimals, text=text, line=line)
