"""Columns of coordinates, attitudes and their sigmas in the words of a statement, as a SYS card has them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import CoordinateSystem
from musatpy.reports.columns import Columns, vector
from musatpy.reports.table import Column
from musatpy.statistics import Statistics, Words
from musatpy.units import ARC_SECOND, DEGREE, GON, AngleUnit

Values = Callable[[Statistics], FloatArray]

_SEXAGESIMAL = "D  M  S   "
_HEADING = {AngleUnit.DEGREES: "deg", AngleUnit.GONS: "gon", AngleUnit.RADIANS: "rad"}
_RADIANS = {AngleUnit.DMS: 1.0, AngleUnit.DEGREES: DEGREE, AngleUnit.GONS: GON, AngleUnit.RADIANS: 1.0}
# Edit descriptors, by the decimals that are no less certain than those of metres (see `docs/extending.md`).
_PLACES = {
    AngleUnit.DMS: "S16.5",
    AngleUnit.DEGREES: "F15.9",
    AngleUnit.GONS: "F15.9",
    AngleUnit.RADIANS: "F15.11",
}
_TURNS = {
    AngleUnit.DMS: "S14.3",
    AngleUnit.DEGREES: "F13.7",
    AngleUnit.GONS: "F13.7",
    AngleUnit.RADIANS: "F13.9",
}
_ELEMENT = "F13.9"
_UNIT = 14  # characters of a unit in a heading: `US survey foot`


def place_columns(words: Words, values: Values, decimals: int) -> Columns:
    """Return the columns of coordinates (n, 3), lengths with `decimals`."""
    lengths = tuple(
        Column(f"{_heading(name)}\n{unit[:_UNIT]}", f"F15.{decimals}", _part(values, axis))
        for axis, (name, unit) in enumerate(zip(words.names, words.units, strict=True))
    )
    if not words.angular:
        return lengths
    unit = words.unit
    headings = [f"{_heading(name)}\n{_HEADING.get(unit, _SEXAGESIMAL)}" for name in words.names[:2]]
    return (*vector(headings, (_PLACES[unit],) * 2, values, unit=_RADIANS[unit]), *lengths[2:])


def place_sigma_columns(words: Words, values: Values) -> Columns:
    """Return the columns of sigmas (n, 3), of east, north, up, or of the coordinates: arc seconds where angles."""
    local = words.spec.kind == CoordinateSystem.LOCAL  # its axes are east, north, up by other names
    if not words.of_system and not local:
        return vector(["Sigma East\nm", "Sigma North\nm", "Sigma Up\nm"], ("F9.3",) * 3, values)
    if not words.angular:
        headings = [f"Sigma {name}\n{unit[:_UNIT]}" for name, unit in zip(words.names, words.units, strict=True)]
        return vector(headings, ("F9.3",) * 3, values)
    plane = vector(["Sigma Lat\narc sec", "Sigma Long\narc sec"], ("F9.5",) * 2, values, unit=ARC_SECOND)
    return (*plane, Column("Sigma h\nm", "F9.3", _part(values, 2)))


def attitude_columns(words: Words, values: Values) -> Columns:
    """Return the columns of attitudes (n, 3) rad, in the unit of the statement, or the rows (3n, 3) of matrices."""
    if words.angles is None:
        return vector(["First axis", "Second axis", "Third axis"], (_ELEMENT,) * 3, values)
    unit = words.unit
    headings = [f"{name}\n{_HEADING.get(unit, _SEXAGESIMAL)}" for name in words.angles]
    return vector(headings, (_TURNS[unit],) * 3, values, unit=_RADIANS[unit])


def attitude_sigma_columns(words: Words, values: Values) -> Columns:
    """Return the columns of sigmas (n, 3) rad of angles, in arc seconds, or one column (3n) beside matrices."""
    if words.angles is None:
        return (Column("Sigma\narc sec", "F9.2", lambda s: values(s).ravel() / ARC_SECOND),)
    names = words.angles if words.of_system else ("X-T", "Y-T", "Hdg")
    return vector([f"Sigma {name}\narc sec" for name in names], ("F9.2",) * 3, values, unit=ARC_SECOND)


def turn_columns(words: Words, values: Values, matrices: Values, sigmas: Values) -> Columns:
    """Return the columns of photos with their attitudes and sigmas: a line for each, three of matrices."""
    if words.angles is not None:
        photo: Column[Statistics] = Column("Photo", "A8", lambda s: s.block.photos.ids)
        return (photo, *attitude_columns(words, values), *attitude_sigma_columns(words, sigmas))
    return (
        Column("Photo", "A8", lambda s: np.repeat(s.block.photos.ids, 3)),
        Column("Row", "I3", lambda s: np.tile([1, 2, 3], len(s.block.photos.ids))),
        *attitude_columns(words, lambda s: matrices(s).reshape(-1, 3)),
        *attitude_sigma_columns(words, sigmas),
    )


def map_columns(words: Words) -> Columns:
    """Return the columns of what the map of the answer does at the stations."""
    unit = words.unit
    heading = f"Convergence\n{_HEADING.get(unit, _SEXAGESIMAL)}"
    columns: Columns = (
        Column("Photo", "A8", lambda s: s.block.photos.ids),
        Column(heading, _TURNS[unit], lambda s: _factors(s)[0] / _RADIANS[unit]),
        Column("Scale along\nmeridian", "F11.7", lambda s: _factors(s)[1]),
        Column("Scale along\nparallel", "F11.7", lambda s: _factors(s)[2]),
    )
    if words.statement.system.height_alone:  # no geoid
        return columns
    return (*columns, Column("Geoid\nm", "F9.3", lambda s: s.answer.undulation if s.answer else ()))


def _factors(statistics: Statistics) -> tuple[FloatArray, FloatArray, FloatArray]:
    answer = statistics.answer
    if answer is None or answer.factors is None:
        raise ValueError("the answer is on no map")
    return answer.factors.convergence, answer.factors.meridian_scale, answer.factors.parallel_scale


def _heading(name: str) -> str:
    return name.capitalize() if len(name) > 1 else name  # h above the ellipsoid, H above a geoid


def _part(values: Values, axis: int) -> Callable[[Statistics], FloatArray]:
    return lambda source: values(source)[:, axis]
