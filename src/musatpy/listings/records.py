"""Two JSON files, field by field at full precision; in sigmas where a record has them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from functools import cached_property, lru_cache
from operator import itemgetter
from typing import Any, NamedTuple, cast

from musatpy.errors import Problem
from musatpy.listings.align import align
from musatpy.listings.findings import Difference, Finding, FindingKind, Place
from musatpy.listings.judge import NO_SPOT, Field, Judge, RuleSet, Spot
from musatpy.listings.lines import CannotCompareError
from musatpy.listings.rules import Rule, Rules
from musatpy.listings.tally import Tally
from musatpy.listings.tokens import Token

TOP = "(top)"
# Fields that may name what a row is about: as many of them, in this order, as tell all rows of a table apart.
_ID_FIELDS = (
    "id", "ids", "name", "pass", "number", "photo", "point", "camera", "mark", "group", "photos", "points",
    "unknown", "first", "second", "kind", "of", "component",
)  # fmt: skip
_PLAIN_SIGMA = frozenset({"position", "xy", "residual", "value", "coordinates"})  # whose sigma is called `sigma`
# Others (NaN, an exponent beyond all reason) are words.
_NUMBER = re.compile(r"-?\d+(?:\.(\d+))?(?:[eE]([+-]?\d{1,4}))?", re.ASCII)
_TWO_NUMBERS = re.compile(rf"{_NUMBER.pattern} {_NUMBER.pattern}", re.ASCII)
_PART = re.compile(r"\[(\d+)\]|\.?([^.\[\]]+)")
_INDEX = re.compile(r"^(.*?)((?:\[\d+\])*)$")
# Of ellipsoids in use, which differ by parts in ten thousand: sigmas are printed to three digits.
_SEMI_MAJOR_AXIS, _ECCENTRICITY_SQUARED = 6378200.0, 0.00675  # m, 1


class Number(str):
    """A number as it is written in a JSON file."""

    __slots__ = ()


_ABSENT = object()  # what a row has in a field that only the other row has
_CONTAINERS = frozenset({list, dict})
Both = tuple[str, Any, Any]  # path of a field, and what A and B have there


@dataclass(eq=False)
class Table:
    """Rows of a record: of a list of objects, or one row of what stands in an object."""

    name: str
    rows: list[dict[str, Any]] = field(default_factory=list)

    @cached_property
    def id_fields(self) -> tuple[str, ...]:
        """The fields that name the rows."""
        found: tuple[str, ...] = ()
        for name in _ID_FIELDS:
            if self.rows and all(name in row for row in self.rows):
                found = (*found, name)
                if self._tell_apart(found):
                    break
        return found

    def _tell_apart(self, names: Sequence[str]) -> bool:
        """Tell whether no two rows have the same in all of some fields."""
        values = list(map(itemgetter(*names), self.rows))
        try:
            return len(set(values)) == len(values)
        except TypeError:  # lists among them
            return len(set(map(repr, values))) == len(values)

    @cached_property
    def ids(self) -> list[tuple[str, ...]]:
        """The names of each row, none where there is only one row."""
        if not self.id_fields:
            return [()] * len(self.rows)
        fields = [[row[name] for row in self.rows] for name in self.id_fields]
        if any(list in set(map(type, values)) for values in fields):
            return [tuple([one for value in row for one in _texts(value)]) for row in zip(*fields, strict=True)]
        return list(zip(*(map(str, values) for values in fields), strict=True))


@dataclass(frozen=True, eq=False)
class Record:
    """A JSON file as tables."""

    tables: dict[str, Table]
    geographic: bool  # positions are latitude, longitude (radians), height

    @classmethod
    def read(cls, text: str, name: str) -> Record:
        """Return the tables of a JSON text; raises `CannotCompareError` where it is none."""
        content = read_json(text, name)
        tables: dict[str, Table] = {}
        for path, rows in _tables(content, ""):
            tables.setdefault(path or TOP, Table(path or TOP)).rows.extend(rows)
        options = content.get("options") if isinstance(content, dict) else None
        return cls(tables, isinstance(options, dict) and options.get("system") == "GEOG")


def read_json(text: str, name: str) -> Any:
    """Return the content of a JSON text, its numbers as they are written; raises `CannotCompareError`."""
    try:
        return json.loads(text, parse_float=Number, parse_int=Number, parse_constant=Number)
    except json.JSONDecodeError as error:
        problem = Problem(file=name, line=error.lineno, message=f"is not JSON: {error.msg}")
        raise CannotCompareError([problem]) from error
    except RecursionError as error:
        raise CannotCompareError([Problem(file=name, message="is nested too deep")]) from error


def _tables(value: Any, path: str) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield rows with the path of their table: objects of a list, and of objects what is no table itself."""
    if _is_table(value):
        yield path, value
        return
    if not isinstance(value, dict):
        yield path, [{"value": value}]
        return
    nested = {key: entry for key, entry in value.items() if _is_table(entry) or isinstance(entry, dict)}
    own = {key: entry for key, entry in value.items() if key not in nested}
    if own or not value:
        yield path, [own]
    for key, entry in nested.items():
        yield from _tables(entry, f"{path}.{key}" if path else key)


