"""Rules applied: which rule decides about a value or a row, whether it lets a difference pass, what was used.

Which rules select a row or a field is a set, kept as an integer with a bit for each rule: two large listings ask
this a million times, and the answers for a page, a name, a heading are remembered.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from decimal import Context, Decimal
from typing import Any, NamedTuple, Protocol

from musatpy.listings.findings import RuleUse
from musatpy.listings.rules import ARC_SECONDS, Rule, Rules
from musatpy.listings.tokens import Token

RuleSet = int  # bit n stands for rule n
CIRCLE = Decimal(1296000)  # arc seconds
# Printed numbers are subtracted without rounding, unless they are further apart than any field is wide. Comparisons
# run in this context: operators are several times quicker than methods of a context.
EXACTLY = Context(prec=400)
_LARGEST_ANGLE = Decimal("1e20")


class AnySpot(Protocol):
    """One row of both files, as rules see it."""

    @property
    def pages(self) -> tuple[int, ...]:
        """Where it stands."""

    @property
    def texts(self) -> tuple[str, ...]:
        """The row as printed, in one or both files."""

    @property
    def ids(self) -> tuple[str, ...]:
        """What it is about."""

    @property
    def photos(self) -> Callable[[int], tuple[str, ...]]:
        """The photos that the field in a column is about."""

    @property
    def points(self) -> Callable[[int], tuple[str, ...]]:
        """The points that the field in a column is about."""

    @property
    def by_row(self) -> bool:
        """True where photos and points are the same in all columns."""


def _nothing(column: int) -> tuple[str, ...]:
    return ()


class Spot(NamedTuple):
    """A row of which all is known from the start, or what stands for one."""

    pages: tuple[int, ...] = ()
    texts: tuple[str, ...] = ()
    ids: tuple[str, ...] = ()
    photos: Callable[[int], tuple[str, ...]] = _nothing
    points: Callable[[int], tuple[str, ...]] = _nothing
    by_row: bool = True


NO_SPOT = Spot()


class Field(NamedTuple):
    """One field of a row, as rules see it."""

    column: int  # -1: in no column
    number: int  # of the column, or of the field where there are no columns, from 1
    heading: str
    start: int = 0  # columns of print, from 0; the end not included
    end: int = 0


_WHOLE_ROW = Field(-1, 0, "")


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
        self.passed = [0] * len(self.rules)
        self._number = {id(rule): n for n, rule in enumerate(self.rules)}
        self._matched: RuleSet = 0
        self._applied: RuleSet = 0
        self._deciding = self.those(lambda rule: rule.decides_values)
        self._of_rows = self.those(lambda rule: rule.order or bool(rule.only))
        self._in_row = self.those(lambda rule: rule.row is not None)
        self._counting = self.those(lambda rule: isinstance(rule.column, int))
        self._in_columns = self.those(lambda rule: rule.selects_fields)
        self._of_angles = self.those(lambda rule: rule.arcsec is not None and rule.angle == "dms")
        self._asking = self._in_row | self.those(looks_at_rows)
        self._pages = _Selected(self.rules, lambda rule: rule.pages, _is_on)
        self._ids = _Selected(self.rules, lambda rule: rule.id, _is_whole)
        self._photos = _Selected(self.rules, lambda rule: rule.photo, _is_whole)
        self._points = _Selected(self.rules, lambda rule: rule.point, _is_whole)
        self._columns = _Selected(self.rules, lambda rule: rule.column, _is_in_column)
        self._places = _Selected(self.rules, lambda rule: rule.at, _is_at)
        self._decisions: dict[tuple[RuleSet, tuple[str, str, bool] | None], tuple[RuleSet, int]] = {}

    def those(self, wanted: Callable[[Rule], bool]) -> RuleSet:
        """Return the rules of a kind."""
        return sum(1 << n for n, rule in enumerate(self.rules) if wanted(rule))

    def open(self, among: RuleSet) -> RuleSet:
        """Return the rules of which it is not known yet that they match, and decide about something."""
        return among & ~(self._matched & self._applied)

    def asks_rows(self, among: RuleSet) -> bool:
        """Tell whether rules ask for more than section, column and columns of print."""
        return bool(among & self._asking)

    def asks_places(self, among: RuleSet) -> bool:
        """Tell whether rules ask for columns of print."""
        return bool(among & self._places.asking)

    def counts_columns(self, among: RuleSet) -> bool:
        """Tell whether rules ask for the number of a column or field."""
        return bool(among & self._counting)

    def reads_angles(self, among: RuleSet) -> bool:
        """Tell whether rules are about degrees, minutes and seconds."""
        return bool(among & self._of_angles)

    def touch_rows(self, among: RuleSet, spot: AnySpot) -> None:
        """Mark the rules about order, and rows in one only, that speak of a row."""
        found = self.of_field(among, spot, _WHOLE_ROW) & self._of_rows
        self._matched |= found
        self._applied |= found

    def of_section(self, titles: Sequence[str]) -> RuleSet:
        """Return the rules that select something in a section."""
        return self.those(lambda rule: rule.section is None or any(rule.section.search(title) for title in titles))

    def of_row(self, among: RuleSet, spot: AnySpot) -> RuleSet:
        """Return the rules among those of a section that select something in a row."""
        if not among & self._asking:
            return among
        if among & self._pages.asking:
            among = self._pages.among(among, spot.pages)
        if among & self._ids.asking:
            among = self._ids.among(among, spot.ids)
        if spot.by_row:
            among = self._about(among, spot, -1)
        for n in _members(among & self._in_row):
            search = self.rules[n].row.search  # type: ignore[union-attr]
            if not any(search(text) for text in spot.texts):
                among &= ~(1 << n)
        return among

    def _about(self, among: RuleSet, spot: AnySpot, column: int) -> RuleSet:
        """Return the rules that ask for the photo and point of a field, or for none."""
        if among & self._photos.asking:
            among = self._photos.among(among, spot.photos(column))
        return self._points.among(among, spot.points(column)) if among & self._points.asking else among

    def of_field(self, among: RuleSet, spot: AnySpot, field: Field) -> RuleSet:
        """Return the rules among those of a row that select a field."""
        if among & self._in_columns:
            among = self._columns.among(among, ((field.number, field.heading),))
            among = self._places.among(among, ((field.start, field.end),))
        return among if spot.by_row else self._about(among, spot, field.column)

    def uses(self) -> tuple[RuleUse, ...]:
        """Return what became of every rule."""
        return tuple(
            RuleUse(
                name=rule.name,
                matched=bool(self._matched >> n & 1),
                applied=bool(self._applied >> n & 1),
                passed=self.passed[n],
            )
            for n, rule in enumerate(self.rules)
        )

    def about_row(self, among: RuleSet, spot: AnySpot, side: str) -> str:
        """Return the name of the rule that allows a row in one file only (`A`, `B`), or elsewhere (`order`)."""
        found = ""
        for n in _members(self.of_field(among, spot, _WHOLE_ROW)):
            rule = self.rules[n]
            if rule.skip or (rule.order if side == "order" else bool(rule.only)):
                self._matched |= 1 << n
                self._applied |= 1 << n
                found = rule.name if rule.skip or rule.order or rule.only in (side, "either") else ""
                if found:
                    self.passed[n] += 1
        return found

    def about_value(self, among: RuleSet, a: Token | None, b: Token | None) -> Rule | None:
        """Return the last of the rules of a field that decides about two tokens, None for exactly equal."""
        if not among:
            return None
        key = among, (None if a is None or b is None else (a.kind, b.kind, a.value is None))
        if (known := self._decisions.get(key)) is None:
            fit = [n for n in _members(among & self._deciding) if _fits(self.rules[n], a, b)]
            known = self._decisions[key] = sum(1 << n for n in fit), (fit[-1] if fit else -1)
        matched, last = known
        if last < 0:
            return None
        self._matched |= matched
        self._applied |= 1 << last
        return self.rules[last]

    def count_passed(self, rule: Rule) -> None:
        """Count a difference that a rule lets pass."""
        self.passed[self._number[id(rule)]] += 1

    def weigh(self, rule: Rule | None, a: Token, b: Token, sigma: float | None = None) -> Verdict:
        """Return the verdict on two tokens of different texts; within the context `EXACTLY`."""
        name = rule.name if rule else "exact"
        if rule and rule.skip:
            return Verdict(True, name, True)
        if a.value is None or b.value is None or a.kind != b.kind:
            return Verdict(a.text == b.text, name)
        difference = b.value - a.value
        step = a.step if a.step > b.step else b.step
        last: Decimal | None = difference.scaleb(-step)
        unit = ""
        if a.kind == "angle":
            unit = "arc sec"
            difference = _around(difference)
            last = difference.scaleb(-step)
        elif rule and rule.arcsec is not None and rule.angle != "dms":
            unit = "arc sec"
            difference = _around(difference * ARC_SECONDS[rule.angle])
            last = None
        same = not difference and (a.kind == "angle" or a.negative_degrees == b.negative_degrees)
        passes = same or (rule is not None and not rule.exact and _within(rule, a, b, difference, last, sigma))
        if passes and not same and rule:
            self.count_passed(rule)
        if not passes and not difference:  # `-0` are degrees: their sign is that of what stands behind them
            return Verdict(False, name)
        return Verdict(passes, name, False, difference, last, unit)


class _Selected:
    """Which rules select what is seen by one of their selectors; rules without that selector select all."""

    def __init__(
        self, rules: Sequence[Rule], selector: Callable[[Rule], Any], fits: Callable[[Any, Any], bool]
    ) -> None:
        self.selectors = [(n, selector(rule)) for n, rule in enumerate(rules) if selector(rule) is not None]
        self.asking: RuleSet = sum(1 << n for n, _ in self.selectors)
        self.fits = fits
        self.known: dict[Any, RuleSet] = {}

    def among(self, among: RuleSet, seen: Sequence[Any]) -> RuleSet:
        """Return the rules among some that select one of what is seen."""
        if not among & self.asking:
            return among
        chosen = 0
        for one in seen:
            if (found := self.known.get(one)) is None:
                found = sum(1 << n for n, selector in self.selectors if self.fits(selector, one))
                self.known[one] = found
            chosen |= found
        return among & (chosen | ~self.asking)


def _is_whole(pattern: re.Pattern[str], name: str) -> bool:
    return pattern.fullmatch(name) is not None


def _is_in_column(selector: re.Pattern[str] | int, own: tuple[int, str]) -> bool:
    number, heading = own
    if isinstance(selector, int):
        return selector == number
    return bool(heading) and selector.search(heading) is not None


def _is_at(selector: tuple[int, int], own: tuple[int, int]) -> bool:
    start, end = own
    return start < selector[1] and end >= selector[0]


def _is_on(selector: tuple[int, int], page: int) -> bool:
    return selector[0] <= page <= selector[1]


def _members(rules: RuleSet) -> Iterator[int]:
    """Yield the numbers of the rules of a set, from the first."""
    while rules:
        lowest = rules & -rules
        yield lowest.bit_length() - 1
        rules ^= lowest


def looks_at_rows(rule: Rule) -> bool:
    """Tell whether a rule asks for more than section, column and columns of print."""
    return any(one is not None for one in (rule.pages, rule.row, rule.id, rule.photo, rule.point))


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
    plain = abs(b.value - a.value)
    if rule.absolute is not None and plain <= rule.absolute:
        return True
    return rule.relative is not None and plain <= rule.relative * max(abs(a.value), abs(b.value))


def _around(angle: Decimal) -> Decimal:
    """Return an angle within half a circle of zero."""
    if abs(angle) > _LARGEST_ANGLE:
        return angle
    turned = angle % CIRCLE
    if abs(turned) > CIRCLE / 2:
        turned -= CIRCLE.copy_sign(turned)
    return turned
