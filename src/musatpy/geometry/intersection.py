"""Image rays in space: where they meet, and the conditions that they do, with closed-form partial derivatives.

Ray i starts at P_i with direction u_i; the partials come as six columns a ray, those by P_i and then by u_i.
ETL-0306 section 3 in the corrected forms of docs/theory.md.
"""

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


def coplanarity(P: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return B.(u_1 x u_2) of ray pairs, and its partials.

    P, u: (..., 2, 3). Returns values (...) and partials (..., 2, 6) by P and u of each ray.
    """
    u1, u2 = u[..., 0, :], u[..., 1, :]
    B = P[..., 1, :] - P[..., 0, :]
    D = cross(u1, u2)
    first = np.concatenate([-D, cross(u2, B)], axis=-1)
    second = np.concatenate([D, cross(B, u1)], axis=-1)
    return _dot(B, D), np.stack([first, second], axis=-2)


def scale_restraint(P: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the difference of the two distances along the middle ray of triples, and its partials.

    One distance comes from the model of rays 1 and 2, the other from that of rays 2 and 3:
    (B12 x u1).D12/|D12|^2 - (B23 x u3).D23/|D23|^2. P, u: (..., 3, 3). Returns values (...) in metres and
    partials (..., 3, 6).
    """
    u1, u2, u3 = u[..., 0, :], u[..., 1, :], u[..., 2, :]
    B12, B23 = P[..., 1, :] - P[..., 0, :], P[..., 2, :] - P[..., 1, :]
    # k2 of the first model, ETL-0306 (3.3), and k1 of the second, (3.2)
    k12, by_B12, by_u1, by_u2 = _distance(B12, u1, u2, u1)
    k23, by_B23, by_u2_second, by_u3 = _distance(B23, u2, u3, u3)
    partials = np.stack(
        [
            np.concatenate([-by_B12, by_u1], axis=-1),
            np.concatenate([by_B12 + by_B23, by_u2 - by_u2_second], axis=-1),
            np.concatenate([-by_B23, -by_u3], axis=-1),
        ],
        axis=-2,
    )
    return k12 - k23, partials


def _distance(
    B: FloatArray, u: FloatArray, w: FloatArray, a: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return k = (B x a).D/|D|^2 with D = u x w, and its gradients by B, u and w; `a` is `u` or `w` itself."""
    D = cross(u, w)
    D2 = _dot(D, D)[..., None]
    Ba = cross(B, a)
    k = _dot(Ba, D)[..., None] / D2
    # d(Ba.D) - k d(D.D) = dB.(a x D) + da.(D x B) + (Ba - 2k D).dD
    E = Ba - 2.0 * k * D
    by_u, by_w = cross(w, E), cross(E, u)
    by_a = cross(D, B)
    if a is u:
        by_u = by_u + by_a
    else:
        by_w = by_w + by_a
    return k[..., 0], cross(a, D) / D2, by_u / D2, by_w / D2


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.einsum("...i,...i->...", a, b)
