"""Rows of two tables -> pairs: by their names, rows without a name by their text.

The longest common order of names is kept, so that one row more or less leaves all others with their partners; a
name that stands elsewhere is a pair that moved. Names are made unique (the second `21` is another one than the
first), so that the longest common order is the longest run of growing places. `difflib` takes the square of rows
for it where every second one differs: 55 s for 10,000.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Sequence
from typing import NamedTuple


class Step(NamedTuple):
    """A row of A and its partner in B, or a row of one of them only."""

    a: int | None
    b: int | None
    moved: bool = False  # the partner stands elsewhere


def align(
    names: tuple[Sequence[Hashable], Sequence[Hashable]],
    texts: tuple[Sequence[str], Sequence[str]],
    *,
    strict: bool,
) -> Iterator[Step]:
    """Yield the rows of A in their order, each with its partner, and between them the rows of B alone.

    `names` and `texts` are one per row of A and of B, names that say nothing are false. As many rows of A as of B
    between two pairs are taken for each other one by one; with `strict` only those without names are.
    """
    if all(names[0]) and list(names[0]) == list(names[1]):
        yield from (Step(n, n) for n in range(len(names[0])))
        return
    keys = [_unique(zip(*side, strict=True)) for side in zip(names, texts, strict=True)]
    places = {key: n for n, key in enumerate(keys[1])}
    pairs = [(n, places[key]) for n, key in enumerate(keys[0]) if key in places]
    kept = _increasing(pairs)
    elsewhere = dict(set(pairs).difference(kept))
    taken = set(elsewhere.values())
    sizes = len(keys[0]), len(keys[1])
    for (a0, b0), (a1, b1) in zip([(-1, -1), *kept], [*kept, sizes], strict=True):
        rows = [n for n in range(a0 + 1, a1) if n not in elsewhere]
        others = [m for m in range(b0 + 1, b1) if m not in taken]
        partners = {
            n: m
            for n, m in zip(rows, others, strict=False)
            if len(rows) == len(others) and not (strict and (names[0][n] or names[1][m]))
        }
        for n in range(a0 + 1, a1):
            yield Step(n, elsewhere[n], moved=True) if n in elsewhere else Step(n, partners.get(n))
        paired = set(partners.values())
        yield from (Step(None, m) for m in others if m not in paired)
        if a1 < sizes[0]:
            yield Step(a1, b1)


def _unique(rows: Iterable[tuple[Hashable, str]]) -> list[Hashable]:
    """Return a key of each row: its name or else its text, with how many of the same stand before."""
    counts: Counter[Hashable] = Counter()
    keys: list[Hashable] = []
    for name, text in rows:
        key = name or (" ".join(text.split()),)
        keys.append((key, counts[key]))
        counts[key] += 1
    return keys


def _increasing(pairs: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the longest run of pairs, sorted by the first, whose second numbers grow (patience sorting)."""
    tails: list[int] = []
    ends: list[int] = []  # the pair that ends the best run of each length
    before = [-1] * len(pairs)
    for n, (_, b) in enumerate(pairs):
        length = bisect_left(tails, b)
        before[n] = ends[length - 1] if length else -1
        tails[length : length + 1] = [b]
        ends[length : length + 1] = [n]
    longest = []
    n = ends[-1] if ends else -1
    while n >= 0:
        longest.append(pairs[n])
        n = before[n]
    return longest[::-1]
