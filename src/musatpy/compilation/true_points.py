"""Points on refracted rays of a run, stations held: those compiled in a stereomodel, and the errors of any others.

What the triangulation does to points that it keeps out, with its stations, water and joint covariances: the same
network of rays with other measurements, so that both agree to rounding.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from musatpy.adjustment import propagation, sightings
from musatpy.adjustment.considered import extended
from musatpy.adjustment.ground import PARALLEL, settle_group
from musatpy.adjustment.iteration import State, initial_state
from musatpy.adjustment.job import build_network
from musatpy.adjustment.network import Network, PointGroup, group_points, participation
from musatpy.adjustment.result import bathymetric_points
from musatpy.adjustment.waterline import WaterLine, best_line, refracted, water_line
from musatpy.adjustment.wavy_water import WorkingSea
from musatpy.arrays import BoolArray, FloatArray, InRows, IntArray, TextArray, in_parts
from musatpy.compilation.triangulation import AdjustedRun, covariances_in
from musatpy.errors import AdjustmentError
from musatpy.geometry import collinearity
from musatpy.geometry.geodesy import surface
from musatpy.model import Block, PlateMeasurements, Points

Result = TypeVar("Result")
_CHUNK = 2**14  # readings at a time
_TURNS = 8  # times that rays may change between wet and dry
PARALLEL_RAYS, BEHIND = "its rays are parallel", "its rays meet behind a camera"
NOT_FOLLOWED = "its rays cannot be followed through the water"
_SHAPES: dict[str, tuple[int, ...]] = {
    "position": (3,), "covariance": (3, 3), "apparent": (3,), "water_level": (), "depth": (), "depth_sigma": (),
    "incidence": (2,), "residual": (2, 2), "y_parallax": (), "y_parallax_sigma": (), "pointing_share": (),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings(InRows):
    """k points read on the plates of two photos: refined plate coordinates xy (k, 2, 2) mm, left and right."""

    ids: TextArray  # (k,)
    submerged: BoolArray  # (k,)
    xy: FloatArray  # (k, 2, 2)
    sigma: FloatArray  # (k, 2, 2) mm, of a pointing

    @classmethod
    def of(
        cls, xy: FloatArray, submerged: BoolArray, sigma: FloatArray | float, ids: TextArray | None = None
    ) -> Readings:
        """Return readings (k, 2, 2), numbered where they have no names; one sigma, or (k, 1, 1) of each."""
        names = np.arange(len(xy)).astype(np.str_) if ids is None else ids
        return cls(ids=names, submerged=submerged, xy=xy, sigma=np.broadcast_to(sigma, xy.shape))


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledPoints:
    """k points in the system of the job; NaN where there is none, and `reasons` says why.

    covariance (k, 3, 3) along east, north, up; apparent (k, 3) where the straight rays meet. Depths are below the
    mean water of both photos. residual (k, 2, 2) mm, adjusted minus read; y_parallax (k,) mm by which the right
    image is off, with its sigma of pointing, stations and water, and the share of pointing in its variance; wet (k,
    2) rays, and their angles of incidence (k, 2) rad in air with the normal of the water, without its waves.
    """

    position: FloatArray
    covariance: FloatArray
    apparent: FloatArray
    water_level: FloatArray
    depth: FloatArray
    depth_sigma: FloatArray
    incidence: FloatArray
    residual: FloatArray
    y_parallax: FloatArray
    y_parallax_sigma: FloatArray
    pointing_share: FloatArray
    wet: BoolArray
    reasons: dict[int, str]

    @classmethod
    def nothing(cls, count: int) -> CompiledPoints:
        """Return points of which nothing is known, not even why."""
        columns = {name: np.full((count, *shape), np.nan) for name, shape in _SHAPES.items()}
        return cls(**columns, wet=np.zeros((count, 2), dtype=bool), reasons={})

    @classmethod
    def joined(cls, parts: Sequence[CompiledPoints]) -> CompiledPoints:
        """Return points of several parts, one after the other."""
        numbers = [len(part.position) for part in parts]
        out = cls.nothing(sum(numbers))
        for part, rows in zip(parts, np.split(np.arange(sum(numbers)), np.cumsum(numbers)[:-1]), strict=True):
            out.put(rows, part)
        return out

    def put(self, rows: IntArray, others: CompiledPoints) -> None:
        """Take others as `rows`."""
        for name, values in vars(others).items():
            if name != "reasons":
                getattr(self, name)[rows] = values
        self.reasons.update({int(rows[row]): why for row, why in others.reasons.items()})

    def take_out(self, reasons: dict[int, str]) -> None:
        """Let points have no position, for reasons by their rows."""
        self.put(np.array(list(reasons), dtype=np.int64), self.nothing(len(reasons)))
        self.reasons.update(reasons)


def true_points(run: AdjustedRun, photos: tuple[int, int], readings: Readings) -> CompiledPoints:
    """Return the points of readings on two photos (rows) of a run."""
    out = CompiledPoints.nothing(len(readings.ids))

    def from_rays(rows: IntArray) -> CompiledPoints:
        return _from_rays(run, photos, readings[rows])

    for first in range(0, len(readings.ids), _CHUNK):
        chunk = np.arange(first, min(first + _CHUNK, len(readings.ids)))
        for rows, points in in_parts(from_rays, chunk, AdjustmentError):
            if points is None:
                out.reasons[int(rows[0])] = NOT_FOLLOWED
            else:
                out.put(rows, points)
    return out


def _from_rays(run: AdjustedRun, photos: tuple[int, int], readings: Readings) -> CompiledPoints:
    """Return the points of readings. Raises `AdjustmentError` where one cannot be followed through waves."""
    block, measured, state = network_of(run, photos, readings)
    count, submerged = len(readings.ids), readings.submerged
    every = np.ones(2 * count, dtype=bool)
    groups = group_points(measured.photo, measured.point, every, every[:count])
    line, state = at_rest(measured, state, groups, submerged)
    network = measured.with_plates(measured.xy, line.wet)
    out, ground, depth = CompiledPoints.nothing(count), state.ground.copy(), np.full(count, np.nan)
    out.reasons.update(_lost(network, state, groups))
    ground[list(out.reasons)] = np.nan
    state, known = replace(state, ground=ground), np.asarray(np.isfinite(ground).all(axis=1))
    out.position[known] = network.frame.system(ground[known])
    covariances = covariances_in(run, network.pattern, network.border.size)
    for group in groups:
        for _, piece in propagation.pieces(network, state, group.part(known[group.point]), covariances):
            point = piece.group.point
            out.covariance[point] = propagation.point_covariances(network, piece, covariances, None)
            off, sigma, share = y_parallax(network, piece)
            out.y_parallax[point], out.y_parallax_sigma[point], out.pointing_share[point] = off, sigma, share
            if submerged[point].any():
                cofactors = propagation.depth_cofactors(network, state, piece, covariances, None)
                depth[point] = np.where(submerged[point], cofactors, np.nan)
    v, rays = np.full((2 * count, 2), np.nan), np.flatnonzero(known[network.point])
    v[rays] = sightings.residuals(network, state, rays)
    out.residual[:] = np.swapaxes(v.reshape(2, count, 2), 0, 1)
    out.wet[:] = line.wet.reshape(2, count).T
    bathymetric = bathymetric_points(block, measured, state, groups, np.sqrt(depth))
    for name in ("apparent", "water_level", "depth", "depth_sigma"):
        getattr(out, name)[bathymetric.point] = getattr(bathymetric, name)
    bent = np.flatnonzero(known & out.wet.any(axis=1))
    of_both = bent[:, None] + np.array([0, count])
    _, air = sightings.straight_rays(network, state, of_both)
    places = np.repeat(ground[bent, None], 2, axis=1)
    over = surface(network.frame, network.slope(state.tilt), state.tide[network.photo[of_both]], places)
    angle = np.arccos(np.clip(-np.einsum("kmi,kmi->km", over.normal, air), -1.0, 1.0))
    out.incidence[bent] = np.where(out.wet[bent], angle, np.nan)
    return out


def network_of(run: AdjustedRun, photos: tuple[int, int], readings: Readings) -> tuple[Block, Network, State]:
    """Return the block of the readings on the photos of the run, its network, and its first state."""
    count = len(readings.ids)
    plates = PlateMeasurements(
        photo=np.repeat(np.array(photos), count),
        point=np.tile(np.arange(count), 2),
        xy=np.concatenate([readings.xy[:, 0], readings.xy[:, 1]]),
        sigma=np.concatenate([readings.sigma[:, 0], readings.sigma[:, 1]]),
        triangulated=np.zeros(2 * count, dtype=bool),
    )
    return network_of_plates(run, Points(ids=readings.ids, bathymetric=readings.submerged), plates)


def network_of_plates(run: AdjustedRun, points: Points, plates: PlateMeasurements) -> tuple[Block, Network, State]:
    """Return the block of points that a run holds no station by, its network, and its first state."""
    options = replace(run.block.options, submerged_factor=1.0)
    block, frame = replace(run.block, points=points, plates=plates, options=options), run.frame
    network = build_network(block, frame, participation(block), run.sea)
    if np.isfinite(run.given).all():  # the axes of the covariances
        axes = frame.axes(frame.working(run.given))
        M = collinearity.attitude_matrix(network.attitude) @ network.axes @ np.swapaxes(axes, 1, 2)
        network = replace(network, axes=axes, attitude=collinearity.attitude_from_matrix(M))
    state = initial_state(network)
    if run.considered:
        wide = extended(block, network, state)
        network, state = wide.network, wide.state
    return block, network, state


def images_of(run: AdjustedRun, photos: tuple[int, int], ground: FloatArray, submerged: BoolArray) -> FloatArray:
    """Return what the stages (k, 2, 2) mm should read of points, ground (k, 3) in working coordinates.

    Raises `AdjustmentError` where a ray cannot be followed through waves.
    """
    _, network, state = network_of(run, photos, Readings.of(np.zeros((len(ground), 2, 2)), submerged, 1.0))
    state = replace(state, ground=ground)
    network = network.with_plates(network.xy, water_line(network, state, submerged).wet)
    xy = sightings.image_coordinates(network, state, np.arange(2 * len(ground)), ground[network.point])
    return np.swapaxes(xy.reshape(2, len(ground), 2), 0, 1)


def at_rest(
    measured: Network, state: State, groups: Sequence[PointGroup], submerged: BoolArray
) -> tuple[WaterLine, State]:
    """Return which rays are wet, and the state with the points where these rays meet."""
    state = nearest_to_rays(measured, state, groups)
    line = water_line(measured, state, submerged)
    state = nearest_to_rays(*refracted(measured, line, state), groups)
    for _ in range(_TURNS):
        state = settled(measured, line, state, groups)
        new = best_line(measured, line, state, submerged)
        if new.same_as(line):
            break
        line = new
    return line, state


def nearest_to_rays(network: Network, state: State, groups: Iterable[PointGroup]) -> State:
    """Return the state with points nearest to their rays, refracted or not: within centimetres of their best."""
    ground = state.ground.copy()
    for group in groups:
        X = ground[group.point]
        rays = sightings.rays_to(network, state, group.rays, np.repeat(X[:, None], group.rays.shape[1], 1))
        nearest = collinearity.nearest_point(*rays)
        ground[group.point] = np.where(np.isfinite(nearest), nearest, X)
    return replace(state, ground=ground)


def settled(measured: Network, line: WaterLine, state: State, groups: Iterable[PointGroup]) -> State:
    """Return the state with the points where their rays meet that are wet by a line."""
    network, state = refracted(measured, line, state)
    ground = state.ground.copy()
    for group in groups:
        ground[group.point], _ = settle_group(network, state, group, ground[group.point])
    return replace(state, ground=ground)


def _lost(network: Network, state: State, groups: Iterable[PointGroup]) -> dict[int, str]:
    """Return why points have no position."""
    reasons: dict[int, str] = {}
    for group in groups:
        _, direction = sightings.straight_rays(network, state, group.rays)
        X = state.ground[group.point]
        photo = network.photo[group.rays]
        seen = collinearity.in_front(X[:, None] - state.position[photo], state.M[photo]).all(axis=1)
        parallel = collinearity.widest_angle(direction) < PARALLEL
        reasons |= dict.fromkeys(group.point[~seen].tolist(), BEHIND)
        reasons |= dict.fromkeys(group.point[parallel].tolist(), PARALLEL_RAYS)
    return reasons


def y_parallax(network: Network, piece: propagation.Piece) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return how far right images (k,) mm are off the rays of left ones, sigmas, and the share of pointing in them.

    The four image coordinates of a point have one condition a'dl = 0 with a'B = 0, B their partials by the point:
    the right image is off its epipolar curve by a'(read - adjusted) over the length of its part of a, positive
    along y.
    """
    N, E = piece.E.normals, piece.E
    k, m = piece.group.rays.shape
    a = _left_null(N.B.reshape(k, 2 * m, 3)).reshape(k, m, 2)
    right = int(np.argmax(piece.group.rays[0])) if k else 1  # those of the left photo come first
    size = np.linalg.norm(a[:, right], axis=1) * np.where(a[:, right, 1] < 0.0, -1.0, 1.0)
    a /= size[:, None, None]
    off = -np.einsum("kma,kma->k", a, N.residual)
    by_station = np.einsum("kma,kmaq->kmq", a, N.images.by_station).reshape(k, -1)
    J = np.concatenate([by_station, np.einsum("kma,kmax->kx", a, E.extras.images)], axis=1)
    variance = np.einsum("ki,kij,kj->k", J, piece.Q, J)
    pointing = np.einsum("kma,kma->k", np.square(a), 1.0 / network.weight[piece.group.rays])
    variance += pointing
    return off, np.sqrt(variance), pointing / variance


