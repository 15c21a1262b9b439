"""The state of an adjustment: stations, ground points and levels, and what a step does to them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from musatpy.adjustment.network import Network
from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.frames import Frame
from musatpy.geometry.rotations import attitude_from_matrix, attitude_matrix, attitude_matrix_partials, wrapped
from musatpy.model import ObservationKind, Photos

LEVEL = 6  # of the unknowns of a photo, where each has a water level of its own


@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """Current values. Positions in working coordinates; attitudes refer to `Network.axes`, the given frames."""

    axes: FloatArray  # (n, 3, 3)
    position: FloatArray  # (n, 3)
    attitude: FloatArray  # (n, 3)
    ground: FloatArray  # (p, 3), NaN where unknown
    levels: FloatArray  # (g,)
    tide: FloatArray  # (n,) m, height of the water at each photo, NaN where not given
    tilt: FloatArray  # (2,) rad, slopes of the water surface towards east and north
    index: float  # refractive index of water
    waves: FloatArray  # (k, 4) height, length, azimuth, crest of unknown waves; (0, 4) where they are known
    squares: FloatArray  # (p,) weighted squares of each point at its optimum, 0 for points that took no part

    @cached_property
    def M(self) -> FloatArray:
        """(n, 3, 3) working axes to photo."""
        return attitude_matrix(self.attitude) @ self.axes

    @cached_property
    def dM(self) -> FloatArray:
        """(n, 3, 3, 3) derivatives of M by omega, phi, kappa."""
        return attitude_matrix_partials(self.attitude) @ self.axes[:, None]


def initial_state(network: Network) -> State:
    """Return the given stations, with ground points and levels still unknown."""
    return State(
        axes=network.axes,
        position=network.position,
        attitude=network.attitude,
        ground=np.full((network.points, 3), np.nan),
        levels=np.full(network.border.count(ObservationKind.EQUAL_ELEVATION), np.nan),
        tide=network.water.tide,
        tilt=network.water.tilt,
        index=network.water.index,
        waves=np.zeros((0, 4)) if network.sea is None else network.sea.waves,
        squares=np.zeros(network.points),
    )


def given_minus(photos: Photos, frame: Frame, position: FloatArray, M: FloatArray, rows: BoolArray) -> FloatArray:
    """Return given stations minus those at `position` (n, 3), working, with the rotations M (n, 3, 3).

    (n, 6): east, north, up there, m, and angles, rad, within half a turn; NaN for others than `rows` (n,).
    """
    difference, axes = np.full((len(rows), 6), np.nan), frame.axes(position[rows])
    shift = frame.working(photos.position[rows]) - position[rows]
    difference[rows, :3] = np.einsum("nij,nj->ni", axes, shift)
    there = attitude_from_matrix(M[rows] @ np.swapaxes(axes, 1, 2))
    difference[rows, 3:] = wrapped(photos.attitude[rows] - there)
    return difference


def attitude_in(state: State, axes: FloatArray, near: FloatArray) -> FloatArray:
    """Return attitudes (n, 3) referred to other local axes, each angle within half a turn of `near`."""
    return wrapped(attitude_from_matrix(state.M @ np.swapaxes(axes, -1, -2)), near)
