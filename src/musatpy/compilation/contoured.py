"""Contours of a compiled bottom beside those of another source, depth by depth, and why some have no partner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.joined_surfaces import JoinedSurface
from musatpy.compilation.rasters import RasterBottom
from musatpy.errors import Problem, SoundingError
from musatpy.soundings.contours import ContourLines, Offsets, area_between, largest_of_most, offsets
from musatpy.surfaces.contours import contours
from musatpy.surfaces.tin import INSIDE, Tin

COMPILED, OTHER = "compiled", "other"  # whose contours are sampled
NOT_IN_OTHER = "the other source has no contour of it"
NOT_ON_IT = "no contour of the other source lies on the surface"
PAST_ENDS = "the contours lie past the ends of each other, or too far"
NO_BOTTOM = "the surface has no contour of it"
_LEVEL_DECIMALS = 3  # mm


@dataclass(frozen=True, kw_only=True, eq=False)
class ContourDistance:
    """How far contours of a depth, those `of` a source, lie from those of the other, over a length, m.

    beyond (m): the length that lies past open ends of the other contours or too far, and does not count. mean, rms
    and most (95 % do not exceed it) are of distances, m. Times the slope of the bottom these are depths: compiled
    less the other.
    """

    surface: int
    depth: float
    of: str
    length: float
    beyond: float
    mean: float
    rms: float
    most: float
    mean_depth: float
    rms_depth: float
    most_depth: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ContourArea:
    """The area (m2) between contours of a depth of a surface, and their mean distance (m); or why there is none."""

    surface: int
    depth: float
    area: float = np.nan
    width: float = np.nan
    reason: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Contoured:
    """Contours beside those of another source."""

    distances: tuple[ContourDistance, ...]
    areas: tuple[ContourArea, ...]

    @property
    def rms(self) -> float:
        """Of all distances, m; NaN where there is none."""
        length = np.array([row.length for row in self.distances])
        return float(np.sqrt(length @ np.square([row.rms for row in self.distances]) / length.sum()))


def contoured(
    surfaces: Sequence[JoinedSurface | RasterBottom],
    other: ContourLines,
    datum: float = 0.0,
    levels: Sequence[float] = (),
    farthest: float = np.inf,
) -> Contoured:
    """Return contours of surfaces, or of a raster, beside others whose datum is `datum` (m) below theirs.

    Places `farthest` (m) from each other are no partners. `levels` are depths whose contours are wanted of both.
    Raises `SoundingError` where coordinates are not of the kind of the job's, `InterchangeError` without shapely,
    `MusatError` without matplotlib.
    """
    depth = np.round(other.depth + datum, _LEVEL_DECIMALS)
    wanted = sorted({*depth.tolist(), *np.round(levels, _LEVEL_DECIMALS).tolist()})
    distances: list[ContourDistance] = []
    areas: list[ContourArea] = []
    for number, surface in enumerate(surfaces, 1):
        bottom = surface if isinstance(surface, RasterBottom) else surface.tin
        if bottom is None:
            continue
        if surface.angular != other.angular:
            needed = "lat and lon" if surface.angular else "x and y"
            raise SoundingError([Problem(message=f"the job has {needed}: give the contours in these")])
        places = [surface.places(line) for line in other.places]
        for level in wanted:
            partners = [places[row] for row in np.flatnonzero(depth == level).tolist()]
            area, ways = _of_level(number, bottom, level, partners, farthest)
            areas.append(area)
            distances += ways
    return Contoured(distances=tuple(distances), areas=tuple(areas))


def _of_level(
    surface: int, bottom: Tin | RasterBottom, level: float, others: Sequence[FloatArray], farthest: float
) -> tuple[ContourArea, list[ContourDistance]]:
    """Return the area between contours of a depth, and their distances both ways; or the reason for none."""
    none = ContourArea(surface=surface, depth=level)
    if not others:
        return replace(none, reason=NOT_IN_OTHER), []
    if isinstance(bottom, RasterBottom):
        compiled, (low, high) = bottom.lines(level), bottom.limits
    else:
        compiled = [line.xy for line in contours(bottom, [level]).lines]
        low, high = float(bottom.z.min()), float(bottom.z.max())
    if not compiled:
        span = f"the surface goes from {low:.2f} to {high:.2f} m"
        return replace(none, reason=NO_BOTTOM if low < level < high else span), []
    backward = offsets(others, compiled, farthest)
    backward = backward.part(bottom.at(backward.xy).reason == INSIDE)
    if not len(backward.xy):
        return replace(none, reason=NOT_ON_IT), []
    forward = offsets(compiled, others, farthest)
    distances = [
        _distance(surface, level, name, bottom, samples)
        for name, samples in ((COMPILED, forward), (OTHER, backward))
        if not samples.beyond.all()
    ]
    if len(distances) < 2:
        return replace(none, reason=PAST_ENDS), distances
    area = area_between(forward.part(~forward.beyond), backward.part(~backward.beyond))
    length = 0.5 * sum(distance.length for distance in distances)
    return replace(none, area=area, width=area / length), distances


def _distance(surface: int, level: float, of: str, bottom: Tin | RasterBottom, samples: Offsets) -> ContourDistance:
    good = samples.part(~samples.beyond)
    weight, distance = good.interval, good.distance
    depth = _as_depths(bottom, good, -1.0 if of == OTHER else 1.0)
    sloping = np.isfinite(depth)  # a sample at the very edge may be beside the surface
    depth, of_depth = depth[sloping], weight[sloping]
    known = len(depth) > 0
    return ContourDistance(
        surface=surface,
        depth=level,
        of=of,
        length=float(weight.sum()),
        beyond=float(samples.interval[samples.beyond].sum()),
        mean=float(np.average(distance, weights=weight)),
        rms=float(np.sqrt(np.average(np.square(distance), weights=weight))),
        most=largest_of_most(distance, weight),
        mean_depth=float(np.average(depth, weights=of_depth)) if known else np.nan,
        rms_depth=float(np.sqrt(np.average(np.square(depth), weights=of_depth))) if known else np.nan,
        most_depth=largest_of_most(np.abs(depth), of_depth) if known else np.nan,
    )


def _as_depths(bottom: Tin | RasterBottom, samples: Offsets, sign: float) -> FloatArray:
    """Return distances (n,) times the slope of the surface: positive where it is deeper than the other source says.

    `sign` is 1 for samples of the surface's own contours. Where the other contour lies on their deeper side, the
    surface has passed the depth there already.
    """
    gradient = bottom.at(samples.xy).gradient
    towards_other = sign * (samples.nearest - samples.xy)
    deeper = np.sign(np.sum(gradient * towards_other, axis=1))
    return np.asarray(deeper * np.linalg.norm(gradient, axis=1) * samples.distance)
