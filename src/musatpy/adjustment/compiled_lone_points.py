"""Lone points by compiled kernels: a dozen arrays of a few numbers each cost numpy more than the work on them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.compiled_points import CompiledRows, plain
from musatpy.adjustment.compiled_settling import LIMITS, TURN
from musatpy.adjustment.ground import MAX_STEPS, RIDGE
from musatpy.adjustment.kernels import compiled_points
from musatpy.adjustment.lone_points import LocalNormals
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water_surface import surface
from musatpy.arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from musatpy.adjustment.kernels import points

_ACROSS = np.array([True, True, False])  # what is free of a point that is held on a level


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledLonePoints:
    """Points of a group of which nothing is known, through level water that is known: `lone_points.LonePoints`."""

    kernels: ModuleType
    network: Network
    state: State
    group: PointGroup

    @classmethod
    def of(cls, network: Network, state: State, group: PointGroup) -> CompiledLonePoints | None:
        """Return the points of a group, None where numpy does it."""
        kernels = compiled_points(network.photos)
        if kernels is None or group.known or network.sea is not None or network.water.unknown:
            return None
        return cls(kernels=kernels, network=network, state=state, group=group)

    @cached_property
    def _stations(self) -> points.Stations:
        return CompiledRows(kernels=self.kernels, network=self.network, groups=()).stations(self.state)

    def settled(
        self, row: IntArray, wet: BoolArray, start: FloatArray, level: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        from musatpy.adjustment.kernels import conditions  # numba is there

        ground, squares, falls = self._held(start, level), np.empty(len(row)), np.empty((len(row), 2))
        at, known, moving = self._measured(row, ground), self._known(ground, level), np.arange(len(row))
        over = self._water(at, wet, ground)
        for _ in range(MAX_STEPS):
            conditions.settle(moving, at, self._stations, over, known, *LIMITS, ground, squares, falls)
            if not self.network.frame.curved:
                break
            before, over = over, self._water(at, wet, ground)
            # the water over them, which is no plane
            turned = np.abs(over.normal - before.normal).reshape(len(row), -1).max(axis=1) > TURN
            moving = np.flatnonzero(turned)
            if not len(moving):
                break
        return self._held(ground, level), squares

    def normals(self, row: IntArray, wet: BoolArray, X: FloatArray, level: FloatArray) -> LocalNormals:
        from musatpy.adjustment.kernels import lone_points  # numba is there

        at, (t, m) = self._measured(row, X), wet.shape
        u = m * self.network.pattern.size
        out = LocalNormals(
            np.empty((t, u, u)), np.empty((t, u)), np.empty((t, u)), np.zeros((t, 0), dtype=np.int64)
        )
        up, known, over = plain(self.network.frame.vertical(X)[0]), self._known(X, level), self._water(at, wet, X)
        lone_points.set_normals(at, self._stations, over, known, RIDGE, up, out.matrix, out.rhs, out.rise)
        return out

    def _measured(self, row: IntArray, ground: FloatArray) -> points.Measured:
        rays = self.group.rays[row]
        (t, m), rays = rays.shape, rays.reshape(-1)
        at: points.Measured = self.kernels.Measured(
            point=np.arange(t),
            start=np.arange(0, t * m + 1, m),
            photo=self.network.photo[rays],
            xy=self.network.xy[rays],
            root=np.sqrt(self.network.weight[rays]),
            ground=ground.copy(),
        )
        return at

    def _water(self, at: points.Measured, wet: BoolArray, ground: FloatArray) -> points.Water:
        state, rays = self.state, np.arange(wet.size)
        tide, X = state.tide[at.photo], np.repeat(ground, wet.shape[1], axis=0)
        over = surface(self.network.frame, self.network.slope(state.tilt), tide, X)
        water: points.Water = self.kernels.Water(
            row=np.where(wet.reshape(-1), rays, -1),
            normal=plain(over.normal),
            depth=plain(over.depth),
            tangent=np.full(wet.size, np.nan),
            rise=np.zeros(0),
            refraction=float(state.index),
        )
        return water

    def _known(self, X: FloatArray, level: FloatArray | None) -> points.Known:
        """Return that points (t, 3) are held on levels (t,)."""
        row = np.full(len(X), -1)
        held = row[:0] if level is None else np.flatnonzero(np.isfinite(level))
        row[held] = np.arange(len(held))
        nothing = np.zeros((len(held), 3))
        known: points.Known = self.kernels.Known(
            row=row,
            axes=plain(self.network.frame.axes(X[held])),
            free=np.tile(_ACROSS, (len(held), 1)),
            weight=nothing,
            pull=nothing,
        )
        return known

    def _held(self, X: FloatArray, level: FloatArray | None) -> FloatArray:
        """Return points (t, 3) on their levels (t,)."""
        if level is None:
            return X.copy()
        at = self.network.frame.level(X)
        return np.asarray(self.network.frame.from_level(np.column_stack([at[:, :2], level])))
