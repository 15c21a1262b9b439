"""Rotation matrices of photographs and of local vertical frames, and products of vectors in space."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray

GIMBAL = 1e-10  # rad from the singular attitude of a form of angles: nearer, two of them turn about one line


def attitude_matrix(attitude: ArrayLike) -> FloatArray:
    """Return M = R3(kappa) R2(phi) R1(omega), (..., 3, 3), ground to photo, of attitudes (..., 3) in radians."""
    sine, cosine = np.sin(attitude), np.cos(attitude)
    so, sp, sk = sine[..., 0], sine[..., 1], sine[..., 2]
    co, cp, ck = cosine[..., 0], cosine[..., 1], cosine[..., 2]
    return _matrix(
        [
            [cp * ck, co * sk + so * sp * ck, so * sk - co * sp * ck],
            [-cp * sk, co * ck - so * sp * sk, so * ck + co * sp * sk],
            [sp, -so * cp, co * cp],
        ]
    )


def attitude_matrix_partials(attitude: ArrayLike) -> FloatArray:
    """Return dM/d(omega, phi, kappa), (..., 3, 3, 3) with the angle on the third axis from the end.

    dM/domega = M E1, dM/dkappa = -E3 M and dM/dphi = -(R3 e2)x M with the cross product matrices E of the axes.
    """
    attitude = np.asarray(attitude)
    M = attitude_matrix(attitude)
    kappa = attitude[..., 2]
    d_omega = np.zeros_like(M)
    d_omega[..., :, 1] = -M[..., :, 2]
    d_omega[..., :, 2] = M[..., :, 1]
    sk, ck = np.sin(kappa)[..., None], np.cos(kappa)[..., None]
    d_phi = np.stack([-ck * M[..., 2, :], sk * M[..., 2, :], ck * M[..., 0, :] - sk * M[..., 1, :]], axis=-2)
    d_kappa = np.stack([M[..., 1, :], -M[..., 0, :], np.zeros_like(M[..., 0, :])], axis=-2)
    return np.stack([d_omega, d_phi, d_kappa], axis=-3)


def attitude_from_matrix(M: ArrayLike) -> FloatArray:
    """Return (omega, phi, kappa), (..., 3) rad, of rotations M (..., 3, 3); |phi| <= 90 degrees.

    Near 90 degrees omega is what rounding makes it, and in the `GIMBAL` case zero: kappa, which turns about the
    same line there, is what it leaves of M.
    """
    M = np.asarray(M, dtype=float)
    cosine = np.hypot(M[..., 2, 1], M[..., 2, 2])
    omega = np.where(cosine < GIMBAL, 0.0, np.arctan2(-M[..., 2, 1], M[..., 2, 2]))
    phi = np.arctan2(M[..., 2, 0], cosine)
    so, co = np.sin(omega), np.cos(omega)
    kappa = np.arctan2(co * M[..., 0, 1] + so * M[..., 0, 2], co * M[..., 1, 1] + so * M[..., 1, 2])
    return np.stack([omega, phi, kappa], axis=-1)


def local_vertical(latitude: ArrayLike, longitude: ArrayLike) -> FloatArray:
    """Return the rotation geocentric -> (east, north, up), (..., 3, 3), rows E, N, U.

    The transpose of M-bar of ETL-0306 (3.7). Angles in radians.
    """
    sf, cf = np.sin(latitude), np.cos(latitude)
    sl, cl = np.sin(longitude), np.cos(longitude)
    return _matrix([[-sl, cl, 0.0 * sl], [-sf * cl, -sf * sl, cf], [cf * cl, cf * sl, sf]])


def wrapped(angle: FloatArray, about: FloatArray | float = 0.0) -> FloatArray:
    """Return angles (rad) brought within half a turn of others; what is there already comes back bit for bit."""
    return angle + 2.0 * np.pi * np.rint((about - angle) / (2.0 * np.pi))


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a x b (..., 3).

    Few vectors at a time are the rule here, for which np.cross takes several times as long: it looks for its axes.
    """
    first = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out = np.empty((*first.shape, 3), dtype=first.dtype)
    out[..., 0] = first
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def skew(v: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) with skew(v) w = v x w of vectors v (..., 3)."""
    out = np.zeros((*v.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i, j], out[..., j, i] = -v[..., k], v[..., k]
    return out


def turn(w: FloatArray) -> FloatArray:
    """Return rotations (..., 3, 3) by about w (..., 3) rad: Cayley's formula gives one whatever the size of w."""
    W = skew(0.5 * w)
    return np.asarray(np.linalg.solve(np.eye(3) - W, np.eye(3) + W), dtype=float)


def orthogonal(A: FloatArray) -> FloatArray:
    """Return the rotations (..., 3, 3) nearest to matrices."""
    U, _, Vt = np.linalg.svd(A)
    U[..., 2] *= np.sign(np.linalg.det(U) * np.linalg.det(Vt))[..., None]
    return U @ Vt


def _matrix(rows: list[list[Any]]) -> FloatArray:
    """Return the matrices (..., 3, 3) whose elements are the arrays (...) of three rows."""
    first = np.asarray(rows[0][0])
    out = np.empty((*first.shape, 3, 3), dtype=first.dtype)
    for i, row in enumerate(rows):
        for j, element in enumerate(row):
            out[..., i, j] = element
    return out
