"""JSON texts whose numbers stay as they are written, and whose long columns are decoded when they are asked for.

The record of a large block has millions of numbers: as objects of Python they take ten times their text.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from typing import Any, overload

from musatpy.errors import Problem
from musatpy.listings.lines import CannotCompareError

_OF_COLUMNS = re.compile(r'\{\s*"schema_version": "2\.')  # a record of a run, of tables by columns
_LONG = 1000  # characters of a column, from which on it is left as a text
_COLUMN = re.compile(rf'^( +"[^"\\]+": )(\[.{{{_LONG},}}\])(?=,?$)', re.MULTILINE)
_TEXT = re.compile(r'"(?:[^"\\]|\\.)*"')
_MARK = "\0"  # before the number of a column, in place of which it stands


class Number(str):
    """A number as it is written in a JSON file."""

    __slots__ = ()


class Column(Sequence[Any]):
    """A column that stands on a line of a JSON text; each time that it is gone through it is decoded."""

    __slots__ = ("_end", "_file", "_start", "_text")

    def __init__(self, text: str, start: int, end: int, file: str) -> None:
        self._text, self._start, self._end, self._file = text, start, end, file

    @property
    def written(self) -> str:
        """The text of the column."""
        return self._text[self._start : self._end]

    def values(self) -> list[Any]:
        """Return the entries. Raises `CannotCompareError` where the text is no JSON."""
        try:
            entries: list[Any] = _decoded(self.written)
        except json.JSONDecodeError as error:
            raise _no_json(error, self._file, self._text.count("\n", 0, self._start)) from error
        return entries

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Column) and self.written == other.written

    __hash__ = None  # type: ignore[assignment]

    def __iter__(self) -> Iterator[Any]:
        return iter(self.values())

    def __len__(self) -> int:
        return len(self.values())

    @overload
    def __getitem__(self, index: int) -> Any: ...
    @overload
    def __getitem__(self, index: slice) -> list[Any]: ...
    def __getitem__(self, index: int | slice) -> Any:
        return self.values()[index]


def read_json(text: str, name: str) -> Any:
    """Return the content of a JSON text; raises `CannotCompareError`."""
    columns: list[Column] = []

    def taken(found: re.Match[str]) -> str:
        if not _is_whole(found[2]):
            return found[0]
        columns.append(Column(text, *found.span(2), name))
        return f'{found[1]}"\\u0000{len(columns) - 1}"'

    try:
        if not _OF_COLUMNS.match(text) or r"\u0000" in text:
            return _decoded(text)
        return _with_columns(_decoded(_COLUMN.sub(taken, text)), columns)
    except json.JSONDecodeError as error:
        raise _no_json(error, name) from error
    except RecursionError as error:
        raise CannotCompareError([Problem(file=name, message="is nested too deep")]) from error


def _is_whole(written: str) -> bool:
    """Tell whether a text is one array of numbers, texts and arrays, where the line that it stands on is JSON."""
    bare = _TEXT.sub("", written) if '"' in written else written
    return bare.count("[") == bare.count("]") and ":" not in bare and "{" not in bare and '"' not in bare


def _with_columns(value: Any, columns: Sequence[Column]) -> Any:
    if isinstance(value, dict):
        return {key: _with_columns(entry, columns) for key, entry in value.items()}
    is_mark = isinstance(value, str) and value.startswith(_MARK) and value[1:].isdecimal()
    return columns[int(value[1:])] if is_mark else value


def _decoded(text: str) -> Any:
    return json.loads(text, parse_float=Number, parse_int=Number, parse_constant=Number)


def _no_json(error: json.JSONDecodeError, name: str, lines: int = 0) -> CannotCompareError:
    """Return what is wrong with a text that has so many lines before it."""
    problem = Problem(file=name, line=lines + error.lineno, message=f"is not JSON: {error.msg}")
    return CannotCompareError([problem])
