"""Two JSON files, field by field at full precision; in sigmas where a record has them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from decimal import Decimal
from functools import cache
from typing import Any, NamedTuple

from musatpy.errors import Problem
from musatpy.listings.align import align
from musatpy.listings.findings import Difference, Tally
from musatpy.listings.json_tables import (
    TOP,
    NamedRows,
    Row,
    leaves,
    number_of,
    read_json,
    tables_of,
    texts_of,
)
from musatpy.listings.judge import Field, Judge, Spot, still_open
from musatpy.listings.lines import CannotCompareError
from musatpy.listings.rules import Rules
from musatpy.listings.tokens import Token
from musatpy.listings.weighing import Comparison, RowPair, Where
from musatpy.reports.values import at

_PLAIN_SIGMA = frozenset({"position", "xy", "residual", "value", "coordinates"})  # whose sigma is called `sigma`
# Others (NaN, infinity) are words.
_NUMBER = re.compile(r"-?\d+(?:\.(\d+))?(?:[eE]([+-]?\d{1,4}))?", re.ASCII)
_INDICES = re.compile(r"\[(\d+)\]")
_GEOGRAPHIC = " (GEOG) or "  # `rad, rad, m (GEOG) or m`
_OF_ROW = "the row's"  # unit, of which the row has a field
_UNIT = re.compile(r"\w+(?:/\w+)?")  # not `that of the coordinates`


def compare_records(a: str, b: str, rules: Rules, names: tuple[str, str]) -> Difference:
    """Return what differs between two JSON texts; raises `CannotCompareError` for records of different schemas."""
    judge = Judge(rules)
    contents = [read_json(text, name) for text, name in zip((a, b), names, strict=True)]
    schemas = [str(at(content, "schema_version")) for content in contents]
    if len({schema.partition(".")[0] for schema in schemas}) > 1:
        message = f"is a record of schema {schemas[0]}, and {names[1]} of {schemas[1]}; run the older deck again"
        raise CannotCompareError([Problem(file=names[0], message=message)])
    tables = [tables_of(content) for content in contents]
    geographic = all(at(content, "options.system") == "GEOG" for content in contents)
    axes = _axes_of(contents[1]) if geographic else None
    titles = dict.fromkeys([*tables[0], *tables[1]])
    none = NamedRows([], ())
    tallies = [
        _Tables(
            judge, title, [side.get(title, none) for side in tables], titles, _Statements(title, geographic, axes)
        ).tally()
        for title in titles
    ]
    return Difference.of(names, tallies, judge.rules)


def _axes_of(content: Any) -> tuple[float, float] | None:
    """Return the axes (m) of the ellipsoid of a record, None where it does not say."""
    from musatpy.geometry.geodesy import Ellipsoid  # most comparisons need none

    name, *sizes = (at(content, f"ellipsoid.{part}") for part in ("name", "semi_major_axis", "inverse_flattening"))
    try:
        return Ellipsoid(str(name or ""), *(number_of(size) for size in sizes)).axes
    except (ValueError, RuntimeError):  # no name that PROJ knows, no size
        return None


class _Tables(Comparison):
    """One table of both records."""

    counts_digits = False

    def __init__(
        self,
        judge: Judge,
        title: str,
        tables: Sequence[NamedRows],
        titles: Collection[str],
        statements: _Statements,
    ) -> None:
        super().__init__(judge, title, [title])
        self.a, self.b = tables
        self.titles = titles  # of all tables
        self.statements = statements

    def tally(self) -> Tally:
        """Compare, and return what was found."""
        if not self.a.rows or not self.b.rows:
            self.only_here(self.a if self.a.rows else self.b, "A" if self.a.rows else "B")
            return self.result
        ids = self.a.ids(), self.b.ids()
        if len(self.a.rows) == len(self.b.rows) == 1:
            ids = [("",)], [("",)]
        texts = [
            [""] * len(names) if all(names) else list(map(json.dumps, table.rows))
            for names, table in zip(ids, (self.a, self.b), strict=True)
        ]
        for n, other, moved in align(ids, (texts[0], texts[1]), strict=any(map(any, ids[0]))):
            if n is not None and other is not None:
                self.rows(n, other, moved)
            elif n is not None:
                self.only(self.a, n, "A")
            elif other is not None:
                self.only(self.b, other, "B")
        return self.result

    def only_here(self, table: NamedRows, side: str) -> None:
        """Take a table that the other record has not: one finding, unless it is empty or rules allow it."""
        fields = [field for row in table.rows for field in leaves(row).items()]
        if all(self.is_empty_table(path, value) for path, value in fields):
            return
        if not self.allows(Spot(), side):
            self.lonely("section", side, f"{len(table.rows)} rows", Where())

    def only(self, table: NamedRows, n: int, side: str) -> None:
        """Take a row that the other record has not."""
        self.only_row(_spot(table, n), side, json.dumps(table.rows[n]), Where(table.label(n)))

    def rows(self, n: int, other: int, moved: bool) -> None:
        """Compare two rows that belong together."""
        self.result.rows += 1
        a, b = self.a.rows[n], self.b.rows[other]
        if a == b and not moved and not still_open(self.rules):
            return
        both = self.pair(Where(self.a.label(n)), _spot(self.a, n))
        if moved:
            self.elsewhere(both)
        unused = still_open(both.among)
        if a == b and not unused:
            return
        if not unused and not any(isinstance(use.rule.column, int) for use in both.among):
            differing = [key for key in dict.fromkeys([*a, *b]) if a.get(key, _ABSENT) != b.get(key, _ABSENT)]
            parts = [{key: row[key] for key in differing if key in row} for row in (a, b)]
            fields = leaves(parts[0]), leaves(parts[1])
        else:  # rules wait for a field, or count them
            fields = leaves(a), leaves(b)
        for number, path in enumerate(fields[0] | fields[1], start=1):
            field = Field(-1, number, path)
            values = tuple(side.get(path, _ABSENT) for side in fields)
            if values[0] != values[1]:
                self.field(both, field, values, (a, b))
            elif unused:
                self.rule(both, field, *map(_token, values))
        if unused:
            self.judge.touch_rows(unused, both.spot)

    def field(self, both: RowPair, field: Field, values: Sequence[Any], rows: tuple[Row, Row]) -> None:
        """Weigh a field that differs, or that one row has not."""
        a, b = map(_token, values)
        path = field.heading
        if a is None or b is None:
            if self.is_empty_table(path, values[a is None]):
                self.rule(both, field, a, b)  # of use, though there is nothing to decide
            else:
                self.unpaired(both, field, (a and a.text, b and b.text))
            return
        sigmas = None
        if a.value is not None and b.value is not None:
            sigmas = self.statements.in_sigmas(path, b.value - a.value, rows)
        self.weigh(both, field, self.statements.unit_of(path, rows[0]), a, b, sigmas)

    def is_empty_table(self, path: str, value: Any) -> bool:
        """Tell whether a field is the empty list of a table of the other record, which is a finding of its own."""
        name = path if self.result.title == TOP else f"{self.result.title}.{path}"
        return value == [] and name in self.titles


_ABSENT = object()  # what a row has in a field that only the other row has


def _spot(table: NamedRows, n: int) -> Spot:
    """Return a row as rules see it."""
    row, label = table.rows[n], table.label(n)

    def named(*keys: str) -> tuple[str, ...]:
        return tuple(name for key in keys if key in row for name in texts_of(row[key]))

    ids = tuple(text for name in table.id_fields for text in texts_of(row[name]))
    return Spot((), (label,), ids, lambda column: named("photo", "photos"), lambda column: named("point", "points"))


def _token(value: Any) -> Token | None:
    """Return the token of what stands in a field; None where the row has no such field."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        text = str(value)
        if (number := _NUMBER.fullmatch(text)) is None:
            return Token("word", text)
        decimals, exponent = number.groups(default="")
        return Token("number", text, Decimal(text), int(exponent or 0) - len(decimals))
    if isinstance(value, str):
        return Token("word", json.dumps(value) if value in ("null", "true", "false", "") else value)
    return None if value is _ABSENT else Token("word", json.dumps(value))


