"""Intersection of rays in space."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.geometry.rotations import cross

_SINGULAR = 1e-14  # smallest eigenvalue from which rays are not parallel


def first_pair(P: FloatArray, u: FloatArray) -> FloatArray:
    """Return the point half-way between the first two rays, (..., 3). ETL-0306 (3.2)-(3.6), corrected.

    P, u: (..., m, 3), m >= 2. Not finite where the two rays are parallel.
    """
    u1, u2 = u[..., 0, :], u[..., 1, :]
    B = P[..., 1, :] - P[..., 0, :]
    D = cross(u1, u2)
    with np.errstate(divide="ignore", invalid="ignore"):
        D2 = np.einsum("...i,...i->...", D, D)
        k1 = np.einsum("...i,...i->...", cross(B, u2), D) / D2
        k2 = np.einsum("...i,...i->...", cross(B, u1), D) / D2
        first = P[..., 0, :] + k1[..., None] * u1
        second = P[..., 1, :] + k2[..., None] * u2
    return 0.5 * (first + second)


def nearest_point(P: FloatArray, u: FloatArray) -> FloatArray:
    """Return the point (..., 3) with the least sum of squared distances from rays P, u (..., m, 3).

    Not finite where all rays of a point are parallel.
    """
    across = np.eye(3) - u[..., :, None] * u[..., None, :]
    N = across.sum(axis=-3)
    t = np.einsum("...mij,...mj->...i", across, P)
    # the determinant over the sum of the principal minors: about the smallest eigenvalue, where that is small
    minors = sum(N[..., i, i] * N[..., j, j] - np.square(N[..., i, j]) for i, j in ((0, 1), (0, 2), (1, 2)))
    singular = np.linalg.det(N) < _SINGULAR * minors
    N = np.where(singular[..., None, None], np.eye(3), N)
    X = np.linalg.solve(N, t[..., None])[..., 0]
    return np.where(singular[..., None], np.nan, X)


def widest_angle(u: FloatArray) -> FloatArray:
    """Return the largest angle (rad) between any two of the unit rays u (..., m, 3) of a point."""
    m = u.shape[-2]
    i, j = np.triu_indices(m, 1)
    sine = np.linalg.norm(cross(u[..., i, :], u[..., j, :]), axis=-1)
    cosine = np.einsum("...i,...i->...", u[..., i, :], u[..., j, :])
    return np.arctan2(sine, cosine).max(axis=-1, initial=0.0)
