"""Apparent and true points of any number of stations: where the rays in air seem to meet, and where the point is.

A ground point under water is imaged along its refracted rays. Prolonged in air these rays seem to come from an
apparent point, which a program that knows no water intersects. With more than two stations, or two of unequal
distance, they do not quite meet: the apparent point is where the sum of the squares of the image residuals is
smallest, as a bundle adjustment has it. Coordinates are rectangular with Z up (m): a local system or a map, over
which the water counts as level; or every point has its own `Verticals`, in which Z is up, and stations stand in
axes that all share. The depth is that below the mean of the tides of the stations that see a point.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import BoolArray, FloatArray, InRows, IntArray
from musatpy.refraction.flat import air_tangent

CLOSE = 1e-6  # m: how near the apparent point of a found true point is to the given one
_CHUNK = 2048  # points at a time: the arrays of their rays stay in the cache
_MAX_STEPS = 50
_PARALLEL = 1e-8  # square of the angle (rad) of rays that count as parallel: 1e-4


class Fault(IntEnum):
    """Why a point has no true position."""

    NONE = 0
    NOT_FINITE = 1
    ABOVE_WATER = 2
    NO_CAMERA = 3
    ONE_CAMERA = 4
    PARALLEL_RAYS = 5
    NO_CONVERGENCE = 6
    BETWEEN_TIDES = 7
    UNKNOWN_WATER = 8
    NO_MEETING = 9
    CAMERA_BELOW = 10
    NO_CONTROL = 11
    UNDECIDED = 12  # it has one, which may be dry or wet


REASONS: Mapping[int, str] = {
    Fault.NONE: "",
    Fault.NOT_FINITE: "a coordinate is no number",
    Fault.ABOVE_WATER: "not below the water",
    Fault.NO_CAMERA: "no camera sees it",
    Fault.ONE_CAMERA: "only one camera sees it",
    Fault.PARALLEL_RAYS: "rays of its cameras are parallel",
    Fault.NO_CONVERGENCE: "no true point was found for it",
    Fault.BETWEEN_TIDES: "between the tides of its cameras",
    Fault.UNKNOWN_WATER: "the surface is not known where its rays meet the water",
    Fault.NO_MEETING: "no parallax makes its rays meet under water",
    Fault.CAMERA_BELOW: "not below both cameras",
    Fault.NO_CONTROL: "no control near it",
    Fault.UNDECIDED: "undecided",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Stations:
    """k exposure stations, the water level at each, and where their cameras look.

    Raises `ValueError` where a station is not above its water.
    """

    position: FloatArray  # (k, 3) m
    level: FloatArray  # (k,) m, the tide
    axis: FloatArray | None = None  # (k, 3) unit vectors of the camera axes; None: every camera looks at the point
    height: FloatArray | None = None  # (k,) m above what levels are above; None: Z of the position

    def __post_init__(self) -> None:
        low = np.flatnonzero(~(self.heights > self.level))
        if low.size:
            raise ValueError(f"station {low[0] + 1} is not above the water")

    @property
    def heights(self) -> FloatArray:
        """(k,) m of the stations, above what levels are above."""
        return self.position[:, 2] if self.height is None else self.height


@dataclass(frozen=True, kw_only=True, eq=False)
class Verticals(InRows):
    """Axes of n points in those of the stations, where the vertical turns from place to place."""

    origin: FloatArray  # (n, 3) m, where the level of the water counts from: Z of the point is its height
    axes: FloatArray  # (n, 3, 3) rows: two horizontal, and up


@dataclass(frozen=True, kw_only=True, eq=False)
class TruePoints:
    """True points of n apparent ones. A lost one keeps its apparent place and has no true one, but a `Fault`.

    Its numbers are NaN, and so are sigmas where nothing is known of the errors of the stations.
    """

    position: FloatArray  # (n, 3) m
    depth: FloatArray  # (n,) m, below the mean tide of the cameras
    factor: FloatArray  # (n,) F = depth / apparent depth
    cameras: IntArray  # (n,) how many see the point
    spread: FloatArray  # (n,) m, standard deviation of the depths that each camera gives alone
    incidence: FloatArray  # (n,) rad, mean angle of incidence in air
    largest_incidence: FloatArray  # (n,) rad
    fault: NDArray[np.int8]  # (n,) Fault
    sigma: FloatArray  # (n, 3) m, along east, north, up
    depth_sigma: FloatArray  # (n,) m


class Through(Protocol):
    """What refracts rays where the water is not level."""

    def __call__(self, station: IntArray, camera: FloatArray, ground: FloatArray) -> FloatArray:
        """Return the vectors (p, 3) from cameras (p, 3) to where the rays to ground points (p, 3) enter the water.

        Of `station` (p,), in the axes of the stations; NaN where a ray cannot be followed.
        """


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rays:
    """The p rays between m points and the stations that see them, those of a point together."""

    point: IntArray  # (p,)
    first: IntArray  # (m,) the first ray of each point
    station: IntArray  # (p,)
    camera: FloatArray  # (3, p)
    level: FloatArray  # (p,)
    axis: FloatArray | None  # (3, p)
    stations: Stations
    verticals: Verticals | None  # of the points
    through: Through | None  # where the water is not level

    @classmethod
    def of(
        cls,
        seen: BoolArray,
        stations: Stations,
        verticals: Verticals | None = None,
        through: Through | None = None,
    ) -> _Rays:
        """Return the rays where `seen` (m, k), in the verticals of their points; every point has one at least."""
        point, station = np.nonzero(seen)
        camera = stations.position.T[:, station]
        axis = None if stations.axis is None else stations.axis.T[:, station]
        if verticals is not None:
            axes = np.ascontiguousarray(np.moveaxis(verticals.axes, 0, -1))[:, :, point]
            camera = _turned(axes, camera - verticals.origin.T[:, point])
            axis = None if axis is None else _turned(axes, axis)
        return cls(
            point=point,
            first=_starts(point),
            station=station,
            camera=camera,
            level=stations.level[station],
            axis=axis,
            stations=stations,
            verticals=verticals,
            through=through,
        )

    def only(self, kept: BoolArray) -> _Rays:
        """Return the rays of the points `kept` (m,), which are counted anew."""
        rays = kept[self.point]
        point = (np.cumsum(kept) - 1)[self.point[rays]]
        return replace(
            self,
            point=point,
            first=_starts(point),
            station=self.station[rays],
            camera=self.camera[:, rays],
            level=self.level[rays],
            axis=None if self.axis is None else self.axis[:, rays],
            verticals=None if self.verticals is None else self.verticals[np.flatnonzero(kept)],
        )

    def of_points(self, values: FloatArray) -> FloatArray:
        """Return the coordinates (3, p) of points (m, 3) for each ray."""
        return np.take(np.ascontiguousarray(values.T), self.point, axis=1)

    def total(self, values: FloatArray) -> FloatArray:
        """Return the sum (m,) of values (p,) over the rays of each point."""
        return np.add.reduceat(values, self.first)

    def largest(self, values: FloatArray) -> FloatArray:
        """Return the largest (m,) of values (p,) of the rays of each point."""
        return np.maximum.reduceat(values, self.first)

    @property
    def count(self) -> IntArray:
        """(m,) the rays of each point."""
        return np.diff(np.append(self.first, len(self.point)))


def _turned(axes: FloatArray, vector: FloatArray) -> FloatArray:
    """Return vectors (3, p) along axes (3, 3, p)."""
    return np.stack([row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2] for row in axes])


def _starts(point: IntArray) -> IntArray:
    return np.flatnonzero(np.diff(point, prepend=-1))


def apparent_points(
    ground: FloatArray, stations: Stations, index: float, seen: BoolArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the apparent points (n, 3) of true points (n, 3) below the water, and the parallax (n,) that is left.

    `seen` (n, k): which stations see which point, at least two each; all where not given. The parallax is the root
    mean square distance (m) of the rays from the apparent point at its height.
    """
    seen = np.ones((len(ground), len(stations.level)), dtype=bool) if seen is None else seen
    apparent, parallax = np.empty_like(ground, dtype=float), np.empty(len(ground))
    for start in range(0, len(ground), _CHUNK):
        part = slice(start, start + _CHUNK)
        rays = _Rays.of(seen[part], stations)
        G = np.asarray(ground[part], dtype=float)
        slope, _ = _slopes(G, index, rays)
        about = G  # any point near: each step leaves a hundredth and less of what was left
        for _ in range(6):
            move, _ = _meeting(about, slope, rays)
            about = about + move
        apparent[part] = about
        miss = _misses(about, slope, rays)
        parallax[part] = np.sqrt(rays.total(np.square(miss).sum(axis=0)) / rays.count)
    return apparent, parallax


