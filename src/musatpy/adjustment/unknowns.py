"""The state of an adjustment: stations, ground points and levels, and the axes along which photos are adjusted.

Of photos that look along the east-west line phi is 90 degrees, and omega and kappa turn about one line: no step can
turn them about the third axis, and the normal equations are singular. Such photos are adjusted along the same axes
in another order, north, up, east, in which their phi is near zero. What is known of them is stated along east,
north, up, by omega, phi, kappa, as that of all others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from musatpy.adjustment.network import BACK, ORDER, Network
from musatpy.adjustment.normals import Cofactors
from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.collinearity import (
    AngleForm,
    angle_rates,
    attitude_from_matrix,
    attitude_matrix,
    attitude_matrix_partials,
    wrapped,
)
from musatpy.geometry.geodesy import Frame
from musatpy.model import ObservationKind, Photos
from musatpy.units import DEGREE

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


_NEAREST = 5.0 * DEGREE  # of phi to 90: so far given attitudes may be off where adjustments start well
_ONE_LINE = 1e-8  # rad: nearer, only what omega and kappa have in common has a sigma that is a number


def with_turned_axes(network: Network) -> Network:
    """Return the network with the photos near a phi of 90 degrees along the axes in their other order.

    Of their attitudes as observed, the smallest of three weights holds the turn about each axis.
    """
    with np.errstate(invalid="ignore"):
        turned = np.abs(np.sin(network.attitude[:, 1])) > np.cos(_NEAREST)
    if not turned.any():
        return network
    axes, attitude = network.axes.copy(), network.attitude.copy()
    position_weight, attitude_weight = network.position_weight.copy(), network.attitude_weight.copy()
    axes[turned] = axes[turned][:, ORDER]
    attitude[turned] = attitude_from_matrix(attitude_matrix(attitude[turned])[..., ORDER])
    position_weight[turned] = position_weight[turned][:, ORDER]
    attitude_weight[turned] = attitude_weight[turned].min(axis=1, keepdims=True)
    return replace(
        network,
        axes=axes,
        attitude=attitude,
        position_weight=position_weight,
        attitude_weight=attitude_weight,
        turned=turned,
    )


def stated_partials(network: Network, state: State) -> FloatArray:
    """Return the partials (n, q, q) of east, north, up, omega, phi, kappa by the unknowns of photos."""
    q = network.pattern.size
    partials = np.broadcast_to(np.eye(q), (network.photos, q, q)).copy()
    rows = np.flatnonzero(network.turned)
    angles = attitude_from_matrix(attitude_matrix(state.attitude[rows])[..., BACK])
    form = AngleForm.OMEGA_PHI_KAPPA
    by_turn = np.linalg.pinv(angle_rates(angles, form), rcond=_ONE_LINE)
    partials[rows, :3, :3] = np.eye(3)[BACK]
    partials[rows, 3:6, 3:6] = by_turn @ angle_rates(state.attitude[rows], form)[:, BACK]
    return partials


def stated(network: Network, state: State, covariances: Cofactors) -> Cofactors:
    """Return the covariances of what is stated of the photos, of those of the unknowns."""
    if not network.turned.any():
        return covariances
    T = stated_partials(network, state)
    i, j = covariances.pattern.pairs.T
    border = T @ covariances.border.reshape(network.photos, network.pattern.size, -1)
    return replace(
        covariances,
        blocks=T[i] @ covariances.blocks @ np.swapaxes(T[j], 1, 2),
        border=border.reshape(covariances.border.shape),
    )