def _is_table(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(entry, dict) for entry in value)


def _texts(value: Any) -> list[str]:
    return [str(one) for one in value] if isinstance(value, list) else [str(value)]


def leaves(value: Any, path: str = "") -> list[tuple[str, Any]]:
    """Return the path and the value of every field of a row: `position[1]`, `a.b`; of an empty list that itself."""
    found: list[tuple[str, Any]] = []
    waiting = [(path, value)]  # the next one last; however deep a record is nested
    while waiting:
        path, value = waiting.pop()
        if isinstance(value, dict):
            inside = [(f"{path}.{key}" if path else key, entry) for key, entry in value.items()]
        elif isinstance(value, list) and value:
            inside = [(f"{path}[{n}]", entry) for n, entry in enumerate(value)]
        else:
            found.append((path, value))
            continue
        if _CONTAINERS.isdisjoint([type(entry) for _, entry in inside]):
            found += inside
        else:
            waiting += reversed(inside)
    return found


def _token(value: Any) -> Token | None:
    """Return the token of what stands in a field; None where the row has no such field."""
    if isinstance(value, Number):
        text = str(value)
        if (number := _NUMBER.fullmatch(text)) is None:
            return Token("word", text)
        decimals, exponent = number.groups(default="")
        return Token._make(("number", text, Decimal(text), int(exponent or 0) - len(decimals)))
    if isinstance(value, str):
        return Token("word", json.dumps(value) if value in ("null", "true", "false", "") else value)
    return None if value is _ABSENT else Token("word", json.dumps(value))


def _fields(a: Mapping[str, Any], b: Mapping[str, Any]) -> list[Both]:
    """Return all fields of two rows."""
    ones, others = leaves(a), leaves(b)
    if [path for path, _ in ones] == [path for path, _ in others]:
        return [(path, one, other) for (path, one), (_, other) in zip(ones, others, strict=True)]
    return [both for key in {**a, **b} for both in _merged(key, a, b)]


def _merged(key: str, a: Mapping[str, Any], b: Mapping[str, Any]) -> list[Both]:
    """Return the fields in one entry of two rows, which need not be made alike."""
    one, other = (dict(leaves(row[key], key)) if key in row else {} for row in (a, b))
    return [(path, one.get(path, _ABSENT), other.get(path, _ABSENT)) for path in {**one, **other}]


def _differing(a: Mapping[str, Any], b: Mapping[str, Any]) -> list[Both]:
    """Return the fields of two rows that differ, with hardly a look at the others."""
    found: list[Both] = []
    for key in a if a.keys() == b.keys() else {**a, **b}:
        value, other = a.get(key, _ABSENT), b.get(key, _ABSENT)
        if value == other:
            continue
        if _is_vector(value) and _is_vector(other) and len(value) == len(other):
            found += [
                (f"{key}[{n}]", one, two)
                for n, (one, two) in enumerate(zip(value, other, strict=True))
                if one != two
            ]
        else:
            found += [both for both in _merged(key, a, b) if both[1] != both[2]]
    return found


