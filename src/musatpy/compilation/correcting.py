"""Old compilations corrected: apparent points of a stereomodel -> true ones, with their sigmas.

An apparent point lies where the straight rays of both photos meet best, by the least squares of their images, as a
compilation lists it: its true point is the one whose refracted images make these rays. Points above the water stay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.compilation.compiled import NO_TIDE, OFF_PLATE
from musatpy.compilation.loop import Drive, Loop
from musatpy.compilation.parts import in_parts
from musatpy.compilation.stereomodels import Stereomodel, off_plate
from musatpy.compilation.true_points import BEHIND, NOT_FOLLOWED, PARALLEL_RAYS, Readings, true_points
from musatpy.geometry.collinearity import in_front
from musatpy.geometry.systems import System

CHUNK = 65536  # points at a time
_STEPS = 40
_STILL = 1e-7  # m by which the straight rays of a point may still miss its apparent place
_ROUNDING = 1e-10  # m, of places in a model
BELOW_HORIZON = "a photo is below its horizon"
REASONS = ("", OFF_PLATE, BEHIND, BELOW_HORIZON, NO_TIDE, PARALLEL_RAYS, NOT_FOLLOWED)
_SHAPES: dict[str, tuple[int, ...]] = {"xyz": (3,), "sigma": (3,), "depth": (), "depth_sigma": (), "moved": (2,)}


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrected:
    """k points in the system of their file: xyz (k, 3), NaN where a reason (k,), a row of `REASONS`, says why.

    sigma (k, 3) m along east, north, up; depth and depth_sigma (k,) m, NaN of dry points; moved (k, 2) m, east and
    north.
    """

    xyz: FloatArray
    sigma: FloatArray
    depth: FloatArray
    depth_sigma: FloatArray
    moved: FloatArray
    reason: IntArray

    @property
    def known(self) -> BoolArray:
        """(k,) which have a position."""
        return np.asarray(np.isfinite(self.xyz).all(axis=1))

    @property
    def shift(self) -> FloatArray:
        """(k,) m, in plan."""
        return np.asarray(np.linalg.norm(self.moved, axis=1))

    @classmethod
    def nothing(cls, count: int, reason: int = 0) -> Corrected:
        """Return points without a position, all for one reason."""
        columns = {name: np.full((count, *shape), np.nan) for name, shape in _SHAPES.items()}
        return cls(**columns, reason=np.full(count, reason, dtype=np.int8))

    def put(self, rows: IntArray | BoolArray, others: Corrected) -> None:
        """Take what came of some of the points from others."""
        for name, values in vars(others).items():
            getattr(self, name)[rows] = values


@dataclass(frozen=True, kw_only=True, eq=False)
class Correction:
    """How apparent points are corrected: the model, the system of the points, the sigma (mm) of their images."""

    stereo: Stereomodel
    system: System
    pointing: float

    def __call__(self, apparent: FloatArray, *, any_format: bool = False) -> Corrected:
        """Return the true points of apparent ones (k, 3); on plates of `any_format`, if it is asked for.

        Raises `SystemsError` where the system does not reach.
        """
        done = Corrected.nothing(len(apparent))
        for first in range(0, len(apparent), CHUNK):
            part = slice(first, first + CHUNK)
            done.put(np.arange(len(apparent))[part], self._part(apparent[part], any_format))
        return done

    def images(self, points: FloatArray) -> FloatArray:
        """Return the images (k, 2, 2) mm of points (k, 3) along straight rays."""
        stereo = self.stereo
        model = stereo.model(stereo.run.frame.from_level(self.system.level(points)))
        return stereo.images(np.repeat(model[:, None], 2, axis=1))

    def _part(self, apparent: FloatArray, any_format: bool) -> Corrected:
        stereo, frame = self.stereo, self.stereo.run.frame
        working, reason = self._lost(apparent)
        if any_format:
            reason[reason == REASONS.index(OFF_PLATE)] = 0
        both = np.repeat(stereo.model(working)[:, None], 2, axis=1)
        xy, known = stereo.images(both), np.isfinite(stereo.tides).all() and stereo.run.block.water is not None
        below = frame.height(working) < np.nan_to_num(stereo.tides, nan=np.inf).max()
        wet = below & (reason == 0)
        if known:
            loop, rows = Loop(stereo=stereo), np.flatnonzero(wet)
            for part, images in in_parts(lambda some: _refracted_images(loop, both[some, 0]), rows):
                xy[part] = np.nan if images is None else images
            reason[rows[np.isnan(xy[rows]).any(axis=(1, 2))]] = REASONS.index(NOT_FOLLOWED)
        else:
            reason[wet] = REASONS.index(NO_TIDE)
        used = np.flatnonzero(reason == 0)
        readings = Readings(
            ids=used.astype(np.str_),
            submerged=below[used],
            xy=xy[used],
            sigma=np.full((len(used), 2, 2), self.pointing),
        )
        points = true_points(stereo.run, stereo.photos, readings)
        for row, why in points.reasons.items():
            reason[used[row]] = REASONS.index(why)
        good = np.isfinite(points.position).all(axis=1)
        rows, true = used[good], frame.working(points.position[good])
        moved = np.einsum("kij,kj->ki", frame.axes(working[rows]), true - working[rows])
        done = Corrected.nothing(len(apparent))
        done.reason[:] = reason
        done.xyz[rows] = self.system.coordinates(frame.level(true))
        done.sigma[rows] = np.sqrt(np.diagonal(points.covariance[good], axis1=1, axis2=2))
        done.moved[rows] = moved[:, :2]
        done.depth[used], done.depth_sigma[used] = points.depth, points.depth_sigma
        return done

    def shows(self, apparent: FloatArray) -> BoolArray:
        """Return which points (k, 3) both photos show. Raises `SystemsError` where the system does not reach."""
        return np.asarray(self._lost(apparent)[1] == 0)

    def _lost(self, points: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return points (k, 3) in working coordinates, and why a photo does not show them, 0 where both do."""
        stereo, frame = self.stereo, self.stereo.run.frame
        working = frame.from_level(self.system.level(points))
        gap = stereo.model(working)[:, None] - stereo.stations
        reason = np.zeros(len(points), dtype=np.int64)
        reason[off_plate(stereo, stereo.images(gap + stereo.stations)).any(axis=1)] = REASONS.index(OFF_PLATE)
        reason[~in_front(gap, stereo.rotation).all(axis=1)] = REASONS.index(BEHIND)
        up = frame.axes(working)[:, 2] @ stereo.axes.T
        reason[(np.einsum("ksi,ki->ks", gap, up) >= 0.0).any(axis=1)] = REASONS.index(BELOW_HORIZON)
        return working, reason


def _refracted_images(loop: Loop, apparent: FloatArray) -> FloatArray:
    """Return the images (k, 2, 2) mm, refracted, whose straight rays meet in points (k, 3) of the model.

    NaN where none are found, as under waves that are short beside the depth. Raises `AdjustmentError`.
    """
    air, stretch = replace(loop, drive=Drive.AIR), np.array([1.0, 1.0, loop.stereo.index])
    true, xy = apparent.copy(), np.empty((len(apparent), 2, 2))
    left, active = np.full(len(true), np.inf), np.arange(len(true))
    for _ in range(_STEPS):
        xy[active] = loop.stages(true[active]).xy
        gap = apparent[active] - air.mark(xy[active])
        true[active] += gap * stretch  # a depth is about as many times its apparent one
        left[active] = np.abs(gap).max(axis=1)
        active = active[left[active] > _ROUNDING]
        if not len(active):
            break
    xy[left > _STILL] = np.nan
    return xy
