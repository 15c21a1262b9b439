"""Apparent points that are not in their model: what is wrong with them, by what would put them there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.correcting import Correction
from musatpy.errors import CompilationError, Problem, SystemsError
from musatpy.geometry.crs import LongitudeLatitude
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.projected import Projected
from musatpy.geometry.systems import Geocentric, System
from musatpy.units import FOOT

_ZONE = 6.0  # degrees, of UTM


def require_model(correction: Correction, points: FloatArray) -> None:
    """Raise `CompilationError` where none of the points (k, 3) is in the model, with what would put them there."""
    if not len(points):
        raise CompilationError([Problem(message="there is no height in it")])
    try:
        if _near_ground(correction, points):
            return
        why = f"both photos show none of the {len(points)} points, taken as {correction.system.text}"
    except SystemsError as error:
        why = f"the points are taken as {error.problems[0].message}"
    level = correction.stereo.run.frame.level(correction.stereo.origin[None])
    middle = correction.system.coordinates(level)[0]
    place = ", ".join(
        f"{name} {value:.{min(decimals, 6)}f}"
        for name, value, decimals in zip(
            correction.system.names, middle.tolist(), correction.system.decimals, strict=True
        )
    )
    ways = "".join(f". It shows them as {words}" for words in _ways(correction, points, level))
    raise CompilationError([Problem(message=f"{why}; the middle of the model is {place}{ways}")])


def _ways(correction: Correction, points: FloatArray, middle: FloatArray) -> Iterator[str]:
    """Yield in words how points would be in the model: changed, or in another system."""
    changed = {
        "x and y exchanged": points[:, [1, 0, 2]],
        "feet": points * FOOT,
        "heights in feet": points * [1.0, 1.0, FOOT],
        "depths positive down": points * [1.0, 1.0, -1.0],
    }
    for words, others in changed.items():
        if _fits(correction, others):
            yield words
    ellipsoid = correction.system.ellipsoid
    if ellipsoid is not None:
        for words, system in _systems(ellipsoid, middle):
            if _fits(replace(correction, system=system), points):
                yield words


def _near_ground(correction: Correction, points: FloatArray) -> bool:
    """Tell whether both photos show one of the points, nearer to the origin in height than the stations are.

    Raises `SystemsError` where the system does not reach.
    """
    stereo, frame = correction.stereo, correction.stereo.run.frame
    height = frame.height(frame.from_level(correction.system.level(points)))
    near = np.abs(height - frame.height(stereo.origin[None])) < stereo.height
    return bool((correction.shows(points) & near).any())


def _fits(correction: Correction, points: FloatArray) -> bool:
    try:
        return _near_ground(correction, points)
    except SystemsError:
        return False


def _systems(ellipsoid: Ellipsoid, middle: FloatArray) -> Iterator[tuple[str, System]]:
    """Yield the systems that files are often in, of the zones of UTM those that the model may be in."""
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