def _is_vector(value: Any) -> bool:
    """Tell whether a value is a list of numbers and words."""
    return type(value) is list and _CONTAINERS.isdisjoint(map(type, value))


@lru_cache(maxsize=1 << 12)
def keys_of(path: str) -> tuple[str | int, ...]:
    """Return the keys and indices of a path, one after the other."""
    return tuple([int(index) if index else name for index, name in _PART.findall(path)])


def at(value: Any, path: str) -> Any:
    """Return what stands at a path of a record (`position[1]`, `solution.sigma0`), None where there is nothing.

    The last names of a path may hold points and blanks of their own (`solution.unknowns.station parameters`).
    """
    for key in keys_of(path):
        if type(key) is int:
            value = value[key] if isinstance(value, list) and key < len(value) else None
        else:
            value = value.get(key) if isinstance(value, dict) else None
    return value


def compare_records(a: str, b: str, rules: Rules, names: tuple[str, str]) -> Difference:
    """Return what differs between two JSON texts."""
    judge = Judge(rules)
    records = Record.read(a, names[0]), Record.read(b, names[1])
    titles = list(dict.fromkeys([*records[0].tables, *records[1].tables]))
    tallies = [_Tables(judge, title, records).tally() for title in titles]
    return Difference(
        a=names[0],
        b=names[1],
        findings=tuple(finding for tally in tallies for finding in tally.findings),
        sections=tuple(tally.summary() for tally in tallies),
        rules=judge.uses(),
    )


