"""JSON files, and records of runs among them, which are held against their schema before anything is read of them.

`reports/record.schema.json` is made from what `reports` states. A reader names the fields that it needs.
"""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from itertools import chain, islice, product
from pathlib import Path
from typing import Any

from musatpy.errors import Problem, RecordError
from musatpy.image_observations import FIELDS, are_apart, with_images

Schema = Mapping[str, Any]
Needs = Mapping[str, Sequence[str]]  # field of a record -> the fields of its table, or of it, that are needed

_SCHEMA = Path(__file__).with_name("reports") / "record.schema.json"
_SOME = "tables"  # content of a record without tables of images
_LEFT_OUT = ": the record was written with --record tables"
_LISTED = 20  # problems of one file
_PYTHON = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None), "integer": int}
_MUCH = 1_000_000  # bytes, from which on a package is worth its loading
_DIGITS = 15  # of a whole number at most that is exact in double precision
_IDS = {  # fields of tables that name a row of another one, and its ids
    "camera": ("cameras", "camera"),
    "photo": ("stations", "photo"),
    "photos": ("stations", "photo"),
    "point": ("points", "point"),
    "points": ("points", "point"),
}
_LARGEST = 1e150  # number of a record: its square is one too


def read_json(path: Path) -> Any:
    """Return what a JSON file says. Raises `RecordError` where it is none, or a number is not finite; `OSError`."""
    return read_json_file(path, parse_float=_finite, parse_int=_whole)


def read_json_file(path: Path, **hooks: Any) -> Any:
    """Return what a JSON file says; numbers beyond all limits are left to who reads on. Raises as `read_json`."""
    try:
        data = path.read_bytes()
        return _read_quickly(data) if len(data) > _MUCH and not hooks else _read(data, **hooks)
    except UnicodeDecodeError as error:
        message = f"is no JSON: byte {error.start + 1} is none of a text in UTF-8"
    except ValueError as error:
        message = f"is no JSON: {error}"
    except RecursionError:
        message = "is nested too deep"
    raise RecordError([Problem(file=str(path), message=message)])


def _read(data: bytes, **hooks: Any) -> Any:
    return json.loads(data, parse_constant=_finite, **hooks)


def _read_quickly(data: bytes) -> Any:
    """Return what JSON says, by orjson where it is there: four times as fast. What that refuses is read again."""
    orjson = quick_json()
    if orjson is not None:
        with suppress(ValueError):
            return orjson.loads(data)
    return _read(data)


@cache
def quick_json() -> Any:
    """Return the package that reads and writes JSON many times as fast as Python does, None without `fast`."""
    return importlib.import_module("orjson") if importlib.util.find_spec("orjson") else None


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:20]} is no finite number")
    return value


def _whole(text: str) -> int:
    return int(_finite(text)) if len(text) > _DIGITS else int(text)


def read_record(
    path: Path, needs: Needs, optional: Needs | None = None, *, schema: Schema | None = None, what: str = "run"
) -> dict[str, Any]:
    """Return what is needed of the record of a run, where it is as its schema says: tables as columns.

    A table has a list for each of its fields. What is `optional` may be missing: a table, or fields of a
    needed one. Raises `RecordError` with the places where it is not as it should be, `OSError`.
    `schema`: that of the record of something else than a run, whose first field is its version, and `what` that is.
    """
    record = read_json_file(path)
    schema = _schema() if schema is None else schema
    _refuse_other_schemas(record, schema, path, what)
    later = optional or {}
    wanted = _narrowed(schema, {**later, **needs}, required=list(needs), later=later)
    record = _together(record, wanted, schema, path)
    return _wanted_of(record, wanted, schema, path)


def known_of(
    record: Any, path: Path, leave: Container[str] = (), *, schema: Schema | None = None
) -> dict[str, Any]:
    """Return what a record, the content of a file, has of what a schema knows: tables as columns.

    Fields to `leave` are not looked at. The schema is that of runs where none is given. Raises `RecordError` as
    `read_record` does.
    """
    schema = _schema() if schema is None else schema
    _refuse_other_schemas(record, schema, path, "run")
    version = next(iter(schema["properties"]))
    fields = {name: of for name, of in schema["properties"].items() if name not in leave}
    required = [name for name in schema["required"] if name not in leave]
    wanted = {"type": "object", "required": required, "properties": {**fields, version: {"type": "string"}}}
    record = _together(record, wanted, schema, path)
    return _wanted_of(record, wanted, schema, path)


