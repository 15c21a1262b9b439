"""Places of another source in the coordinates of a job."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyproj

from musatpy.arrays import FloatArray
from musatpy.errors import Problem, SoundingError, SystemsError
from musatpy.geometry.crs import system_of
from musatpy.geometry.geodesy import Ellipsoid


def job_places(source: Path, xy: FloatArray, crs: pyproj.CRS | None, job: Ellipsoid | None) -> FloatArray:
    """Return places (n, 2) of xy (n, 2) in a system: latitude and longitude (rad) by the ellipsoid of a job.

    Those of a local job (`job` None) are x and y themselves. Raises `SoundingError` where one of the two is local
    and the other is not, and where the system stands on another ellipsoid.
    """
    if job is None and crs is not None:
        raise _refused(source, f"it is in the system {crs.name}, and the job in a local one")
    if job is None:
        return xy
    if crs is None:
        raise _refused(source, "no coordinate system is given: name it (--crs EPSG:32620)")
    plane = crs.sub_crs_list[0] if crs.is_compound else crs
    try:
        level = system_of(plane.to_wkt(), job).level(np.column_stack([xy, np.zeros(len(xy))]))
    except SystemsError as error:
        raise SoundingError(
            [Problem(file=str(source), message=problem.message) for problem in error.problems]
        ) from error
    return level[:, :2]


def _refused(source: Path, message: str) -> SoundingError:
    return SoundingError([Problem(file=str(source), message=message)])