def true_points(
    apparent: FloatArray,
    stations: Stations,
    index: float,
    seen: BoolArray | None = None,
    verticals: Verticals | None = None,
    through: Through | None = None,
) -> TruePoints:
    """Return the true points of apparent points (n, 3), with what each is worth or why there is none.

    `seen` (n, k): which stations see which point; all where not given. With `verticals` each point stands in its
    own, before and after; `through` refracts the rays where there are waves on the levels. Memory goes with n k
    bits of `seen` and n.
    """
    n = len(apparent)
    seen = np.ones((n, len(stations.level)), dtype=bool) if seen is None else seen
    points = _nothing_found(apparent, stations, seen)
    for start in range(0, n, _CHUNK):
        rows = start + np.flatnonzero(points.fault[start : start + _CHUNK] == Fault.NONE)
        if rows.size:
            own = None if verticals is None else verticals[rows]
            _find(apparent[rows], index, _Rays.of(seen[rows], stations, own, through), points, rows)
    return points


def _nothing_found(apparent: FloatArray, stations: Stations, seen: BoolArray) -> TruePoints:
    """Return true points of which only the faults are known that show without any ray."""
    n, count, height = len(apparent), np.count_nonzero(seen, axis=1), apparent[:, 2]
    rising = np.argsort(stations.level)
    tides = stations.level[rising]  # of the cameras of each point:
    lowest = np.where(count, tides[seen[:, rising].argmax(axis=1)], np.inf)
    highest = np.where(count, tides[::-1][seen[:, rising[::-1]].argmax(axis=1)], tides[-1])
    fault = np.zeros(n, dtype=np.int8)
    fault[height >= lowest] = Fault.BETWEEN_TIDES
    fault[count == 1] = Fault.ONE_CAMERA
    fault[count == 0] = Fault.NO_CAMERA
    fault[height >= highest] = Fault.ABOVE_WATER
    fault[~np.isfinite(apparent).all(axis=1)] = Fault.NOT_FINITE
    names = ("depth", "factor", "spread", "incidence", "largest_incidence", "depth_sigma")
    number = {name: np.full(n, np.nan) for name in names}
    position, sigma = np.full((2, n, 3), np.nan)
    return TruePoints(position=position, cameras=count, fault=fault, sigma=sigma, **number)


