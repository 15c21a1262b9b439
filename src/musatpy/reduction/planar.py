"""Plane transformations between comparator and plate: similarity, affine, projective; fitted to marks.

All are homographies w (x, y, 1) = H (u, v, 1) whose matrix is linear in the parameters, so one set of formulas
serves: with q = (u, v, 1) and w = H[2] q,

    x = H[0] q / w,   dx/du = (H[0, :2] - x H[2, :2]) / w,   dx/dp_i = (E_i[0] q - x E_i[2] q) / w

where E_i = dH/dp_i; y likewise.

Comparator and stereocomparator: from readings along its rails to right-handed rectangular millimetres.

With readings (u, v) along the two rails, scales s_u and s_v (mm per unit), the angle epsilon by which the v rail
leans from the perpendicular towards u, the rotation rho of the rectangular system and h = -1 for a left-handed
comparator, else 1:

    x' = s_u u + s_v h v sin(epsilon)        x = x' cos(rho) - y' sin(rho)
    y' =         s_v h v cos(epsilon)        y = x' sin(rho) + y' cos(rho)

The inverse of a small displacement in the plate, by Newton's method.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from musatpy.arrays import FloatArray

_STEPS = 50
_SETTLED = 1e-13  # of the parameters' own size
_SINGULAR = 1e-10  # least ratio of singular values of the scaled design: marks on a line fall far below


class PlanarKind(StrEnum):
    """Which transformation, by the number of its parameters."""

    SIMILARITY = "SIMILARITY"  # x = a u - b v + tx, y = b u + a v + ty
    AFFINE = "AFFINE"  # x = a u + b v + tx, y = c u + d v + ty
    PROJECTIVE = "PROJECTIVE"  # x = (a1 u + a2 v + a3) / (c1 u + c2 v + 1), y = (b1 u + b2 v + b3) / (same)


# Parameter -> (row, column, factor) of the elements of H that it stands in.
_Places = dict[str, tuple[tuple[int, int, float], ...]]


def _single(names: str, elements: str) -> _Places:
    """Return the places of parameters that stand in one element each."""
    pairs = zip(names.split(), elements.split(), strict=True)
    return {name: ((int(element[0]), int(element[1]), 1.0),) for name, element in pairs}


_PLACES: dict[PlanarKind, _Places] = {
    PlanarKind.SIMILARITY: {
        "a": ((0, 0, 1.0), (1, 1, 1.0)),
        "b": ((1, 0, 1.0), (0, 1, -1.0)),
        **_single("tx ty", "02 12"),
    },
    PlanarKind.AFFINE: _single("a b c d tx ty", "00 01 10 11 02 12"),
    PlanarKind.PROJECTIVE: _single("a1 a2 a3 b1 b2 b3 c1 c2", "00 01 02 10 11 12 20 21"),
}
MARKS_NEEDED = {PlanarKind.SIMILARITY: 2, PlanarKind.AFFINE: 3, PlanarKind.PROJECTIVE: 4}


def parameter_names(kind: PlanarKind) -> tuple[str, ...]:
    """Return the names of the parameters, in the order of their array."""
    return tuple(_PLACES[kind])


def _basis(kind: PlanarKind) -> FloatArray:
    """Return dH/dp, (k, 3, 3)."""
    places = _PLACES[kind]
    E = np.zeros((len(places), 3, 3))
    for i, elements in enumerate(places.values()):
        for row, column, factor in elements:
            E[i, row, column] = factor
    return E


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarTransformation:
    """One transformation: its kind and parameters (k,)."""

    kind: PlanarKind
    parameters: FloatArray

    def matrix(self) -> FloatArray:
        """Return the homography H (3, 3), H[2, 2] = 1."""
        corner = np.zeros((3, 3))
        corner[2, 2] = 1.0
        return corner + np.tensordot(self.parameters, _basis(self.kind), axes=1)

    def apply(self, xy: FloatArray) -> FloatArray:
        """Return the transformed points (..., 2) of xy (..., 2)."""
        image = _homogeneous(xy) @ self.matrix().T
        return image[..., :2] / image[..., 2:]

    def partials(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (..., 2, 2) of the transformed points by xy (..., 2)."""
        H = self.matrix()
        out, w = self.apply(xy), _weight(H, xy)
        return (H[:2, :2] - out[..., None] * H[2, :2]) / w[..., None, None]

    def by_parameters(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (..., 2, k) of the transformed points by the parameters."""
        out, w = self.apply(xy), _weight(self.matrix(), xy)
        Eq = np.einsum("kij,...j->...ik", _basis(self.kind), _homogeneous(xy))
        return (Eq[..., :2, :] - out[..., None] * Eq[..., 2:, :]) / w[..., None, None]


def _homogeneous(xy: FloatArray) -> FloatArray:
    return np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)


def _weight(H: FloatArray, xy: FloatArray) -> FloatArray:
    return xy @ H[2, :2] + H[2, 2]


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A transformation fitted to q marks by least squares."""

    plane: PlanarTransformation
    cofactor: FloatArray  # (k, k) covariance of the parameters where sigma0 is 1
    residuals: FloatArray  # (q, 2) mm, transformed minus calibrated
    normalized: FloatArray  # (q, 2) residual over its own sigma; NaN where the mark is not controlled
    sigma0: float  # of unit weight; NaN without redundancy
    freedom: int

    @property
    def covariance(self) -> FloatArray:
        """Return the covariance (k, k) of the parameters, by sigma0; by the given sigmas where there is none."""
        return self.cofactor * (self.sigma0**2 if self.freedom else 1.0)

    @property
    def linear_covariance(self) -> FloatArray:
        """Return the covariance (4, 4) of H[0, 0], H[0, 1], H[1, 0], H[1, 1], from which scales and angles come."""
        E = _basis(self.plane.kind)[:, :2, :2].reshape(-1, 4)
        return E.T @ self.covariance @ E


def fit(
    kind: PlanarKind,
    measured: FloatArray,
    calibrated: FloatArray,
    reading_sigma: FloatArray,
    mark_sigma: FloatArray,
) -> Fit | None:
    """Return the transformation from measured (q, 2) to calibrated (q, 2); None where the marks do not give it.

    `mark_sigma` (q, 2) mm is of the calibrated coordinates, `reading_sigma` (q, 2) of the readings in their unit;
    a residual weighs by both, the readings' taken through the transformation (the combined case of least squares,
    Mikhail and Ackermann 1976; first order in the residuals). Gauss and Newton, from the affine one.
    """
    if 2 * len(measured) < len(_PLACES[kind]):
        return None
    plane = _start(kind, measured, calibrated)
    if plane is None:
        return None
    for _ in range(_STEPS):
        C = _residual_covariance(plane, measured, reading_sigma, mark_sigma)
        solved = _step(plane, measured, calibrated, C)
        if solved is None:
            return None
        step, cofactor = solved
        plane = PlanarTransformation(kind=kind, parameters=plane.parameters + step)
        if np.all(np.abs(step) <= _SETTLED * _sizes(kind, plane, measured)):
            break
    return _summary(plane, measured, calibrated, C, cofactor)


def _start(kind: PlanarKind, measured: FloatArray, calibrated: FloatArray) -> PlanarTransformation | None:
    """Return a first transformation: the unit one for the linear kinds, the affine one for the projective."""
    if kind is not PlanarKind.PROJECTIVE:
        return PlanarTransformation(
            kind=kind,
            parameters=np.array([1.0, 0, 0, 0] if kind is PlanarKind.SIMILARITY else [1.0, 0, 0, 1, 0, 0]),
        )
    ones = np.ones_like(calibrated)
    affine = fit(PlanarKind.AFFINE, measured, calibrated, np.zeros_like(ones), ones)
    if affine is None:
        return None
    a, b, c, d, tx, ty = affine.plane.parameters
    return PlanarTransformation(kind=kind, parameters=np.array([a, b, tx, c, d, ty, 0.0, 0.0]))


def _residual_covariance(
    plane: PlanarTransformation, measured: FloatArray, reading_sigma: FloatArray, mark_sigma: FloatArray
) -> FloatArray:
    """Return the covariances (q, 2, 2) of the discrepancies at the marks."""
    J = plane.partials(measured)
    of_marks = np.square(mark_sigma)[:, None, :] * np.eye(2)
    return of_marks + np.einsum("qij,qj,qkj->qik", J, np.square(reading_sigma), J)


def _step(
    plane: PlanarTransformation, measured: FloatArray, calibrated: FloatArray, C: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Return the step of the parameters and their cofactors; None where the design is singular."""
    L = np.linalg.inv(np.linalg.cholesky(C))  # whitens the discrepancies
    A = (L @ plane.by_parameters(measured)).reshape(2 * len(measured), -1)
    b = np.einsum("qij,qj->qi", L, calibrated - plane.apply(measured)).reshape(-1)
    scale = np.linalg.norm(A, axis=0)
    if not np.all(np.isfinite(scale)) or np.any(scale == 0.0):
        return None
    U, s, Vt = np.linalg.svd(A / scale, full_matrices=False)
    if s[-1] < _SINGULAR * s[0]:
        return None
    root = Vt.T / s  # (k, k)
    return root @ (U.T @ b) / scale, root @ root.T / np.outer(scale, scale)


def _sizes(kind: PlanarKind, plane: PlanarTransformation, measured: FloatArray) -> FloatArray:
    """Return what each parameter is compared with: the change of it that moves a mark by the plate's size."""
    effect = np.abs(plane.by_parameters(measured)).max(axis=(0, 1))
    reach = np.abs(plane.apply(measured)).max()
    return reach / np.maximum(effect, np.finfo(float).tiny)


def _summary(
    plane: PlanarTransformation, measured: FloatArray, calibrated: FloatArray, C: FloatArray, cofactor: FloatArray
) -> Fit:
    v = plane.apply(measured) - calibrated
    freedom = v.size - len(plane.parameters)
    squares = float(np.einsum("qi,qij,qj->", v, np.linalg.inv(C), v))
    A = plane.by_parameters(measured)
    Qv = C - A @ cofactor @ np.swapaxes(A, 1, 2)
    variance = np.diagonal(Qv, axis1=1, axis2=2)
    controlled = variance > 1e-8 * np.diagonal(C, axis1=1, axis2=2)  # else it is rounding
    normalized = np.where(controlled, v / np.sqrt(np.where(controlled, variance, 1.0)), np.nan)
    return Fit(
        plane=plane,
        cofactor=cofactor,
        residuals=v,
        normalized=normalized,
        sigma0=float(np.sqrt(squares / freedom)) if freedom else float("nan"),
        freedom=freedom,
    )


COMPARATOR_PARAMETERS = ("scale u", "scale v", "non-orthogonality", "rotation")


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
    of_columns = comparator.by_parameters(np.eye(2))
    J = np.linalg.inv(np.swapaxes(of_columns, 0, 1).reshape(4, 4))  # columns of the matrix -> rows
    return J @ linear @ J.T


def _rotation(rho: float) -> FloatArray:
    return np.array([[np.cos(rho), -np.sin(rho)], [np.sin(rho), np.cos(rho)]])


PlaneFunction = Callable[[FloatArray], FloatArray]

TOLERANCE = 1e-11  # mm: well below the 1e-9 mm that an inverse is good for
_INVERSE_STEPS = 30


def invert(function: PlaneFunction, partials: PlaneFunction, target: FloatArray) -> FloatArray:
    """Return xy (..., 2) with function(xy) = target (..., 2), mm, to 1e-9 mm or better.

    `function` moves points (..., 2) by little, `partials` are its derivatives (..., 2, 2). Points at which the
    iteration does not settle, or settles where the plane is folded over (no plate has such distortion), are NaN.
    """
    xy = np.array(target, dtype=float)
    settled = np.zeros(xy.shape[:-1], dtype=bool)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for _ in range(_INVERSE_STEPS):
            miss = function(xy) - target
            step = solve(partials(xy), miss)
            xy = np.where(settled[..., None], xy, xy - step)
            settled |= np.abs(step).max(axis=-1) < TOLERANCE
            if settled.all():
                break
        J = partials(xy)
        settled &= (np.linalg.det(J) > 0.0) & (np.trace(J, axis1=-2, axis2=-1) > 0.0)
    return np.where(settled[..., None], xy, np.nan)


def solve(J: FloatArray, b: FloatArray) -> FloatArray:
    """Return J^-1 b for 2 by 2 matrices J (..., 2, 2) and vectors b (..., 2); not finite where J is singular."""
    return np.einsum("...ij,...j->...i", inverse(J), b)


def inverse(J: FloatArray) -> FloatArray:
    """Return the inverses of 2 by 2 matrices (..., 2, 2); not finite where there is none."""
    a, b, c, d = J[..., 0, 0], J[..., 0, 1], J[..., 1, 0], J[..., 1, 1]
    adjoint = np.empty_like(J)
    adjoint[..., 0, 0], adjoint[..., 0, 1], adjoint[..., 1, 0], adjoint[..., 1, 1] = d, -b, -c, a
    return adjoint / (a * d - b * c)[..., None, None]
