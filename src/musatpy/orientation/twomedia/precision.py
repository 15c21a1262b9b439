"""What errors of images and control do to an orientation through water, and what checks them.

Then how the unknowns depend on one another, in words.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.orientation.twomedia.helmert import Adjusted, HelmertProblem, inverse_of_normals
from musatpy.orientation.twomedia.rays import IMAGE, PHOTO, WATER, image_rays, refracted

OF_PHOTO = ("omega", "phi", "kappa", "X0", "Y0", "Z0")
OF_WATER = ("tilt along X", "tilt along Y", "level", "index")
_MOVED = 0.01  # part of a direction, of 1, from which it moves photos or water
_NAMED = 4  # unknowns of a direction
_NAMED_SHARE = 0.3  # of the largest part of a direction, for a part to be named
_ROUNDING = 1e-14  # of the largest eigenvalue, that of the smallest
_FREE = 1e3  # rad, or heights of the stations over the water: the sigma from which a direction is free


def gains(problem: HelmertProblem, adjusted: Adjusted) -> list[FloatArray]:
    """Return by how much misclosures of the groups lower the vector of one orientation, each (k, 6 m + 4, q)."""
    inverse = inverse_of_normals(problem, adjusted.at, adjusted.linear)[0]
    return [inverse @ np.swapaxes(part.by_unknown[0], 1, 2) @ part.estimate[0] for part in adjusted.linear]


def covariance_of(problem: HelmertProblem, adjusted: Adjusted) -> FloatArray:
    """Return the covariance (6 m + 4, 6 m + 4) for unit weight: of equal weights that of what these propagate."""
    inverse = inverse_of_normals(problem, adjusted.at, adjusted.linear)[0]
    if not problem.equal:
        return inverse
    covariance = np.zeros_like(inverse)
    for gain, part in zip(gains(problem, adjusted), adjusted.linear, strict=True):
        by_values = gain @ part.by_values[0]
        covariance += np.sum((by_values * part.variance[:, None]) @ np.swapaxes(by_values, 1, 2), axis=0)
    return covariance


def expected_squares(problem: HelmertProblem, adjusted: Adjusted) -> tuple[float, float]:
    """Return the mean of v' Q^-1 v after any estimate, and the degrees of freedom of a chi-square of its variance.

    Satterthwaite, Biometrics Bulletin 2 (1946) 110; both are the redundancy where the weights are those of v.
    """
    parts = adjusted.linear
    B = np.concatenate([part.by_unknown[0].reshape(-1, len(problem.unknown)) for part in parts])
    G = np.concatenate([np.concatenate([*gain], axis=1) for gain in gains(problem, adjusted)], axis=1)
    A = block_diag(*(block for part in parts for block in part.by_values[0]))
    spread = A * np.concatenate([part.variance.ravel() for part in parts]) @ A.T
    W = block_diag(*(block for part in parts for block in part.weight[0]))
    left = np.eye(len(B)) - B @ G
    K = W @ left @ spread @ left.T
    mean = float(np.trace(K))
    return mean, mean**2 / float(np.sum(K * K.T))


def redundancy_numbers(problem: HelmertProblem, adjusted: Adjusted) -> FloatArray:
    """Return the redundancy numbers (n, 2) of the images: the diagonal of Q A' W (1 - B G) A with the gains G."""
    redundancy = np.full(problem.image.shape, np.nan)
    for group, part, gain in zip(problem.groups, adjusted.linear, gains(problem, adjusted), strict=True):
        A, W = part.by_values[0], part.weight[0]
        left = A - part.by_unknown[0] @ (gain @ A)
        share = part.variance * np.sum(A * (W @ left), axis=1)
        k, r = group.images.shape
        redundancy[group.images] = share[:, : 2 * r].reshape(k, r, 2)
    return redundancy


