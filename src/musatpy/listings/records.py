"""Two JSON files as tables, field by field at full precision; in sigmas where a record has them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from decimal import Decimal
from functools import cache
from typing import Any, NamedTuple

from musatpy.listings.findings import Difference, PagePlace
from musatpy.listings.lines import CannotCompareError
from musatpy.listings.rules import FieldSpot, Rules, RuleSet, RuleUse, Spot, still_open
from musatpy.listings.tokens import PlacedToken, Token
from musatpy.listings.weighing import Cell, SectionComparison
from musatpy.reports.values import at

TOP = "(top)"
# Fields that may name what a row is about: as many of them, in this order, as tell all rows of a table apart.
_ID_FIELDS = (
    "id", "ids", "name", "pass", "number", "photo", "point", "camera", "mark", "group", "photos", "points",
    "unknown", "first", "second", "kind", "of", "component", "wave", "parameter", "quantity", "marks", "cross",
    "model", "root", "sounding",
)  # fmt: skip
_PLAIN_SIGMA = frozenset({"position", "xy", "residual", "value", "coordinates"})  # whose sigma is called `sigma`
# Others (NaN, infinity) are words.
_NUMBER = re.compile(r"-?\d+(?:\.(\d+))?(?:[eE]([+-]?\d{1,4}))?", re.ASCII)
_INDEX = re.compile(r"\[\d+\]")
_GEOGRAPHIC = " (GEOG) or "  # `rad, rad, m (GEOG) or m`
_OF_ROW = "the row's"  # unit, of which the row has a field
_UNIT = re.compile(r"\w+(?:/\w+)?")  # not `that of the coordinates`


class RecordRow(NamedTuple):
    """One row of a table: what it is called, the texts of its ids, its fields."""

    name: str
    ids: tuple[str, ...]
    fields: Mapping[str, Any]
    place: PagePlace = PagePlace()

    @property
    def text(self) -> str:
        """All of it."""
        return json.dumps(self.fields)


def compare_records(a: str, b: str, rules: Rules, names: tuple[str, str]) -> Difference:
    """Return what differs between two JSON texts; raises `CannotCompareError` for records of different schemas."""
    uses = [RuleUse(rule) for rule in rules.rules]
    contents = [read_json(text, name) for text, name in zip((a, b), names, strict=True)]
    schemas = [at(content, "schema_version") for content in contents]
    if len({str(schema).partition(".")[0] for schema in schemas}) > 1:
        message = f"is a record of schema {schemas[0]}, and {names[1]} of {schemas[1]}; run the older deck again"
        raise CannotCompareError.of(message, file=names[0])
    tables = [tables_of(content) for content in contents]
    geographic = all(at(content, "options.system") == "GEOG" for content in contents)
    comparisons = [_Tables(uses, title, *(side.get(title) for side in tables)) for title in tables[0] | tables[1]]
    for comparison in comparisons:
        comparison.geographic = geographic
        comparison.compare()
    return Difference(*names, tuple(comparison.result for comparison in comparisons), tuple(uses))


def read_json(text: str, name: str) -> Any:
    """Return the content of a JSON text; raises `CannotCompareError`."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise CannotCompareError.of("is nested too deep", file=name) from error
    except ValueError as error:
        line = getattr(error, "lineno", None)  # a number of more digits than Python reads has none
        raise CannotCompareError.of(f"is not JSON: {error}", file=name, line=line) from error


def tables_of(content: Any) -> dict[str, list[RecordRow]]:
    """Return the tables of a file by their paths, in their order; but not what depends on the machine alone."""
    tables: dict[str, list[Mapping[str, Any]]] = {}
    for path, rows in _tables(content, ""):
        tables.setdefault(path or TOP, []).extend(rows)
    return {path: _named(rows) for path, rows in tables.items()}


