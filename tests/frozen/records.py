"""Records number by number: which fields two of them have, by names that a new schema may have changed."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_RENAMED = Path(__file__).with_name("fields.toml")
_VALUES = 3  # of a field that differs, of both versions


def renamed() -> dict[str, str]:
    """Return the fields that have another name now: `points.position` = `ground.position`."""
    return tomllib.loads(_RENAMED.read_text(encoding="utf-8"))["renamed"]


def fields(record: Any, name: str = "") -> Iterator[tuple[str, list[Any]]]:
    """Yield the names of all fields of a record and their values, one after the other."""
    if isinstance(record, dict):
        for key, value in record.items():
            yield from fields(value, f"{name}.{key}" if name else key)
    elif isinstance(record, list) and any(isinstance(row, dict) for row in record):
        gathered: dict[str, list[Any]] = {}
        for row in record:
            for key, values in fields(row, name):
                gathered.setdefault(key, []).extend(values)
        yield from gathered.items()
    else:
        yield name, list(_flat(record))


def differences(before: str, after: str, names: dict[str, str] | None = None) -> list[str]:
    """Return the fields of two records that differ, a line each; every number of the first is looked for."""
    names = renamed() if names is None else names
    old, new = (dict(fields(json.loads(text))) for text in (before, after))
    old = {names.get(name, name): values for name, values in old.items()}
    lines = [f"only before: {name}" for name in old.keys() - new.keys()]
    lines += [f"only after: {name}" for name in new.keys() - old.keys()]
    for name in old.keys() & new.keys():
        if old[name] != new[name]:
            pairs = zip(old[name], new[name], strict=False)
            changed = [f"{one} -> {other}" for one, other in pairs if one != other][:_VALUES]
            lines.append(f"{name}: {len(old[name])} and {len(new[name])} values; {', '.join(changed)}")
    return sorted(lines)


def _flat(value: Any) -> Iterator[Any]:
    if isinstance(value, list):
        for entry in value:
            yield from _flat(entry)
    else:
        yield value
