"""Rules applied: which rule decides about a value or a row, whether it lets a difference pass, what was used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Context, Decimal
from typing import NamedTuple

from musatpy.reportdiff.findings import RuleUse
from musatpy.reportdiff.rules import ARC_SECONDS, Rule, Rules
from musatpy.reportdiff.tokens import Token

CIRCLE = Decimal(1296000)  # arc seconds
# Printed numbers are subtracted without rounding, unless they are further apart than any field is wide.
_LARGEST_ANGLE = Decimal("1e20")
EXACTLY = Context(prec=400)


@dataclass(frozen=True)
class Spot:
    """One row of both files, as rules see it."""

    pages: tuple[int, ...]
    texts: tuple[str, ...]  # as printed, of one or both files
    ids: tuple[str, ...]
    photos: Callable[[int], tuple[str, ...]]  # of the field in a column
    points: Callable[[int], tuple[str, ...]]
    by_row: bool = True  # photos and points are the same in all columns


class Field(NamedTuple):
    """One field of a row, as rules see it."""

    column: int  # -1: in no column
    number: int  # of the column, or of the field where there are no columns, from 1
    heading: str
    start: int = 0  # columns of print, from 0; the end not included
    end: int = 0


class Verdict(NamedTuple):
    """Two values weighed: their difference, and whether it passes."""

    passes: bool
    rule: str
    skipped: bool = False
    difference: Decimal | None = None
    last_digits: Decimal | None = None
    unit: str = ""


class Judge:
    """All rules of a comparison, and what was used of them."""

    def __init__(self, rules: Rules) -> None:
        self.rules = rules.rules
        self.deciding = [rule.decides_values for rule in self.rules]
        self.matched = [False] * len(self.rules)
        self.applied = [False] * len(self.rules)
        self.passed = [0] * len(self.rules)

    def is_open(self, n: int) -> bool:
        """Tell whether it is not known yet that a rule matches, and decides about something."""
        return not (self.matched[n] and self.applied[n])

    def touch_rows(self, among: Sequence[int], spot: Spot) -> None:
        """Mark the rules about order, and rows in one only, that speak of a row."""
        for n in self.of_field(among, spot, Field(-1, 0, "")):
            if self.rules[n].order or self.rules[n].only:
                self.matched[n] = self.applied[n] = True

    def of_section(self, titles: Sequence[str]) -> list[int]:
        """Return the rules that select something in a section."""
        found = []
        for n, rule in enumerate(self.rules):
            if rule.section is None or any(rule.section.search(title) for title in titles):
                found.append(n)
        return found

    def of_row(self, among: Sequence[int], spot: Spot) -> list[int]:
        """Return the rules among those of a section that select something in a row."""
        return [n for n in among if _selects_row(self.rules[n], spot)] if among else []

    def of_field(self, among: Sequence[int], spot: Spot, field: Field) -> list[int]:
        """Return the rules among those of a row that select a field."""
        return [n for n in among if _selects_field(self.rules[n], spot, field)] if among else []

    def uses(self) -> tuple[RuleUse, ...]:
        """Return what became of every rule."""
        return tuple(
            RuleUse(name=rule.name, matched=self.matched[n], applied=self.applied[n], passed=self.passed[n])
            for n, rule in enumerate(self.rules)
        )

    def about_row(self, among: Sequence[int], spot: Spot, side: str) -> str:
        """Return the name of the rule that allows a row in one file only (`A`, `B`), or elsewhere (`order`)."""
        found = ""
        for n in self.of_field(among, spot, Field(-1, 0, "")):
            rule = self.rules[n]
            if rule.skip or (rule.order if side == "order" else bool(rule.only)):
                self.matched[n] = self.applied[n] = True
                found = rule.name if rule.skip or rule.order or rule.only in (side, "either") else ""
                if found:
                    self.passed[n] += 1
        return found

    def about_value(self, among: Sequence[int], a: Token | None, b: Token | None) -> Rule | None:
        """Return the last of the rules of a field that decides about two tokens, None for exactly equal."""
        found = None
        for n in among:
            if self.deciding[n] and _fits(self.rules[n], a, b):
                self.matched[n] = True
                found = n
        if found is None:
            return None
        self.applied[found] = True
        return self.rules[found]

    def weigh(self, rule: Rule | None, a: Token, b: Token, sigma: float | None = None) -> Verdict:
        """Return the verdict on two tokens of different texts."""
        name = rule.name if rule else "exact"
        if rule and rule.skip:
            return Verdict(True, name, skipped=True)
        if a.value is None or b.value is None or a.kind != b.kind:
            return Verdict(a.text == b.text, name)
        difference = EXACTLY.subtract(b.value, a.value)
        unit = ""
        if a.kind == "angle":
            unit = "arc sec"
            difference = _around(difference)
        elif rule and rule.arcsec is not None:
            unit = "arc sec"
            difference = _around(EXACTLY.multiply(difference, ARC_SECONDS[rule.angle]))
        last = None if unit and a.kind != "angle" else EXACTLY.scaleb(difference, -max(a.step, b.step))
        same = not difference and (a.negative_degrees == b.negative_degrees or a.kind == "angle")
        passes = same or (rule is not None and not rule.exact and _within(rule, a, b, difference, last, sigma))
        if passes and not same and rule:
            self.passed[self.rules.index(rule)] += 1
        return Verdict(passes, name, difference=difference, last_digits=last, unit=unit)


def looks_at_rows(rule: Rule) -> bool:
    """Tell whether a rule asks for more than section, column and columns of print."""
    return any(one is not None for one in (rule.pages, rule.row, rule.id, rule.photo, rule.point))


def _selects_row(rule: Rule, spot: Spot) -> bool:
    if rule.pages and not any(rule.pages[0] <= page <= rule.pages[1] for page in spot.pages):
        return False
    if rule.row and not any(rule.row.search(text) for text in spot.texts):
        return False
    if rule.id and not any(rule.id.fullmatch(one) for one in spot.ids):
        return False
    return not spot.by_row or _is_about(rule, spot, -1)


def _is_about(rule: Rule, spot: Spot, column: int) -> bool:
    """Tell whether a field is of the photo and point that a rule asks for."""
    for pattern, names in ((rule.photo, spot.photos), (rule.point, spot.points)):
        if pattern and not any(pattern.fullmatch(one) for one in names(column)):
            return False
    return True


def _selects_field(rule: Rule, spot: Spot, field: Field) -> bool:
    if isinstance(rule.column, int):
        if rule.column != field.number:
            return False
    elif rule.column is not None and not (field.heading and rule.column.search(field.heading)):
        return False
    if rule.at and not (field.start < rule.at[1] and field.end >= rule.at[0]):
        return False
    return spot.by_row or _is_about(rule, spot, field.column)


def _fits(rule: Rule, a: Token | None, b: Token | None) -> bool:
    """Tell whether a rule can decide about two tokens: limits are for numbers, arc seconds for angles."""
    if rule.skip or rule.exact:
        return True
    if a is None or b is None or a.kind != b.kind or a.value is None:
        return False
    if a.kind == "angle":
        return rule.last_digits is not None or (rule.arcsec is not None and rule.angle == "dms")
    return rule.arcsec is None or rule.angle != "dms" or _has_other_limit(rule)


def _has_other_limit(rule: Rule) -> bool:
    return any(limit is not None for limit in (rule.absolute, rule.relative, rule.last_digits, rule.sigmas))


def _within(rule: Rule, a: Token, b: Token, difference: Decimal, last: Decimal | None, sigma: float | None) -> bool:
    """Tell whether a difference is within one of the limits of a rule."""
    size = abs(difference)
    is_angle = a.kind == "angle"
    if rule.last_digits is not None and last is not None and abs(last) <= rule.last_digits:
        return True
    if rule.arcsec is not None and (is_angle or rule.angle != "dms") and size <= rule.arcsec:
        return True
    if rule.sigmas is not None and sigma is not None and abs(sigma) <= rule.sigmas:
        return True
    if is_angle or a.value is None or b.value is None:
        return False
    plain = abs(EXACTLY.subtract(b.value, a.value))
    if rule.absolute is not None and plain <= rule.absolute:
        return True
    return rule.relative is not None and plain <= rule.relative * max(abs(a.value), abs(b.value))


def _around(angle: Decimal) -> Decimal:
    """Return an angle within half a circle of zero."""
    if abs(angle) > _LARGEST_ANGLE:
        return angle
    turned = EXACTLY.remainder(angle, CIRCLE)
    if abs(turned) > CIRCLE / 2:
        turned -= CIRCLE.copy_sign(turned)
    return turned
