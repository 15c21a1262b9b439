"""What a similarity makes of attitudes, stations, planes and points of a model, with partial derivatives.

Each quantity has three components: an attitude its angles, a plane z = level + slope . (x, y) its slopes and level.
By a change of the similarity its partials are those of `geometry.similarity.small`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.geometry.collinearity import AngleForm, angle_rates, attitude_from_matrix, attitude_matrix
from musatpy.geometry.similarity import Similarity, by_change


@dataclass(frozen=True, kw_only=True, eq=False)
class Moved:
    """k quantities in the new axes: value (k, 3), by_old (k, 3, 3), and by_change (k, 3, 7) of the similarity."""

    value: FloatArray
    by_old: FloatArray
    by_change: FloatArray


def moved_places(move: Similarity, x: FloatArray) -> Moved:
    """Return places x (k, 3) in the new axes."""
    value = move.apply(x)
    by_old = np.broadcast_to(move.scale * move.rotation, (*x.shape, 3))
    return Moved(value=value, by_old=by_old, by_change=by_change(value))


def moved_attitudes(move: Similarity, attitude: FloatArray) -> Moved:
    """Return attitudes (k, 3) omega, phi, kappa in the new axes."""
    value = attitude_from_matrix(move.turn(attitude_matrix(attitude)))
    by_turn = np.linalg.inv(angle_rates(value, AngleForm.OMEGA_PHI_KAPPA))
    by_old = by_turn @ move.rotation @ angle_rates(attitude, AngleForm.OMEGA_PHI_KAPPA)
    change = np.zeros((*attitude.shape, 7))
    change[..., 1:4] = by_turn
    return Moved(value=value, by_old=by_old, by_change=change)


def moved_planes(move: Similarity, plane: FloatArray) -> Moved:
    """Return planes (k, 3), slope X, slope Y and level, in the new axes."""
    normal = np.concatenate([-plane[:, :2], np.ones((len(plane), 1))], axis=1) @ move.rotation.T
    up = normal[:, 2:]
    normal = normal / up
    level = move.scale * plane[:, 2] / up[:, 0] + normal @ move.shift
    value = np.concatenate([-normal[:, :2], level[:, None]], axis=1)
    by_slope = -np.broadcast_to(move.rotation[:, :2], (len(plane), 3, 2)) / up[..., None]
    by_old = np.zeros((len(plane), 3, 3))
    by_old[..., :2] = _of_normal(by_slope, normal, level, move.shift)
    by_old[:, 2, 2] = move.scale / up[:, 0]
    change = np.zeros((len(plane), 3, 7))
    change[:, 2, 0], change[:, 2, 4:] = level, normal
    turned = np.cross(np.eye(3), normal[:, None])  # (k, 3 axes, 3)
    change[..., 1:4] = _of_normal(np.swapaxes(turned, 1, 2), normal, level, np.zeros(3))
    return Moved(value=value, by_old=by_old, by_change=change)


def _of_normal(by: FloatArray, normal: FloatArray, level: FloatArray, shift: FloatArray) -> FloatArray:
    """Return what changes (k, 3, c) of normals (k, 3) of third component 1 are in slopes and levels."""
    slopes = -by[:, :2] + normal[:, :2, None] * by[:, 2:]
    levels = shift @ by - level[:, None] * by[:, 2]
    return np.concatenate([slopes, levels[:, None]], axis=1)
