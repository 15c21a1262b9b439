"""Rules applied: which rule decides about a value or a row, whether it lets a difference pass, what was used."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from decimal import Context, Decimal
from typing import Any, NamedTuple

from musatpy.listings.findings import RuleUse
from musatpy.listings.rules import ARC_SECONDS, Rule
from musatpy.listings.tokens import Token

CIRCLE = Decimal(1296000)  # arc seconds
# Printed numbers are subtracted without rounding, unless they are further apart than any field is wide. Comparisons
# run in this context: operators are several times quicker than methods of a context.
EXACTLY = Context(prec=400)
_LARGEST_ANGLE = Decimal("1e20")
RuleSet = Sequence[RuleUse]  # in the order of their file
Named = Callable[[int], tuple[str, ...]]  # column -> the photos, or points, that its field is about


class Spot(NamedTuple):
    """One row of both files, as rules see it."""

    pages: tuple[int, ...] = ()
    texts: tuple[str, ...] = ()  # the row as printed, in one or both files
    ids: tuple[str, ...] = ()  # what it is about
    photos: Named = lambda column: ()
    points: Named = lambda column: ()
    by_row: bool = True  # photos and points are the same in all columns


class FieldSpot(NamedTuple):
    """One field of a row, as rules see it."""

    column: int = -1  # -1: in no column
    number: int = 0  # of the column, or of the field where there are no columns, from 1
    heading: str = ""
    start: int = 0  # columns of print, from 0; the end not included
    end: int = 0

    @property
    def name(self) -> str:
        """What findings call it: its heading, or its number in the row."""
        return self.heading or (f"field {self.number}" if self.number else "")


def of_section(rules: RuleSet, titles: Sequence[str]) -> RuleSet:
    """Return the rules that select something in a section with these titles in A and B."""
    return [use for use in rules if use.rule.section is None or any(map(use.rule.section.search, titles))]


def of_row(rules: RuleSet, spot: Spot) -> RuleSet:
    """Return the rules that select something in a row; those about whole rows are of use by that."""
    found = [use for use in rules if _selects_row(use.rule, spot)]
    for use in found:
        if (use.rule.order or use.rule.only) and _selects_field(use.rule, spot, FieldSpot()):
            use.matched = use.applied = True
    return found


def decider(rules: RuleSet, spot: Spot, field: FieldSpot, a: Token | None, b: Token | None) -> RuleUse | None:
    """Return the last of the rules of a row that decides about two tokens of a field, None for exactly equal."""
    last = None
    for use in rules:
        if use.rule.decides_values and _selects_field(use.rule, spot, field) and _fits(use.rule, a, b):
            use.matched, last = True, use
    if last:
        last.applied = True
    return last


def allows(rules: RuleSet, spot: Spot, side: str) -> bool:
    """Tell whether rules allow a row in one file only (`A`, `B`), or elsewhere (`order`): the last decides."""
    allowed = False
    for use in rules:
        rule = use.rule
        if (rule.skip or (rule.order if side == "order" else rule.only)) and _selects_field(
            rule, spot, FieldSpot()
        ):
            use.matched = use.applied = True
            allowed = rule.skip or side == "order" or rule.only in (side, "either")
            use.passed += allowed
    return allowed


def still_open(rules: RuleSet) -> RuleSet:
    """Return the rules of which it is not known yet that they match, and decide about something."""
    return [use for use in rules if not (use.matched and use.applied)]


def read_angles(rules: RuleSet) -> bool:
    """Tell whether rules are about degrees, minutes and seconds."""
    return any(use.rule.arcsec is not None and use.rule.angle == "dms" for use in rules)


def measured(rule: Rule | None, a: Token, b: Token) -> tuple[Decimal, Decimal | None, str]:
    """Return B minus A, that in units of the last digit that both print, and its unit where it is an angle."""
    difference, step = _number(b) - _number(a), max(a.step, b.step)
    if a.kind == "angle":
        difference = _around(difference)
        return difference, difference.scaleb(-step), "arc sec"
    if rule and rule.arcsec is not None and rule.angle != "dms":
        return _around(difference * ARC_SECONDS[rule.angle]), None, "arc sec"
    return difference, difference.scaleb(-step), ""


def passes(
    rule: Rule | None, a: Token, b: Token, difference: Decimal, last: Decimal | None, sigmas: float | None
) -> bool:
    """Tell whether a rule lets a difference pass: it is within one of its limits."""
    if rule is None or rule.exact:
        return False
    is_angle = a.kind == "angle"
    sizes: list[tuple[Decimal | None, Any]] = [(rule.last_digits, last), (rule.sigmas, sigmas)]
    if is_angle or rule.angle != "dms":
        sizes.append((rule.arcsec, difference))
    if not is_angle:
        plain, largest = _number(b) - _number(a), max(abs(_number(a)), abs(_number(b)))
        sizes += [(rule.absolute, plain), (None if rule.relative is None else rule.relative * largest, plain)]
    return any(limit is not None and size is not None and abs(size) <= limit for limit, size in sizes)


def _selects_row(rule: Rule, spot: Spot) -> bool:
    return (
        (rule.pages is None or any(rule.pages[0] <= page <= rule.pages[1] for page in spot.pages))
        and _names(rule.id, spot.ids)
        and (not spot.by_row or _is_about(rule, spot, -1))
        and (rule.row is None or any(map(rule.row.search, spot.texts)))
    )


def _selects_field(rule: Rule, spot: Spot, field: FieldSpot) -> bool:
    if isinstance(rule.column, int) and rule.column != field.number:
        return False
    if isinstance(rule.column, re.Pattern) and not (field.heading and rule.column.search(field.heading)):
        return False
    if rule.at is not None and not (field.start < rule.at[1] and field.end >= rule.at[0]):
        return False
    return spot.by_row or _is_about(rule, spot, field.column)


def _is_about(rule: Rule, spot: Spot, column: int) -> bool:
    """Tell whether a rule asks for the photo and point of a field, or for none."""
    return (rule.photo is None or _names(rule.photo, spot.photos(column))) and (
        rule.point is None or _names(rule.point, spot.points(column))
    )


def _names(pattern: re.Pattern[str] | None, names: Sequence[str]) -> bool:
    return pattern is None or any(map(pattern.fullmatch, names))


def _fits(rule: Rule, a: Token | None, b: Token | None) -> bool:
    """Tell whether a rule can decide about two tokens: limits are for numbers, arc seconds for angles."""
    if rule.skip or rule.exact:
        return True
    if a is None or b is None or a.kind != b.kind or a.value is None:
        return False
    if a.kind == "angle":
        return rule.last_digits is not None or (rule.arcsec is not None and rule.angle == "dms")
    others = (rule.absolute, rule.relative, rule.last_digits, rule.sigmas)
    return rule.arcsec is None or rule.angle != "dms" or any(limit is not None for limit in others)


def _number(token: Token) -> Decimal:
    assert token.value is not None
    return token.value


def _around(angle: Decimal) -> Decimal:
    """Return an angle within half a circle of zero."""
    if abs(angle) > _LARGEST_ANGLE:
        return angle
    turned = angle % CIRCLE
    if abs(turned) > CIRCLE / 2:
        turned -= CIRCLE.copy_sign(turned)
    return turned
