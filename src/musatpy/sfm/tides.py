"""The water level at exposures: readings of a gauge, interpolated in time, or one level that is given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.errors import Problem
from musatpy.formats.job_folder import read_job
from musatpy.geometry.projected import Geoid
from musatpy.model import ObservationKind, Solution
from musatpy.pointfiles.columns import number
from musatpy.pointfiles.gauges import GAP, Tide
from musatpy.sfm.model import ModelError, links, refused
from musatpy.sfm.wet import LIMIT


@dataclass(frozen=True, kw_only=True, eq=False)
class PhotoLevels:
    """The water at n exposures, as the tables of a block have it."""

    level: FloatArray  # (n,) m
    sigma: FloatArray  # (n,) m
    group: TextArray  # (n,) photos with a common error: flights
    tide: Tide | None = None  # from which they are, its levels as those of the photos

    def kept(self, time: FloatArray) -> dict[str, Any]:
        """Return what is kept of a tide in a job folder, with the mean times of flights by those of photos (n,)."""
        if self.tide is None:
            return {}
        names, number = np.unique(self.group, return_inverse=True)
        return {
            "tide": np.column_stack([self.tide.time, self.tide.level, self.tide.sigma]),
            "flights": names,
            "flight_times": np.bincount(number, time) / np.bincount(number),
        }


def datum_heights(statement: str, position: FloatArray) -> FloatArray:
    """Return the heights (n,) m of the zero of a tide at positions (n, 3), latitude and longitude in radians.

    The statement is one height, or a grid of heights above the ellipsoid that PROJ reads. Raises `ModelError` for
    what is neither, `SystemsError` for a grid that is none or does not reach a position.
    """
    height = number(statement)
    if np.isfinite(height):
        return np.full(len(position), height)
    if not Path(statement).suffix:
        message = f"the datum '{statement}' is neither a height in metres nor a grid of heights (.gtx, .tif)"
        raise ModelError.of(message)
    return Geoid(statement).reached(position)


def tide_levels(tide: Tide, photos: Sequence[str], time: FloatArray, datum: FloatArray) -> PhotoLevels:
    """Return the levels at n exposures; `datum` (n,) m is the height of the tide's zero.

    Raises `ModelError` that names every photo beyond the readings or in a gap of them.
    """
    level, sigma = tide.at(time)
    lost = np.flatnonzero(np.isnan(level)).tolist()
    refused([Problem(file=tide.file, message=f"photo {photos[row]}, {tide.lacking(time[row])}") for row in lost])
    tide = replace(tide, level=tide.level + datum.mean())
    return PhotoLevels(level=level + datum, sigma=sigma, group=flights(time), tide=tide)


def given_levels(level: float, sigma: float, time: FloatArray) -> PhotoLevels:
    """Return one level and its sigma (m) at n exposures; those without times (NaN) are one flight."""
    count = len(time)
    return PhotoLevels(level=np.full(count, level), sigma=np.full(count, sigma), group=flights(time))


def flights(time: FloatArray, gap: float = GAP) -> TextArray:
    """Return the flight (n,) of each exposure: FLIGHT1, ... by time, another one after each gap (s)."""
    order = np.argsort(time, kind="stable")
    numbers = np.empty(len(time), dtype=np.int64)
    numbers[order] = 1 + np.cumsum(np.diff(time[order], prepend=time[order][:1]) > gap)
    return np.array([f"FLIGHT{flight}" for flight in numbers.tolist()], dtype=np.str_)


def fitting_hours(tide: Tide, time: FloatArray, level: FloatArray, sigma: FloatArray) -> list[int]:
    """Return the whole hours, -14 to 14, by which a tide must be later to fit levels at k times, the least first.

    `sigma` (k,) m is that of each level. Within three sigmas all fit; none where they do as it is.
    """
    hours = sorted(range(-14, 15), key=lambda hour: (abs(hour), hour))
    fitting = []
    for hour in hours:
        at, doubt = tide.at(time + 3600.0 * hour)
        if (np.abs(level - at) <= LIMIT * np.hypot(sigma, doubt)).all():
            fitting.append(hour)
    return [] if 0 in fitting else fitting


def clock_note(job: Path, solution: Solution) -> str:
    """Return which clock may be in a wrong zone by the adjusted levels of an imported job; empty where none may."""
    of, water = solution.observed, solution.water
    if of is None or water is None:
        return ""
    rows = np.flatnonzero((of.kind == ObservationKind.WATER_LEVEL) & (of.redundancy > 0.0))
    share = of.redundancy[rows]
    error, sigma = -of.residual[rows] / share, of.sigma[rows] / np.sqrt(share)  # what images alone say
    source = read_job(job).source if (np.abs(error) > LIMIT * sigma).any() else {}
    if "tide" not in source:
        return ""
    flight, known = links(water.correction_ids[of.row[rows]].tolist(), source["flights"].tolist())
    time, level, reading = source["tide"].T
    tide, at = Tide(file=str(job), time=time, level=level, sigma=reading), source["flight_times"][flight]
    hours = fitting_hours(tide, at, tide.at(at)[0] - error, sigma) if known.all() else []
    if not hours:
        return ""
    fitting = ", ".join(f"{hour:+d}" for hour in hours)
    return f"the water level of the images is that of the tide {fitting} hours off: is the zone of a clock wrong?"