class _Tables:
    """One table of both records."""

    def __init__(self, judge: Judge, title: str, records: tuple[Record, Record]) -> None:
        self.judge = judge
        self.title = title
        self.a, self.b = (record.tables.get(title, Table(title)) for record in records)
        self.geographic = all(record.geographic for record in records)
        self.names = {*records[0].tables, *records[1].tables}
        self.result = Tally(title)
        self.rules = judge.of_section([title])
        self.touched: set[tuple[RuleSet, int, str, type]] = set()

    def tally(self) -> Tally:
        """Compare, and return what was found."""
        if not self.a.rows or not self.b.rows:
            fields = [one for row in (*self.a.rows, *self.b.rows) for one in leaves(row)]
            if not fields or not all(self.is_empty_table(path, _token(value)) for path, value in fields):
                self.only_here("A" if self.a.rows else "B")
            return self.result
        ids = self.a.ids, self.b.ids
        if len(self.a.rows) == len(self.b.rows) == 1:
            ids = [("",)], [("",)]
        texts = self.texts(ids)
        found = align(ids, texts, lambda side, row: texts[side][row][:60], strict=any(map(any, ids[0])))
        for n in found.only_a:
            self.only_row(self.a, n, "A")
        for n, other in found.pairs:
            self.rows(n, other, n in found.moved)
        for n in found.only_b:
            self.only_row(self.b, n, "B")
        return self.result

    def texts(self, ids: tuple[Sequence[Hashable], Sequence[Hashable]]) -> tuple[list[str], list[str]]:
        """Return the rows as texts, which tell rows without ids apart."""
        if len(set(ids[0])) == len(ids[0]) and len(set(ids[1])) == len(ids[1]):
            return [str(one) for one in ids[0]], [str(one) for one in ids[1]]
        return [json.dumps(row) for row in self.a.rows], [json.dumps(row) for row in self.b.rows]

    def only_here(self, side: str) -> None:
        """Take a table that the other record has not: one finding, unless rules allow it."""
        rows = len((self.a if side == "A" else self.b).rows)
        spot = _spot({}, (), "")
        if not self.judge.about_row(self.judge.of_row(self.rules, spot), spot, side):
            text = f"{rows} rows"
            self.found("section", "", "", text if side == "A" else None, text if side == "B" else None)

    def only_row(self, table: Table, n: int, side: str) -> None:
        """Take a row that the other record has not."""
        spot = self.spot(table, n)
        if not self.judge.about_row(self.judge.of_row(self.rules, spot), spot, side):
            text = json.dumps(table.rows[n])
            kind = cast(FindingKind, f"only in {side}")
            label = _label(table, n)
            self.found(kind, label, "", text if side == "A" else None, text if side == "B" else None)

    def rows(self, n: int, other: int, moved: bool) -> None:
        """Compare two rows that belong together."""
        self.result.rows += 1
        a, b = self.a.rows[n], self.b.rows[other]
        same = a == b
        if same and not moved and not self.rules:
            return
        label = _label(self.a, n)
        spot = self.spot(self.a, n) if self.rules else NO_SPOT
        among = self.judge.of_row(self.rules, spot)
        if moved and not self.judge.about_row(among, spot, "order"):
            self.found("order", label, "", None, None)
        unused = self.judge.open(among)
        if same and not unused:
            return
        fields = _fields(a, b) if unused or self.judge.counts_columns(among) else _differing(a, b)
        for number, (path, one, two) in enumerate(fields, start=1):
            if one != two:
                if among or not self.numbers(path, label, one, two, (a, b)):
                    tokens = _token(one), _token(two)
                    self.field(path, label, tokens, (a, b), self.rule(among, spot, number, path, tokens))
            elif unused:
                self.touch(among, spot, number, path, one)
        if unused:
            self.judge.touch_rows(unused, spot)

    def rule(
        self, among: RuleSet, spot: Spot, number: int, path: str, tokens: tuple[Token | None, Token | None]
    ) -> Rule | None:
        """Return the rule that decides about a field."""
        return self.judge.about_value(self.judge.of_field(among, spot, Field(-1, number, path)), *tokens)

    def touch(self, among: RuleSet, spot: Spot, number: int, path: str, value: Any) -> None:
        """Let rules decide about a field that does not differ: once for all of one name and type."""
        key = among, number, path, type(value)
        if key not in self.touched:
            token = _token(value)
            self.rule(among, spot, number, path, (token, token))
            if token is not None and (token.is_value or not isinstance(value, Number)):
                self.touched.add(key)

    def numbers(
        self, path: str, label: str, one: Any, two: Any, rows: tuple[Mapping[str, Any], Mapping[str, Any]]
    ) -> bool:
        """Take two numbers that no rule selects as `field` would, in half the time; tell if they differ."""
        if type(one) is not Number or type(two) is not Number or not _TWO_NUMBERS.fullmatch(f"{one} {two}"):
            return False
        difference = Decimal(two) - Decimal(one)
        if difference:
            sigmas = _in_sigmas(path, difference, rows, self.geographic)
            unit = _unit(path, self.geographic)
            self.result.found(
                Finding._make((
                    "number", self.title, label, path, str(one), str(two), difference, unit, None, sigmas, "exact",
                    _NO_PLACE, _NO_PLACE,
                ))
            )  # fmt: skip
        return bool(difference)

    def field(
        self,
        path: str,
        label: str,
        tokens: tuple[Token | None, Token | None],
        rows: tuple[Mapping[str, Any], Mapping[str, Any]],
        rule: Rule | None,
    ) -> None:
        """Weigh a field that differs, or that one row has not."""
        a, b = tokens
        if a is None or b is None:
            if not self.is_empty_table(path, a or b) and (rule is None or not rule.skip):
                name = rule.name if rule else "exact"
                self.found("text", label, path, a and a.text, b and b.text, rule=name)
            return
        sigmas = None
        if a.value is not None and b.value is not None:
            sigmas = _in_sigmas(path, b.value - a.value, rows, self.geographic)
        passes, name, skipped, difference, _, unit = self.judge.weigh(rule, a, b, sigmas)
        if skipped or (passes and not difference):
            return
        kind: FindingKind = "number"
        if difference is None:
            kind, unit = "text", ""
        elif not unit:
            unit = _unit(path, self.geographic)
        self.result.found(
            Finding._make((
                kind, self.title, label, path, a.text, b.text, difference, unit, None, sigmas, name, _NO_PLACE,
                _NO_PLACE,
            )),
            passes=passes,
        )  # fmt: skip

    def is_empty_table(self, path: str, token: Token | None) -> bool:
        """Tell whether a field is the empty list of a table of the other record, which is a finding of its own."""
        name = path if self.title == TOP else f"{self.title}.{path}"
        return token is not None and token.text == "[]" and name in self.names

    def found(
        self, kind: FindingKind, row: str, column: str, a: str | None, b: str | None, *, rule: str = "exact"
    ) -> None:
        """Take a finding without a difference of numbers."""
        self.result.found(Finding(kind=kind, section=self.title, row=row, column=column, a=a, b=b, rule=rule))

    def spot(self, table: Table, n: int) -> Spot:
        """Return a row as rules see it."""
        return _spot(table.rows[n], table.ids[n], _label(table, n))


