"""What the columns of tables of points, stations and lines are called, and what may stand in them."""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Literal

import numpy as np

from musatpy.arrays import FloatArray

FAR = 1e15  # m, and whatever else files of points and stations hold
ABOVE_ZERO = 1.0 / FAR  # the least number that is not read as zero
AXES, PLAN, LON_LAT = ("x", "y", "z"), ("x", "y"), ("lon", "lat")
_ALIKE = (  # names of one quantity, in lower case
    ("id", "name", "label", "point"),
    ("x", "easting", "east", "x/easting", "x/east"),
    ("y", "northing", "north", "y/northing", "y/north"),
    ("lon", "longitude", "long", "x/longitude"),
    ("lat", "latitude", "y/latitude"),
    ("z", "height", "elevation", "altitude", "z/altitude"),
    ("t", "time"),
)
_OTHER_NAMES = {name: alike for alike in _ALIKE for name in alike}
_UNIT = re.compile(r"(.*\S)\s*(?:\[([^][]*)\]|\(([^()]*)\))")  # behind a name
_UNITS = {"metre": "m", "metres": "m", "meter": "m", "meters": "m", "degree": "deg", "degrees": "deg", "°": "deg"}


def number(text: str) -> float:
    """Return the number that a text is, infinite or not; NaN where it is none.

    Python takes 1_000 for a number, and digits of any script: here only what other programs read is one. What is
    farther than `FAR` is as good as infinite, and what is smaller than its inverse is zero: their squares and
    products would be, in the middle of a computation.
    """
    try:
        value = float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        return math.nan
    if abs(value) > FAR:
        return math.copysign(math.inf, value)
    return 0.0 if abs(value) < ABOVE_ZERO else value


def numbers(texts: Sequence[str]) -> FloatArray:
    """Return `number` of each text."""
    return np.array([number(text) for text in texts])


def parted(heading: str) -> tuple[str, str]:
    """Return the name and the unit in brackets, '' for none, of what stands above a column."""
    both = _UNIT.fullmatch(heading.strip())
    return (both[1], (both[2] or both[3] or "").strip()) if both else (heading.strip(), "")


@dataclass(frozen=True, kw_only=True)
class FileColumn:
    """What a column is called, and what may stand in it."""

    name: str
    aliases: tuple[str, ...] | None = None  # None: all other names of what it is
    unit: str = ""  # of its numbers; a file that states another one in brackets is refused
    kind: Literal["number", "text", "date"] = "number"
    required: bool = True
    blank: bool = False  # whether a cell may be empty (or nan, or -): NaN, '' or no day
    unique: bool = False
    several: bool = False  # the first of several columns counts
    least: float = -FAR
    most: float = FAR
    expected: str = "a number"

    @property
    def other_names(self) -> tuple[str, ...]:
        """The names by which it goes where no column has its own."""
        return _OTHER_NAMES.get(self.name, ()) if self.aliases is None else self.aliases

    def wrong(self, texts: Sequence[str], values: FloatArray | None = None) -> list[int]:
        """Return which of some texts cannot stand in it, by their `values` (n,) where it is one of numbers."""
        if values is not None:
            off = np.flatnonzero(~((values >= self.least) & (values <= self.most))).tolist()
            return [row for row in off if not (self.blank and texts[row].lower() in ("", "nan", "-"))]
        return [row for row, text in enumerate(texts) if not (self._is_text(text) if text else self.blank)]

    def _is_text(self, text: str) -> bool:
        try:
            return self.kind == "text" or bool(datetime.date.fromisoformat(text))
        except ValueError:
            return False


