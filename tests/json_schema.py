"""As much of JSON Schema as our schemas use, and the lists of fields of the manual that are made from them.

`python tests/json_schema.py` writes the schema of the record anew, and the lists into src/musatpy/reports/record.md
and src/musatpy/campaign/summary.md.
"""

import json
from pathlib import Path

ROOT = Path(__file__).parents[1]
SCHEMA = ROOT / "src" / "musatpy" / "reports" / "record.schema.json"
MANUAL = ROOT / "src" / "musatpy" / "reports" / "record.md"
BATCH_SCHEMA = ROOT / "src" / "musatpy" / "campaign" / "summary.schema.json"
BATCH_MANUAL = ROOT / "src" / "musatpy" / "campaign" / "summary.md"
BEGIN, END = "<!-- record: begin -->", "<!-- record: end -->"

_TYPES = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}
_KEYWORDS = {"$schema", "$defs", "$ref", "title", "description", "unit", "type", "const", "enum", "properties"}
_KEYWORDS |= {"required", "additionalProperties", "items", "minItems", "maxItems", "columns", "digits"}


def load_schema(path=SCHEMA):
    return json.loads(path.read_text())


def violations(value, schema, root, path="$"):
    """Yield one text for every place where `value` breaks `schema`."""
    unknown = set(schema) - _KEYWORDS
    if unknown:
        raise ValueError(f"{path}: keywords that this checker does not know: {unknown}")
    if "$ref" in schema:
        yield from violations(value, root["$defs"][schema["$ref"].rpartition("/")[2]], root, path)
        return
    types = schema.get("type", [])
    types = [types] if isinstance(types, str) else types
    if types and not any(_is_of(value, name) for name in types):
        yield f"{path}: {value!r} is not {' or '.join(types)}"
        return
    if "const" in schema and value != schema["const"]:
        yield f"{path}: {value!r} is not {schema['const']!r}"
    if "enum" in schema and value not in schema["enum"]:
        yield f"{path}: {value!r} is none of {schema['enum']}"
    if isinstance(value, dict):
        yield from _object_violations(value, schema, root, path)
    if isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            yield f"{path}: {len(value)} items"
        for number, item in enumerate(value):
            yield from violations(item, schema.get("items", {}), root, f"{path}[{number}]")


def _object_violations(value, schema, root, path):
    properties, others = schema.get("properties", {}), schema.get("additionalProperties", True)
    for name in schema.get("required", []):
        if name not in value:
            yield f"{path}: without {name}"
    if schema.get("columns") and len(set(map(len, value.values()))) > 1:
        yield f"{path}: columns of different lengths"
    for name, entry in value.items():
        if name in properties:
            yield from violations(entry, properties[name], root, f"{path}.{name}")
        elif others is False:
            yield f"{path}: {name} is not in the schema"
        elif isinstance(others, dict):
            yield from violations(entry, others, root, f"{path}.{name}")


def _is_of(value, name):
    if name == "integer":
        return isinstance(value, int) and not isinstance(value, bool)
    if name == "number":
        return isinstance(value, int | float) and not isinstance(value, bool)
    return isinstance(value, _TYPES[name])


def manual_list(schema):
    """Return the fields of the schema as a list in Markdown: type, unit, meaning."""
    rows = []
    for path, entry in _fields(schema, schema, ""):
        kind = _kind(entry, schema) + (f", {entry['unit']}" if "unit" in entry else "")
        kind += f", {entry['digits']} digits" if "digits" in entry else ""
        meaning = f": {entry['description']}" if "description" in entry else ""
        rows.append(f"- `{path}` ({kind}){meaning}")
    return "\n".join(rows)


def _fields(schema, root, path):
    for name, entry in schema.get("properties", {}).items():
        here = f"{path}.{name}" if path else name
        yield here, entry
        inner = root["$defs"][entry["$ref"].rpartition("/")[2]] if "$ref" in entry else entry
        if inner.get("columns"):
            yield from ((f"{here}[].{column}", _of_rows(of)) for column, of in inner["properties"].items())
        elif "properties" in inner:
            yield from _fields(inner, root, here)
        elif "properties" in inner.get("items", {}) and "$ref" not in entry:
            yield from _fields(inner["items"], root, f"{here}[]")
    for name, entry in schema.get("$defs", {}).items():
        inside = f"({name})[]" if "items" in entry else f"({name})"
        yield from _fields(entry.get("items", entry), root, inside)


def _of_rows(column):
    """Return what a schema says of one entry of a column."""
    return {**column["items"], **{key: column[key] for key in ("unit", "description", "digits") if key in column}}


def _kind(entry, root):
    if entry.get("columns"):
        return "columns"
    if "$ref" in entry:
        return entry["$ref"].rpartition("/")[2]
    if "const" in entry:
        return f"`{json.dumps(entry['const'])}`"
    if "enum" in entry:
        return " ".join(f"`{value}`" for value in entry["enum"])
    types = entry["type"] if isinstance(entry["type"], list) else [entry["type"]]
    names = [_array_kind(entry, root) if name == "array" else name for name in types if name != "null"]
    return "|".join(names) + "?" * ("null" in types)


def _array_kind(entry, root):
    item = entry["items"]
    if "properties" in item:
        return "table"
    size = entry.get("minItems")
    return f"{_kind(item, root)}[{size or ''}]"


def with_table(text, schema):
    """Return the text of the manual with the list between its marks made anew."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{manual_list(schema)}\n{END}{after}"


def schema_text():
    """Return the schema of the record as JSON text, one field on a line."""
    from musatpy.reports.record import document

    return _spread(document().schema(), "\n  ") + "\n"


def _spread(schema, margin):
    """Return JSON in which every field stands on a line of its own, after `margin`; all else stands behind."""
    if not isinstance(schema, dict):
        return json.dumps(schema)
    entries = []
    for key, entry in schema.items():
        text = _spread(entry, margin + "  ")
        if key in ("properties", "$defs"):
            fields = (f"{margin}{json.dumps(name)}: {_spread(of, margin + '  ')}" for name, of in entry.items())
            text = "{" + ",".join(fields) + "}"
        entries.append(f"{json.dumps(key)}: {text}")
    return "{" + ", ".join(entries) + "}"


if __name__ == "__main__":
    SCHEMA.write_text(schema_text())
    for manual, schema in ((MANUAL, SCHEMA), (BATCH_MANUAL, BATCH_SCHEMA)):
        manual.write_text(with_table(manual.read_text(), load_schema(schema)))
