"""Two JSON files, field by field at full precision; in sigmas where a record has them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Hashable, Iterator, Mapping, Sequence
from decimal import Decimal
from functools import cache, lru_cache
from itertools import chain
from typing import Any, NamedTuple

from musatpy.image_observations import are_apart
from musatpy.listings.align import align
from musatpy.listings.findings import Difference, Tally
from musatpy.listings.json_tables import (
    TOP,
    RecordTable,
    TableOfColumns,
    TableOfRows,
    at,
    images_in_columns,
    in_one_table,
    keys_of,
    leaves,
    number_of,
    tables_of,
    texts_of,
)
from musatpy.listings.json_text import Number, read_json
from musatpy.listings.judge import NO_SPOT, Field, Judge, Spot, still_open
from musatpy.listings.rules import Rules
from musatpy.listings.tokens import Token
from musatpy.listings.weighing import Comparison, RowPair, Where

_PLAIN_SIGMA = frozenset({"position", "xy", "residual", "value", "coordinates"})  # whose sigma is called `sigma`
# Others (NaN, an exponent beyond all reason) are words.
_NUMBER = re.compile(r"-?\d+(?:\.(\d+))?(?:[eE]([+-]?\d{1,4}))?", re.ASCII)
_INDICES = re.compile(r"\[(\d+)\]")
_GEOGRAPHIC = " (GEOG) or "  # `rad, rad, m (GEOG) or m`
_OF_ROW = "the row's"  # unit, of which the row has a field
_UNIT = re.compile(r"\w+(?:/\w+)?")  # not `that of the coordinates`

_ABOUT = ("photo", "photos", "point", "points")  # fields that rules ask for
_ABSENT = object()  # what a row has in a field that only the other row has
Row = Mapping[str, Any]
Both = tuple[str, Any, Any]  # path of a field, and what A and B have there


def compare_records(a: str, b: str, rules: Rules, names: tuple[str, str]) -> Difference:
    """Return what differs between two JSON texts."""
    judge = Judge(rules)
    contents = [read_json(text, name) for text, name in zip((a, b), names, strict=True)]
    contents = [images_in_columns(content) for content in contents]
    if len({are_apart(content) for content in contents}) > 1:  # one is of an earlier version
        contents = [in_one_table(content) for content in contents]
    tables = [tables_of(content) for content in contents]
    geographic = all(at(content, "options.system") == "GEOG" for content in contents)
    axes = _axes_of(contents[1]) if geographic else None
    titles, tallies = dict.fromkeys([*tables[0], *tables[1]]), []
    for title in titles:
        both = [side.pop(title, TableOfRows(title, [])) for side in tables]  # gone when they are compared
        tallies.append(_Tables(judge, title, both, titles, _Statements(title, geographic, axes)).tally())
    return Difference.of(names, tallies, judge.rules)


def _axes_of(content: Any) -> tuple[float, float] | None:
    """Return the axes (m) of the ellipsoid of a record, None where it does not say."""
    from musatpy.geometry.geodesy import Ellipsoid  # most comparisons need none

    name, *sizes = (at(content, f"ellipsoid.{part}") for part in ("name", "semi_major_axis", "inverse_flattening"))
    try:
        return Ellipsoid(str(name or ""), *(number_of(size) for size in sizes)).axes
    except (ValueError, RuntimeError):  # no name that PROJ knows, no size
        return None


class _Columns(NamedTuple):
    """Those of two tables by columns in which two rows differ."""

    compared: Collection[str]
    asked: Collection[str]  # these, and what says the units and sigmas of others


class _Tables(Comparison):
    """One table of both records."""

    counts_digits = False

    def __init__(
        self,
        judge: Judge,
        title: str,
        tables: Sequence[RecordTable],
        names: Collection[str],
        statements: _Statements,
    ) -> None:
        super().__init__(judge, title, [title])
        self.a, self.b = tables
        self.names = names  # of all tables
        self.statements = statements

    def tally(self) -> Tally:
        """Compare, and return what was found."""
        if not len(self.a) or not len(self.b):
            self.only_here(self.a if len(self.a) else self.b, "A" if len(self.a) else "B")
            return self.result
        if self.is_settled():
            self.result.rows += len(self.a)
            return self.result
        ids = self.a.ids, self.b.ids
        if len(self.a) == len(self.b) == 1:
            ids = [("",)], [("",)]
        if ids[0] == ids[1] and self.by_columns():
            return self.result
        texts = self.texts(ids)
        alignment = align(ids, texts, lambda side, row: texts[side][row][:60], strict=any(map(any, ids[0])))
        for n in alignment.only_a:
            self.only(self.a, n, "A")
        for n, other in alignment.pairs:
            self.rows(n, other, n in alignment.moved)
        for n in alignment.only_b:
            self.only(self.b, n, "B")
        return self.result

    def is_settled(self) -> bool:
        """Tell whether both tables are written alike, and no rule waits for a field that it is about."""
        a, b = self.a, self.b
        if not (isinstance(a, TableOfColumns) and isinstance(b, TableOfColumns)):
            return False
        return not still_open(self.rules) and a.columns == b.columns

    def by_columns(self) -> bool:
        """Compare tables of the same rows column by column, where they have the same columns."""
        a, b = self.a, self.b
        if not (isinstance(a, TableOfColumns) and isinstance(b, TableOfColumns)):
            return False
        if list(a.names) != list(b.names) or not all(map(any, a.ids)):
            return False
        differing, names = a.differing(b), tuple(a.names)
        asked = {name for name in names if self.statements.asks_for(name)}
        chosen: dict[int, _Columns] = {}
        is_numbered = any(isinstance(use.rule.column, int) for use in self.rules)  # the fields of whole rows are
        for n, bits in enumerate(differing):
            if still_open(self.rules) or (bits and is_numbered):
                self.rows(n, n, False)
            elif bits:
                if bits not in chosen:
                    compared = [name for bit, name in enumerate(names) if bits >> bit & 1]
                    chosen[bits] = _Columns(compared, [*compared, *asked.difference(compared)])
                self.rows(n, n, False, chosen[bits])
            else:
                self.result.rows += 1
        return True

    def texts(self, ids: tuple[Sequence[Hashable], Sequence[Hashable]]) -> tuple[list[str], list[str]]:
        """Return the rows as texts, which tell rows without ids apart."""
        if len(set(ids[0])) == len(ids[0]) and len(set(ids[1])) == len(ids[1]):
            return [str(names) for names in ids[0]], [str(names) for names in ids[1]]
        rows = ([json.dumps(table.row(n)) for n in range(len(table))] for table in (self.a, self.b))
        return next(rows), next(rows)

    def only_here(self, table: RecordTable, side: str) -> None:
        """Take a table that the other record has not: one finding, unless it is empty or rules allow it."""
        fields = (field for n in range(len(table)) for field in leaves(table.row(n)))
        first = next(fields, None)
        if first is None and not len(table):
            return
        if first and all(self.is_empty_table(path, _token(value)) for path, value in chain([first], fields)):
            return
        if not self.allows(_spot({}, (), ""), side):
            self.lonely("section", side, f"{len(table)} rows", Where())

    def only(self, table: RecordTable, n: int, side: str) -> None:
        """Take a row that the other record has not."""
        self.only_row(self.spot(table, n), side, json.dumps(table.row(n)), Where(table.label(n)))

    def spot(self, table: RecordTable, n: int) -> Spot:
        """Return a row as rules see it."""
        return _spot(table.row(n, _ABOUT), table.ids[n], table.label(n))

    def rows(self, n: int, other: int, moved: bool, columns: _Columns | None = None) -> None:
        """Compare two rows that belong together; of tables by columns, in some of these alone."""
        self.result.rows += 1
        names = columns.asked if columns else None
        whole = self.a.row(n, names), self.b.row(other, names)
        a, b = ({name: row[name] for name in columns.compared} for row in whole) if columns else whole
        same = a == b
        if same and not moved and not self.rules:
            return
        both = self.pair(Where(self.a.label(n)), self.spot(self.a, n) if self.rules else NO_SPOT)
        if moved:
            self.elsewhere(both)
        unused = still_open(both.among)
        if same and not unused:
            return
        for number, (path, of_a, of_b) in enumerate(_fields(a, b), start=1):
            field = Field(-1, number, path)
            if of_a != of_b:
                self.field(both, field, _token(of_a), _token(of_b), whole)
            elif unused:
                self.rule(both, field, _token(of_a), _token(of_b))
        if unused:
            self.judge.touch_rows(unused, both.spot)

    def field(self, both: RowPair, field: Field, a: Token | None, b: Token | None, rows: tuple[Row, Row]) -> None:
        """Weigh a field that differs, or that one row has not."""
        path = field.heading
        if a is None or b is None:
            if self.is_empty_table(path, a or b):
                self.rule(both, field, a, b)  # of use, though there is nothing to decide
            else:
                self.unpaired(both, field, (a and a.text, b and b.text))
            return
        sigmas = None
        if a.value is not None and b.value is not None:
            sigmas = self.statements.in_sigmas(path, b.value - a.value, rows)
        self.weigh(both, field, self.statements.unit_of(path, rows[0]), a, b, sigmas)

    def is_empty_table(self, path: str, token: Token | None) -> bool:
        """Tell whether a field is the empty list of a table of the other record, which is a finding of its own."""
        name = path if self.result.title == TOP else f"{self.result.title}.{path}"
        return token is not None and token.text == "[]" and name in self.names


def _spot(row: Row, ids: tuple[str, ...], label: str) -> Spot:
    def named(*keys: str) -> tuple[str, ...]:
        return tuple(name for key in keys if key in row for name in texts_of(row[key]))

    return Spot((), (label,), ids, lambda column: named("photo", "photos"), lambda column: named("point", "points"))


def _fields(a: Row, b: Row) -> list[Both]:
    """Return all fields of two rows."""
    fields_a, fields_b = leaves(a), leaves(b)
    if [path for path, _ in fields_a] == [path for path, _ in fields_b]:
        return [(path, of_a, of_b) for (path, of_a), (_, of_b) in zip(fields_a, fields_b, strict=True)]
    return [both for key in {**a, **b} for both in _merged(key, a, b)]


def _merged(key: str, a: Row, b: Row) -> list[Both]:
    """Return the fields in one entry of two rows, which need not be made alike."""
    of_a, of_b = (dict(leaves(row[key], key)) if key in row else {} for row in (a, b))
    return [(path, of_a.get(path, _ABSENT), of_b.get(path, _ABSENT)) for path in {**of_a, **of_b}]


def _token(value: Any) -> Token | None:
    """Return the token of what stands in a field; None where the row has no such field."""
    if isinstance(value, Number):
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

    @staticmethod
    def asks_for(name: str) -> bool:
        """Tell whether a field may say the unit or the sigma of others."""
        return name == "unit" or "sigma" in name

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
        names = [
            f"{base}_sigma{index}",
            f"sigma_{base}{index}",
            *([f"sigma{index}"] if base in _PLAIN_SIGMA else []),
        ]
        for row in (rows[1], rows[0]):
            for name in names:
                sigma = number_of(at(row, name)) if keys_of(name)[0] in row else None
                if sigma is not None and sigma > 0.0:
                    return float(difference) * scale / sigma
        return None


@lru_cache(maxsize=1 << 12)
def _split(path: str) -> tuple[str, str]:
    """Return a path without the indices at its end, and these."""
    base = path.rstrip("[]0123456789") if path.endswith("]") else path
    return base, path[len(base) :]


@lru_cache(maxsize=1 << 12)
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
