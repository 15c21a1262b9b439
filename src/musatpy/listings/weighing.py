"""One section of both files: what all comparisons have in common, whatever the two files are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from musatpy.listings.findings import Finding, FindingKind, Place, RuleUse, Tally
from musatpy.listings.judge import NO_SPOT, Field, Judge, RuleSet, Spot
from musatpy.listings.tokens import Token


class Where(NamedTuple):
    """What a row is called, and where it stands in A and in B."""

    row: str = ""
    a: Place = Place()
    b: Place = Place()


@dataclass(frozen=True, eq=False)
class RowPair:
    """Two rows that belong together, with the rules that select something in them."""

    where: Where
    spot: Spot = NO_SPOT
    among: RuleSet = ()


class Comparison:
    """A section of A and of B, or of one only: its rules, and what was found."""

    counts_digits = True  # numbers have a last digit

    def __init__(self, judge: Judge, title: str, titles: Sequence[str]) -> None:
        self.judge = judge
        self.result = Tally(title)
        self.rules = judge.of_section(titles)

    def rule(self, both: RowPair, field: Field, a: Token | None, b: Token | None) -> RuleUse | None:
        """Return the rule that decides about two values of a field, None for exactly equal."""
        if not both.among:
            return None
        return self.judge.about_value(self.judge.of_field(both.among, both.spot, field), a, b)

    def weigh(
        self, both: RowPair, field: Field, unit: str, a: Token, b: Token, sigmas: float | None = None
    ) -> None:
        """Weigh two tokens of a field, and take their difference where there is one."""
        verdict = self.judge.weigh(self.rule(both, field, a, b), a, b, sigmas)
        if verdict.skipped or (verdict.passes and not verdict.difference):
            return
        kind: FindingKind = "angle" if a.kind == "angle" else "number"
        if verdict.difference is None:
            kind = "overflow" if "overflow" in (a.kind, b.kind) else "text"
        self.result.add(
            Finding(
                kind=kind,
                section=self.result.title,
                row=both.where.row,
                column=self.name_of(field),
                a=a.text or None,
                b=b.text or None,
                difference=verdict.difference,
                unit="" if verdict.difference is None else verdict.unit or unit,
                last_digits=verdict.last_digits if self.counts_digits else None,
                sigmas=sigmas,
                rule=verdict.rule,
                place_a=both.where.a,
                place_b=both.where.b,
            ),
            passes=verdict.passes,
        )

    def name_of(self, field: Field) -> str:
        """Return what findings call a field."""
        return field.heading

    def finding(
        self,
        kind: FindingKind,
        where: Where,
        texts: tuple[str | None, str | None] = (None, None),
        *,
        column: str = "",
        rule: str = "exact",
    ) -> None:
        """Take a finding that is no difference of two values; `texts` are those of A and of B."""
        self.result.add(
            Finding(
                kind=kind,
                section=self.result.title,
                row=where.row,
                column=column,
                a=texts[0],
                b=texts[1],
                rule=rule,
                place_a=where.a,
                place_b=where.b,
            )
        )

    def lonely(self, kind: FindingKind, side: str, text: str, where: Where, column: str = "") -> None:
        """Take what only one file has: side `A` or `B`, where it stands as place of A."""
        if side == "A":
            self.finding(kind, where, (text, None), column=column)
        else:
            self.finding(kind, where._replace(a=where.b, b=where.a), (None, text), column=column)

    def pair(self, where: Where, spot: Spot) -> RowPair:
        """Return two rows with the rules that select something in them."""
        return RowPair(where, spot, self.judge.of_row(self.rules, spot))

    def elsewhere(self, both: RowPair) -> None:
        """Take two rows that do not stand in the same order, unless rules allow it."""
        if not self.judge.allows(both.among, both.spot, "order"):
            self.finding("order", both.where)

    def unpaired(self, both: RowPair, field: Field, texts: tuple[str | None, str | None]) -> None:
        """Take a field whose values cannot be paired, unless rules leave it out."""
        decider = self.rule(both, field, None, None)
        if decider is None or not decider.rule.skip:
            name = decider.rule.name if decider else "exact"
            self.finding("text", both.where, texts, column=self.name_of(field), rule=name)

    def only_row(self, spot: Spot, side: str, text: str, where: Where) -> None:
        """Take a row that the other file has not, unless rules allow it."""
        if not self.allows(spot, side):
            self.lonely("only in A" if side == "A" else "only in B", side, text, where)

    def allows(self, spot: Spot, side: str) -> bool:
        """Tell whether a rule allows a row in one file only (`A`, `B`), or elsewhere (`order`)."""
        return self.judge.allows(self.judge.of_row(self.rules, spot), spot, side)