class _Statements(NamedTuple):
    """What the reports state of the fields of a table: their units; and where their sigmas stand."""

    title: str
    geographic: bool
    axes: tuple[float, float] | None  # of the ellipsoid of geographic positions, m

    def unit_of(self, path: str, row: Row) -> str:
        """Return the unit of a field, nothing where the reports state none for it alone."""
        text, index = _unit_text(self.title, path), _INDICES.findall(path)
        if text == _OF_ROW:
            return str(row.get("unit", ""))
        geographic, _, plane = text.partition(_GEOGRAPHIC)
        parts = (geographic if self.geographic else plane or text).split(", ")
        if len(parts) > 1:
            parts = [parts[int(index[0])]] if len(index) == 1 and int(index[0]) < len(parts) else [""]
        return parts[0] if _UNIT.fullmatch(parts[0]) else ""

    def in_sigmas(self, path: str, difference: Decimal, rows: tuple[Row, Row]) -> float | None:
        """Return B minus A of a field in sigmas of B (of A where B has none); None without sigmas."""
        base, index, scale = *_split(path), 1.0
        if self.geographic and index in ("[0]", "[1]") and _GEOGRAPHIC in _unit_text(self.title, path):
            latitude = number_of(at(rows[1], f"{base}[0]"))
            if self.axes is None or latitude is None or not math.isfinite(latitude):
                return None
            scale = _metres_per_radian(*self.axes, latitude, along_meridian=index == "[0]")
            index = "[1]" if index == "[0]" else "[0]"  # sigmas are those of east, north, up
        plain = [f"sigma{index}"] if base in _PLAIN_SIGMA else []
        for row in (rows[1], rows[0]):
            for name in (f"{base}_sigma{index}", f"sigma_{base}{index}", *plain):
                sigma = number_of(at(row, name))
                if sigma is not None and sigma > 0.0:
                    return float(difference) * scale / sigma
        return None