SIGMA = FileColumn(
    name="sigma", unit="m", required=False, blank=True, least=0.0, expected="a number of 0 or more, or nothing"
)


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """The columns that a table must or may have; other ones are left alone, unless it is `closed`."""

    columns: tuple[FileColumn, ...]
    forms: tuple[tuple[str, ...], ...] = ()  # a table has the columns of one of them, the first that is complete
    together: tuple[tuple[str, ...], ...] = ()  # all of these columns, or none
    bare: tuple[str, ...] = ()  # the first columns of a table without names; empty: it must have them
    added: tuple[str, ...] = ()  # columns that it gets, and does not have yet
    closed: bool = False

    def places(self, headings: Sequence[str]) -> dict[str, list[int]]:
        """Return where columns stand among headings: by their own names, else by others that no column has yet."""
        names = [parted(heading)[0].lower() for heading in headings]
        places = {
            column.name: [k for k, name in enumerate(names) if name == column.name] for column in self.columns
        }
        taken = set(chain(*places.values()))
        for column in self.columns:
            if not places[column.name]:
                alike = [k for k, name in enumerate(names) if name in column.other_names and k not in taken]
                places[column.name] = alike
                taken.update(alike)
        return {name: at for name, at in places.items() if at}

    def read(self, headings: Sequence[str]) -> dict[int, FileColumn]:
        """Return the columns that are read, by their places: not those of other forms than the table has."""
        places = self.places(headings)
        others = {*chain(*self.forms)} - {*(self._form(places) or ())}
        return {places[c.name][0]: c for c in self.columns if c.name in places and c.name not in others}

    def are_named(self, headings: Sequence[str]) -> bool:
        """Tell whether all columns that must be there are among headings."""
        places = self.places(headings)
        return bool(places) and self._form(places) is not None and not self._missing(places)

    def _form(self, places: Mapping[str, Sequence[int]]) -> tuple[str, ...] | None:
        return next((form for form in self.forms or ((),) if {*form} <= places.keys()), None)

    def _missing(self, places: Mapping[str, Sequence[int]]) -> list[FileColumn]:
        needed = [column for column in self.columns if column.required and column.name not in chain(*self.forms)]
        return [column for column in needed if column.name not in places]

    def faults(self, headings: Sequence[str]) -> Iterator[str]:
        """Yield what is wrong with the names of a table, and their units."""
        if not headings:
            yield "no line of names or values"
            return
        names, units = zip(*map(parted, headings), strict=True)
        places, among = self.places(headings), f"among {', '.join(names)}"
        for column in self._missing(places):
            yield f"no column {column.name}{f' [{column.unit}]' * bool(column.unit)} {among}"
        for column in self.columns:
            at = places.get(column.name, [])
            unit = _UNITS.get(units[at[0]].lower(), units[at[0]].lower()) if at else ""
            if len(at) > 1 and not column.several:
                yield f"more than one column {column.name} {among}"
            elif unit and column.unit and unit != column.unit:
                yield f"column {names[at[0]]} is in {unit}: {column.unit} is needed"
        yield from (f"there is a column {name} already" for name in names if name.lower() in self.added)
        for group in self.together:
            given = [name for name in group if name in places]
            if 0 < len(given) < len(group):
                yield f"{', '.join(group)} go together: only {', '.join(given)} found"
        form = self._form(places)
        if form is None:
            least = [form for form in self.forms if not any({*other} < {*form} for other in self.forms)]
            yield f"no columns {' or '.join(map(', '.join, least))} {among}"
        for other in self.forms:
            if form is not None and {*other} <= places.keys() and not {*other} <= {*form}:
                parts = ([name for name in one if name not in two] for one, two in ((form, other), (other, form)))
                yield f"columns {' and '.join(map(', '.join, parts))}: one is meant"
        if self.closed:
            known = {*chain(*places.values())}
            yield from (f"unknown column {name}" for place, name in enumerate(names) if name and place not in known)


def place_columns(
    names: Sequence[str] = AXES, units: Sequence[str] = ("m", "m", "m"), *, blank: bool = False
) -> tuple[FileColumn, ...]:
    """Return the columns of three coordinates; x, y and z go by all their names in their units, by others alone.

    Places in degrees are longitudes and latitudes, those in metres eastings and northings, in no unit either.
    Where they may be `blank` they may be infinite: such a point has a reason.
    """
    columns = []
    for name, axis, angle, stated in zip(names, AXES, (*LON_LAT, "z"), units, strict=True):
        unit = _UNITS.get(stated, stated)
        aliases = _OTHER_NAMES[axis] * (unit != "deg") + _OTHER_NAMES[angle] * (unit != "m")
        most = math.inf if blank else FAR
        columns.append(
            FileColumn(
                name=name.lower(),
                aliases=aliases * (name == axis),
                unit=unit if unit in ("m", "deg") else "",
                blank=blank,
                least=-most,
                most=most,
            )
        )
    return tuple(columns)


MAP_PLACES = (  # degrees, or else x and y of a map
    *(
        FileColumn(name=name, unit="deg", least=-most, most=most, expected=f"{-most:g} to {most:g} degrees")
        for name, most in (("lat", 90.0), ("lon", 360.0))
    ),
    *(FileColumn(name=name, unit="m") for name in PLAN),
)
