"""The errors of points on the refracted rays of many photos: pointing, stations with their covariances, and water.

What the triangulation says of the points that it determines, of any others: by the same network of rays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.network import group_points
from musatpy.adjustment.propagation import covariances_with_depths, pieces
from musatpy.adjustment.wavy_water import WorkingSea
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.compilation.triangulation import AdjustedRun, covariances_in, of_block
from musatpy.compilation.true_points import in_parts, network_of_plates
from musatpy.geometry.collinearity import attitude_from_matrix
from musatpy.model import (
    Block,
    Cameras,
    CoordinateSystem,
    Options,
    Photos,
    PlateMeasurements,
    Points,
    Program,
    StationPairs,
    Water,
)
from musatpy.model.tables import empty


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
            for rows, piece in pieces(network, state, group, covariances):
                covariance, variance = covariances_with_depths(network, state, piece, covariances)
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

        for rows, v in in_parts(vectors, np.flatnonzero(np.isfinite(ground).all(axis=1))):
            out[rows] = np.nan if v is None else v
        return out


def of_stations(
    names: tuple[str, ...], position: FloatArray, rotation: FloatArray, camera: FloatArray, tide: FloatArray,
    sigma: FloatArray, water: Water,
) -> AdjustedRun:  # fmt: skip
    """Return k stations of a table as a triangulation, their errors independent of each other.

    position (k, 3) m, Z up; rotation (k, 3, 3) ground to photo; camera (k, 3) mm: focal length, width, height of
    the format; tide (k,) m; sigma (k, 7): of the position (m), omega, phi, kappa (rad) and the tide (m). Raises
    `CompilationError`.
    """
    count, nothing = len(names), np.full(position.shape, np.nan)
    block = Block(
        titles=(),
        options=Options(program=Program.IIIA, system=CoordinateSystem.LOCAL),
        water=water,
        cameras=Cameras(
            ids=np.array(names),
            focal_length=camera[:, 0],
            principal_point=np.zeros((count, 2)),
            format_size=camera[:, 1:],
        ),
        photos=Photos(
            ids=np.array(names),
            camera=np.arange(count),
            position=position,
            position_sigma=nothing,
            attitude=attitude_from_matrix(rotation),
            attitude_sigma=nothing,
            tide=tide,
            tide_sigma=sigma[:, 6],
        ),
        points=empty(Points),
    )
    diagonal = np.square(sigma[:, :6, None]) * np.eye(6)
    pairs = StationPairs(photo=np.empty((0, 2), dtype=np.int64), covariance=np.empty((0, 6, 6)))
    return replace(of_block(block), covariance=diagonal, pairs=pairs)
