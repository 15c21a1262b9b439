"""Rules of a comparison: a TOML file -> what is selected, and how far it may differ; and these rules applied.

The last rule that selects a value decides about it; the order of rows and rows in one file only are decided apart,
by the last rule that speaks of them. A file that is wrong is refused with every reason.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Context, Decimal
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

from musatpy.errors import ProblemsError
from musatpy.listings.tokens import Token
from musatpy.specs import Reader, key, require, toml_of

AngleUnit = Literal["dms", "degrees", "radians", "gons"]
ARC_SECONDS = {
    "degrees": Decimal(3600),
    "gons": Decimal(3240),
    "radians": Decimal(648000) / Decimal("3.14159265358979323846264338328"),
}
_LIMITS = ("absolute", "relative", "last_digits", "arcsec", "sigmas")


class RulesError(ProblemsError):
    """A rule file that cannot be used."""


def _pattern(value: Any) -> re.Pattern[str]:
    """Return a regular expression."""
    require(isinstance(value, str) and value != "", "is a text: a regular expression")
    try:
        return re.compile(value)
    except re.error as error:
        raise ValueError(f"'{value}' is no regular expression: {error}") from error


def _patterns(value: Any) -> tuple[re.Pattern[str], ...]:
    """Return a regular expression, or a list of them."""
    return tuple(_pattern(entry) for entry in (value if isinstance(value, list) else [value]))


def _ids(value: Any) -> re.Pattern[str]:
    """Return a regular expression of ids, which may be a list of them, or integers."""
    require(value != [], "names at least one")
    texts = [
        str(entry) if type(entry) is int else entry for entry in (value if isinstance(value, list) else [value])
    ]
    return re.compile("|".join(f"(?:{_pattern(entry).pattern})" for entry in texts))


def _limit(value: Any) -> Decimal:
    """Return a number that is not negative."""
    number = Decimal(value) if type(value) is int else value
    fits = isinstance(number, Decimal) and number.is_finite() and number >= 0
    require(fits, "is a number, zero or larger")
    return Decimal(number)


def _span(value: Any) -> tuple[int, int]:
    """Return first and last of pages, or of columns of print."""
    both = value if isinstance(value, list) else [value, value]
    wrong = len(both) != 2 or any(type(end) is not int or end < 1 for end in both) or both[0] > both[1]
    require(not wrong, "is a number from 1, or [first, last]")
    return both[0], both[1]


def _column(value: Any) -> re.Pattern[str] | int:
    """Return the heading of a column as a regular expression, or its number."""
    if type(value) is not int:
        return _pattern(value)
    require(value >= 1, "is counted from 1")
    return value


@dataclass(frozen=True, kw_only=True)
class Rule:
    """One rule: selectors, all of which must fit, and what is allowed."""

    name: str = key("")
    pages: tuple[int, int] | None = key(None, "of A (of B for a row that only B has)", name="page", convert=_span)
    section: re.Pattern[str] | None = key(None, "found in the title", convert=_pattern)
    row: re.Pattern[str] | None = key(None, "found in the printed row", convert=_pattern)
    column: re.Pattern[str] | int | None = key(None, "in the heading; or its number, from 1", convert=_column)
    at: tuple[int, int] | None = key(None, "columns of print, first and last, from 1", convert=_span)
    id: re.Pattern[str] | None = key(None, "one of the ids of the row, whole", convert=_ids)
    photo: re.Pattern[str] | None = key(None, convert=_ids)
    point: re.Pattern[str] | None = key(None, convert=_ids)
    absolute: Decimal | None = key(None, convert=_limit)
    relative: Decimal | None = key(None, convert=_limit)
    last_digits: Decimal | None = key(None, convert=_limit)
    arcsec: Decimal | None = key(None, convert=_limit)
    sigmas: Decimal | None = key(None, convert=_limit)
    angle: AngleUnit = key("dms", choices=("dms", *ARC_SECONDS))
    skip: bool = key(False)
    exact: bool = key(False)
    order: str = key("", "the order of rows does not count", choices=("any",))
    only: str = key("", "rows may be in one of them only", choices=("A", "B", "either"))

    @staticmethod
    def faults(table: dict[str, Any]) -> Iterator[tuple[str, str]]:
        """Yield what is wrong with what a rule says as a whole."""
        limits = [name for name in _LIMITS if name in table]
        effects = [*limits, *(name for name in ("skip", "exact", "order", "only") if table.get(name))]
        if not effects:
            yield "", f"allows nothing; give one of {', '.join((*_LIMITS, 'skip, exact, order, only'))}"
        if table.get("skip", False) + table.get("exact", False) + bool(limits) > 1:
            yield effects[-1], "contradicts: a rule skips, is exact, or has limits"
        if "angle" in table and "arcsec" not in table:
            yield "angle", "goes with arcsec"
        if ("order" in table or "only" in table) and ("column" in table or "at" in table):
            name = "order" if "order" in table else "only"
            yield name, "speaks of whole rows: it does not go with column or at"

    @cached_property
    def decides_values(self) -> bool:
        """True where the rule speaks of values, not of rows only."""
        return self.skip or self.exact or any(getattr(self, key) is not None for key in _LIMITS)


@dataclass(frozen=True, kw_only=True)
class ListingLayout:
    """What cannot be seen in a text: lines that begin sections or belong to page headers, the control column."""

    section: tuple[re.Pattern[str], ...] = key((), convert=_patterns)
    header: tuple[re.Pattern[str], ...] = key((), convert=_patterns)
    carriage_control: bool | None = key(None, "None: found out")


@dataclass(frozen=True, kw_only=True)
class Rules:
    """All rules of a comparison, in the order of their file."""

    layout: ListingLayout = key(ListingLayout)
    rules: tuple[Rule, ...] = key((), name="rule")


def rounding_rules(part: float) -> Rules:
    """Return the rules of two records by different kernels or machines, whose last digits are rounded otherwise.

    Numbers may differ by this part of them, or what is near zero by a thousandth of it; positions, whose leading
    digits are of no account, by a hundred times this part of their sigmas; depths that common errors shift, which
    are small differences of large numbers, by a hundred times this part of them, or this part of a metre.
    """
    limit = Decimal(str(part))
    numbers = Rule(name="rounding", absolute=limit / 1000, relative=limit)
    positions = Rule(
        name="rounding of positions",
        column=re.compile(r"^position(\[\d\])?$"),
        sigmas=100 * limit,
        relative=limit / 1000000,
    )
    shifts = Rule(
        name="rounding of shifts",
        section=re.compile("^common_errors"),
        column=re.compile("^depth_"),
        absolute=limit,
        relative=100 * limit,
    )
    return Rules(rules=(numbers, positions, shifts))


def load_rules(path: str | Path) -> Rules:
    """Return the rules of a TOML file; raises `RulesError` with every problem, and `OSError`."""
    path = Path(path)
    return parse_rules(path.read_bytes(), str(path))


def parse_rules(data: bytes | str, name: str = "rules") -> Rules:
    """Return the rules of TOML text; raises `RulesError` with every problem."""
    try:
        text = data.decode("utf-8-sig") if isinstance(data, bytes) else data
        content = toml_of(text, parse_float=_decimal)
    except UnicodeDecodeError as error:
        raise RulesError.of("is not UTF-8 text", file=name) from error
    except ValueError as error:
        where = re.search(r" \(at line (\d+), column \d+\)$", str(error))
        message = str(error)[: where.start()] if where else str(error)
        line = int(where[1]) if where else len(text.splitlines())
        raise RulesError.of(message, file=name, line=line) from error
    reader = Reader(name, text)
    rules = reader.table(Rules, content, "")
    if reader.problems or not isinstance(rules, Rules):
        raise RulesError(reader.problems)
    labelled = (replace(rule, name=rule.name or f"rule {n}") for n, rule in enumerate(rules.rules, 1))
    return replace(rules, rules=tuple(labelled))


def _decimal(text: str) -> Decimal:
    try:
        return Decimal(text)
    except ArithmeticError as error:  # an exponent without end
        raise ValueError(f"{text[:20]} is no number") from error


# --- the rules applied: which decides about a value or a row, whether it lets a difference pass ---


CIRCLE = Decimal(1296000)  # arc seconds
# Printed numbers are subtracted without rounding, unless they are further apart than any field is wide. Comparisons
# run in this context: operators are several times quicker than methods of a context.
EXACTLY = Context(prec=400)
_LARGEST_ANGLE = Decimal("1e20")


@dataclass(eq=False)
class RuleUse:
    """What became of one rule: whether it selected anything, and how many differences it let pass."""

    rule: Rule
    matched: bool = False
    applied: bool = False  # False where a later rule always won
    passed: int = 0

    @property
    def name(self) -> str:
        """The name of the rule."""
        return self.rule.name


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
