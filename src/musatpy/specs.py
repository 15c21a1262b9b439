"""Reading of a TOML table into a frozen dataclass, every problem reported; its keys as lists for the manual.

The dataclass is the only place where a key stands; `key` puts its unit, limits and meaning there.
"""

from __future__ import annotations

import dataclasses
import math
import re
import tomllib
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from musatpy.errors import Problem, SpecError

Spec = TypeVar("Spec")
Triple = tuple[float, float, float]  # one number in the TOML stands for all three
Pair = tuple[float, float]
Area = tuple[float, float, float, float]  # east from, east to, north from, north to (m about the centre)


_FAR = 1e15  # of numbers: products of larger ones overflow, and nothing is as far
_COUNTED = 2**62  # of whole numbers: room for sums in 64 bits
_SHOWN = 40  # characters of what is wrong
_DEEPEST = 100  # parts of a key
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
_DEEP_KEY = re.compile(rf"(?<![\w-])(?:{_PART}){{{_DEEPEST}}}")


def read_toml(path: Path) -> dict[str, Any]:
    """Return what a TOML file says; raises `ValueError` with what is wrong, `OSError`."""
    try:
        return toml_of(path.read_bytes().decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise ValueError(f"it is no text in UTF-8 at byte {error.start + 1}") from error


def toml_of(text: str, parse_float: Callable[[str], Any] = float) -> dict[str, Any]:
    """Return what a TOML text says; raises `ValueError` with what is wrong (`tomllib.TOMLDecodeError` is one)."""
    deep = _DEEP_KEY.search(text)
    if deep:  # of which tomllib keeps all beginnings
        line = text.count("\n", 0, deep.start()) + 1
        raise ValueError(f"it is nested too deep: a key of more than {_DEEPEST} parts (at line {line})")
    try:
        return tomllib.loads(text, parse_float=parse_float)
    except RecursionError as error:
        raise ValueError("it is nested too deep") from error


def key(
    default: Any = dataclasses.MISSING,
    doc: str = "",
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: Sequence[str] = (),
    longest: int | None = None,
    quiet: bool = False,
    name: str = "",
    required: bool = False,
    convert: Callable[[Any], Any] | None = None,
) -> Any:
    """Return a dataclass field for one key of the spec; without a default, or if `required`, it must be given.

    `low` and `high` bound numbers (each of a list), `longest` the characters of texts. A `quiet` key stands in the
    truth only where it is off its default: those that came later leave the truth of older specs as it was. `name`
    is the key where the attribute has another; `convert` makes the value in place of the type, and raises
    `ValueError` with what is wrong.
    """
    about: dict[str, Any] = {"doc": doc, "unit": unit, "choices": tuple(choices), "longest": longest}
    about |= {"low": low, "high": high, "quiet": quiet}
    about |= {"name": name, "required": required, "convert": convert}
    if callable(default):
        return dataclasses.field(default_factory=default, metadata=about)
    return dataclasses.field(default=default, metadata=about)


@cache
def keys(kind: Any) -> dict[str, dataclasses.Field[Any]]:
    """Return the dataclass fields that a table may give, by their keys."""
    fields = (field for field in dataclasses.fields(kind) if "doc" in field.metadata)
    return {field.metadata["name"] or field.name: field for field in fields}


def is_required(field: dataclasses.Field[Any]) -> bool:
    """Return whether a key must be given."""
    without = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    return without or bool(field.metadata["required"])


def require(holds: bool, what: str) -> None:
    """Raise `ValueError` saying `what` unless it holds."""
    if not holds:
        raise ValueError(what)


_PLACE = re.compile(r"(?:(\w+)(?:\[(\d+)\](?:\.|$)|\.))?(.*)", re.DOTALL)  # table, its number, key
_TESTS: dict[Any, tuple[Callable[[Any], bool], str]] = {
    float: (lambda value: _is_number(value), "a number"),
    int: (lambda value: isinstance(value, int) and not isinstance(value, bool), "a whole number"),
    bool: (lambda value: isinstance(value, bool), "true or false"),
    str: (lambda value: isinstance(value, str), "a text"),
}


@cache
def _hints(kind: Any) -> dict[str, Any]:
    return typing.get_type_hints(kind)


@cache
def _shape(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return what values of a type are read as: a dataclass, `tuple` or `dict` and members, or a scalar type."""
    if isinstance(hint, types.UnionType):
        hint = next(member for member in typing.get_args(hint) if member is not types.NoneType)
    origin = typing.get_origin(hint)
    if origin in (tuple, dict):
        return origin, typing.get_args(hint)
    return (str if origin is typing.Literal else hint), ()


class Reader:
    """Turns tables into dataclasses and gathers what is wrong with them in `problems`.

    A dataclass may have `faults`, which yields keys of a raw table, empty for all of it, and what is wrong between
    them; it gets the keys whose values are what they should be.
    """

    def __init__(self, file: str | None = None, text: str | None = None) -> None:
        self.file = file
        self.lines = None if text is None else text.splitlines()  # where they are given, problems have lines
        self.problems: list[Problem] = []

    def complain(self, where: str, message: str) -> None:
        """Add one problem of the key `where`."""
        if self.lines is None:
            self.problems.append(Problem(file=self.file, field=where, message=message))
            return
        table, number, key = _PLACE.fullmatch(where).groups()  # type: ignore[union-attr]
        label = f"{table} {number}" if number else table
        line = self._line(table, int(number or 1), key)
        self.problems.append(Problem(file=self.file, line=line, card=label, field=key or None, message=message))

    def _line(self, table: str | None, number: int, key: str) -> int:
        """Return the line of a key, or of its table where the key is nowhere in it, from 1."""
        lines = self.lines or []
        heads = [n for n, line in enumerate(lines) if re.match(rf"\s*\[+\s*{table}\s*\]", line)] if table else []
        start = heads[number - 1] if number <= len(heads) else 0
        for n in range(start, len(lines) if key else start):
            line = lines[n].strip()
            if re.match(rf"[\"']?{re.escape(key)}[\"']?\s*[=.]|\[+\s*{re.escape(key)}\s*[\].]", line):
                return n + 1
            if n > start and line.startswith("[") and table:
                break
        return start + 1

    def table(self, kind: Any, raw: Any, where: str) -> Any:
        """Return `kind` made from the TOML table `raw`, or None where that failed."""
        if not isinstance(raw, dict):
            return self.complain(where, f"a table is expected, not {_shown(raw)}")
        before = len(self.problems)
        hints, known = _hints(kind), keys(kind)
        for name in sorted(raw.keys() - known.keys()):
            self.complain(_join(where, name), f"is no key here; there are {', '.join(known)}")
        values: dict[str, Any] = {}
        right: dict[str, Any] = {}
        for name, field in known.items():
            if name in raw:
                so_far = len(self.problems)
                values[field.name] = self._given(field.metadata, hints[field.name], raw[name], _join(where, name))
                right |= {name: raw[name]} if len(self.problems) == so_far else {}
            elif is_required(field):
                about = field.metadata["doc"]
                self.complain(_join(where, name), f"is missing: {about}" if about else "is missing")
        for name, fault in kind.faults(right) if hasattr(kind, "faults") else ():
            self.complain(_join(where, name) if name else where, fault)
        if len(self.problems) > before:
            return None
        try:
            return kind(**values)
        except ValueError as error:
            return self.complain(where or "spec", str(error))

    def _given(self, about: Mapping[str, Any], hint: Any, raw: Any, where: str) -> Any:
        """Return the value of a key that is given."""
        if about["convert"] is None:
            value = self._value(hint, raw, where)
            self._check_limits(about, value, where)
            return value
        try:
            return about["convert"](raw)
        except ValueError as error:
            return self.complain(where, str(error))

    def _value(self, hint: Any, raw: Any, where: str) -> Any:
        """Return `raw` as a type says: a scalar, an optional, a tuple of them, a table or an array of tables."""
        kind, members = _shape(hint)
        if kind in _TESTS:
            return self._scalar(kind, raw, where)
        if kind is dict:
            return self._by_name(members[1], raw, where)
        return self._tuple(members, raw, where) if kind is tuple else self.table(kind, raw, where)

    def _by_name(self, member: Any, raw: Any, where: str) -> Any:
        """Return a table whose keys are any names, and its values all of one type."""
        if not isinstance(raw, dict):
            return self.complain(where, f"a table is expected, not {_shown(raw)}")
        return {name: self._value(member, value, _join(where, name)) for name, value in raw.items()}

    def _tuple(self, members: tuple[Any, ...], raw: Any, where: str) -> Any:
        if members == (float,) * 3 and _is_number(raw):
            raw = [raw] * 3
        if not isinstance(raw, list):
            return self.complain(where, f"a list is expected, not {_shown(raw)}")
        if len(members) == 2 and members[1] is Ellipsis:
            members = (members[0],) * len(raw)
        if len(raw) != len(members):
            return self.complain(where, f"{len(members)} values are expected, not {len(raw)}")
        pairs = enumerate(zip(members, raw, strict=True), start=1)
        return tuple(self._value(member, value, f"{where}[{i}]") for i, (member, value) in pairs)

    def _scalar(self, kind: Any, raw: Any, where: str) -> Any:
        fits, name = _TESTS[kind]
        if not fits(raw):
            return self.complain(where, f"{name} is expected, not {_shown(raw)}")
        if kind is float and abs(raw) > _FAR and raw not in (math.inf, -math.inf):
            return self.complain(where, f"{str(raw)[:_SHOWN]} is beyond {_FAR:g}")
        if kind is int and abs(raw) > _COUNTED:
            return self.complain(where, f"{str(raw)[:_SHOWN]} is beyond {_COUNTED}")
        return kind(raw)

    def _check_limits(self, about: Mapping[str, Any], given: Any, where: str) -> None:
        """Complain about numbers outside the limits of the key, and texts that are too long or not its choices."""
        for value in given if isinstance(given, tuple) else (given,):
            if isinstance(value, str):
                if about["choices"] and value not in about["choices"]:
                    self.complain(where, f"'{value}' is not one of {', '.join(filter(None, about['choices']))}")
                if about["longest"] and not 1 <= len(value) <= about["longest"]:
                    self.complain(where, f"'{value}' has not 1 to {about['longest']} characters")
            elif _is_number(value):
                if about["low"] is not None and value < about["low"]:
                    self.complain(where, f"{value} is below {about['low']:g}")
                if about["high"] is not None and value > about["high"]:
                    self.complain(where, f"{value} is above {about['high']:g}")
                if not math.isfinite(value):
                    self.complain(where, f"{value} is not a finite number")


def spec_of(kind: type[Spec], raw: dict[str, Any], file: str | None = None) -> Spec:
    """Return a table as a dataclass. Raises `SpecError` with every problem found."""
    reader = Reader(file)
    spec = reader.table(kind, raw, "")
    if reader.problems or not isinstance(spec, kind):
        raise SpecError(reader.problems)
    return spec


def spec_table(path: Path) -> dict[str, Any]:
    """Return the table of a TOML file. Raises `SpecError` where it cannot be read."""
    try:
        return read_toml(path)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise SpecError.of(f"cannot be read: {why}", file=path) from error


def echoed(spec: Any) -> dict[str, Any]:
    """Return the keys of a spec dataclass as plain data; without those that are None, or quiet at their default."""
    echo = {}
    for field in dataclasses.fields(spec):
        value = getattr(spec, field.name)
        if value is not None and not (field.metadata["quiet"] and value == field.default):
            echo[field.name] = _plain(value)
    return echo


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return echoed(value)
    return [_plain(member) for member in value] if isinstance(value, tuple) else value


def _join(where: str, name: str) -> str:
    return f"{where}.{name}" if where else name


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _shown(raw: Any) -> str:
    return repr(raw)[:_SHOWN]


# --- the keys of a spec as lists ---

_NAMES = {float: "number", int: "integer", bool: "true/false", str: "text"}
_LISTS = {Pair: "[2 numbers]", Triple: "[3 numbers] or one", Area: "[4 numbers]"}


def key_tables(spec: Any) -> str:
    """Return the keys of a spec dataclass as Markdown, one heading per table of the TOML."""
    parts = ["### Top of the file", *_rows(spec)]
    for kind in _tables(spec):
        heading, _, about = (kind.__doc__ or "").partition(": ")
        parts += ["", f"### `{heading}`", "", f"{about[0].upper()}{about[1:]}", *_rows(kind)]
    return "\n".join(parts) + "\n"


def _tables(kind: Any) -> list[type[Any]]:
    """Return the dataclasses below a spec dataclass, in the order of their keys, each with those below it."""
    tables: list[type[Any]] = []
    for field in dataclasses.fields(kind):
        member = _member(_hints(kind)[field.name])
        if hasattr(member, "__dataclass_fields__"):
            tables += [member, *_tables(member)]
    return tables


def _member(hint: Any) -> Any:
    """Return the type itself, out of `X | None` and of `tuple[X, ...]`."""
    if isinstance(hint, types.UnionType):
        return _member(next(kind for kind in typing.get_args(hint) if kind is not types.NoneType))
    members = typing.get_args(hint)
    return members[0] if len(members) == 2 and members[1] is Ellipsis else hint


def _rows(kind: Any) -> list[str]:
    """Return the plain keys of a spec dataclass as a Markdown list: value, default and meaning."""
    hints = _hints(kind)
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
