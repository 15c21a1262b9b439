"""Words of a row -> cells, with the repairs that these take.

A row is read by what its cells must be (a count, an id, a number, a sexagesimal angle), never by columns. Scanned
words may be broken (`84 6`) or run together (`00.454`); each departure from the text has a cost. The cheapest
division of the words into cells is taken, and none where two of them are equally good.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from itertools import combinations, pairwise
from typing import Literal, NamedTuple

Kind = Literal["count", "id", "number", "angle"]

_TAGS = re.compile(r"</?\w+>")
_BULLETS = "\u2022\u00b7\u2219"
_ONES, _ZEROS = "lI|!", "Oo"
_BORDERS = frozenset("1lI|![]{}")  # what a vertical rule at the edge of a row is read as
_BAR = re.compile(r"^[|!](?=\d)|(?<=\d)[|!]$")  # at the end of an id: a rule, or a 1
# Numbers of at most 15 digits, which are exact.
_FORMS = {
    "count": re.compile(r"0|[1-9]\d{0,14}"),
    "id": re.compile(r"[^\W_][\w./+-]*"),
    "number": re.compile(r"-?(?:0|[1-9]\d{0,14})?\.\d{1,15}"),
    "angle": re.compile(r"-?\d{1,3} \d{1,2} \d{0,2}\.\d{1,15}"),
}
# Angles whose fields have run together: the degrees would be lost, were they not 0.
_SECONDS_JOINED = re.compile(r"(?P<degrees>-?0)(?P<digits>\d{1,4}| \d{2,4})(?P<decimals>\.\d+)")
_MINUTES_JOINED = re.compile(r"(-?0)(\d{1,2}) (\d*\.\d+)")
_MOST_WORDS = 4  # of a cell
_MOST_READINGS = 8  # that are kept of the same words
_UNEVEN = 2  # per character that an id or a count is longer or shorter than those beside it; for other decimals
_CHEAP, _DEAR = 1, 3  # joining words one of which is a fragment, or two whole ones


class RepairKind(StrEnum):
    """The repairs of scanned text that are allowed; nothing else is changed, and each one made is reported."""

    STRAY = "stray character"  # punctuation or mark-up that belongs to no number
    BORDER = "border of the table"  # a 1, l, |, [ or ] at the edge of a row, left of the ruling
    BULLET = "point read as bullet"  # `•281` is .281
    HYPHEN = "point read as hyphen"  # `903378-8` is 903378.8
    ONE = "1 read as letter"  # l, I, |, !
    ZERO = "0 read as letter"  # O, o
    SPLIT = "split number"  # `84 6` is 846
    JOINED = "fields run together"  # `00.454` is 0 0 .454
    POINT = "lost point"  # `66` where the column has two decimals is .66
    LABEL = "axis by its place"  # the X, Y or Z of a row is not legible


@dataclass(frozen=True)
class Repair:
    """One repair: what stood in the text, and what was read."""

    line: int  # 1-based
    kind: RepairKind
    found: str
    read: str


class Reading(NamedTuple):
    """Words read as cells: their texts, the repairs (kind, found, read) that these take, and what they cost."""

    texts: tuple[str, ...] = ()
    changes: tuple[tuple[RepairKind, str, str], ...] = ()
    cost: int = 0

    def repaired(self, kind: RepairKind, text: str, cost: int = 1) -> Reading:
        """Return a reading of one cell with another text, at a cost; itself where the text is the same."""
        if text == self.texts[0]:
            return self
        return Reading((text,), (*self.changes, (kind, self.texts[0], text)), self.cost + cost)

    def then(self, other: Reading) -> Reading:
        """Return this reading followed by that of the words behind it."""
        return Reading(self.texts + other.texts, self.changes + other.changes, self.cost + other.cost)

    def repairs(self, line: int) -> list[Repair]:
        """Return the repairs of a line."""
        return [Repair(line, *change) for change in self.changes]


def read_cells(
    text: str, kinds: Sequence[Kind], places: Sequence[int | None] | None = None, width: int | None = None
) -> Reading | None:
    """Return the cheapest reading of a text; None where there is none, or two that differ cost the same.

    `places` are the decimals that the columns of the cells have. A cell with others costs more, and where a column
    has two or more, a number of as many digits is taken to have lost its point. An id or count of another `width`
    costs more, too; that is the width of most of the row where it is not given.
    """
    words, kinds = tuple(_TAGS.sub(" ", text).split()), tuple(kinds)
    if len(words) > _MOST_WORDS * len(kinds) + 6:
        return None
    readings = _readings(words, kinds, tuple(places or [None] * len(kinds)))
    best = _cheapest([_with_widths(reading, kinds, width) for reading in readings])
    if not best or (len(best) > 1 and best[0].cost == best[1].cost):
        return None
    return Reading(changes=tuple((RepairKind.STRAY, tag, "") for tag in _TAGS.findall(text))).then(best[0])


@lru_cache(maxsize=4096)
def _readings(words: tuple[str, ...], kinds: tuple[Kind, ...], places: tuple[int | None, ...]) -> list[Reading]:
    """Return the cheapest readings of all words as all cells."""
    # (first word, first cell) -> readings of what follows.
    best: dict[tuple[int, int], list[Reading]] = {(len(words), len(kinds)): [Reading()]}
    for at in reversed(range(len(words))):
        for n in range(len(kinds) + 1):
            found = [left_out.then(rest) for left_out in _left_out(words, at) for rest in best.get((at + 1, n), ())]
            for end in range(at + 1, min(at + _MOST_WORDS, len(words)) + 1):
                following = best.get((end, n + 1), ())
                cells = _cells(words[at:end], kinds[n], places[n]) if following else ()
                found += [cell.then(rest) for cell in cells for rest in following]
            best[at, n] = _cheapest(found)
    return best[0, 0] if words else []


def _left_out(words: tuple[str, ...], at: int) -> Iterator[Reading]:
    """Yield the reading of a word that is no cell: the border of a table, or a mark."""
    word = words[at]
    is_border, is_mark = at in (0, len(words) - 1) and word in _BORDERS, not re.search(r"[^\W_]", word)
    if is_border or is_mark:
        kind = RepairKind.BORDER if is_border else RepairKind.STRAY
        yield Reading(changes=((kind, word, ""),), cost=1 if is_mark else 2)


def _cheapest(readings: list[Reading]) -> list[Reading]:
    """Return the cheapest readings, the first before all, those of the same texts once."""
    unique: dict[tuple[str, ...], Reading] = {}
    for reading in sorted(readings, key=lambda reading: reading.cost):
        unique.setdefault(reading.texts, reading)
    return list(unique.values())[:_MOST_READINGS]


def _with_widths(reading: Reading, kinds: tuple[Kind, ...], usual: int | None) -> Reading:
    """Return a reading, dearer where its ids or counts are of unequal width."""
    cells = zip(reading.texts, kinds, strict=True)
    widths = sorted(len(text) for text, kind in cells if kind in ("id", "count"))
    if usual is None and widths:
        usual = widths[len(widths) // 2]
    return reading._replace(cost=reading.cost + _UNEVEN * sum(abs(width - (usual or 0)) for width in widths))


@lru_cache(maxsize=4096)
def _cells(words: tuple[str, ...], kind: Kind, places: int | None) -> tuple[Reading, ...]:
    """Return what words can be as one cell."""
    joined = _join(words)
    if kind == "id":
        barred = joined.repaired(RepairKind.ONE, _BAR.sub("1", joined.texts[0]))
        cells = [_clean(cell, kind) for cell in dict.fromkeys((joined, barred))]
    elif kind == "angle":
        cuts = combinations(range(1, len(words)), 2)
        cells = [*_joined_angles(words), *(_angle(words[:m], words[m:s], words[s:]) for m, s in cuts)]
    else:
        cells = [_clean(joined, kind)]
        text = cells[0].texts[0]
        if kind == "number" and places and places > 1 and re.fullmatch(rf"\d{{{places}}}", text):
            cells = [cells[0].repaired(RepairKind.POINT, f".{text}", 2)]
    legible = [cell for cell in cells if _FORMS[kind].fullmatch(cell.texts[0])]
    unusual = [places not in (None, len(cell.texts[0].partition(".")[2])) for cell in legible]
    return tuple(
        cell._replace(cost=cell.cost + _UNEVEN * other) for cell, other in zip(legible, unusual, strict=True)
    )


def _join(words: tuple[str, ...]) -> Reading:
    """Return words as one, at the cost of joining them."""
    cost = 0
    for left, right in pairwise(words):
        is_fragment = len(right) == 1 or len(left) == 1 or right[0] in f".{_BULLETS}" or left[-1] == "."
        cost += _CHEAP if is_fragment else _DEAR
    return Reading((" ".join(words),)).repaired(RepairKind.SPLIT, "".join(words), cost)


def _clean(cell: Reading, kind: Kind) -> Reading:
    """Return a cell with the characters of a number put right; ids with letters stay as they are."""
    for pattern, new, what in _replacements(kind):
        cell = cell.repaired(what, re.sub(pattern, new, cell.texts[0]))
    return cell


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


def _angle(*fields: tuple[str, ...]) -> Reading:
    """Return degrees, minutes and seconds as one cell."""
    whole = Reading()
    kinds: tuple[Kind, ...] = ("count", "count", "number")
    for words, kind in zip(fields, kinds, strict=True):
        whole = whole.then(_clean(_join(words), kind))
    return whole._replace(texts=(" ".join(whole.texts),))


def _joined_angles(words: tuple[str, ...]) -> Iterator[Reading]:
    """Yield degrees, minutes, seconds of fields run together: all three, the first two, or the last two.

    Where the minutes may end after one digit or after two, both are yielded, and so none is taken.
    """
    cells = [_clean(Reading((word,)), "number") for word in words]
    text, changes = " ".join(cell.texts[0] for cell in cells), sum((cell.changes for cell in cells), ())
    fields: list[tuple[str, ...]] = []
    if match := _SECONDS_JOINED.fullmatch(text):
        digits = match["digits"].strip()
        fields = [(match["degrees"], digits[:n], digits[n:] + match["decimals"]) for n in (1, 2)]
    elif match := _MINUTES_JOINED.fullmatch(text):
        fields = [match.groups()]
    for angle in dict.fromkeys(fields):
        if int(angle[1]) < 60:
            read = " ".join(angle)
            yield Reading((" ".join(words),), changes, len(changes)).repaired(RepairKind.JOINED, read)