def _tables(value: Any, path: str) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield tables with their paths: lists of objects, objects of columns, of others what is no table itself."""
    rows = rows_in(value)
    if rows is not None or not isinstance(value, dict):
        yield path, [{"value": value}] if rows is None else rows
        return
    tables = {key: entry for key, entry in value.items() if isinstance(entry, dict) or rows_in(entry) is not None}
    left_out = {*tables, "kernels"} if path == "program" else tables
    fields = {key: entry for key, entry in value.items() if key not in left_out}
    if fields or not tables:
        yield path, [fields]
    for key, entry in tables.items():
        yield from _tables(entry, f"{path}.{key}" if path else key)


def rows_in(value: Any) -> list[dict[str, Any]] | None:
    """Return the rows of a table, which is a list of objects, or an object of columns; None of what is neither.

    Columns are lists of one length, of which one names the rows.
    """
    if isinstance(value, list):
        return value if all(isinstance(entry, dict) for entry in value) else None
    if not isinstance(value, dict) or not all(isinstance(column, list) for column in value.values()):
        return None
    has_objects = any(isinstance(column[0], dict) for column in value.values() if column)
    if len(set(map(len, value.values()))) != 1 or has_objects or value.keys().isdisjoint(_ID_FIELDS):
        return None
    return [dict(zip(value, row, strict=True)) for row in zip(*value.values(), strict=True)]


def _named(rows: Sequence[Mapping[str, Any]]) -> list[RecordRow]:
    """Return the rows of a table with the fields that tell them apart, as far as any do."""
    names: list[str] = []
    everywhere = set.intersection(*map(set, rows)) if rows else ()
    for name in _ID_FIELDS:
        if name in everywhere:
            names.append(name)
            if len({repr([row[name] for name in names]) for row in rows}) == len(rows):
                break
    named = []
    for n, row in enumerate(rows, start=1):
        ids = [(name, _texts(row[name])) for name in names]
        label = " ".join(f"{name} {' '.join(texts)}" for name, texts in ids)
        label = label or (f"row {n}" if len(rows) > 1 else "values")
        named.append(RecordRow(label, tuple([text for _, texts in ids for text in texts]), row))
    return named


def _texts(value: Any) -> list[str]:
    return [str(entry) for entry in value] if isinstance(value, list) else [str(value)]


def _leaves(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return every field of a row by its path: `position[1]`, `a.b`; an empty list or object is one itself."""
    fields: dict[str, Any] = {}
    waiting = list(row.items())[::-1]  # the next one last; however deep a record is nested
    while waiting:
        path, value = waiting.pop()
        if isinstance(value, dict) and value:
            waiting += [(f"{path}.{key}", entry) for key, entry in reversed(value.items())]
        elif isinstance(value, list) and value:
            waiting += [(f"{path}[{n}]", entry) for n, entry in enumerate(value)][::-1]
        else:
            fields[path] = value
    return fields