_NO_PLACE = Place()


def _spot(row: Mapping[str, Any], ids: tuple[str, ...], label: str) -> Spot:
    def named(*keys: str) -> tuple[str, ...]:
        return tuple(one for key in keys if key in row for one in _texts(row[key]))

    return Spot((), (label,), ids, lambda column: named("photo", "photos"), lambda column: named("point", "points"))


def _label(table: Table, n: int) -> str:
    if table.id_fields:
        row = table.rows[n]
        return " ".join([f"{key} {' '.join(_texts(row[key]))}" for key in table.id_fields])
    return f"row {n + 1}" if len(table.rows) > 1 else "values"


def _in_sigmas(
    path: str, difference: Decimal, rows: tuple[Mapping[str, Any], Mapping[str, Any]], geographic: bool
) -> float | None:
    """Return B minus A of a field in sigmas of B (of A where B has none); None without sigmas."""
    yard = _yardstick(path, geographic)
    scale = 1.0
    if yard.latitude:
        latitude = at(rows[1], yard.latitude)
        if not isinstance(latitude, Number) or not math.isfinite(float(latitude)):
            return None
        scale = _metres_per_radian(float(latitude), yard.along_meridian)
    for row in (rows[1], rows[0]):
        for first, name in yard.sigmas:
            if first in row:
                text = at(row, name)
                if isinstance(text, Number) and (sigma := float(text)) > 0.0:
                    return float(difference) * scale / sigma
    return None


class _Yardstick(NamedTuple):
    """Where the sigma of a field may stand in its row, each path behind the first of its keys."""

    sigmas: tuple[tuple[str | int, str], ...]
    latitude: str = ""  # where it stands for an angle on the ellipsoid, whose sigma is in metres
    along_meridian: bool = False


@lru_cache(maxsize=1 << 12)
def _yardstick(path: str, geographic: bool) -> _Yardstick:
    base, index = _split(path)
    on_ellipsoid = geographic and base.endswith("position") and index in ("[0]", "[1]")
    along_meridian = on_ellipsoid and index == "[0]"
    if on_ellipsoid:
        index = "[1]" if along_meridian else "[0]"  # sigmas are those of east, north, up
    names = [f"{base}_sigma{index}", f"sigma_{base}{index}"]
    names += [f"sigma{index}"] if base in _PLAIN_SIGMA else []
    sigmas = tuple((keys_of(name)[0], name) for name in names)
    return _Yardstick(sigmas, f"{base}[0]" if on_ellipsoid else "", along_meridian)


@lru_cache(maxsize=1 << 12)
def _split(path: str) -> tuple[str, str]:
    match = _INDEX.match(path)
    return (match[1], match[2]) if match else (path, "")


def _metres_per_radian(latitude: float, along_meridian: bool) -> float:
    """Return metres on the ellipsoid for a radian of latitude, or of longitude."""
    w = math.sqrt(1.0 - _ECCENTRICITY_SQUARED * math.sin(latitude) ** 2)
    if along_meridian:
        return _SEMI_MAJOR_AXIS * (1.0 - _ECCENTRICITY_SQUARED) / w**3
    return _SEMI_MAJOR_AXIS / w * math.cos(latitude)


@lru_cache(maxsize=1 << 12)
def _unit(path: str, geographic: bool) -> str:
    """Return the unit of a field of our records, as far as its name says it."""
    base, index = _split(path)
    if "attitude" in base or (geographic and base.endswith("position") and index in ("[0]", "[1]")):
        return "rad"
    if base.endswith(("position", "position_sigma", "depth", "depth_sigma", "water_level")):
        return "m"
    return ""
