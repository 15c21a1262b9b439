"""Attitudes of a body that carries a camera: the angles of inertial units, and what lies between two attitudes.

The axes of the body are x forward, y left, z up. P takes vectors along east, north, up, or other reference axes, to
the body. With the rotations R1, R2, R3 of axes, as in `collinearity`,

- `OPK`    omega, phi, kappa,     P = R3(kappa) R2(phi) R1(omega)
- `POK`    phi, omega, kappa,     P = R3(kappa) R1(omega) R2(phi)
- `RPY`    roll, pitch, heading,  P = F R' C,  R = Rz(heading) Ry(pitch) Rx(roll)

where R, of rotations of vectors (ARINC 705, ISO 1151-2), takes vectors along x forward, y right, z down to north,
east, down; F = diag(1, -1, -1), and C takes east, north, up to north, east, down. Heading is clockwise from north,
roll positive with the right wing down, pitch with the nose up.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray
from musatpy.geometry.collinearity import AngleForm, angles_of, matrix_of, skew

_F = np.diag([1.0, -1.0, -1.0])
_C = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_OPK = AngleForm.OMEGA_PHI_KAPPA
_SMALL = 1e-4  # rad: below, series have all digits


class BodyAngles(StrEnum):
    """Which three angles state the attitude of a body, in the order of their names."""

    OMEGA_PHI_KAPPA = "OPK"
    PHI_OMEGA_KAPPA = "POK"
    ROLL_PITCH_HEADING = "RPY"


def body_matrix(angles: ArrayLike, form: BodyAngles) -> FloatArray:
    """Return P (..., 3, 3), reference axes to body, of angles (..., 3) rad."""
    if form is not BodyAngles.ROLL_PITCH_HEADING:
        return matrix_of(angles, AngleForm(form.value))
    R = matrix_of(-np.asarray(angles, dtype=float), _OPK)  # rotations of vectors are those of axes turned back
    return np.asarray(_F @ np.swapaxes(R, -1, -2) @ _C)


def body_angles(P: ArrayLike, form: BodyAngles) -> FloatArray:
    """Return the angles (..., 3) rad of P (..., 3, 3), each within half a turn: the inverse of `body_matrix`."""
    if form is not BodyAngles.ROLL_PITCH_HEADING:
        return angles_of(P, AngleForm(form.value))
    return -angles_of(np.swapaxes(_F @ np.asarray(P, dtype=float) @ _C.T, -1, -2), _OPK)


def rotation_vector(R: FloatArray) -> FloatArray:
    """Return w (..., 3) rad with R = exp([w]x), of rotations R (..., 3, 3); its length is at most pi."""
    from scipy.spatial.transform import Rotation  # of few jobs

    return np.asarray(Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(R.shape[:-1]))


def inverse_right_jacobian(w: FloatArray) -> FloatArray:
    """Return J (..., 3, 3) with log(exp([w]x) exp([d]x)) = w + J d for small d, of w (..., 3) up to half a turn.

    J = I + [w]x/2 + (1/t2 - cot(t/2)/2t) [w]x[w]x, t = |w| (Chirikjian, Stochastic Models 2 (2012), 10.86).
    """
    t = np.linalg.norm(w, axis=-1)
    safe = np.where(t > _SMALL, t, 1.0)
    c = np.where(t > _SMALL, 1.0 / safe**2 - 0.5 / (safe * np.tan(0.5 * safe)), 1.0 / 12.0)
    W = skew(w)
    return np.eye(3) + 0.5 * W + c[..., None, None] * (W @ W)
