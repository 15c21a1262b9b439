"""Columns of coordinates, attitudes and their sigmas in the words of a statement, as a SYS card has them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import CoordinateSystem
from musatpy.reports.editing import printed_unit
from musatpy.reports.fields import Field
from musatpy.statistics import Statistics, Words
from musatpy.units import ARC_SECOND, DEGREE, GON, AngleUnit

Values = Callable[[Statistics], FloatArray]
Columns = tuple[Field[Statistics], ...]

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


def of_job(heading: str, edit: str, values: Callable[[Any], Any]) -> Field[Any]:
    """Return a column of what no table of the record has: `values` of the statistics of a job."""
    return Field(heading, heading=heading, edit=edit, shown=lambda t: values(getattr(t, "source", t)), of_run=True)


def _vector(headings: Sequence[str], edits: Sequence[str], values: Values, units: Sequence[float]) -> Columns:
    """Return one column for each component of `values` (n, k), printed in these units."""

    def component(axis: int, heading: str) -> Callable[[Statistics], FloatArray]:
        unit = units[axis] / printed_unit(heading)
        return lambda s: values(s)[:, axis] / unit

    return tuple(
        of_job(heading, edit, component(axis, heading))
        for axis, (heading, edit) in enumerate(zip(headings, edits, strict=True))
    )


def place_columns(words: Words, values: Values, decimals: int) -> Columns:
    """Return the columns of coordinates (n, 3), lengths with `decimals`."""
    headings = [f"{_heading(name)}\n{unit[:_UNIT]}" for name, unit in zip(words.names, words.units, strict=True)]
    edits, units, unit = [f"F15.{decimals}"] * 3, [1.0] * 3, words.unit
    if words.angular:
        headings[:2] = [f"{_heading(name)}\n{_HEADING.get(unit, _SEXAGESIMAL)}" for name in words.names[:2]]
        edits[:2], units[:2] = [_PLACES[unit]] * 2, [_RADIANS[unit]] * 2
    return _vector(headings, edits, values, units)


def place_sigma_columns(words: Words, values: Values) -> Columns:
    """Return the columns of sigmas (n, 3), of east, north, up, or of the coordinates: arc seconds where angles."""
    local = words.spec.kind == CoordinateSystem.LOCAL  # its axes are east, north, up by other names
    edits, units = ["F9.3"] * 3, [1.0] * 3
    if not words.of_system and not local:
        headings = ["Sigma East\nm", "Sigma North\nm", "Sigma Up\nm"]
    elif not words.angular:
        headings = [f"Sigma {name}\n{unit[:_UNIT]}" for name, unit in zip(words.names, words.units, strict=True)]
    else:
        headings = ["Sigma Lat\narc sec", "Sigma Long\narc sec", "Sigma h\nm"]
        edits[:2], units[:2] = ["F9.5"] * 2, [ARC_SECOND] * 2
    return _vector(headings, edits, values, units)


def turn_columns(words: Words, values: Values, matrices: Values, sigmas: Values) -> Columns:
    """Return the columns of photos with their attitudes and sigmas: a line for each, three of matrices.

    Attitudes (n, 3) rad are in the unit of the statement, matrices (n, 3, 3), sigmas (n, 3) rad in arc seconds.
    """
    if words.angles is not None:
        unit, names = words.unit, words.angles if words.of_system else ("X-T", "Y-T", "Hdg")
        headings = [f"{name}\n{_HEADING.get(unit, _SEXAGESIMAL)}" for name in words.angles]
        sigma_headings = [f"Sigma {name}\narc sec" for name in names]
        return (
            of_job("Photo", "A8", lambda s: s.block.photos.ids),
            *_vector(headings, (_TURNS[unit],) * 3, values, (_RADIANS[unit],) * 3),
            *_vector(sigma_headings, ("F9.2",) * 3, sigmas, (ARC_SECOND,) * 3),
        )
    axes = ("First axis", "Second axis", "Third axis")
    return (
        of_job("Photo", "A8", lambda s: np.repeat(s.block.photos.ids, 3)),
        of_job("Row", "I3", lambda s: np.tile([1, 2, 3], len(s.block.photos.ids))),
        *_vector(axes, (_ELEMENT,) * 3, lambda s: matrices(s).reshape(-1, 3), (1.0,) * 3),
        of_job("Sigma\narc sec", "F9.2", lambda s: sigmas(s).ravel()),
    )


def map_columns(words: Words) -> Columns:
    """Return the columns of what the map of the answer does at the stations."""
    unit = words.unit
    heading = f"Convergence\n{_HEADING.get(unit, _SEXAGESIMAL)}"
    columns: Columns = (
        of_job("Photo", "A8", lambda s: s.block.photos.ids),
        *_vector([heading], [_TURNS[unit]], lambda s: _factors(s)[0][:, None], [_RADIANS[unit]]),
        of_job("Scale along\nmeridian", "F11.7", lambda s: _factors(s)[1]),
        of_job("Scale along\nparallel", "F11.7", lambda s: _factors(s)[2]),
    )
    if words.statement.system.height_alone:  # no geoid
        return columns
    return (*columns, of_job("Geoid\nm", "F9.3", lambda s: s.answer.undulation if s.answer else ()))


def _factors(statistics: Statistics) -> tuple[FloatArray, FloatArray, FloatArray]:
    answer = statistics.answer
    if answer is None or answer.factors is None:
        raise ValueError("the answer is on no map")
    return answer.factors.convergence, answer.factors.meridian_scale, answer.factors.parallel_scale


def _heading(name: str) -> str:
    return name.capitalize() if len(name) > 1 else name  # h above the ellipsoid, H above a geoid
