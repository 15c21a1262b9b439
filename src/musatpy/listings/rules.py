"""Rules of a comparison: a TOML file -> what is selected, and how far it may differ.

The last rule that selects a value decides about it; the order of rows and rows in one file only are decided apart,
by the last rule that speaks of them. A file that is wrong is refused with every reason.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from musatpy.errors import ProblemsError
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
