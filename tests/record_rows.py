"""Records with the rows of their tables as objects, as tests read and change them; and back to columns."""

import json
from pathlib import Path
from typing import Any

from json_schema import load_schema, violations
from musatpy.listings.records import rows_in


def read_rows(path: Path) -> Any:
    """Return what a JSON file says, its tables as lists of rows."""
    return with_rows(json.loads(path.read_text()))


def valid_rows(path: Path, schema: Any) -> Any:
    """Return what a JSON file says, its tables as lists of rows, after it was held against its schema."""
    value = json.loads(path.read_text())
    assert not list(violations(value, schema, schema))
    return with_rows(value)


def with_rows(value: Any) -> Any:
    """Return a record whose tables of columns are lists of rows."""
    rows = rows_in(value)
    if rows is not None:
        return [{name: with_rows(entry) for name, entry in row.items()} for row in rows]
    return {name: with_rows(entry) for name, entry in value.items()} if isinstance(value, dict) else value


def with_columns(record: dict[str, Any], schema: Any = None) -> dict[str, Any]:
    """Return a record by rows, one of a run where no schema is given, as it is written: by columns."""
    schema = load_schema() if schema is None else schema
    return {name: _in_columns(record[name], schema["properties"].get(name, {}), schema) for name in record}


def _in_columns(value: Any, schema: Any, root: Any) -> Any:
    schema = root["$defs"][schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema
    if schema.get("columns") and isinstance(value, list):
        names = value[0] if value else schema["properties"]
        return {name: [row[name] for row in value] for name in names}
    if isinstance(value, dict):
        inner = schema.get("properties", {})
        return {name: _in_columns(entry, inner.get(name, {}), root) for name, entry in value.items()}
    return (
        [_in_columns(entry, schema.get("items", {}), root) for entry in value] if isinstance(value, list) else value
    )
