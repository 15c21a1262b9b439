"""Rules of a comparison: a TOML file -> what is selected, and how far it may differ.

The last rule that selects a value decides about it; the order of rows and rows in one file only are decided apart,
by the last rule that speaks of them. A file that is wrong is refused with every reason.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, fields
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from musatpy.errors import Problem, ProblemsError
from musatpy.specs import toml_of

AngleUnit = Literal["dms", "degrees", "radians", "gons"]
ARC_SECONDS = {
    "degrees": Decimal(3600),
    "gons": Decimal(3240),
    "radians": Decimal(648000) / Decimal("3.14159265358979323846264338328"),
}


class RulesError(ProblemsError):
    """A rule file that cannot be used."""


@dataclass(frozen=True, kw_only=True)
class Rule:
    """One rule: selectors, all of which must fit, and what is allowed."""

    name: str
    pages: tuple[int, int] | None = None  # first and last page, of A (of B for a row that only B has)
    section: re.Pattern[str] | None = None  # found in the title
    row: re.Pattern[str] | None = None  # found in the printed row
    column: re.Pattern[str] | int | None = None  # found in the heading; or which column, from 1
    at: tuple[int, int] | None = None  # columns of print, first and last, from 1
    id: re.Pattern[str] | None = None  # one of the ids of the row, whole
    photo: re.Pattern[str] | None = None
    point: re.Pattern[str] | None = None
    absolute: Decimal | None = None
    relative: Decimal | None = None
    last_digits: Decimal | None = None
    arcsec: Decimal | None = None
    sigmas: Decimal | None = None
    angle: AngleUnit = "dms"
    skip: bool = False
    exact: bool = False
    order: bool = False  # the order of rows does not count
    only: str = ""  # rows may be in "A", "B" or "either" only

    @property
    def decides_values(self) -> bool:
        """True where the rule speaks of values, not of rows only."""
        return self.skip or self.exact or any(getattr(self, key) is not None for key in _LIMITS)

    @cached_property
    def for_last_digits(self) -> Decimal | None:
        """How many units of the last digit numbers may differ; None where that does not decide."""
        return None if self.exact or self.skip or self.arcsec is not None else self.last_digits

    @property
    def selects_fields(self) -> bool:
        """True where the rule selects fields of a row, not whole rows."""
        return self.column is not None or self.at is not None


@dataclass(frozen=True, kw_only=True)
class Layout:
    """What cannot be seen in a text: lines that begin sections or belong to page headers, the control column."""

    section: tuple[re.Pattern[str], ...] = ()
    header: tuple[re.Pattern[str], ...] = ()
    carriage_control: bool | None = None  # None: found out


@dataclass(frozen=True, kw_only=True)
class Rules:
    """All rules of a comparison, in the order of their file."""

    rules: tuple[Rule, ...] = ()
    layout: Layout = field(default_factory=Layout)


_LIMITS = ("absolute", "relative", "last_digits", "arcsec", "sigmas")
_PATTERNS = ("section", "row", "id", "photo", "point")
_KEYS = {"page", *(one.name for one in fields(Rule))} - {"pages"}
_LAYOUT_KEYS = {one.name for one in fields(Layout)}


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
        raise RulesError([Problem(file=name, message="is not UTF-8 text")]) from error
    except ValueError as error:
        where = re.search(r" \(at line (\d+), column \d+\)$", str(error))
        message = str(error)[: where.start()] if where else str(error)
        line = int(where[1]) if where else len(text.splitlines())
        raise RulesError([Problem(file=name, line=line, message=message)]) from error
    return _Reader(text, name).rules(content)


def _decimal(text: str) -> Decimal:
    try:
        return Decimal(text)
    except ArithmeticError as error:  # an exponent without end
        raise ValueError(f"{text[:20]} is no number") from error


class _Reader:
    """Turns the content of a rule file into rules, and keeps what is wrong with the line where it stands."""

    def __init__(self, text: str, name: str) -> None:
        self.lines = text.splitlines()
        self.name = name
        self.problems: list[Problem] = []
        self.heads = [n for n, line in enumerate(self.lines) if re.match(r"\s*\[\[\s*rule\s*\]\]", line)]
        self.start: int | None = None  # of the table that is read
        self.label = ""

    def rules(self, content: dict[str, Any]) -> Rules:
        """Return all rules; raises `RulesError`."""
        for key in content:
            if key not in ("rule", "layout"):
                self.start, self.label = 0, ""
                self.wrong(key, "is not a key; a rule file has [layout] and [[rule]] tables")
        layout = self.layout(content.get("layout", {}))
        entries = content.get("rule", [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            self.start, self.label = 0, ""
            self.wrong("rule", "is written [[rule]], one table for each rule")
            entries = []
        found = [self.rule(entry, number) for number, entry in enumerate(entries)]
        if self.problems:
            raise RulesError(self.problems)
        return Rules(rules=tuple(found), layout=layout)

    def wrong(self, key: str | None, message: str) -> None:
        """Keep a problem of a key of the table that is read."""
        self.problems.append(
            Problem(file=self.name, line=self.line_of(key), card=self.label or None, field=key, message=message)
        )

    def line_of(self, key: str | None) -> int | None:
        """Return the line of a key, or of its table, from 1."""
        if self.start is None:
            return None
        if key is not None:
            for number in range(self.start, len(self.lines)):
                line = self.lines[number].strip()
                if re.match(rf"[\"']?{re.escape(key)}[\"']?\s*[=.]|\[+\s*{re.escape(key)}\s*[\].]", line):
                    return number + 1
                if number > self.start and line.startswith("[") and self.label:
                    break
        return self.start + 1

    def layout(self, table: Any) -> Layout:
        """Return the table [layout]."""
        heads = [n for n, line in enumerate(self.lines) if re.match(r"\s*\[\s*layout\s*\]", line)]
        self.start, self.label = (heads[0] if heads else 0), "layout"
        if not isinstance(table, dict):
            self.wrong(None, "is a table: [layout]")
            return Layout()
        for key in table.keys() - _LAYOUT_KEYS:
            self.wrong(key, f"is not a key of [layout]; there are {', '.join(sorted(_LAYOUT_KEYS))}")
        control = table.get("carriage_control")
        if control is not None and not isinstance(control, bool):
            self.wrong("carriage_control", "is true or false")
        patterns = {key: self.patterns(table, key) for key in ("section", "header") if key in table}
        return Layout(carriage_control=control, **patterns)

    def patterns(self, table: dict[str, Any], key: str) -> tuple[re.Pattern[str], ...]:
        """Return a regular expression, or a list of them."""
        value = table[key]
        found = [self.pattern(key, one) for one in (value if isinstance(value, list) else [value])]
        return tuple(one for one in found if one is not None)

    def rule(self, table: dict[str, Any], number: int) -> Rule:
        """Return one rule; what is wrong with it is kept."""
        self.start = self.heads[number] if number < len(self.heads) else 0
        self.label = f"rule {number + 1}"
        for key in sorted(table.keys() - _KEYS):
            self.wrong(key, f"is not a key of a rule; there are {', '.join(sorted(_KEYS))}")
        values: dict[str, Any] = {}
        readers = {
            **dict.fromkeys(_PATTERNS, self.id_pattern),
            **dict.fromkeys(_LIMITS, self.limit),
            **dict.fromkeys(("skip", "exact"), self.true),
            "page": self.span,
            "at": self.span,
            "column": self.column,
            "name": self.text,
            "angle": self.angle,
            "order": self.order,
            "only": self.only,
        }
        for key, value in table.items():
            if key in readers:
                values["pages" if key == "page" else key] = readers[key](key, value)
        self.together(table)
        return Rule(**{"name": self.label} | {key: value for key, value in values.items() if value is not None})

    def together(self, table: dict[str, Any]) -> None:
        """Check what a rule says as a whole."""
        limits = [key for key in _LIMITS if key in table]
        whats = [*limits, *(key for key in ("skip", "exact", "order", "only") if key in table)]
        if not whats:
            self.wrong(None, f"allows nothing; give one of {', '.join((*_LIMITS, 'skip, exact, order, only'))}")
        if ("skip" in table) + ("exact" in table) + bool(limits) > 1:
            self.wrong(whats[-1], "contradicts: a rule skips, is exact, or has limits")
        if "angle" in table and "arcsec" not in table:
            self.wrong("angle", "goes with arcsec")
        if ("order" in table or "only" in table) and ("column" in table or "at" in table):
            key = "order" if "order" in table else "only"
            self.wrong(key, "speaks of whole rows: it does not go with column or at")

    def pattern(self, key: str, value: Any) -> re.Pattern[str] | None:
        """Return a regular expression."""
        if not isinstance(value, str) or not value:
            self.wrong(key, "is a text: a regular expression")
            return None
        try:
            return re.compile(value)
        except re.error as error:
            self.wrong(key, f"'{value}' is no regular expression: {error}")
            return None

    def id_pattern(self, key: str, value: Any) -> re.Pattern[str] | None:
        """Return a regular expression; ids may be a list of them, or integers."""
        if key in ("section", "row"):
            return self.pattern(key, value)
        if value == []:
            self.wrong(key, "names at least one")
        texts = [str(one) if type(one) is int else one for one in (value if isinstance(value, list) else [value])]
        found = [self.pattern(key, one) for one in texts]
        return re.compile("|".join(f"(?:{one.pattern})" for one in found if one)) if all(found) and found else None

    def limit(self, key: str, value: Any) -> Decimal | None:
        """Return a number that is not negative."""
        if type(value) is int:
            value = Decimal(value)
        if not isinstance(value, Decimal) or not value.is_finite() or value < 0:
            self.wrong(key, "is a number, zero or larger")
            return None
        return value

    def true(self, key: str, value: Any) -> bool | None:
        """Return True, all that these keys can say."""
        if value is not True:
            self.wrong(key, "is true, or left out")
            return None
        return True

    def span(self, key: str, value: Any) -> tuple[int, int] | None:
        """Return first and last of pages, or of columns of print."""
        both = value if isinstance(value, list) else [value, value]
        if len(both) != 2 or any(type(one) is not int or one < 1 for one in both) or both[0] > both[1]:
            self.wrong(key, "is a number from 1, or [first, last]")
            return None
        return both[0], both[1]

    def column(self, key: str, value: Any) -> re.Pattern[str] | int | None:
        """Return the heading of a column as a regular expression, or its number."""
        if type(value) is int:
            if value < 1:
                self.wrong(key, "is counted from 1")
                return None
            return value
        return self.pattern(key, value)

    def text(self, key: str, value: Any) -> str | None:
        """Return a text."""
        if not isinstance(value, str) or not value.strip():
            self.wrong(key, "is a text")
            return None
        return value

    def angle(self, key: str, value: Any) -> str | None:
        """Return in which unit numbers are angles."""
        if value not in ("dms", *ARC_SECONDS):
            self.wrong(key, "is 'dms', 'degrees', 'radians' or 'gons'")
            return None
        return str(value)

    def order(self, key: str, value: Any) -> bool | None:
        """Return True for `order = "any"`."""
        if value != "any":
            self.wrong(key, "is 'any'")
            return None
        return True

    def only(self, key: str, value: Any) -> str | None:
        """Return which file may have rows that the other has not."""
        if value not in ("A", "B", "either"):
            self.wrong(key, "is 'A', 'B' or 'either'")
            return None
        return str(value)
