"""What no answer can be: gates of the verdict that need no statistics, only physics.

Each yields its reasons. What the cards of a deck themselves put there (a camera that looks up, a point above its
camera) is no reason.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model import (
    Concern,
    Grade,
    Initial,
    PointStatus,
    Reason,
    Treatment,
)
from musatpy.model.water import index_range
from musatpy.statistics.analyses import elevations, rectangular

if TYPE_CHECKING:
    from musatpy.statistics.analyses import Statistics

FARTHEST = 100.0  # flying heights
PART_OF_FORMAT = 0.1  # of a plate, that no residual of a measurement in the solution reaches
_NAMED = 5  # photos or points by name, the others by their number
_STATIONS, _POINTS = "Adjusted Exposure Stations", "Adjusted Ground Points"


def gates(statistics: Statistics) -> Iterator[Reason]:
    """Yield every physical reason to reject a solution."""
    yield from not_finite(statistics)
    yield from stations(statistics)
    yield from far_points(statistics)
    yield from index(statistics)
    yield from residuals(statistics)


def not_finite(statistics: Statistics) -> Iterator[Reason]:
    """Yield what has no finite number: sigma0, stations, points, their covariances."""
    solution, block = statistics.solution, statistics.block
    if not np.isfinite(solution.sigma0):
        yield _rejected(Concern.FINITE, "sigma0 is not finite", "Solution Summary")
    busy = np.zeros(len(block.photos.ids), dtype=bool)
    busy[block.plates.photo[solution.plates.triangulated]] = True
    placed = solution.points.status != PointStatus.NOT_DETERMINED
    for what, names, values, covariances, rows, section in (
        (
            "photo",
            block.photos.ids,
            np.hstack([solution.stations.position, solution.stations.attitude]),
            solution.stations.covariance,
            busy,
            _STATIONS,
        ),
        ("point", block.points.ids, solution.points.position, solution.points.covariance, placed, _POINTS),
    ):
        lost = np.flatnonzero(rows & ~np.isfinite(values).all(axis=1))
        if len(lost):
            yield _rejected(Concern.FINITE, f"{named(what, names[lost])}: no finite coordinates", section)
        variances = np.diagonal(covariances, axis1=1, axis2=2)
        with np.errstate(invalid="ignore"):
            wild = ~(np.isfinite(variances) & (variances >= 0.0)).all(axis=1)
        unsure = np.flatnonzero(rows & wild & np.isfinite(values).all(axis=1))
        if len(unsure):
            yield _rejected(Concern.FINITE, f"{named(what, names[unsure])}: no finite sigmas", section)


def stations(statistics: Statistics) -> Iterator[Reason]:
    """Yield the cameras below their water or their ground, or looking up, where no card puts them so."""
    solution, photos = statistics.solution, statistics.block.photos
    height = elevations(statistics.block, solution.stations.position)
    given_height = np.full(len(height), np.nan)
    given_attitude = np.full((len(height), 3), np.nan)
    if statistics.block.options.initial is not Initial.COMPUTE:
        given_height = elevations(statistics.block, photos.position)
        given_attitude = photos.attitude
    water = photos.tide if solution.water is None else solution.water.tide
    sees_water = np.zeros(len(height), dtype=bool)
    plates = statistics.block.plates
    sees_water[plates.photo[statistics.submerged_plates & solution.plates.triangulated]] = True
    ground = ground_heights(statistics)
    with np.errstate(invalid="ignore"):
        drowned = sees_water & (height <= water)
        buried = (height < ground) & ~(given_height < ground)
        upwards = _looks_up(solution.stations.attitude) & ~_looks_up(given_attitude)
    for what, rows in (("below the water", drowned), ("below its ground", buried), ("looking up", upwards)):
        if rows.any():
            text = f"{named('photo', photos.ids[rows])}: camera {what}"
            yield _rejected(Concern.STATION, text, _STATIONS)


def far_points(statistics: Statistics) -> Iterator[Reason]:
    """Yield the points farther from every camera that sees them than `FARTHEST` flying heights."""
    rays, height = ray_lengths(statistics), flying_height(statistics)
    plates, points = statistics.block.plates, statistics.block.points
    nearest = np.full(len(points.ids), np.inf)
    with np.errstate(invalid="ignore"):
        np.fmin.at(nearest, plates.point, rays)
        far = np.flatnonzero(np.isfinite(nearest) & (nearest > FARTHEST * height))
    if len(far):
        largest = float(nearest[far].max())
        text = f"{named('point', points.ids[far])}: {largest:.2g} m from the cameras, which fly {height:.0f} m high"
        yield _rejected(Concern.DISTANCE, text, _POINTS)


def index(statistics: Statistics) -> Iterator[Reason]:
    """Yield an adjusted refractive index at the ends of its physical range, or outside."""
    water, given = statistics.solution.water, statistics.block.water
    if water is None or given is None or statistics.block.options.water_index is not Treatment.ADJUST:
        return
    low, high = index_range(given.liquid)
    if not low < water.index < high:
        text = f"the adjusted refractive index {water.index:.4f} is not between {low:g} and {high:g}"
        yield _rejected(Concern.INDEX, text, "Water: Surface And Index")


def residuals(statistics: Statistics) -> Iterator[Reason]:
    """Yield measurements in the solution whose residual is more than `PART_OF_FORMAT` of the plate."""
    block, residual = statistics.block, np.abs(statistics.solution.plates.residual)
    size = np.nanmin(_formats(statistics), axis=1)[block.photos.camera[block.plates.photo]]
    with np.errstate(invalid="ignore"):
        rows = np.flatnonzero(
            statistics.solution.plates.triangulated & (residual.max(axis=1) > PART_OF_FORMAT * size)
        )
    if len(rows):
        plates = block.plates
        names = [
            f"{block.photos.ids[photo]} point {block.points.ids[point]}"
            for photo, point in zip(plates.photo[rows].tolist(), plates.point[rows].tolist(), strict=True)
        ]
        largest = float(residual[rows].max())
        text = f"{named('photo', names)}: residuals up to {largest:.1f} mm"
        yield _rejected(Concern.FORMAT, text, "Plate Residuals")


def named(noun: str, names: Iterable[object]) -> str:
    """Return `photos 1, 2, 3`: a few by name, the others by their number."""
    texts = [str(name) for name in names]
    if len(texts) == 1:
        return f"{noun} {texts[0]}"
    more = f" and {len(texts) - _NAMED} more" if len(texts) > _NAMED else ""
    return f"{noun}s {', '.join(texts[:_NAMED])}{more}"


def ray_lengths(statistics: Statistics) -> FloatArray:
    """Return the distances (m,) m from camera to point of every measurement; NaN where one has no position."""
    block, solution = statistics.block, statistics.solution
    stations = rectangular(block, solution.stations.position)[block.plates.photo]
    points = rectangular(block, solution.points.position)[block.plates.point]
    with np.errstate(invalid="ignore", over="ignore"):
        return np.linalg.norm(points - stations, axis=1)


def flying_height(statistics: Statistics) -> float:
    """Return the median distance (m) from the cameras to the points of the solution."""
    rays = ray_lengths(statistics)[statistics.solution.plates.triangulated]
    rays = rays[np.isfinite(rays)]
    return float(np.median(rays)) if len(rays) else float("nan")


def ground_heights(statistics: Statistics) -> FloatArray:
    """Return the median height (n,) m of the points that each photo shows; NaN where it shows none."""
    block, solution = statistics.block, statistics.solution
    height = elevations(block, solution.points.position)[block.plates.point]
    known = solution.plates.triangulated & np.isfinite(height)
    return _medians(block.plates.photo[known], height[known], len(block.photos.ids))


def _medians(group: IntArray, value: FloatArray, groups: int) -> FloatArray:
    """Return the medians (groups,) of the values (k,) of each group, NaN of empty ones."""
    value = value[np.lexsort((value, group))]
    count = np.bincount(group, minlength=groups)
    first, some = np.cumsum(count) - count, count > 0
    low, high = ((first + middle // 2)[some] for middle in (count - 1, count))
    medians = np.full(groups, np.nan)
    medians[some] = 0.5 * (value[low] + value[high])
    return medians


def _looks_up(attitude: FloatArray) -> BoolArray:
    """Return (n,) whether cameras of these attitudes look above the horizon: their axis is -(third row of M)."""
    return np.cos(attitude[:, 0]) * np.cos(attitude[:, 1]) < 0.0


def _formats(statistics: Statistics) -> FloatArray:
    """Return the formats (c, 2) mm of the cameras; where none is given, the extent of what was measured."""
    block = statistics.block
    extent = np.ptp(block.plates.xy, axis=0) if len(block.plates.xy) else np.full(2, np.inf)
    return np.where(np.isnan(block.cameras.format_size), extent, block.cameras.format_size)


def _rejected(concern: Concern, text: str, section: str) -> Reason:
    return Reason(grade=Grade.REJECTED, concern=concern, text=text, section=section)
