"""Rows of two sections -> pairs: by their ids, and where these do not tell, by what the rows have in common.

One row more or less leaves all others with their partners. Rows with ids of their own find each other wherever they
stand; among the rest the longest common order is kept (patience sorting: O(n log n)).
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

Key = Hashable
_DENSE = 40_000  # pairs of a gap that are all looked at
_NAMED = 0.5  # share of the rows that find each other by ids, without which ids are no guide
_ALIKE = 0.5  # share of fields that rows without a common id must have in common


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """Pairs (row of A, row of B) in the order of A, rows of one only, and rows of A that stand elsewhere in B."""

    pairs: list[tuple[int, int]]
    only_a: list[int]
    only_b: list[int]
    moved: frozenset[int]

    def steps(self) -> Iterator[tuple[int | None, int | None]]:
        """Yield the rows of A with their partners, those of B alone before the row whose partner follows them."""
        partner, waiting = dict(self.pairs), self.only_b[::-1]
        for n in sorted([*partner, *self.only_a]):
            other = partner.get(n)
            while waiting and other is not None and waiting[-1] < other:
                yield None, waiting.pop()
            yield n, other
        yield from ((None, other) for other in reversed(waiting))


def align(
    ids: tuple[Sequence[Key], Sequence[Key]],
    texts: tuple[Sequence[str], Sequence[str]],
    coarse: Callable[[int, int], Key],
    *,
    strict: bool,
) -> Alignment:
    """Return the alignment of rows.

    `ids` and `texts` are one per row of A and of B, ids that say nothing are false; `coarse(side, row)` is a key
    that rows of nearly equal numbers share. With `strict`, rows of different ids are never partners.
    """
    if all(ids[0]) and list(ids[0]) == list(ids[1]):
        return Alignment(pairs=[(n, n) for n in range(len(ids[0]))], only_a=[], only_b=[], moved=frozenset())
    rows = len(ids[0]), len(ids[1])
    named = _unique_pairs(ids[0], ids[1], range(rows[0]), range(rows[1]))
    if len(named) < _NAMED * min(rows):
        named = []  # the names of a few rows say nothing about the others
    kept = _increasing(named)
    moved = dict(set(named) - set(kept))
    gaps = _Gaps(ids, texts, coarse, strict)
    gone_b = set(moved.values())
    pairs = [*kept, *moved.items()]
    for (a0, b0), (a1, b1) in zip([(-1, -1), *kept], [*kept, rows], strict=True):
        if a1 > a0 + 1 and b1 > b0 + 1:
            rows_a = [n for n in range(a0 + 1, a1) if n not in moved]
            rows_b = [n for n in range(b0 + 1, b1) if n not in gone_b]
            pairs += gaps.pairs(rows_a, rows_b)
    elsewhere = _elsewhere(pairs, texts, coarse)
    pairs += elsewhere
    pairs.sort()
    return Alignment(
        pairs=pairs,
        only_a=_without({a for a, _ in pairs}, rows[0]),
        only_b=_without({b for _, b in pairs}, rows[1]),
        moved=frozenset([*moved, *(a for a, _ in elsewhere)]),
    )


def _without(partnered: set[int], rows: int) -> list[int]:
    """Return the rows without a partner."""
    return [] if len(partnered) == rows else [n for n in range(rows) if n not in partnered]


def _elsewhere(
    partners: Sequence[tuple[int, int]],
    texts: tuple[Sequence[str], Sequence[str]],
    coarse: Callable[[int, int], Key],
) -> list[tuple[int, int]]:
    """Return the pairs of rows that stand in another order: of one text, or of nearly equal numbers."""
    if len(partners) == min(map(len, texts)):
        return []
    with_a, with_b = {a for a, _ in partners}, {b for _, b in partners}
    alone = (
        [n for n in range(len(texts[0])) if n not in with_a and texts[0][n]],
        [n for n in range(len(texts[1])) if n not in with_b and texts[1][n]],
    )
    pairs: list[tuple[int, int]] = []
    for key in (lambda side, row: texts[side][row].split(), coarse):
        if not all(alone):
            break
        waiting: dict[Key, list[int]] = defaultdict(list)
        for n in reversed(alone[1]):
            waiting[repr(key(1, n))].append(n)
        new = [(n, waiting[name].pop()) for n in alone[0] if waiting.get(name := repr(key(0, n)))]
        pairs += new
        gone_a, gone_b = {a for a, _ in new}, {b for _, b in new}
        alone = [n for n in alone[0] if n not in gone_a], [n for n in alone[1] if n not in gone_b]
    return pairs


@dataclass(frozen=True)
class _Gaps:
    """What stands between rows that have found each other."""

    ids: tuple[Sequence[Key], Sequence[Key]]
    texts: tuple[Sequence[str], Sequence[str]]
    coarse: Callable[[int, int], Key]
    strict: bool

    def pairs(self, a: Sequence[int], b: Sequence[int]) -> list[tuple[int, int]]:
        """Return the pairs of a gap: equal texts at its ends and in it, nearly equal numbers, the most alike."""
        if not a or not b:
            return []
        if self._same_ids(a, b):
            return list(zip(a, b, strict=True))
        first = 0
        while first < min(len(a), len(b)) and self.texts[0][a[first]] == self.texts[1][b[first]]:
            first += 1
        last = 0
        room = min(len(a), len(b)) - first
        while last < room and self.texts[0][a[-1 - last]] == self.texts[1][b[-1 - last]]:
            last += 1
        ends = list(zip(a[:first], b[:first], strict=True))
        ends += zip(a[len(a) - last :], b[len(b) - last :], strict=True)
        a, b = a[first : len(a) - last], b[first : len(b) - last]
        return ends + self._between(a, b, self.texts, self._by_numbers)

    def _by_numbers(self, a: Sequence[int], b: Sequence[int]) -> list[tuple[int, int]]:
        if len(a) * len(b) <= _DENSE // 16:
            return self._most_alike(a, b)
        keys = ({n: self.coarse(0, n) for n in a}, {n: self.coarse(1, n) for n in b})
        return self._between(a, b, keys, self._most_alike)

    def _between(
        self,
        a: Sequence[int],
        b: Sequence[int],
        keys: tuple[object, object],
        otherwise: Callable[[Sequence[int], Sequence[int]], list[tuple[int, int]]],
    ) -> list[tuple[int, int]]:
        """Return the pairs of rows with a key of their own, and what `otherwise` makes of the rows between them."""
        if not a or not b:
            return []
        kept = _increasing(_unique_pairs(keys[0], keys[1], a, b))
        place_a, place_b = ({row: n for n, row in enumerate(rows)} for rows in (a, b))
        marks = [(-1, -1), *((place_a[row_a], place_b[row_b]) for row_a, row_b in kept), (len(a), len(b))]
        pairs = list(kept)
        for (a0, b0), (a1, b1) in pairwise(marks):
            pairs += otherwise(a[a0 + 1 : a1], b[b0 + 1 : b1])
        return pairs

    def _most_alike(self, a: Sequence[int], b: Sequence[int]) -> list[tuple[int, int]]:
        """Return the pairs, in order, that have most in common; of a large gap, row by row."""
        if not a or not b:
            return []
        if self._same_ids(a, b) or (len(a) == len(b) == 1 and not self.ids[0][a[0]] and not self.ids[1][b[0]]):
            return list(zip(a, b, strict=True))
        if len(a) * len(b) > _DENSE:
            return [pair for pair in zip(a, b, strict=False) if self._score(*pair) > 0.0]
        best = [[0.0] * (len(b) + 1) for _ in range(len(a) + 1)]
        score = [[self._score(row_a, row_b) for row_b in b] for row_a in a]
        for i in reversed(range(len(a))):
            for j in reversed(range(len(b))):
                with_both = best[i + 1][j + 1] + score[i][j] if score[i][j] > 0.0 else 0.0
                best[i][j] = max(with_both, best[i + 1][j], best[i][j + 1])
        pairs, i, j = [], 0, 0
        while i < len(a) and j < len(b):
            if score[i][j] > 0.0 and best[i][j] == best[i + 1][j + 1] + score[i][j]:
                pairs.append((a[i], b[j]))
                i, j = i + 1, j + 1
            elif best[i][j] == best[i + 1][j]:
                i += 1
            else:
                j += 1
        return pairs

    def _same_ids(self, a: Sequence[int], b: Sequence[int]) -> bool:
        ids = [self.ids[0][n] for n in a]
        return all(ids) and ids == [self.ids[1][n] for n in b]

    def _score(self, row_a: int, row_b: int) -> float:
        """Return how much two rows have in common; 0 where they are no partners."""
        id_a, id_b = self.ids[0][row_a], self.ids[1][row_b]
        fields_a, fields_b = self.texts[0][row_a].split(), self.texts[1][row_b].split()
        common = sum(x == y for x, y in zip(fields_a, fields_b, strict=False))
        alike = common / max(len(fields_a), len(fields_b), 1)
        if id_a and id_a == id_b:
            return 2.0 + alike
        if not id_a and not id_b:  # numbers only
            return 0.1 + alike if len(fields_a) == len(fields_b) else alike
        return alike if not self.strict and alike >= _ALIKE else 0.0


def _unique_pairs(keys_a: object, keys_b: object, a: Sequence[int], b: Sequence[int]) -> list[tuple[int, int]]:
    """Return the rows whose key no other row of their side has, with their partners, in the order of A."""
    count_a = Counter(keys_a[n] for n in a)  # type: ignore[index]
    count_b = Counter(keys_b[n] for n in b)  # type: ignore[index]
    place = {keys_b[n]: n for n in b}  # type: ignore[index]
    keyed = ((n, keys_a[n]) for n in a)  # type: ignore[index]
    return [(n, place[key]) for n, key in keyed if key and count_a[key] == 1 and count_b.get(key) == 1]


def _increasing(pairs: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the longest run of pairs, sorted by the first, whose second numbers grow."""
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
