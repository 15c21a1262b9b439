"""What errors of images and control do to an orientation through water, and what checks them."""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from musatpy.arrays import FloatArray, IntArray
from musatpy.orientation.twomedia.conditions import refracted
from musatpy.orientation.twomedia.helmert import Adjusted, Problem
from musatpy.orientation.twomedia.rays import IMAGE, PHOTO, WATER, image_rays


def gains(problem: Problem, adjusted: Adjusted) -> list[FloatArray]:
    """Return by how much misclosures of the groups lower the vector of one orientation, each (k, 6 m + 4, q)."""
    inverse = _inverse(problem, adjusted)
    return [inverse @ np.swapaxes(part.by_unknown[0], 1, 2) @ part.estimate[0] for part in adjusted.linear]


def covariance_of(problem: Problem, adjusted: Adjusted) -> FloatArray:
    """Return the covariance (6 m + 4, 6 m + 4) for unit weight: of equal weights that of what these propagate."""
    inverse = _inverse(problem, adjusted)
    if not problem.equal:
        return inverse
    covariance = np.zeros_like(inverse)
    for gain, part in zip(gains(problem, adjusted), adjusted.linear, strict=True):
        by_values = gain @ part.by_values[0]
        covariance += np.sum((by_values * part.variance[:, None]) @ np.swapaxes(by_values, 1, 2), axis=0)
    return covariance


def _inverse(problem: Problem, adjusted: Adjusted) -> FloatArray:
    """Return the inverse (6 m + 4, 6 m + 4) of the normals of the estimate."""
    T = adjusted.directions[0]
    N = (T.T * np.square(1.0 / problem.prior)) @ T
    for part in adjusted.linear:
        BT = part.by_unknown[0] @ T
        N += np.sum(np.swapaxes(BT, 1, 2) @ part.estimate[0] @ BT, axis=0)
    return np.asarray(T @ np.linalg.pinv(N, hermitian=True) @ T.T)


def expected_squares(problem: Problem, adjusted: Adjusted) -> tuple[float, float]:
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


def redundancy_numbers(problem: Problem, adjusted: Adjusted) -> FloatArray:
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
    problem: Problem, adjusted: Adjusted, rows: IntArray, points: FloatArray
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
        values = np.take_along_axis(by_unknown, np.broadcast_to(columns, (k, 2 * r, PHOTO)), axis=-1)
        np.put_along_axis(
            by_unknown, np.broadcast_to(columns, (k, 2 * r, PHOTO)), values + by_rays[:, :, ray, :PHOTO], axis=-1
        )
        by_unknown[..., -WATER:] += by_rays[:, :, ray, PHOTO : PHOTO + WATER]
    inverse = -np.linalg.inv(by_image)
    return inverse @ conditions.by_control[0], inverse @ by_unknown
