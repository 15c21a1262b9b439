"""Apparent points that no camera sees: what is wrong with them, by what would put them below the cameras."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.depth.correction import Correction, CorrectionTally
from musatpy.errors import DepthError, Problem, SystemsError
from musatpy.geometry.crs import LongitudeLatitude
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.projected import Projected
from musatpy.geometry.systems import Geocentric, System
from musatpy.refraction.apparent import Fault, TruePoints
from musatpy.units import FOOT

_ZONE = 6.0  # degrees, of UTM


def attempted(correction: Correction, source: str, apparent: FloatArray) -> tuple[TruePoints, BoolArray] | Problem:
    """Return the true points of apparent ones (n, 3), and (n, k) which cameras see them.

    Or the problem of a file with points that their system does not reach: errors do not leave a process.
    """
    try:
        return correction(apparent)
    except SystemsError as error:
        what = "; ".join(problem.message for problem in error.problems)
        return Problem(
            file=source, message=f"{what}: are the points in this system? {_directions(correction, apparent)}"
        )


def require_sight(correction: Correction, tally: CorrectionTally, source: Path, some: FloatArray) -> None:
    """Raise `DepthError` where there are points, and no camera sees any, with what would let it see `some`."""
    count = int(tally.faults.sum() - tally.faults[Fault.NOT_FINITE])
    if not count or tally.seen:
        return
    message = (
        f"no camera sees any of its {count} points: are they in the system of the job? They were taken as "
        f"{correction.ground.system.text}. {_directions(correction, some)}"
    )
    raise DepthError([Problem(file=str(source), message=message)])


def _directions(correction: Correction, points: FloatArray) -> str:
    """Return in words where the stations are in the system of points (n, 3), and how these would be seen."""
    system = correction.ground.system
    place = ", ".join(
        f"{name} {value:.{min(decimals, 6)}f}"
        for name, value, decimals in zip(system.names, correction.middle.tolist(), system.decimals, strict=True)
    )
    ways = "".join(f". They are seen as {words}" for words in _ways(correction, points))
    return f"The middle of the stations is {place}{ways}"


def _ways(correction: Correction, points: FloatArray) -> Iterator[str]:
    """Yield in words how points would be seen: changed, or in another system."""
    points = points[np.isfinite(points).all(axis=1)]
    changed = {
        "x and y exchanged": points[:, [1, 0, 2]],
        "feet": points * FOOT,
        "heights in feet": points * [1.0, 1.0, FOOT],
        "depths positive down": points * [1.0, 1.0, -1.0],
    }
    for words, others in changed.items():
        if _fits(correction, others):
            yield words
    ellipsoid = correction.ground.system.ellipsoid
    if ellipsoid is not None:
        for words, system in _systems(ellipsoid, correction.ground.system.level(correction.middle[None])):
            if _fits(replace(correction, system=system), points):
                yield words


def _fits(correction: Correction, points: FloatArray) -> bool:
    """Tell whether a camera sees one of the points, which is nearer to the water than the stations are."""
    stations = correction.cameras.stations
    level, height = float(stations.level.mean()), float(stations.heights.mean())
    try:
        placed = correction.ground.placed(points)
    except SystemsError:
        return False
    near = np.abs(placed.upright[:, 2] - level) < height - level
    return bool((correction.cameras.sees(placed.position).any(axis=1) & near).any())


def _systems(ellipsoid: Ellipsoid, middle: FloatArray) -> Iterator[tuple[str, System]]:
    """Yield the systems that files are often in, of the zones of UTM those that the stations may be in."""
    yield "longitude and latitude in degrees", LongitudeLatitude(ellipsoid)
    yield "geocentric coordinates", Geocentric(ellipsoid)
    latitude, longitude = np.degrees(middle[0, :2]).tolist()
    zone = int((longitude + 180.0) // _ZONE) % 60
    for near in (zone - 1, zone, zone + 1):
        for side in ("north", "south"):
            number = near % 60 + 1
            definition = f"+proj=utm +zone={number}{' +south' if side == 'south' else ''} {ellipsoid.definition}"
            if (side == "north") == (latitude >= 0.0) or abs(latitude) < _ZONE:
                yield f'UTM, zone {number} {side} (--crs "{definition}")', Projected(definition, ellipsoid)
