"""JSON files, and records of runs among them, which are held against their schema before anything is read of them.

`reports/record.schema.json` is made from what `reports` states. A reader names the tables that it needs. Files have
the observations of images in the table of plates, nothing said twice; readers have all observations in one table.
Photo, point, residual and sigma of an image are those of its plate measurement; Student's t and the estimated error
follow from what stands there (Pope 1976, Baarda 1968). Both coordinates of each image come first, in the order of
the plates.
"""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from functools import cache, partial
from itertools import chain, compress, islice, product, repeat
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.errors import Problem, RecordError
from musatpy.probability import students_of_pope

Schema = Mapping[str, Any]
Place = Callable[[int], str]  # number of a value -> its path in the record

_SCHEMA = Path(__file__).parents[1] / "reports" / "record.schema.json"
_SOME = "tables"  # content of a record without tables of images
_LEFT_OUT = ": the record was written with --record tables"
_LISTED = 20  # problems of one file
_PYTHON = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None), "integer": int}
_DIGITS = 15  # of a whole number at most that is exact in double precision
_IDS = {  # fields of tables that name a row of another one, and its ids
    "camera": ("cameras", "camera"),
    "photo": ("stations", "photo"),
    "photos": ("stations", "photo"),
    "point": ("points", "point"),
    "points": ("points", "point"),
}
FIELDS = ("redundancy", "standardised", "normal_test", "detectable", "effect")  # of images, two for each
_APART = ("plates", "observations", "solution")  # tables of which all observations are made
_MADE = ("residual", "test", "estimated_error")  # columns of these that are more than those they are made of
_LARGE = {"plates", "observations", "points", "bathymetric_points", "station_pairs"}  # most of a file
_AXES = ("x", "y")
_PLATE = "plate"
_LARGEST = 1e150  # number of a record: its square is one too


def read_json(path: Path) -> Any:
    """Return what a JSON file says. Raises `RecordError` where it is none, or a number is not finite; `OSError`."""
    return read_json_file(path, parse_float=_finite, parse_int=_whole)


def read_json_file(path: Path, leave: Set[str] = frozenset(), **hooks: Any) -> Any:
    """Return what a JSON file says; numbers beyond all limits are left to who reads on. Raises as `read_json`.

    Tables to `leave` are not read of a record that has the lines of this program.
    """
    quick = None if hooks else quick_json()
    hooks["parse_constant"] = _finite
    try:
        with suppress(ValueError, RecursionError):  # Python says of the whole file what is wrong, and where
            data = _without(path, leave)
            return quick.loads(data) if quick else json.loads(data, **hooks)
        return json.loads(path.read_bytes(), **hooks)
    except UnicodeDecodeError as error:
        message = f"is no JSON: byte {error.start + 1} is none of a text in UTF-8"
    except ValueError as error:
        message = f"is no JSON: {error}"
    except RecursionError:
        message = "is nested too deep"
    raise RecordError.of(message, file=path)


@cache
def quick_json() -> Any:
    """Return the package that reads and writes JSON some times as fast as Python does, None without `fast`."""
    return importlib.import_module("orjson") if importlib.util.find_spec("orjson") else None


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:20]} is no finite number")
    return value


def _whole(text: str) -> int:
    return int(_finite(text)) if len(text) > _DIGITS else int(text)


def read_record(
    path: Path,
    tables: Iterable[str],
    optional: Iterable[str] = (),
    *,
    schema: Schema | None = None,
    what: str = "run",
) -> dict[str, Any]:
    """Return these tables of the record of a run, as columns, where they are as its schema says.

    A table has a list for each of its fields. What is `optional` may be missing. Raises `RecordError` with the
    places where it is not as it should be, `OSError`. `schema`: that of the record of something else than a run,
    whose first field is its version, and `what` that is.
    """
    tables, optional = tuple(tables), tuple(optional)
    wanted = {*tables, *optional, *(_APART if "observations" in (*tables, *optional) else ())}
    record = read_json_file(path, _LARGE - wanted)
    return tables_of(record, path, tables, optional, schema=schema, what=what)


def _without(path: Path, leave: Set[str]) -> bytes:
    """Return a file without the tables to `leave`, where it has the lines of this program."""
    if not leave:
        return path.read_bytes()
    lines, kept = list[bytes](), True
    with path.open("rb") as file:
        for line in file:
            if line.startswith(b'  "'):  # a field of the record; those of a table stand further in
                kept = line[3 : line.find(b'"', 3)].decode() not in leave
            if kept or line.startswith(b"}"):
                lines.append(line)
    return b"".join(lines)


def known_of(
    record: Any, path: Path, leave: Container[str] = (), *, schema: Schema | None = None
) -> dict[str, Any]:
    """Return all tables of a record that its schema knows but those to `leave`, as `tables_of` does."""
    schema = _schema() if schema is None else schema
    known = [name for name in schema["properties"] if name not in leave]
    return tables_of(record, path, [name for name in known if name in schema["required"]], known, schema=schema)


