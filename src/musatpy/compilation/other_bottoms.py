"""Soundings and contours of other sources beside the bottom of a compilation, and why some of them do not count."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.compilation.joined_surfaces import JoinedSurface
from musatpy.compilation.rasters import RasterBottom
from musatpy.errors import SoundingError, SystemsError
from musatpy.soundings.contours import ContourLines, Offsets, area_between, largest_of_most, offsets
from musatpy.soundings.differences import DepthDifferences
from musatpy.soundings.sounding_files import Soundings
from musatpy.surfaces import tin
from musatpy.surfaces.contours import contours
from musatpy.surfaces.tin import SurfaceValues, Tin

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
            raise SoundingError.of(f"the job has {needed}: give the contours in these")
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
    backward = backward[bottom.at(backward.xy).reason == tin.INSIDE]
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
    area = area_between(forward[~forward.beyond], backward[~backward.beyond])
    length = 0.5 * sum(distance.length for distance in distances)
    return replace(none, area=area, width=area / length), distances


def _distance(surface: int, level: float, of: str, bottom: Tin | RasterBottom, samples: Offsets) -> ContourDistance:
    good = samples[~samples.beyond]
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


STEEP = "the bottom is steeper there than the limit"
DRY = "dry: the bottom there is above the water"
UNDATED = "its date is not known"
_WEST = ": they look like longitudes that are positive to the west; give them positive to the east"
_DRY = len(tin.REASONS) + 1
# of reasons of several surfaces the last counts
_RANK = np.argsort([tin.OUTSIDE, tin.EMPTY, tin.FEW, tin.LONG_EDGE, tin.LAND, _DRY, tin.INSIDE])


@dataclass(frozen=True, kw_only=True)
class Matching:
    """How soundings are held against a bottom.

    `datum` (m): how far the datum of the soundings is below that of the compilation, with its sigma; sigma of
    soundings whose file has none, sigma of their place (m); the steepest slope of the bottom that counts. With a
    `radius` (m) the bottom is the plane of the points so near, else triangles. not_before: the first day that
    counts, None for all.
    """

    datum: float = 0.0
    datum_sigma: float = 0.0
    sigma: float = 0.0
    plan_sigma: float = 0.0
    steepest: float = np.inf
    radius: float = np.inf
    not_before: datetime.date | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Sounded:
    """Soundings beside a bottom: those that meet it, their `rows` (k,), and why the rows of others do not.

    `xy` (k, 2) m: where they stand on the map of the first model.
    """

    soundings: Soundings
    how: Matching
    rows: IntArray
    xy: FloatArray
    differences: DepthDifferences
    reasons: dict[int, str]


def sounded(surfaces: Sequence[JoinedSurface | RasterBottom], soundings: Soundings, how: Matching) -> Sounded:
    """Return soundings beside the surfaces of a compilation or a raster; where these overlap beside the surer one.

    Raises `SoundingError` where their coordinates are not of the kind of the job's.
    """
    used = [surface for surface in surfaces if isinstance(surface, RasterBottom) or surface.tin is not None]
    at = _surest_bottom(used, soundings, how.radius)
    slope = np.asarray(np.linalg.norm(at.gradient, axis=1))
    reasons = _reasons(at.reason, slope, soundings, how)
    met = np.setdiff1d(np.arange(len(soundings.depth)), list(reasons))
    of_soundings = np.where(np.isfinite(soundings.sigma[met]), soundings.sigma[met], how.sigma)
    parts = (at.sigma[met], of_soundings, slope[met] * how.plan_sigma, np.full(len(met), how.datum_sigma))
    return Sounded(
        soundings=soundings,
        how=how,
        rows=met,
        xy=used[0].places(soundings.place[met]) if used else np.zeros((0, 2)),
        differences=DepthDifferences(
            names=soundings.names[met],
            compiled=at.value[met],
            sounded=soundings.depth[met] + how.datum,
            sigma=np.sqrt(np.sum(np.square(parts), axis=0)),
        ),
        reasons=reasons,
    )


def _surest_bottom(
    surfaces: Sequence[JoinedSurface | RasterBottom], soundings: Soundings, radius: float
) -> SurfaceValues:
    """Return the surest bottom at soundings, and the last of the reasons why there is none."""
    n = len(soundings.depth)
    value, sigma, gradient = np.full(n, np.nan), np.full(n, np.inf), np.full((n, 2), np.nan)
    reason = np.full(n, tin.OUTSIDE)
    for surface in surfaces:
        if surface.angular != soundings.angular:
            needed = "lat and lon" if surface.angular else "x and y"
            named = ", or name the system of x and y (--crs EPSG:32620)" if surface.angular else ""
            raise SoundingError.of(f"the job has {needed}: give the soundings in these{named}")
        part = _bottom_at(surface, surface.places(soundings.place), radius)
        reason = np.where(_RANK[part.reason] > _RANK[reason], part.reason, reason)
        surer = (part.reason == tin.INSIDE) & ~(part.sigma >= sigma)  # one without a sigma is better than none
        value[surer], sigma[surer], gradient[surer] = part.value[surer], part.sigma[surer], part.gradient[surer]
    return SurfaceValues(value=value, gradient=gradient, sigma=sigma, reason=reason)


def _bottom_at(surface: JoinedSurface | RasterBottom, places: FloatArray, radius: float) -> SurfaceValues:
    """Return a bottom at places (n, 2); that of a model is dry where it is above the water of the nearest point."""
    if isinstance(surface, RasterBottom):
        return surface.at(places)
    from scipy.spatial import KDTree  # it takes long to load

    points = surface.points
    assert surface.tin is not None
    if np.isfinite(radius):
        at = tin.planes_at(places, points.xy, points.depth, points.sigma, radius)
    else:
        at = surface.tin.at(places)
    nearest = KDTree(points.xy).query(places)[1]
    return replace(at, reason=np.where(at.value < points.water[nearest], _DRY, at.reason))


def nowhere(
    surfaces: Sequence[JoinedSurface | RasterBottom], soundings: Soundings, compared: Sounded
) -> SoundingError:
    """Return the error of soundings none of which meets the bottom: why, and with which other places they would."""
    why = next(iter(compared.reasons.values()), "there is no bottom")
    names = "lat and lon" if soundings.angular else "x and y"
    place = soundings.place
    others = {f"{names} exchanged": place[:, ::-1], f"the other sign of {names.split()[2]}": place * (1.0, -1.0)}
    if soundings.angular:
        others |= {"lat and lon exchanged, and the other sign of lon": place[:, ::-1] * (1.0, -1.0)}
    hint = ""
    for how, places in others.items():
        met = 0
        with suppress(SystemsError):  # where a system does not reach
            met = len(sounded(surfaces, replace(soundings, place=places), Matching()).rows)
        hint += f". {met} of them would with {how}{_WEST if how.endswith('sign of lon') else ''}" if met else ""
    return SoundingError.of(f"no sounding meets the bottom: {why}{hint}")


def _reasons(reason: IntArray, slope: FloatArray, soundings: Soundings, how: Matching) -> dict[int, str]:
    """Return why soundings do not count, by their rows in order."""
    words = {**tin.REASONS, _DRY: DRY}
    reasons = {int(row): words[int(reason[row])] for row in np.flatnonzero(reason != tin.INSIDE)}
    reasons |= dict.fromkeys(np.flatnonzero((reason == tin.INSIDE) & (slope > how.steepest)).tolist(), STEEP)
    if how.not_before is not None:
        reasons |= dict.fromkeys(np.flatnonzero(np.isnat(soundings.date)).tolist(), UNDATED)
        old = np.flatnonzero(soundings.date < np.datetime64(how.not_before))
        reasons |= dict.fromkeys(old.tolist(), f"older than {how.not_before}")
    return dict(sorted(reasons.items()))
