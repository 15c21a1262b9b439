"""Attitudes in other words: orders of rotation, axes that they refer to, and what becomes of their errors.

A rotation M takes vectors along three reference axes to the photo, as in `rotations`, with the same R1, R2, R3. All
forms are three rotations one after the other, so that matrices, rates and gimbal cases have one formula for all:

- `OMEGA_PHI_KAPPA`        (omega, phi, kappa), M = R3(kappa) R2(phi) R1(omega): the form of the adjustment
- `PHI_OMEGA_KAPPA`        (phi, omega, kappa), M = R3(kappa) R1(omega) R2(phi): phi is primary
- `AZIMUTH_TILT_SWING`     (alpha, t, s),       M = R3(s - pi) R1(t) R3(-alpha)

A small rotation w (rad, along the reference axes) is that of M (I - [w]x): it turns the photo by w.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.rotations import GIMBAL, attitude_from_matrix, attitude_matrix


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


def nearest_rotation(M: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the rotations (..., 3, 3) nearest to matrices, and by how much (...) their elements differ at most.

    By the singular value decomposition (Horn, Hilden and Negahdaripour, J. Opt. Soc. Am. A 5 (1988) 1127): what a
    card rounds is made orthogonal again. A mirror image differs by about 2 from its nearest rotation.
    """
    M = np.asarray(M, dtype=float)
    U, _, V = np.linalg.svd(M)
    sign = np.ones(M.shape[:-1])
    sign[..., 2] = np.linalg.det(U @ V)
    rotation = (U * sign[..., None, :]) @ V
    return rotation, np.abs(M - rotation).max(axis=(-2, -1))


def _factors(angles: ArrayLike, form: AngleForm) -> list[FloatArray]:
    """Return the three rotations (..., 3, 3) in the order in which they are applied."""
    turned: FloatArray = np.asarray(angles, dtype=float) + _OFFSET.get(form, np.zeros(3))
    return [_about(axis, sense * turned[..., i]) for i, (axis, sense) in enumerate(_ROTATIONS[form])]


def _about(axis: int, angle: FloatArray) -> FloatArray:
    """Return R1, R2 or R3 (..., 3, 3) of angles (...)."""
    zero = np.zeros_like(angle)
    return attitude_matrix(np.stack([angle if i == axis else zero for i in range(3)], axis=-1))
