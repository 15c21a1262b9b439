"""Two files, section by section: rows find each other by their names, then the fields of each pair are weighed."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from musatpy.listings.findings import Finding, FindingKind, Place, RuleUse, Tally
from musatpy.listings.judge import (
    Field,
    RuleSet,
    Spot,
    allows,
    decider,
    of_row,
    of_section,
    still_open,
    touch_rows,
    weighed,
)
from musatpy.listings.tokens import Token

Texts = tuple[str | None, str | None]  # of A and of B
NOWHERE = Place()
Key = tuple[Hashable, str]  # what a row is about, false where nothing says so; its text


class Pair(NamedTuple):
    """Two rows that belong together, or one alone: their name and places, and the rules that select them."""

    name: str = ""
    a: Place = NOWHERE
    b: Place = NOWHERE
    spot: Spot = Spot()
    among: RuleSet = ()


class Comparison:
    """A section of A and of B, or of one only: its rules, and what was found; `rows` are those of both."""

    counts_digits = True  # numbers have a last digit
    rows: tuple[Sequence[Any], Sequence[Any]]

    def __init__(self, rules: RuleSet, title: str, titles: Sequence[str]) -> None:
        self.result = Tally(title)
        self.rules = of_section(rules, titles)
        self.pending = still_open(self.rules)

    def name_of(self, row: Any) -> str:
        """Return what a row is called."""
        raise NotImplementedError

    def place_of(self, row: Any) -> Place:
        """Return where a row stands."""
        raise NotImplementedError

    def text_of(self, row: Any) -> str:
        """Return a row as it is shown where it is alone."""
        raise NotImplementedError

    def spot_of(self, row: Any, side: int, other: Any = None) -> Spot:
        """Return a row of A (side 0) or B, or two that belong together, as rules see them."""
        raise NotImplementedError

    def are_same(self, a: Any, b: Any) -> bool:
        """Tell whether two rows have nothing that could differ."""
        raise NotImplementedError

    def weigh_fields(self, a: Any, b: Any, pair: Pair) -> None:
        """Weigh the fields of two rows that differ."""
        raise NotImplementedError

    def fields_of(self, row: Any, pair: Pair) -> Iterator[tuple[Field, Token | None]]:
        """Yield every field of a row of A with its token, whether it differs or not."""
        raise NotImplementedError

    def compare_rows(self, keys: tuple[Sequence[Key], Sequence[Key]], *, strict: bool) -> None:
        """Compare the rows, each with its partner by their keys (see `aligned`)."""
        a, b = self.rows
        for n, other, moved in aligned(*keys, strict=strict):
            if n is not None and other is not None:
                self.pair_of_rows(a[n], b[other], moved)
            else:
                self.lonely_row(a[n] if n is not None else b[other or 0], int(n is None))

    def pair_of_rows(self, a: Any, b: Any, moved: bool) -> None:
        """Compare two rows that belong together."""
        self.result.rows += 1
        same = self.are_same(a, b)
        if same and not moved and not self.pending:
            return
        spot = self.spot_of(a, 0, b) if self.rules else Spot()
        pair = Pair(self.name_of(a), self.place_of(a), self.place_of(b), spot, self.judged(spot))
        if moved and not allows(pair.among, pair.spot, "order"):
            self.found("order", pair)
        if not same:
            self.weigh_fields(a, b, pair)
        if waiting := still_open(pair.among):  # that rules decide about values is known, though these do not differ
            for field, token in self.fields_of(a, pair):
                decider(pair.among, pair.spot, field, token, token)
            touch_rows(waiting, pair.spot)
        self.pending = still_open(self.pending)

    def lonely_row(self, row: Any, side: int) -> None:
        """Take a row that the other file has not, unless rules allow it."""
        if not self.allowed(self.spot_of(row, side), "AB"[side]):
            kind: FindingKind = "only in B" if side else "only in A"
            self.lonely(kind, side, self.text_of(row), self.name_of(row), self.place_of(row))

    def lonely(
        self, kind: FindingKind, side: int, text: str, name: str = "", place: Place = NOWHERE, column: str = ""
    ) -> None:
        """Take what only one file has."""
        pair = Pair(name, b=place) if side else Pair(name, place)
        self.found(kind, pair, (None, text) if side else (text, None), column)

    def allowed(self, spot: Spot, side: str) -> bool:
        """Tell whether a rule allows a row in one file only (`A`, `B`), or elsewhere (`order`)."""
        return allows(self.judged(spot), spot, side)

    def judged(self, spot: Spot) -> RuleSet:
        """Return the rules that select something in a row."""
        return of_row(self.rules, spot)

    def rule(self, pair: Pair, field: Field, a: Token | None = None, b: Token | None = None) -> RuleUse | None:
        """Return the rule that decides about two values of a field, None for exactly equal."""
        return decider(pair.among, pair.spot, field, a, b) if pair.among else None

    def unpaired(self, pair: Pair, field: Field, texts: Texts) -> None:
        """Take a field whose values cannot be paired, unless rules leave it out."""
        use = self.rule(pair, field)
        if use is None or not use.rule.skip:
            self.found("text", pair, texts, field.name, rule=use.name if use else "exact")

    def weigh(self, pair: Pair, field: Field, unit: str, a: Token, b: Token, sigmas: float | None = None) -> None:
        """Weigh two tokens of a field, and take their difference where there is one."""
        verdict = weighed(self.rule(pair, field, a, b), a, b, sigmas)
        if verdict.skipped or (verdict.passes and not verdict.difference):
            return
        kind: FindingKind = "angle" if a.kind == "angle" else "number"
        more: dict[str, Any] = {"difference": verdict.difference, "unit": verdict.unit or unit}
        if verdict.difference is None:
            kind = "overflow" if "overflow" in (a.kind, b.kind) else "text"
            more = {}
        elif self.counts_digits:
            more["last_digits"] = verdict.last_digits
        texts = a.text or None, b.text or None
        self.found(kind, pair, texts, field.name, passes=verdict.passes, rule=verdict.rule, sigmas=sigmas, **more)

    def found(
        self,
        kind: FindingKind,
        pair: Pair,
        texts: Texts = (None, None),
        column: str = "",
        *,
        passes: bool = False,
        **more: Any,
    ) -> None:
        """Take a finding, with the `texts` of A and of B."""
        section, (a, b) = self.result.title, texts
        finding = Finding(kind, section, pair.name, column, a, b, place_a=pair.a, place_b=pair.b, **more)
        self.result.add(finding, passes=passes)


def aligned(a: Sequence[Key], b: Sequence[Key], *, strict: bool) -> Iterator[tuple[int | None, int | None, bool]]:
    """Yield the rows of A, each with its partner in B, and whether that stands elsewhere; between them rows of B.

    A row goes by its name, or without one by its text; the second of a key is another than the first. As many rows
    of A as of B between two pairs are taken for each other one by one; with `strict` only those without names are.
    """
    counted_a, counted_b = _counted(a), _counted(b)
    places = {key: n for n, key in enumerate(counted_b)}
    partners = {n: places[key] for n, key in enumerate(counted_a) if key in places}
    kept = _in_order(list(partners.items()))
    taken = set(partners.values())
    for (a0, b0), (a1, b1) in zip([(-1, -1), *kept], [*kept, (len(a), len(b))], strict=True):
        rows = [n for n in range(a0 + 1, a1) if n not in partners]
        others = [m for m in range(b0 + 1, b1) if m not in taken]
        alike: dict[int, int] = {}
        if len(rows) == len(others):
            pairs = zip(rows, others, strict=True)
            alike = {n: m for n, m in pairs if not (strict and (a[n][0] or b[m][0]))}
        for n in range(a0 + 1, a1):
            yield n, partners.get(n, alike.get(n)), n in partners
        paired = set(alike.values())
        yield from ((None, m, False) for m in others if m not in paired)
        if a1 < len(a):
            yield a1, b1, False


def _counted(keys: Iterable[Key]) -> list[Hashable]:
    """Return the name of each row, or else its words, with how many of the same stand before."""
    counts: Counter[Hashable] = Counter()
    counted: list[Hashable] = []
    for name, text in keys:
        key = name or (" ".join(text.split()),)
        counted.append((key, counts[key]))
        counts[key] += 1
    return counted


def _in_order(pairs: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the longest run of pairs, sorted by the first numbers, whose second ones grow (patience sorting).

    `difflib` takes the square of rows for it: 54 s for 20,000 of which every two stand the other way round.
    """
    tails: list[int] = []
    ends: list[int] = []  # the pair that ends the best run of each length
    before: list[int] = []
    for n, (_, b) in enumerate(pairs):
        length = bisect_left(tails, b)
        before.append(ends[length - 1] if length else -1)
        tails[length : length + 1], ends[length : length + 1] = [b], [n]
    longest = []
    n = ends[-1] if ends else -1
    while n >= 0:
        longest.append(pairs[n])
        n = before[n]
    return longest[::-1]
