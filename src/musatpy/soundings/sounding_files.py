"""Soundings from a LAS file, or from a table.

Places are `lat` and `lon` (degrees), or `x` and `y` (m); the value is `depth`, positive down, or `height`; `sigma`
of it, `name` and `date` may be given.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import DateArray, FloatArray, TextArray
from musatpy.errors import Problem, SoundingError, SystemsError
from musatpy.geometry.crs import system_of
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.projected import crs_of
from musatpy.interchange import las
from musatpy.pointfiles.columns import LON_LAT, MAP_PLACES, PLAN, SIGMA, FileColumn, Wanted
from musatpy.pointfiles.las_files import SUFFIXES
from musatpy.pointfiles.point_tables import read_table
from musatpy.units import DEGREE

if TYPE_CHECKING:
    import pyproj

FORMS = tuple((*plan, value) for plan in (LON_LAT, PLAN) for value in ("depth", "height"))
VALUES = tuple(FileColumn(name=name, unit="m") for name in ("depth", "height"))
_DATE = "date"
NO_DATES = "no column date, by which soundings could be left out"
_COLUMNS = (*MAP_PLACES, *VALUES, SIGMA, FileColumn(name="name", kind="text", required=False, blank=True))
_DATES = FileColumn(name=_DATE, kind="date", blank=True, expected="a date YYYY-MM-DD")


@dataclass(frozen=True, kw_only=True, eq=False)
class Soundings:
    """n soundings: place (n, 2), latitude and longitude (rad) where `angular`, else m; depth (n,) m, positive down.

    sigma (n,) m of the depth, NaN where the file gives none, date (n,) NaT where it gives none. Values that are
    heights have the opposite sign here. crs: the system that the file says, None for none.
    """

    names: TextArray
    place: FloatArray
    angular: bool
    depth: FloatArray
    sigma: FloatArray
    date: DateArray
    crs: pyproj.CRS | None = None


def read_soundings(source: Path, job: Ellipsoid | None = None, *, crs: str = "", dated: bool = False) -> Soundings:
    """Return the soundings of a file, places in the coordinates of a job: None for those of a local one.

    `crs` is the system of x and y that a file does not say, `dated` asks for dates. Raises `SoundingError` with
    every line that cannot be used, `InterchangeError` for a LAS file that cannot, and `OSError`.
    """
    soundings = _of_las(source, dated) if source.suffix.lower() in SUFFIXES else _of_table(source, dated)
    system = soundings.crs or (crs_of(crs) if crs else None)
    if soundings.angular or system is None:
        return soundings
    return replace(soundings, place=job_places(source, soundings.place, system, job), angular=True)


def _of_las(source: Path, dated: bool) -> Soundings:
    """Return the points of a LAS file: depths by their extra bytes `depth`, or else heights."""
    points = las.read(source)
    if dated:
        raise SoundingError.of(NO_DATES, file=source)
    columns = {name.lower(): column.values.astype(float) for name, column in points.columns.items()}
    depth = columns.get("depth", -points.xyz[:, 2])
    lost = np.flatnonzero(~np.isfinite(depth))
    if len(lost):
        raise SoundingError.of(f"{len(lost)} points have no depth, point {lost[0] + 1} first", file=source)
    return Soundings(
        names=np.arange(1, len(depth) + 1).astype(np.str_),
        place=points.xyz[:, :2],
        angular=False,
        depth=depth,
        sigma=columns.get("sigma", np.full(len(depth), np.nan)),
        date=np.full(len(depth), "NaT", dtype="datetime64[D]"),
        crs=points.crs,
    )


def _of_table(source: Path, dated: bool) -> Soundings:
    """Return the soundings of a table."""
    table = read_table(source, Wanted(columns=_COLUMNS + (_DATES,) * dated, forms=FORMS))
    table.require(SoundingError, empty="no sounding")
    angular, lines = table.has("lat"), [str(line) for line in table.lines]
    return Soundings(
        names=np.array(table.texts("name") if table.has("name") else lines, dtype=np.str_),
        place=table.numbers("lat", "lon") * DEGREE if angular else table.numbers(*PLAN),
        angular=angular,
        depth=table.numbers("depth") if table.has("depth") else -table.numbers("height"),
        sigma=table.numbers("sigma"),
        date=table.dates(_DATE) if dated else np.full(len(lines), "NaT", dtype="datetime64[D]"),
    )


def job_places(source: Path, xy: FloatArray, crs: pyproj.CRS | None, job: Ellipsoid | None) -> FloatArray:
    """Return places (n, 2) of xy (n, 2) in a system: latitude and longitude (rad) by the ellipsoid of a job.

    Those of a local job (`job` None) are x and y themselves. Raises `SoundingError` where one of the two is local
    and the other is not, and where the system stands on another ellipsoid.
    """
    if job is None and crs is not None:
        raise SoundingError.of(f"it is in the system {crs.name}, and the job in a local one", file=source)
    if job is None:
        return xy
    if crs is None:
        raise SoundingError.of("no coordinate system is given: name it (--crs EPSG:32620)", file=source)
    plane = crs.sub_crs_list[0] if crs.is_compound else crs
    try:
        level = system_of(plane.to_wkt(), job).level(np.column_stack([xy, np.zeros(len(xy))]))
    except SystemsError as error:
        raise SoundingError(
            [Problem(file=str(source), message=problem.message) for problem in error.problems]
        ) from error
    return level[:, :2]