class _Tables(SectionComparison):
    """One table of both records."""

    counts_digits = False
    geographic = False

    def __init__(
        self, rules: RuleSet, title: str, a: Sequence[RecordRow] | None, b: Sequence[RecordRow] | None
    ) -> None:
        super().__init__(rules, title, [title])
        self.tables = a, b  # None: there is none
        self.rows = a or (), b or ()

    def spot_of(self, row: RecordRow, side: int, other: RecordRow | None = None) -> Spot:
        def named(key: str) -> tuple[str, ...]:
            return tuple([text for name in (key, f"{key}s") for text in _texts(row.fields.get(name, []))])

        return Spot((), (row.name,), row.ids, lambda n: named("photo"), lambda n: named("point"))

    def are_same(self, a: RecordRow, b: RecordRow) -> bool:
        return a.fields == b.fields

    def compare(self) -> None:
        """Compare the tables; one that the other record has not, or without rows, is one finding."""
        if all(self.rows) or self.tables == ([], []):
            single = all(len(rows) == 1 for rows in self.rows)
            self.compare_rows(strict=not single and any(rows[0].ids for rows in self.rows if rows))
            return
        side = int(not self.tables[0])
        if not self.allowed(Spot(), "AB"[side]):
            self.lonely("section", side, f"{len(self.rows[side])} rows")

    def cells(self, a: RecordRow, b: RecordRow, among: RuleSet) -> Iterator[Cell]:
        first, second = _leaves(a.fields), _leaves(b.fields)
        is_open = bool(still_open(among))
        for number, path in enumerate(first | second, start=1):
            values = [fields[path] for fields in (first, second) if path in fields]
            if len(values) < 2 or values[0] != values[1]:
                sides = [[_placed(fields[path])] if path in fields else [] for fields in (first, second)]
                sigmas = self.in_sigmas(path, sides, (b.fields, a.fields))
                yield Cell(FieldSpot(-1, number, path), self.unit_of(path, a.fields), sides[0], sides[1], sigmas)
            elif is_open:
                token = (_placed(values[0]),)
                yield Cell(FieldSpot(-1, number, path), "", token, token)

    def stated_unit(self, path: str) -> str:
        """Return what the reports state of the unit of a field."""
        title = self.result.title
        return _stated_unit(_INDEX.sub("", path if title == TOP else f"{title}.{path}"))

    def unit_of(self, path: str, row: Mapping[str, Any]) -> str:
        """Return the unit of a field, nothing where the reports state none for it alone."""
        text, index = self.stated_unit(path), _INDEX.findall(path)
        if text == _OF_ROW:
            return str(row.get("unit", ""))
        geographic, _, plane = text.partition(_GEOGRAPHIC)
        parts = (geographic if self.geographic else plane or text).split(", ")
        if len(parts) > 1:
            number = int(index[0][1:-1]) if len(index) == 1 else len(parts)
            parts = [*parts, *[""] * number][number : number + 1]
        return parts[0] if _UNIT.fullmatch(parts[0]) else ""

    def in_sigmas(
        self, path: str, sides: Sequence[Sequence[PlacedToken]], rows: Sequence[Mapping[str, Any]]
    ) -> Any:
        """Return a difference of a field in sigmas of the first of the rows that has some; None without sigmas.

        Latitudes and longitudes have none: theirs are in metres.
        """
        numbers = [placed.token.value for side in sides for placed in side if placed.token.value is not None]
        base = path.rstrip("[]0123456789") if path.endswith("]") else path
        index = path[len(base) :]
        is_angle = self.geographic and index in ("[0]", "[1]") and _GEOGRAPHIC in self.stated_unit(path)
        plain = [f"sigma{index}"] if base in _PLAIN_SIGMA else []
        for row in rows if len(numbers) == 2 and not is_angle else ():
            for name in (f"{base}_sigma{index}", f"sigma_{base}{index}", *plain):
                sigma = at(row, name)
                if is_number(sigma) and sigma > 0.0:
                    return float(numbers[1] - numbers[0]) / sigma
        return None


def is_number(value: Any) -> bool:
    """Tell whether a field has a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _placed(value: Any) -> PlacedToken:
    """Return what stands in a field; it has no columns of print."""
    if isinstance(value, str):
        return PlacedToken(
            Token("word", json.dumps(value) if value in ("null", "true", "false", "") else value), 0, 0
        )
    if not is_number(value):
        return PlacedToken(Token("word", json.dumps(value)), 0, 0)
    text = str(value)
    if (parts := _NUMBER.fullmatch(text)) is None:
        return PlacedToken(Token("word", text), 0, 0)
    decimals, exponent = parts.groups(default="")
    return PlacedToken(Token("number", text, Decimal(text), int(exponent or 0) - len(decimals)), 0, 0)


@cache
def _stated_unit(path: str) -> str:
    """Return the unit of a field of our records by its path without indices; empty where it has none."""
    from musatpy.reports.record import document  # most comparisons need none

    whole = document().schema()
    node: Mapping[str, Any] = whole
    for name in path.split("."):
        node = node.get("items", node).get("properties", {}).get(name, {})
        node = whole["$defs"][node["$ref"].rpartition("/")[2]] if "$ref" in node else node
    return str(node.get("unit", ""))