def _split(path: str) -> tuple[str, str]:
    """Return a path without the indices at its end, and these."""
    base = path.rstrip("[]0123456789") if path.endswith("]") else path
    return base, path[len(base) :]


def _unit_text(title: str, path: str) -> str:
    """Return what the reports state of the unit of a field."""
    return _stated_units().get(_INDICES.sub("", path if title == TOP else f"{title}.{path}"), "")


@cache
def _stated_units() -> dict[str, str]:
    """Return the units of the fields of our records that have one, by their paths without indices."""
    from musatpy.reports.record import schema  # most comparisons need none

    whole = schema()

    def units(node: Mapping[str, Any], path: str) -> Iterator[tuple[str, str]]:
        node = whole["$defs"][node["$ref"].rpartition("/")[2]] if "$ref" in node else node
        if "unit" in node:
            yield path, node["unit"]
        for name, inner in node.get("properties", {}).items():
            yield from units(inner, f"{path}.{name}" if path else name)
        if isinstance(node.get("items"), dict):
            yield from units(node["items"], path)

    return dict(units(whole, ""))


def _metres_per_radian(a: float, b: float, latitude: float, *, along_meridian: bool) -> float:
    """Return metres on an ellipsoid of axes a, b (m) for a radian of latitude, or of longitude."""
    eccentricity_squared = 1.0 - (b / a) ** 2
    w = math.sqrt(1.0 - eccentricity_squared * math.sin(latitude) ** 2)
    return a * (1.0 - eccentricity_squared) / w**3 if along_meridian else a / w * math.cos(latitude)
