"""Photos that look along the east-west line: phi is 90 degrees there, and omega and kappa turn about one line.

No step can then turn the photo about the third axis, and the normal equations are singular. Such photos are
adjusted along the same axes in another order, north, up, east, in which their phi is near zero. What is known of
them is stated along east, north, up, by omega, phi, kappa, as that of all others.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.adjustment.network import BACK, ORDER, Network
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray
from musatpy.geometry.attitudes import AngleForm, angle_rates
from musatpy.geometry.rotations import attitude_from_matrix, attitude_matrix
from musatpy.units import DEGREE

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