def _find(A: FloatArray, index: float, rays: _Rays, points: TruePoints, rows: IntArray) -> None:
    """Fill in the true points of apparent points (m, 3) in the rows (m,) of what is found."""
    level = rays.total(rays.level) / rays.count
    alone = _alone(A, index, rays)
    mean = rays.total(alone) / rays.count
    spread = np.sqrt(rays.total(np.square(alone - mean[rays.point])) / (rays.count - 1))
    G, angle, fault = _solve(A, np.column_stack([A[:, :2], mean]), level, index, rays)
    points.fault[rows] = fault
    good = fault == Fault.NONE
    rows, depth = rows[good], (level - G[:, 2])[good]
    points.position[rows] = G[good]
    points.depth[rows] = depth
    points.factor[rows] = depth / (level - A[:, 2])[good]
    points.spread[rows] = spread[good]
    points.incidence[rows] = (rays.total(angle) / rays.count)[good]
    points.largest_incidence[rows] = rays.largest(angle)[good]


def _alone(A: FloatArray, index: float, rays: _Rays) -> FloatArray:
    """Return the height (p,) that each ray gives alone: straight below the apparent point, by (9) and (10)."""
    x, y, z = rays.of_points(A) - rays.camera
    n2 = index * index
    square = (x * x + y * y) / (z * z)  # of tan r
    apparent_depth = rays.level - rays.camera[2] - z
    return rays.level - apparent_depth * np.sqrt(n2 + (n2 - 1.0) * square)


def _solve(
    A: FloatArray, start: FloatArray, level: FloatArray, index: float, rays: _Rays
) -> tuple[FloatArray, FloatArray, NDArray[np.int8]]:
    """Return the true points (m, 3), the angles of incidence (p,) and the faults (m,).

    G + (dX, dY, F dZ) where the apparent point of G is A - (dX, dY, dZ): F changes so slowly with the depth that a
    step leaves some hundredths of the error.
    """
    G, fault = start.copy(), np.full(len(A), Fault.NO_CONVERGENCE, dtype=np.int8)
    tangents = np.empty(len(rays.point))  # of the angles of incidence
    open_rows, open_rays, left = np.arange(len(A)), np.arange(len(rays.point)), rays
    for _ in range(_MAX_STEPS):
        slope, tangent = _slopes(G[open_rows], index, left)
        move, parallel = _meeting(A[open_rows], slope, left)
        factor = (level - G[:, 2])[open_rows] / (level - A[:, 2])[open_rows]
        with np.errstate(invalid="ignore"):
            done = np.abs(move).max(axis=1) < CLOSE
        step = -move * np.column_stack([np.ones_like(factor), np.ones_like(factor), factor])
        G[open_rows] += np.where(parallel[:, None], 0.0, step)
        tangents[open_rays] = tangent
        fault[open_rows[done]] = Fault.NONE
        fault[open_rows[parallel]] = Fault.PARALLEL_RAYS
        # a step that leaves the water, goes far below it, or where no ray follows, does not come back
        lost = ~((level - G[:, 2])[open_rows] > 0.0)
        going = ~(done | parallel | lost)
        if not going.any():
            break
        if not going.all():
            open_rows, open_rays = open_rows[going], open_rays[going[left.point]]
            left = left.only(going)
    return G, np.arctan(tangents), fault


