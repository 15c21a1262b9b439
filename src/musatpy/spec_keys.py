"""The keys of a TOML spec as lists, from the dataclasses that read it."""

from __future__ import annotations

import dataclasses
import types
import typing
from typing import Any

from musatpy.specs import Area, Pair, Triple

_NAMES = {float: "number", int: "integer", bool: "true/false", str: "text"}
_LISTS = {Pair: "[2 numbers]", Triple: "[3 numbers] or one", Area: "[4 numbers]"}


def key_tables(spec: type[Any]) -> str:
    """Return the keys of a spec dataclass as Markdown, one heading per table of the TOML."""
    parts = ["### Top of the file", *_rows(spec)]
    for kind in _tables(spec):
        heading, _, about = (kind.__doc__ or "").partition(": ")
        parts += ["", f"### `{heading}`", "", f"{about[0].upper()}{about[1:]}", *_rows(kind)]
    return "\n".join(parts) + "\n"


def _tables(kind: type[Any]) -> list[type[Any]]:
    """Return the dataclasses below a spec dataclass, in the order of their keys, each with those below it."""
    tables: list[type[Any]] = []
    hints = typing.get_type_hints(kind)
    for field in dataclasses.fields(kind):
        member = _member(hints[field.name])
        if dataclasses.is_dataclass(member):
            tables += [typing.cast(type[Any], member), *_tables(typing.cast(type[Any], member))]
    return tables


def _member(hint: Any) -> Any:
    """Return the type itself, out of `X | None` and of `tuple[X, ...]`."""
    if isinstance(hint, types.UnionType):
        return _member(next(kind for kind in typing.get_args(hint) if kind is not types.NoneType))
    members = typing.get_args(hint)
    return members[0] if len(members) == 2 and members[1] is Ellipsis else hint


def _rows(kind: type[Any]) -> list[str]:
    """Return the plain keys of a spec dataclass as a Markdown list: value, default and meaning."""
    hints = typing.get_type_hints(kind)
    rows = [""]
    for field in dataclasses.fields(kind):
        if dataclasses.is_dataclass(_member(hints[field.name])):
            continue
        about = field.metadata
        meaning = about["doc"] + (f": {', '.join(about['choices'])}" if about["choices"] else "")
        value = _type_name(hints[field.name]) + (f", {about['unit']}" if about["unit"] else "")
        value += f" of {about['longest']} characters at most" if about["longest"] else ""
        rows.append(f"- `{field.name}` ({value}{_default(field)}): {meaning}")
    return rows


def _type_name(hint: Any) -> str:
    member = _member(hint)
    if member in _LISTS:
        return _LISTS[member]
    single = isinstance(hint, types.UnionType) or member is hint
    if typing.get_origin(member) is tuple:
        kinds = typing.get_args(member)
        inside = "x [3 numbers]" if kinds[0] == Triple else f"{_NAMES[kinds[0]]}s"
        name = f"[{len(kinds)} {inside}]"
        return name if single else f"list of {name}"
    name = _NAMES[member]
    return name if single else f"list of {name}s"


def _default(field: dataclasses.Field[Any]) -> str:
    """Return the default as TOML writes it; `required` where there is none, nothing where the key may be absent."""
    value = field.default
    if value is dataclasses.MISSING:
        return "; required"
    if value is None:
        return ""
    if isinstance(value, tuple):
        return f"; `{list(value)}`".replace("'", '"')
    return f"; `{str(value).lower() if isinstance(value, bool) else value}`"
