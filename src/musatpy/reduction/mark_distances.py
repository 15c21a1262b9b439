"""The fiducial transformation where only distances between marks are calibrated, not their coordinates.

Certificates of older cameras give the distances between opposite marks; the classical correction divides each
coordinate by the ratio of the measured to the calibrated distance along it (Wolf and Dewitt, Elements of
Photogrammetry, chapter 4). Here the scales come from all calibrated distances by least squares, as the metric G
of the readings, D^2 = d^T G d for a distance D between marks that are d apart in the readings:

    UNIFORM  G = m I               one scale           one distance needed
    AXES     G = diag(m, n)        a scale per rail    two distances in different directions
    AFFINE   G = [[m, k], [k, n]]  scales and shear    three

Centre and axes then come from two pairs of marks: the lines that join them meet in the origin (the fiducial
centre). On plates with side marks the first line is the x axis, from its first mark to its second; with corner
marks the lines are diagonals, the first from lower left to upper right, the second from lower right to upper
left, and the x axis halves the angle between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.reduction.planar import Kind, Plane

_STEPS = 50
_SETTLED = 1e-14
_SINGULAR = 1e-6  # least ratio of singular values: distances in nearly one direction give no second scale


class Scales(StrEnum):
    """What the distances determine."""

    UNIFORM = "UNIFORM"
    AXES = "AXES"
    AFFINE = "AFFINE"


_ELEMENTS = {
    Scales.UNIFORM: np.array([[[1.0, 0.0], [0.0, 1.0]]]),
    Scales.AXES: np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]]),
    Scales.AFFINE: np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 1.0], [1.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]]),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class DistanceFit:
    """The affine transformation to the fiducial system, and how well e distances agree with it."""

    plane: Plane  # AFFINE
    metric: FloatArray  # (k,) m; m, n; or m, k, n of G
    cofactor: FloatArray  # (k, k) their covariance where sigma0 is 1
    residuals: FloatArray  # (e,) mm, scaled minus calibrated distance
    sigma0: float  # NaN without redundancy
    freedom: int


@dataclass(frozen=True, kw_only=True)
class Axes:
    """The two pairs of marks, as rows of the measured ones, whose lines meet in the origin."""

    first: tuple[int, int]
    second: tuple[int, int]
    corners: bool = False  # the lines are diagonals


def transform(
    scales: Scales, marks: FloatArray, ends: IntArray, distance: FloatArray, sigma: FloatArray, axes: Axes
) -> DistanceFit | None:
    """Return the transformation of measured marks (q, 2) by e calibrated distances; None where they do not give it.

    `ends` (e, 2) are rows of the marks, `distance` (e,) and `sigma` (e,) are mm. A mirrored plate, or parallel
    lines of the axes, give none.
    """
    d = marks[ends[:, 1]] - marks[ends[:, 0]]
    solved = _metric(scales, d, distance, sigma)
    if solved is None:
        return None
    m, cofactor = solved
    G = np.tensordot(m, _ELEMENTS[scales], axes=1)
    if not (G[0, 0] > 0.0 and np.linalg.det(G) > 0.0):
        return None
    plane = _placed(np.linalg.cholesky(G).T, marks, axes)
    if plane is None:
        return None
    v = _length(G, d) - distance
    freedom = len(distance) - len(m)
    return DistanceFit(
        plane=plane,
        metric=m,
        cofactor=cofactor,
        residuals=v,
        sigma0=float(np.sqrt(np.square(v / sigma).sum() / freedom)) if freedom else float("nan"),
        freedom=freedom,
    )


def _length(G: FloatArray, d: FloatArray) -> FloatArray:
    return np.sqrt(np.einsum("ei,ij,ej->e", d, G, d))


def _metric(
    scales: Scales, d: FloatArray, distance: FloatArray, sigma: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Return the elements of G and their cofactors. Gauss and Newton; dD/dm = d^T E d / (2 D)."""
    E = _ELEMENTS[scales]
    if len(distance) < len(E) or np.any(np.linalg.norm(d, axis=1) == 0.0):
        return None
    square = np.einsum("ei,kij,ej->ek", d, E, d)
    m = float((distance / np.linalg.norm(d, axis=1)).mean()) ** 2 * np.einsum("kii->k", E).clip(max=1.0)
    root = np.eye(len(E))
    for _ in range(_STEPS):
        D = _length(np.tensordot(m, E, axes=1), d)
        A = square / (2.0 * D * sigma)[:, None]
        U, s, Vt = np.linalg.svd(A, full_matrices=False)
        if not np.all(np.isfinite(s)) or s[-1] < _SINGULAR * s[0]:
            return None
        root = Vt.T / s
        step = root @ (U.T @ ((distance - D) / sigma))
        m = m + step
        if np.all(np.abs(step) <= _SETTLED * np.abs(m).max()):
            break
    return m, root @ root.T


def _placed(A: FloatArray, marks: FloatArray, axes: Axes) -> Plane | None:
    """Return the affine transformation with a linear part R A that puts centre and axes where the marks say."""
    xy = marks @ A.T
    a, b = xy[axes.first[0]], xy[axes.first[1]] - xy[axes.first[0]]
    c, e = xy[axes.second[0]], xy[axes.second[1]] - xy[axes.second[0]]
    area = b[0] * e[1] - b[1] * e[0]
    if area <= _SINGULAR * np.linalg.norm(b) * np.linalg.norm(e):  # parallel, or mirrored
        return None
    centre = a + b * ((c - a)[0] * e[1] - (c - a)[1] * e[0]) / area
    turn = math.atan2(b[1], b[0])
    if axes.corners:
        second = turn + math.atan2(area, b @ e)
        turn = 0.5 * (turn + second) - 0.5 * math.pi  # the diagonals stand on both sides of the y axis
    R = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    B, shift = R @ A, -R @ centre
    return Plane(kind=Kind.AFFINE, parameters=np.array([*B[0], *B[1], *shift]))
