"""Comparator and stereocomparator: from readings along its rails to right-handed rectangular millimetres.

With readings (u, v) along the two rails, scales s_u and s_v (mm per unit), the angle epsilon by which the v rail
leans from the perpendicular towards u, the rotation rho of the rectangular system and h = -1 for a left-handed
comparator, else 1:

    x' = s_u u + s_v h v sin(epsilon)        x = x' cos(rho) - y' sin(rho)
    y' =         s_v h v cos(epsilon)        y = x' sin(rho) + y' cos(rho)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.reduction.inversion import solve

PARAMETERS = ("scale u", "scale v", "non-orthogonality", "rotation")


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparator:
    """The calibration of a comparator; the angles in radians, the scales in mm per unit of the readings."""

    scale: tuple[float, float] = (1.0, 1.0)
    non_orthogonality: float = 0.0
    rotation: float = 0.0
    left_handed: bool = False

    def parameters(self) -> FloatArray:
        """Return (s_u, s_v, epsilon, rho)."""
        return np.array([*self.scale, self.non_orthogonality, self.rotation])

    def matrix(self) -> FloatArray:
        """Return the matrix (2, 2) that takes readings to plate coordinates."""
        s_u, s_v, epsilon, rho = self.parameters()
        h = -1.0 if self.left_handed else 1.0
        return _rotation(rho) @ np.array([[s_u, h * s_v * np.sin(epsilon)], [0.0, h * s_v * np.cos(epsilon)]])

    def apply(self, xy: FloatArray) -> FloatArray:
        """Return plate coordinates (..., 2) mm of readings (..., 2)."""
        return xy @ self.matrix().T

    def inverse(self, xy: FloatArray) -> FloatArray:
        """Return the readings (..., 2) of plate coordinates (..., 2)."""
        return solve(self.matrix(), xy)

    def partials(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (..., 2, 2) of the plate coordinates by the readings (..., 2)."""
        return np.broadcast_to(self.matrix(), (*xy.shape[:-1], 2, 2))

    def by_parameters(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (..., 2, 4) of the plate coordinates by s_u, s_v, epsilon, rho."""
        s_u, s_v, epsilon, rho = self.parameters()
        u, v = xy[..., 0], xy[..., 1] * (-1.0 if self.left_handed else 1.0)
        sin, cos = math.sin(epsilon), math.cos(epsilon)
        zero = np.zeros_like(u)
        plate = np.stack([s_u * u + s_v * v * sin, s_v * v * cos], axis=-1)
        turned = np.stack([-plate[..., 1], plate[..., 0]], axis=-1)
        columns = [
            np.stack([u, zero], axis=-1),
            np.stack([v * sin, v * cos], axis=-1),
            np.stack([s_v * v * cos, -s_v * v * sin], axis=-1),
            turned,
        ]
        return _rotation(rho) @ np.stack(columns, axis=-1)


def from_matrix(A: FloatArray) -> Comparator:
    """Return the calibration with the linear part A (2, 2) of an affine transformation: its scales and angles.

    So an affine transformation fitted to a grid plate is a calibration, and that of a plate is read as one. The
    rotation is that of the u rail. Raises `ValueError` where A is singular.
    """
    area = float(A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0])
    s_u, s_v = float(np.hypot(A[0, 0], A[1, 0])), float(np.hypot(A[0, 1], A[1, 1]))
    if not abs(area) > 0.0:
        raise ValueError("the axes of a comparator are not parallel")
    h = -1.0 if area < 0.0 else 1.0
    cross = h * float(A[0, 0] * A[0, 1] + A[1, 0] * A[1, 1])
    return Comparator(
        scale=(s_u, s_v),
        non_orthogonality=math.asin(max(-1.0, min(1.0, cross / (s_u * s_v)))),
        rotation=math.atan2(A[1, 0], A[0, 0]),
        left_handed=area < 0.0,
    )


def parameter_covariance(comparator: Comparator, linear: FloatArray) -> FloatArray:
    """Return the covariance (4, 4) of scales and angles from that of the matrix elements, row by row (4, 4)."""
    by_parameters = np.swapaxes(comparator.by_parameters(np.eye(2)), 0, 1).reshape(
        4, 4
    )  # columns of the matrix -> rows
    J = np.linalg.inv(by_parameters)
    return J @ linear @ J.T


def _rotation(rho: float) -> FloatArray:
    return np.array([[np.cos(rho), -np.sin(rho)], [np.sin(rho), np.cos(rho)]])
