"""Columns that several listings share: positions in the job's system, attitudes, sigmas, names."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from musatpy.arrays import FloatArray
from musatpy.model import CoordinateSystem
from musatpy.reports.table import Choice, Column
from musatpy.statistics import Statistics, metric_components

Columns = tuple[Column[Statistics], ...]
Values = Callable[[Statistics], FloatArray]

_GEOGRAPHIC = ("Latitude\nD  M  S    ", "Longitude\nD  M  S    ", "Elevation\nm")
_METRIC = (("East", "North", "Up"), ("X", "Y", "Z"))


def vector(
    headings: Sequence[str],
    edits: Sequence[str],
    values: Values | None = None,
    *,
    unit: float = 1.0,
    shows: str = "",
) -> Columns:
    """Return one column per component of `values` (n, k), each divided by `unit`, or of a field of the record."""

    def component(axis: int) -> Values | None:
        return None if values is None else lambda source: values(source)[:, axis] / unit

    return tuple(
        Column(heading, edit, component(axis), shows and f"{shows}[{axis}]")
        for axis, (heading, edit) in enumerate(zip(headings, edits, strict=True))
    )


def is_geographic(statistics: Statistics) -> bool:
    """Tell whether the positions of the job are latitude, longitude and elevation."""
    return statistics.block.options.system is CoordinateSystem.GEOGRAPHIC


def position_columns(shows: str, decimals: int, values: Values | None = None) -> Choice[Statistics]:
    """Return the columns of positions (n, 3) in the job's system, metres with `decimals`."""
    angular = vector(_GEOGRAPHIC, ("S16.5", "S16.5", f"F11.{decimals}"), values, shows=shows)
    plane = vector(("X\nm", "Y\nm", "Z\nm"), (f"F15.{decimals}",) * 3, values, shows=shows)
    metric = (CoordinateSystem.LOCAL, CoordinateSystem.GEOCENTRIC)
    return Choice((angular, plane), lambda s: angular if is_geographic(s) else plane, metric)


def attitude_columns(shows: str, decimals: int) -> Columns:
    """Return the columns of attitudes (n, 3) rad, in degrees, minutes and seconds."""
    headings = ("X-Tilt\nD  M  S   ", "Y-Tilt\nD  M  S   ", "Heading\nD  M  S   ")
    return vector(headings, (f"S{11 + decimals}.{decimals}",) * 3, shows=shows)


def metric_columns(
    shows: str, label: str = "", values: Values | None = None, *, edit: str = "F9.3", unit: str = "m"
) -> Choice[Statistics]:
    """Return the columns of what is along east, north, up (X, Y, Z in local jobs), behind a label, in metres."""

    def component(names: tuple[str, str, str], axis: int) -> Column[Statistics]:
        heading = f"{label}{names[axis]}" + (f"\n{unit}" if unit else "")
        return Column(heading, edit, None if values is None else lambda s: values(s)[:, axis], f"{shows}[{axis}]")

    enu, xyz = (tuple(component(names, axis) for axis in range(3)) for names in _METRIC)
    return Choice(
        (enu, xyz),
        lambda s: xyz if tuple(metric_components(s.block)) == _METRIC[1] else enu,
        (CoordinateSystem.LOCAL,),
    )


def attitude_sigma_columns(shows: str) -> Columns:
    """Return the columns of attitude sigmas (n, 3) rad, in arc seconds."""
    headings = ("Sigma X-T\narc sec", "Sigma Y-T\narc sec", "Sigma Hdg\narc sec")
    return vector(headings, ("F9.2",) * 3, shows=shows)