def image_partials(
    problem: HelmertProblem, adjusted: Adjusted, rows: IntArray, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the partials of the images (k, r) of points (k, 3), by the point (k, 2 r, 3) and the orientation."""
    k, r = rows.shape
    images = rows.ravel()
    photo, wet, rise = problem.photo[images], problem.wet[images], problem.rise[images]
    bundle = image_rays(adjusted.at, photo, adjusted.image[:, images], wet, rise)
    conditions = refracted(bundle[np.arange(k * r).reshape(k, r)], points[None], adjusted.at)
    by_rays = conditions.by_rays[0]
    by_image = by_rays[..., IMAGE].reshape(k, 2 * r, 2 * r)
    by_unknown = np.zeros((k, 2 * r, len(problem.unknown)))
    for ray in range(r):
        columns = PHOTO * problem.photo[rows[:, ray], None, None] + np.arange(PHOTO)
        columns = np.broadcast_to(columns, (k, 2 * r, PHOTO))
        np.put_along_axis(by_unknown, columns, by_rays[:, :, ray, :PHOTO], axis=-1)
        by_unknown[..., -WATER:] += by_rays[:, :, ray, PHOTO : PHOTO + WATER]
    inverse = -np.linalg.inv(by_image)
    return inverse @ conditions.by_control[0], inverse @ by_unknown


# --- what determines the unknowns ---


@dataclass(frozen=True, kw_only=True, eq=False)
class Direction:
    """A direction of the unknowns: its parts (6 m + 4,), scaled, its eigenvalue, and what it moves in words."""

    parts: FloatArray
    eigenvalue: float
    words: str

    @property
    def moves_photos(self) -> bool:
        """Whether it is not of the water alone."""
        return bool(np.abs(self.parts[:-WATER]).max() > _MOVED)

    @property
    def moves_water(self) -> bool:
        """Whether it moves the plane of water."""
        return bool(np.abs(self.parts[-WATER:-1]).max() > _MOVED)


def inflation(adjusted: Adjusted, unknown: BoolArray) -> FloatArray:
    """Return the variance inflation factors (6 m + 4,) of one solution, NaN for what is held.

    By how much the variance of an unknown grows because the others are not known: diag(N) diag(N^-1).
    """
    N = scaled(_normals(adjusted, adjusted.normals[0], unknown))
    factors = np.full(len(unknown), np.nan)
    factors[unknown] = np.diagonal(np.linalg.pinv(N, hermitian=True))
    return factors


def weakest(adjusted: Adjusted, unknown: BoolArray, photos: TextArray) -> list[Direction]:
    """Return the two weakest directions of the normals scaled to unit diagonal, the weakest first."""
    N = scaled(_normals(adjusted, adjusted.normals[0], unknown))
    return _directions(N, unknown, photos)[:2]


def free(problem: HelmertProblem, adjusted: Adjusted, photos: TextArray, *, priors: bool) -> list[Direction]:
    """Return the directions of one solution that its conditions, with its `priors` or without, leave free.

    Of what nothing moves the normals are rounding, which a scale of their own would hide: the units are the radian
    and the height of the stations over the water.
    """
    T = adjusted.directions[0]
    information = (T.T * np.square(1.0 / problem.prior)) @ T
    along = adjusted.normals[0] - (0.0 if priors else information)
    units = adjusted.at.units[0, problem.unknown]
    N = _normals(adjusted, along, problem.unknown) * np.outer(units, units)
    directions = _directions(N, problem.unknown, photos)
    rounding = _ROUNDING * directions[-1].eigenvalue
    return [direction for direction in directions if direction.eigenvalue < max(_FREE**-2, rounding)]


def _normals(adjusted: Adjusted, along: FloatArray, unknown: BoolArray) -> FloatArray:
    """Return the normals (u, u) of the unknowns from those along the directions of the steps."""
    inverse = np.linalg.inv(adjusted.directions[0, unknown])
    return np.asarray(inverse.T @ along @ inverse)


def scaled(N: FloatArray) -> FloatArray:
    """Return normals scaled to unit diagonal, zeros where nothing determines an unknown."""
    diagonal = np.diagonal(N)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, np.inf))
    return N * np.outer(scale, scale)


def _directions(N: FloatArray, unknown: BoolArray, photos: TextArray) -> list[Direction]:
    """Return the eigenvectors of normals (u, u), the weakest first."""
    names = [f"{name} of {photo}" if len(photos) > 1 else name for photo in photos for name in OF_PHOTO]
    names += OF_WATER
    eigenvalues, axes = np.linalg.eigh(N)
    directions = []
    for eigenvalue, axis in zip(eigenvalues, axes.T, strict=True):
        parts = np.zeros(len(unknown))
        parts[unknown] = axis
        size = np.abs(parts)
        order = [row for row in np.argsort(-size)[:_NAMED] if size[row] > _NAMED_SHARE * size.max()]
        words = " with ".join(names[row] for row in order)
        directions.append(Direction(parts=parts, eigenvalue=float(eigenvalue), words=words))
    return directions