def _left_null(B: FloatArray) -> FloatArray:
    """Return the rows a (k, 4) with a'B = 0 of matrices B (k, 4, 3): their cofactors."""
    rows = np.arange(4)
    minors = [np.linalg.det(B[:, rows != row]) for row in rows]
    return np.stack([minor if row % 2 == 0 else -minor for row, minor in enumerate(minors)], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class PointSigmas:
    """How well points are known from k photos (rows) of a run whose images have a sigma of pointing (mm)."""

    run: AdjustedRun
    photos: IntArray  # (k,)
    pointing: float

    def __call__(self, level: FloatArray, seen: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return the sigmas (n, 3) m along east, north, up of points below the water, and (n,) m of their depths.

        level (n, 3): latitude, longitude (rad) and height (m), or X, Y, Z of a local job; seen (n, k): by which of
        the photos each is, two at least. Depths are below the mean water of these.
        """
        if not len(level):
            return np.empty((0, 3)), np.empty(0)
        order = np.lexsort(seen.T)  # points of the same photos together: they share the covariances of these
        level, seen = level[order], seen[order]
        run, (point, camera) = self.run, np.nonzero(seen)
        xy, every = np.zeros((len(point), 2)), np.ones(len(point), dtype=bool)
        ids = np.arange(len(level)).astype(np.str_)
        plates = PlateMeasurements(
            photo=self.photos[camera],
            point=point,
            xy=xy,
            sigma=np.full(xy.shape, self.pointing),
            triangulated=~every,
        )
        bathymetric = np.ones(len(level), dtype=bool)
        _, network, state = network_of_plates(run, Points(ids=ids, bathymetric=bathymetric), plates)
        network, state = network.with_plates(xy, every), replace(state, ground=run.frame.from_level(level))
        covariances = covariances_in(run, network.pattern, network.border.size)
        sigma, depth = np.empty((len(level), 3)), np.empty(len(level))
        for group in group_points(network.photo, network.point, every, bathymetric):
            for rows, piece in propagation.pieces(network, state, group, covariances):
                covariance, variance = propagation.covariances_with_depths(network, state, piece, covariances)
                sigma[order[group.point[rows]]] = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
                depth[order[group.point[rows]]] = np.sqrt(variance)
        return sigma, depth


@dataclass(frozen=True, kw_only=True, eq=False)
class ThroughWaves:
    """How the waves of a run refract rays to k of its photos (rows)."""

    run: AdjustedRun
    photos: IntArray  # (k,)

    def __call__(self, station: IntArray, camera: FloatArray, ground: FloatArray) -> FloatArray:
        """Return the vectors (p, 3) from cameras to where rays to ground points (p, 3) enter the water.

        Of `station` (p,) of the k, geocentric or in a local job; NaN where a ray cannot be followed.
        """
        run, photo, out = self.run, self.photos[station], np.full(camera.shape, np.nan)
        assert run.sea is not None and run.block.water is not None
        sea, origin, index = WorkingSea.of(run.sea, run.frame).known, run.frame.origin, run.block.water.index
        tide = run.block.photos.tide[photo]

        def vectors(some: IntArray) -> FloatArray:
            return sea.incidence(photo[some], camera[some] - origin, ground[some] - origin, tide[some], index).v

        for rows, v in in_parts(vectors, np.flatnonzero(np.isfinite(ground).all(axis=1)), AdjustmentError):
            out[rows] = np.nan if v is None else v
        return out