def tables_of(
    record: Any,
    path: Path,
    tables: Iterable[str],
    optional: Iterable[str] = (),
    *,
    schema: Schema | None = None,
    what: str = "run",
) -> dict[str, Any]:
    """Return tables of a record, the content of a file, as `read_record` does. Raises `RecordError`."""
    schema = _schema() if schema is None else schema
    key = next(iter(schema["properties"]))
    ours = str(schema["properties"][key]["const"])
    version = record.get(key) if isinstance(record, dict) else None
    if not isinstance(version, str):
        raise RecordError.of(f"is not the record of a {what}", file=path)
    if version.split(".")[0] != ours.split(".")[0]:
        message = f"is a record of schema {version}, and this program reads {ours}; run the deck again"
        raise RecordError.of(message, file=path, field=key)
    required = list(tables)
    wanted = list(dict.fromkeys([*required, *optional]))
    form = _form(schema, wanted, required)
    if "observations" in wanted and are_apart(record):
        form = _form(schema, dict.fromkeys([*wanted, *_APART]), [*required, *_APART], plates=FIELDS)
        _hold_against(record, form, schema, path)
        columns = schema["properties"]["observations"]["properties"]
        form = {"properties": {"observations": {"properties": {name: columns[name] for name in _MADE}}}}
        record = with_images(record)
    _hold_against(record, form, schema, path)
    named = {name: record[name] for name in wanted if name in record}
    if faults := list(islice(_unknown_ids(named), _LISTED)) if schema is _schema() else []:
        raise RecordError(Problem(file=str(path), field=where, message=message) for where, message in faults)
    return named


def _form(schema: Schema, wanted: Iterable[str], required: Sequence[str], plates: Sequence[str] = ()) -> Schema:
    """Return what a schema says of tables; its version may be a later one. `plates` must have these too."""
    properties = {name: schema["properties"][name] for name in wanted}
    key = next(iter(schema["properties"]))
    properties |= {key: {"type": "string"}} if key in properties else {}
    if plates:
        table = properties["plates"]
        properties["plates"] = {**table, "required": [*table["required"], *plates]}
    return {"type": "object", "required": required, "properties": properties}


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
    if faults := list(islice(_faults([record], form, lambda row: ""), _LISTED)):
        left_out = schema["properties"].keys() - set(schema["required"]) if record.get("content") == _SOME else ()
        texts = ((where, f"{message}{_LEFT_OUT if where in left_out else ''}") for where, message in faults)
        raise RecordError(Problem(file=str(path), field=where, message=message) for where, message in texts)


@cache
def _schema() -> Schema:
    schema: Schema = json.loads(_SCHEMA.read_text(encoding="utf-8"))
    return schema


