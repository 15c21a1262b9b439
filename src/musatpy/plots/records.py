"""Records as tables for pictures: what is a record of, and which pictures it has."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from musatpy.errors import Problem, RecordError
from musatpy.json_files import Schema, read_record
from musatpy.plots.gallery import COMPILED, GALLERY, SOUNDED
from musatpy.plots.picture import Picture
from musatpy.plots.tables import Tables

_VERSION = re.compile(rb'\s*\{\s*"(\w+)_version"')  # the first field of a record, of whichever kind
_RUN = {"options": ("system",), "stations": ("photo", "position")}
# What pictures take where it is there: records without observations, and earlier ones, lack some of it.
_OF_RUN: dict[str, tuple[str, ...]] = {
    "stated": ("answer",),
    "ellipsoid": (),
    "adjusted_water": ("tide",),
    "dependence": ("globals",),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordKind:
    """What a record is of, and the pictures of it."""

    what: str
    pictures: tuple[Picture[Any], ...]
    schema: Callable[[], Schema | None]  # None: of a run
    required: dict[str, tuple[str, ...]]
    optional: dict[str, tuple[str, ...]]


def needs_of(pictures: Iterable[Picture[Any]]) -> dict[str, tuple[str, ...]]:
    """Return the tables that pictures need, with their fields."""
    needs: dict[str, tuple[str, ...]] = {}
    for picture in pictures:
        for table, fields in picture.needs.items():
            needs[table] = tuple(dict.fromkeys([*needs.get(table, ()), *fields]))
    return needs


def _compilation() -> Schema:
    from musatpy.reports import compilation

    return compilation.DOCUMENT.schema()


def _soundings() -> Schema:
    from musatpy.reports import soundings

    return soundings.DOCUMENT.schema()


KINDS = {
    b"schema": RecordKind(
        what="run", pictures=GALLERY, schema=lambda: None, required=_RUN, optional=needs_of(GALLERY) | _OF_RUN
    ),
    b"compilation": RecordKind(
        what="compilation", pictures=COMPILED, schema=_compilation, required=needs_of(COMPILED), optional={}
    ),
    b"soundings": RecordKind(
        what="comparison", pictures=SOUNDED, schema=_soundings, required=needs_of(SOUNDED), optional={}
    ),
}


def read_tables(path: Path) -> tuple[RecordKind, Tables]:
    """Return what a record is of, and the tables that its pictures need.

    Raises `RecordError` where it is none, or not as its schema says, and `OSError`.
    """
    with path.open("rb") as file:
        begin = _VERSION.match(file.read(200))
    kind = KINDS.get(begin[1]) if begin else None
    if kind is None:
        message = "is not the record of a run, of a compilation or of a comparison with soundings"
        raise RecordError([Problem(file=str(path), message=message)])
    optional = {table: fields for table, fields in kind.optional.items() if table not in kind.required}
    return kind, read_record(path, kind.required, optional, schema=kind.schema(), what=kind.what)
