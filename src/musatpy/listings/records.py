"""Two JSON files as tables, field by field at full precision; in sigmas where a record has them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from decimal import Decimal
from functools import cache
from typing import Any, NamedTuple

from musatpy.errors import Problem
from musatpy.listings.findings import Difference, Place, RuleUse
from musatpy.listings.judge import Field, RuleSet, Spot, still_open
from musatpy.listings.lines import CannotCompareError
from musatpy.listings.rules import Rules
from musatpy.listings.tokens import Placed, Token
from musatpy.listings.weighing import Cell, Comparison
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
_ABSENT = object()  # what a row has in a field that only the other row has


class Row(NamedTuple):
    """One row of a table: what it is called, the texts of its ids, its fields."""

    name: str
    ids: tuple[str, ...]
    fields: Mapping[str, Any]
    place: Place = Place()

    @property
    def text(self) -> str:
        """All of it."""
        return json.dumps(self.fields)


def compare_records(a: str, b: str, rules: Rules, names: tuple[str, str]) -> Difference:
    """Return what differs between two JSON texts; raises `CannotCompareError` for records of different schemas."""
    uses = [RuleUse(rule) for rule in rules.rules]
    contents = [read_json(text, name) for text, name in zip((a, b), names, strict=True)]
    if major(contents[0]) != major(contents[1]):
        schemas = [at(content, "schema_version") for content in contents]
        message = f"is a record of schema {schemas[0]}, and {names[1]} of {schemas[1]}; run the older deck again"
        raise CannotCompareError([Problem(file=names[0], message=message)])
    tables = [tables_of(content) for content in contents]
    geographic = all(at(content, "options.system") == "GEOG" for content in contents)
    sections = []
    for title in (titles := tables[0] | tables[1]):
        comparison = _Tables(uses, title, [side.get(title, []) for side in tables], titles)
        comparison.geographic = geographic
        comparison.compare()
        sections.append(comparison.result)
    return Difference(*names, tuple(sections), tuple(uses))


def read_json(text: str, name: str) -> Any:
    """Return the content of a JSON text; raises `CannotCompareError`."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise CannotCompareError([Problem(file=name, message="is nested too deep")]) from error
    except ValueError as error:  # a number of more digits than Python reads has no line
        line = getattr(error, "lineno", 0)
        message = f"is not JSON: {getattr(error, 'msg', error)}"
        raise CannotCompareError([Problem(file=name, line=line, message=message)]) from error


def major(content: Any, default: str = "None") -> str:
    """Return the number of the schema of a record, without that of changes which hurt no reader."""
    version = at(content, "schema_version")
    return str(default if version is None else version).partition(".")[0]


def tables_of(content: Any) -> dict[str, list[Row]]:
    """Return the tables of a file by their paths, in their order; but not what depends on the machine alone."""
    tables: dict[str, list[Mapping[str, Any]]] = {}
    for path, rows in _tables(content, ""):
        tables.setdefault(path or TOP, []).extend(rows)
    return {path: _named(rows) for path, rows in tables.items()}