def _resolved(schema: Schema) -> Schema:
    return _schema()["$defs"][schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema


def _faults(values: Sequence[Any], schema: Schema, place: Place) -> Iterator[tuple[str, str]]:
    """Yield the places where values of one field are not as its schema says, and what is wrong there.

    The values of all rows are looked at as a whole; those that are no value of the field are not looked into.
    """
    schema = _resolved(schema)
    if strange := _of_other_types(values, schema):
        yield from ((place(n), f"expected {_expected(schema)}, found {_shown(values[n])}") for n in strange)
        rows = sorted(set(range(len(values))).difference(strange))
        yield from _faults([values[n] for n in rows], schema, lambda row: place(rows[row]))
        return
    choices = schema.get("enum", [schema["const"]] if "const" in schema else None)
    if choices is not None:
        expected = " or ".join(map(_shown, choices))
        wrong = (n for n, value in enumerate(values) if value not in choices)
        yield from ((place(n), f"expected {expected}, found {_shown(values[n])}") for n in wrong)
    if "items" in schema:
        yield from _faults_of_lists(*_of_type(list, values, place), schema)
    if "properties" in schema or "additionalProperties" in schema:
        yield from _faults_of_tables(*_of_type(dict, values, place), schema)


def _of_other_types(values: Sequence[Any], schema: Schema) -> list[int]:
    """Return the numbers of those values whose type is not in a schema, and of numbers that are too large."""
    names = schema.get("type", [])
    names = {names} if isinstance(names, str) else set(names)
    allowed = {_PYTHON[name] for name in names - {"number"}} | ({int, float} if "number" in names else set())
    kinds = set(map(type, values))
    if not allowed or (kinds <= allowed and float not in allowed):
        return []
    if kinds <= allowed:
        numbers = [value for value in values if value is not None] if type(None) in kinds else values
        if not numbers or (-_LARGEST < min(numbers) and max(numbers) < _LARGEST):
            return []
    is_number = {int, float} if float in allowed else set()
    return [
        n
        for n, value in enumerate(values)
        if type(value) not in allowed or (type(value) in is_number and not -_LARGEST < value < _LARGEST)
    ]


def _of_type(kind: type, values: Sequence[Any], place: Place) -> tuple[Sequence[Any], Place]:
    """Return the values of one type, with their places."""
    if set(map(type, values)) <= {kind}:
        return values, place
    rows = [n for n, value in enumerate(values) if type(value) is kind]
    return [values[n] for n in rows], lambda row: place(rows[row])


def _faults_of_lists(lists: Sequence[list[Any]], place: Place, schema: Schema) -> Iterator[tuple[str, str]]:
    low, high = schema.get("minItems", 0), schema.get("maxItems", math.inf)
    if not all(low <= length <= high for length in set(map(len, lists))):
        wrong = (n for n, entries in enumerate(lists) if not low <= len(entries) <= high)
        yield from ((place(n), f"expected {_expected(schema)}, found {len(lists[n])}") for n in wrong)

    def place_of_item(number: int) -> str:
        row = 0
        while number >= len(lists[row]):
            number -= len(lists[row])
            row += 1
        return f"{place(row)}[{number}]"

    yield from _faults(list(chain.from_iterable(lists)), schema["items"], place_of_item)


def _faults_of_tables(tables: Sequence[dict[str, Any]], place: Place, schema: Schema) -> Iterator[tuple[str, str]]:
    """Yield what is wrong in tables; fields that a schema does not name may be anything."""
    others = schema.get("additionalProperties")
    fields = schema.get("properties", {})
    if isinstance(others, dict):
        fields = {**dict.fromkeys(chain.from_iterable(tables), others), **fields}
    for name, inner in fields.items():
        rows = [n for n, table in enumerate(tables) if name in table]
        if name in schema.get("required", ()):
            missing = sorted(set(range(len(tables))).difference(rows))
            yield from ((_place_in(place, missing, name, n), "is missing") for n in range(len(missing)))
        yield from _faults([tables[n][name] for n in rows], inner, partial(_place_in, place, rows, name))
    for n, table in enumerate(tables) if schema.get("columns") else ():
        columns = (column for name, column in table.items() if isinstance(column, list) or name not in fields)
        lengths = {len(column) if isinstance(column, list) else 0 for column in columns}
        if len(lengths) > 1:
            yield place(n), f"has columns of {min(lengths)} and of {max(lengths)} entries"


def _place_in(place: Place, rows: Sequence[int], name: str, row: int) -> str:
    """Return the place of the field of a table."""
    return f"{place(rows[row])}.{name}".lstrip(".")


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


# --- the observations of images, which files have in the table of plates ---


def are_apart(record: Any) -> bool:
    """Tell whether a record has the observations of images in its table of plates, as files have."""
    plates = record.get("plates") if isinstance(record, Mapping) else None
    return isinstance(plates, Mapping) and FIELDS[0] in plates and isinstance(record.get("observations"), Mapping)


def with_images(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record whose table of observations has those of images too, and its table of plates no more of them.

    Its tables are columns. Raises `LookupError`, `TypeError` or `ValueError` for a record that is not as its schema
    says.
    """
    plates, others, solution = record["plates"], record["observations"], record["solution"]
    there = [value is not None for value in chain.from_iterable(plates[FIELDS[0]])]
    names = [[photo, point] for photo, point in zip(plates["photo"], plates["point"], strict=True)]
    pairs = {"of": zip(names, names, strict=True), "component": repeat(_AXES, len(names))}
    pairs |= {name: plates[name] for name in ("residual", "sigma", *FIELDS)}
    found = {name: list[Any](compress(chain.from_iterable(pair), there)) for name, pair in pairs.items()}
    found["kind"] = [_PLATE] * len(found["of"])
    students = _students(found["standardised"], solution["unit_sigma"], solution["degrees_of_freedom"])
    found["test"] = students
    found["estimated_error"] = [
        None if test is None or residual is None or not redundancy else -float(residual) / float(redundancy)
        for test, residual, redundancy in zip(
            found["standardised"], found["residual"], found["redundancy"], strict=True
        )
    ]
    return {
        **record,
        "observations": {name: [*found[name], *others[name]] for name in others},
        "plates": {name: column for name, column in plates.items() if name not in FIELDS},
    }


def _students(standardised: Sequence[Any], unit_sigma: Any, freedom: Any) -> list[float | None]:
    """Return Student's t of residuals over their own sigmas: Pope's tau with sigma0 from all others."""
    sigma0, f = float(unit_sigma or 0.0), int(freedom)
    if sigma0 <= 0.0 or f < 2:
        return [None] * len(standardised)
    taus = np.array([math.nan if value is None else float(value) for value in standardised]) / sigma0
    return [value if math.isfinite(value) else None for value in students_of_pope(taus, f).tolist()]
