"""Rotation matrices of photographs and of local vertical frames, their angles, and products of vectors in space.

A rotation M takes vectors along three reference axes to the photo. All forms of its angles are three rotations one
after the other, so that matrices, rates and gimbal cases have one formula for all:

- `OMEGA_PHI_KAPPA`        (omega, phi, kappa), M = R3(kappa) R2(phi) R1(omega): the form of the adjustment
- `PHI_OMEGA_KAPPA`        (phi, omega, kappa), M = R3(kappa) R1(omega) R2(phi): phi is primary
- `AZIMUTH_TILT_SWING`     (alpha, t, s),       M = R3(s - pi) R1(t) R3(-alpha)

A small rotation w (rad, along the reference axes) is that of M (I - [w]x): it turns the photo by w.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray

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
    """Return the rotations (..., 3, 3) nearest to matrices, as to what a card rounds.

    By the singular value decomposition (Horn, Hilden and Negahdaripour, J. Opt. Soc. Am. A 5 (1988) 1127).
    """
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


class AngleForm(StrEnum):
    """Which three angles state an attitude, in the order of their names."""

    OMEGA_PHI_KAPPA = "OPK"
    PHI_OMEGA_KAPPA = "POK"
    AZIMUTH_TILT_SWING = "ATS"


# Axis and sense of the rotation of each angle, in the order in which they are applied.
_ROTATIONS = {
    AngleForm.OMEGA_PHI_KAPPA: ((0, 1.0), (1, 1.0), (2, 1.0)),
    AngleForm.PHI_OMEGA_KAPPA: ((1, 1.0), (0, 1.0), (2, 1.0)),
    AngleForm.AZIMUTH_TILT_SWING: ((2, -1.0), (0, 1.0), (2, 1.0)),
}
_OFFSET = {AngleForm.AZIMUTH_TILT_SWING: np.array([0.0, 0.0, -np.pi])}  # a swing of 180 degrees turns nothing


def matrix_of(angles: ArrayLike, form: AngleForm) -> FloatArray:
    """Return M (..., 3, 3), reference axes to photo, of angles (..., 3) rad."""
    if form is AngleForm.OMEGA_PHI_KAPPA:
        return attitude_matrix(angles)
    first, second, third = _factors(angles, form)
    return third @ second @ first


def angles_of(M: ArrayLike, form: AngleForm) -> FloatArray:
    """Return the angles (..., 3) rad of rotations M (..., 3, 3).

    Phi, the omega that comes second, lie within 90 degrees, tilts within 0 and 180 degrees, all else within half a
    turn. In a `gimbal` case the first angle is zero and the third has the turn of both.
    """
    M = np.asarray(M, dtype=float)
    if form is AngleForm.OMEGA_PHI_KAPPA:
        return attitude_from_matrix(M)
    if form is AngleForm.PHI_OMEGA_KAPPA:
        first, half_turn = np.arctan2(M[..., 2, 0], M[..., 2, 2]), 1.0
        second = np.arctan2(-M[..., 2, 1], np.hypot(M[..., 2, 0], M[..., 2, 2]))
    else:
        first, half_turn = np.arctan2(-M[..., 2, 0], -M[..., 2, 1]), -1.0
        second = np.arctan2(np.hypot(M[..., 2, 0], M[..., 2, 1]), M[..., 2, 2])
    first = np.where(gimbal(M, form), 0.0, first)
    axis, sense = _ROTATIONS[form][0]
    rest = M @ np.swapaxes(
        _about(axis, sense * first), -1, -2
    )  # what the first angle leaves, whatever rounding made it
    third = np.arctan2(-half_turn * rest[..., 1, 0], half_turn * rest[..., 0, 0])
    return np.stack([first, second, third], axis=-1)


def gimbal(M: ArrayLike, form: AngleForm) -> BoolArray:
    """Return (...) where first and third angle turn about one line, so that only their sum or difference is known.

    That is so at phi = 90 degrees (`OPK`), at omega = 90 degrees (`POK`), and at a tilt of zero (`ATS`): a truly
    vertical photograph has neither azimuth nor swing.
    """
    M = np.asarray(M, dtype=float)
    columns = (0, 1) if form is AngleForm.AZIMUTH_TILT_SWING else (0, 2)
    if form is AngleForm.OMEGA_PHI_KAPPA:
        columns = (1, 2)
    return np.hypot(M[..., 2, columns[0]], M[..., 2, columns[1]]) < GIMBAL


def angle_rates(angles: ArrayLike, form: AngleForm) -> FloatArray:
    """Return B (..., 3, 3) with w = B d(angles): the axes of the three angles, as columns along the reference axes.

    Singular in the gimbal cases.
    """
    first, second, _ = _factors(angles, form)
    rotations = _ROTATIONS[form]
    B = np.empty(first.shape)
    B[..., :, 0] = np.eye(3)[rotations[0][0]] * rotations[0][1]
    B[..., :, 1] = first[..., rotations[1][0], :] * rotations[1][1]
    B[..., :, 2] = (second @ first)[..., rotations[2][0], :] * rotations[2][1]
    return B


def in_axes(M: ArrayLike, axes: ArrayLike) -> FloatArray:
    """Return M (..., 3, 3) referred to other axes, the rows of `axes` (..., 3, 3) along the present ones."""
    return np.asarray(M) @ np.swapaxes(np.asarray(axes), -1, -2)


def angles_by_turn(M: ArrayLike, form: AngleForm, turn: ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return angles (..., 3) of M, their partials (..., 3, k), and the gimbal cases (...), in which these are NaN.

    `turn` (..., 3, k) is the small rotation of M, along its reference axes, by k parameters.
    """
    angles, lost = angles_of(M, form), gimbal(M, form)
    rates = angle_rates(angles, form)
    rates[lost] = np.eye(3)
    partials = np.asarray(np.linalg.solve(rates, np.asarray(turn, dtype=float)), dtype=float)
    partials[lost] = np.nan
    return angles, partials, lost


def _factors(angles: ArrayLike, form: AngleForm) -> list[FloatArray]:
    """Return the three rotations (..., 3, 3) in the order in which they are applied."""
    turned: FloatArray = np.asarray(angles, dtype=float) + _OFFSET.get(form, np.zeros(3))
    return [_about(axis, sense * turned[..., i]) for i, (axis, sense) in enumerate(_ROTATIONS[form])]


def _about(axis: int, angle: FloatArray) -> FloatArray:
    """Return R1, R2 or R3 (..., 3, 3) of angles (...)."""
    zero = np.zeros_like(angle)
    return attitude_matrix(np.stack([angle if i == axis else zero for i in range(3)], axis=-1))