def _slopes(G: FloatArray, index: float, rays: _Rays) -> tuple[tuple[FloatArray, FloatArray], FloatArray]:
    """Return the horizontal way (p,) along x and y of each ray in air for a metre of fall, and its length tan I."""
    if rays.through is not None:
        ground, turn = G[rays.point], np.eye(3)[None]
        if rays.verticals is not None:
            turn = rays.verticals.axes[rays.point]
            ground = rays.verticals.origin[rays.point] + np.einsum("pij,pi->pj", turn, ground)
        v = rays.through(rays.station, rays.stations.position[rays.station], ground)
        x, y, z = (turn @ v[..., None])[..., 0].T
        return (x / -z, y / -z), np.hypot(x, y) / -z
    x, y, z = rays.of_points(G) - rays.camera
    D = np.sqrt(x * x + y * y)
    H = rays.camera[2] - rays.level
    t = air_tangent(H, -z - H, D, index)
    scale = t / np.where(D > 0.0, D, 1.0)
    return (x * scale, y * scale), t


def _misses(A: FloatArray, slope: tuple[FloatArray, FloatArray], rays: _Rays) -> FloatArray:
    """Return (2, p) where each ray passes the height of its point, minus the point."""
    x, y, z = rays.camera - rays.of_points(A)
    return np.stack([x + slope[0] * z, y + slope[1] * z])


def _meeting(A: FloatArray, slope: tuple[FloatArray, FloatArray], rays: _Rays) -> tuple[FloatArray, BoolArray]:
    """Return the way (m, 3) from points A to where their rays in air meet, and which (m,) rays are parallel.

    A ray with the slopes (qx, qy) passes X + qx Z = const, Y + qy Z = const: two observation equations, whose
    weights are those of image residuals.
    """
    x, y, z = rays.camera - rays.of_points(A)
    qx, qy = -x / z, -y / z  # of the straight ray to the point: the partials are those of its image
    cx, cy = _misses(A, slope, rays)
    wxx, wxy, wyy = _weights(A, (qx, qy), rays)
    total = rays.total
    a, b = wxx * qx + wxy * qy, wxy * qx + wyy * qy
    lx, ly = wxx * cx + wxy * cy, wxy * cx + wyy * cy
    Nxx, Nxy, Nyy, Nxz, Nyz = total(wxx), total(wxy), total(wyy), total(a), total(b)
    Lx, Ly = total(lx), total(ly)
    det = Nxx * Nyy - Nxy * Nxy
    # X and Y eliminated: what is left for Z
    px, py = (Nyy * Nxz - Nxy * Nyz) / det, (Nxx * Nyz - Nxy * Nxz) / det
    Nzz = total(a * qx + b * qy) - px * Nxz - py * Nyz
    with np.errstate(invalid="ignore", divide="ignore"):
        dz = (total(lx * qx + ly * qy) - px * Lx - py * Ly) / Nzz
        # not finite: a ray could not be followed
        parallel = ~(Nzz > _PARALLEL * (Nxx + Nyy)) & np.isfinite(Nxx + Nyy)
        dx = (Nyy * Lx - Nxy * Ly) / det - px * dz
        dy = (Nxx * Ly - Nxy * Lx) / det - py * dz
    return np.column_stack([dx, dy, dz]), parallel


def _weights(
    A: FloatArray, slope: tuple[FloatArray, FloatArray], rays: _Rays
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the weights (p,) of horizontal misses: xx, xy, yy of the squared image residual, focal length 1.

    Of a camera with axis m a miss d across the unit ray u at distance R is d (I - u k' - k u' + k k') d / (R u.m)^2
    in the image, k = m / u.m; of one that looks at the point k = u.
    """
    qx, qy = slope
    length = np.sqrt(1.0 + qx * qx + qy * qy)
    R = (rays.camera[2] - A[rays.point, 2]) * length
    ux, uy = qx / length, qy / length
    if rays.axis is None:
        w = 1.0 / (R * R)
        return (1.0 - ux * ux) * w, -ux * uy * w, (1.0 - uy * uy) * w
    mx, my, mz = rays.axis
    along = mx * ux + my * uy - mz / length
    kx, ky = mx / along, my / along
    w = 1.0 / np.square(R * along)
    return (
        (1.0 + kx * kx - 2.0 * kx * ux) * w,
        (kx * ky - kx * uy - ky * ux) * w,
        (1.0 + ky * ky - 2.0 * ky * uy) * w,
    )