def _tables(value: Any, path: str) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield tables with their paths: lists of objects, objects of columns, of others what is no table itself."""
    rows = rows_in(value)
    if rows is not None:
        yield path, rows
    elif not isinstance(value, dict):
        yield path, [{"value": value}]
    else:
        inside = {key for key, entry in value.items() if isinstance(entry, dict) or _is_list_of_objects(entry)}
        if inside != value.keys() or not value:
            is_ours = path == "program"
            yield (
                path,
                [{key: value[key] for key in value if key not in inside and not (is_ours and key == "kernels")}],
            )
        for key in value:
            if key in inside:
                yield from _tables(value[key], f"{path}.{key}" if path else key)


def rows_in(value: Any) -> list[dict[str, Any]] | None:
    """Return the rows of a table, which is a list of objects, or an object of columns; None of what is neither.

    Columns are lists of one length, of which one names the rows.
    """
    if _is_list_of_objects(value):
        return list(value)
    if not isinstance(value, dict) or not all(isinstance(column, list) for column in value.values()):
        return None
    has_objects = any(isinstance(column[0], dict) for column in value.values() if column)
    if len(set(map(len, value.values()))) != 1 or has_objects or value.keys().isdisjoint(_ID_FIELDS):
        return None
    return [dict(zip(value, row, strict=True)) for row in zip(*value.values(), strict=True)]


def _is_list_of_objects(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(entry, dict) for entry in value)


def _named(rows: Sequence[Mapping[str, Any]]) -> list[Row]:
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
        named.append(Row(label, tuple([text for _, texts in ids for text in texts]), row))
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


class _Tables(Comparison):
    """One table of both records."""

    counts_digits = False
    geographic = False

    def __init__(
        self, rules: RuleSet, title: str, tables: Sequence[Sequence[Row]], titles: Mapping[str, Any]
    ) -> None:
        super().__init__(rules, title, [title])
        self.rows = tables[0], tables[1]
        self.titles = titles  # of all tables

    def spot_of(self, row: Row, side: int, other: Row | None = None) -> Spot:
        def named(*keys: str) -> tuple[str, ...]:
            return tuple([text for key in keys if key in row.fields for text in _texts(row.fields[key])])

        return Spot(
            (), (row.name,), row.ids, lambda n: named("photo", "photos"), lambda n: named("point", "points")
        )

    def are_same(self, a: Row, b: Row) -> bool:
        return a.fields == b.fields

    def compare(self) -> None:
        """Compare the tables; one that the other record has not is one finding, unless it is empty."""
        side = int(not self.rows[0])
        if all(self.rows):
            single = all(len(rows) == 1 for rows in self.rows)
            self.compare_rows(strict=not single and bool(self.rows[0][0].ids))
            return
        fields = [field for row in self.rows[side] for field in _leaves(row.fields).items()]
        is_empty = all(self.is_empty_table(path, value) for path, value in fields)
        if not is_empty and not self.allowed(Spot(), "AB"[side]):
            self.lonely("section", side, f"{len(self.rows[side])} rows")

    def cells(self, a: Row, b: Row, among: RuleSet) -> Iterator[Cell]:
        first, second = _leaves(a.fields), _leaves(b.fields)
        is_open = bool(still_open(among))
        for number, path in enumerate(first | second, start=1):
            values = first.get(path, _ABSENT), second.get(path, _ABSENT)
            if values[0] == values[1]:
                if is_open:
                    token = (_placed(values[0]),)
                    yield Cell(Field(-1, number, path), "", token, token)
                continue
            of_a, of_b = (() if value is _ABSENT else (_placed(value),) for value in values)
            numbers = [side[0].token.value if side else None for side in (of_a, of_b)]
            sigmas = None
            if numbers[0] is not None and numbers[1] is not None:
                sigmas = self.in_sigmas(path, numbers[1] - numbers[0], (b.fields, a.fields))
            elif not (of_a and of_b) and self.is_empty_table(path, values[not of_a]):
                continue
            yield Cell(Field(-1, number, path), self.unit_of(path, a.fields), of_a, of_b, sigmas)

    def is_empty_table(self, path: str, value: Any) -> bool:
        """Tell whether a field is the empty list of a table of the other record, which is a finding of its own."""
        return value == [] and (path if self.result.title == TOP else f"{self.result.title}.{path}") in self.titles

    def stated_unit(self, path: str) -> str:
        """Return what the reports state of the unit of a field."""
        title = self.result.title
        return _stated_units().get(_INDEX.sub("", path if title == TOP else f"{title}.{path}"), "")

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

    def in_sigmas(self, path: str, difference: Decimal, rows: Sequence[Mapping[str, Any]]) -> float | None:
        """Return a difference of a field in sigmas of the first of the rows that has some; None without sigmas.

        Latitudes and longitudes have none: theirs are in metres.
        """
        base = path.rstrip("[]0123456789") if path.endswith("]") else path
        index = path[len(base) :]
        if self.geographic and index in ("[0]", "[1]") and _GEOGRAPHIC in self.stated_unit(path):
            return None
        plain = [f"sigma{index}"] if base in _PLAIN_SIGMA else []
        for row in rows:
            for name in (f"{base}_sigma{index}", f"sigma_{base}{index}", *plain):
                sigma = number_of(at(row, name))
                if sigma is not None and sigma > 0.0:
                    return float(difference) / sigma
        return None


def number_of(value: Any) -> float | None:
    """Return the number in a field, None where it has none."""
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def _placed(value: Any) -> Placed:
    """Return what stands in a field; it has no columns of print."""
    if isinstance(value, str):
        return Placed(Token("word", json.dumps(value) if value in ("null", "true", "false", "") else value), 0, 0)
    if number_of(value) is None:
        return Placed(Token("word", json.dumps(value)), 0, 0)
    text = str(value)
    if (parts := _NUMBER.fullmatch(text)) is None:
        return Placed(Token("word", text), 0, 0)
    decimals, exponent = parts.groups(default="")
    return Placed(Token("number", text, Decimal(text), int(exponent or 0) - len(decimals)), 0, 0)


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