def _refuse_other_schemas(record: Any, schema: Schema, path: Path, what: str) -> None:
    """Raise `RecordError` for what is no record, or one of another schema."""
    key = next(iter(schema["properties"]))
    ours = str(schema["properties"][key]["const"])
    version = record.get(key) if isinstance(record, dict) else None
    if not isinstance(version, str):
        raise RecordError([Problem(file=str(path), message=f"is not the record of a {what}")])
    if version.split(".")[0] != ours.split(".")[0]:
        message = f"is a record of schema {version}, and this program reads {ours}; run the deck again"
        raise RecordError([Problem(file=str(path), field=key, message=message)])


def _wanted_of(record: dict[str, Any], wanted: Schema, schema: Schema, path: Path) -> dict[str, Any]:
    """Return what is wanted of a record; raises `RecordError` with the places where it is not as it should be."""
    _hold_against(record, wanted, schema, path)
    found = {name: record.pop(name) for name in wanted["properties"] if name in record}
    if faults := list(islice(_unknown_ids(found), _LISTED)) if schema is _schema() else []:
        raise RecordError(Problem(file=str(path), field=where, message=message) for where, message in faults)
    return found


def _unknown_ids(tables: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the places of the record of a run that name a camera, photo or point which its own table has not."""
    for (name, table), (field, (home, key)) in product(tables.items(), _IDS.items()):
        known = (tables.get(home) or {}).get(key)
        if known is None or not isinstance(table, dict) or not isinstance(table.get(field), list):
            continue
        rows = [entry if isinstance(entry, list) else [entry] for entry in table[field]]
        strange = {entry for entry in chain.from_iterable(rows) if isinstance(entry, str)}.difference(known)
        for number, row in enumerate(rows) if strange else ():
            for entry in (one for one in row if isinstance(one, str) and one in strange):
                yield f"{name}.{field}[{number}]", f"there is no {key} {entry} in {home}"


def _hold_against(record: dict[str, Any], form: Schema, schema: Schema, path: Path) -> None:
    """Raise `RecordError` with the places where a record is not in a `form`."""
    if _fits([record], form):
        return
    left_out = schema["properties"].keys() - set(schema["required"]) if record.get("content") == _SOME else ()
    faults = [
        (where, f"{message}{_LEFT_OUT if where in left_out else ''}")
        for where, message in islice(_faults(record, form, ""), _LISTED)
    ]
    raise RecordError(Problem(file=str(path), field=where, message=message) for where, message in faults)


def _together(record: dict[str, Any], wanted: Schema, schema: Schema, path: Path) -> dict[str, Any]:
    """Return a record with all observations in one table, where they are wanted and some are apart."""
    if "observations" not in wanted["properties"] or not are_apart(record):
        return record
    parts = {"plates": (), "observations": (), "solution": ("unit_sigma", "degrees_of_freedom")}
    narrowed = _narrowed(schema, parts, required=list(parts))
    plates = narrowed["properties"]["plates"]
    narrowed["properties"]["plates"] = {**plates, "required": [*plates["required"], *FIELDS]}
    _hold_against(record, narrowed, schema, path)
    return with_images(record)


@cache
def _schema() -> Schema:
    schema: Schema = json.loads(_SCHEMA.read_text(encoding="utf-8"))
    return schema


def _narrowed(schema: Schema, needs: Needs, required: Sequence[str], later: Needs | None = None) -> Schema:
    """Return what a schema says of the fields that are needed, and of those that `later` versions have."""
    properties = {
        name: _of_fields(_resolved(schema["properties"][name]), needs[name], (later or {}).get(name, ()))
        for name in needs
    }
    return {"type": "object", "required": required, "properties": properties}


def _of_fields(schema: Schema, fields: Sequence[str], later: Sequence[str]) -> Schema:
    if not fields:
        return schema
    if "items" in schema:
        return {**schema, "items": _of_fields(schema["items"], fields, later)}
    known = {name: schema["properties"][name] for name in (*fields, *later)}
    return {**schema, "required": fields, "properties": known}


def _resolved(schema: Schema) -> Schema:
    return _schema()["$defs"][schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema


def _types(schema: Schema) -> set[type]:
    """Return the types of Python that a value may have."""
    names = schema.get("type", [])
    names = {names} if isinstance(names, str) else set(names)
    return {_PYTHON[name] for name in names - {"number"}} | ({int, float} if "number" in names else set())


def _fits(values: Sequence[Any], schema: Schema) -> bool:
    """Tell whether all values of one place are as a schema says; columns of tables are looked at as a whole."""
    schema = _resolved(schema)
    allowed = _types(schema)
    kinds = set(map(type, values))
    if allowed and not kinds <= allowed:
        return False
    if float in allowed and kinds - {type(None)} and not _are_near(values):
        return False
    choices = schema.get("enum", [schema["const"]] if "const" in schema else None)
    if choices is not None and any(value not in choices for value in values):
        return False
    tables, lists = (_of_type(values, kind, kinds) for kind in (dict, list))
    if lists and "items" in schema:
        low, high = schema.get("minItems", 0), schema.get("maxItems", float("inf"))
        if not all(low <= length <= high for length in set(map(len, lists))):
            return False
        if not _fits(list(chain.from_iterable(lists)), schema["items"]):
            return False
    return not tables or _columns_fit(tables, schema)


def _of_type(values: Sequence[Any], kind: type, kinds: set[type]) -> Sequence[Any]:
    """Return the values of one type, of those whose types are `kinds`: most places have one only."""
    if kind not in kinds:
        return ()
    return values if len(kinds) == 1 else [value for value in values if type(value) is kind]


def _are_near(values: Sequence[float | None]) -> bool:
    """Tell whether numbers are finite, as 1e999 is not, and no digits are without end."""
    numbers = [value for value in values if value is not None] if None in values else values
    return -_LARGEST < min(numbers) and max(numbers) < _LARGEST  # type: ignore[type-var,operator]


def _columns_fit(tables: Sequence[dict[str, Any]], schema: Schema) -> bool:
    """Tell whether the fields of tables are as a schema says; those that it does not name may be anything."""
    required = schema.get("required", ())
    for name, inner in schema.get("properties", {}).items():
        column = [table[name] for table in tables if name in table]
        if (name in required and len(column) < len(tables)) or not _fits(column, inner):
            return False
    if schema.get("columns") and any(len(_lengths(table, schema)) > 1 for table in tables):
        return False
    others = schema.get("additionalProperties")
    if isinstance(others, dict):
        return _fits([value for table in tables for value in table.values()], others)
    return True


def _lengths(table: Mapping[str, Any], schema: Schema) -> set[int]:
    """Return how many entries the columns of a table have, strange ones too: one number where it is whole."""
    known = schema["properties"]
    columns = (column for name, column in table.items() if isinstance(column, list) or name not in known)
    return {len(column) if isinstance(column, list) else 0 for column in columns}


def _faults(value: Any, schema: Schema, path: str) -> Iterator[tuple[str, str]]:
    """Yield the places where a value is not as a schema says, and what is wrong there."""
    schema = _resolved(schema)
    if _fits([value], schema):
        return
    if not _fits([value], {"type": schema.get("type", [])}):
        yield path, f"expected {_expected(schema)}, found {_shown(value)}"
        return
    choices = schema.get("enum", [schema["const"]] if "const" in schema else None)
    if choices is not None and value not in choices:
        yield path, f"expected {' or '.join(map(_shown, choices))}, found {_shown(value)}"
    if isinstance(value, list) and "items" in schema:
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            yield path, f"expected {_expected(schema)}, found {len(value)}"
        for number, item in enumerate(value):
            yield from _faults(item, schema["items"], f"{path}[{number}]")
    if isinstance(value, dict):
        for name, inner in schema.get("properties", {}).items():
            where = f"{path}.{name}" if path else name
            if name in value:
                yield from _faults(value[name], inner, where)
            elif name in schema.get("required", ()):
                yield where, "is missing"
        others = schema.get("additionalProperties")
        if isinstance(others, dict):
            for name, item in value.items():
                yield from _faults(item, others, f"{path}.{name}")
        if schema.get("columns") and len(lengths := sorted(_lengths(value, schema))) > 1:
            yield path, f"has columns of {lengths[0]} and of {lengths[-1]} entries"


def _expected(schema: Schema) -> str:
    """Return what a schema expects, in words: `3 numbers`, `text or nothing`."""
    names = schema.get("type", [])
    nouns = {"null": "null", "object": "a table", "string": "text", "boolean": "true or false"}
    nouns |= {"number": "a number", "integer": "a whole number", "array": "a list"}
    size, item = schema.get("minItems"), _resolved(schema.get("items", {})).get("type")
    if size and size == schema.get("maxItems"):
        nouns["array"] = f"{size} numbers" if item in ("number", ["number", "null"]) else f"{size} items"
    return " or ".join(nouns[name] for name in ([names] if isinstance(names, str) else names))


def _shown(value: Any) -> str:
    """Return a value in few characters."""
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "a list"
    text = json.dumps(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
