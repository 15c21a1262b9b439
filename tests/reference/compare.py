"""Differences between solutions of the program and those of the reference, or others, in sigmas of the latter."""

import numpy as np

from musatpy.model import AdjustedStations, Block, Solution
from reference.dense_bundle import Result, Start
from reference.earth import earth_of


def beside(solution: Solution) -> Start:
    """A start for the reference where a solution stands, on its side of every tide.

    A point that dries at one tide may have a minimum on either side of it, both of them right.
    """
    stations, points = solution.stations, solution.points
    return Start(position=stations.position, attitude=stations.attitude, points=points.position)


def enu_difference(block: Block, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(r, 3) east, north, up metres from `other` to `one`, positions in the job's system."""
    earth = earth_of(block)
    native = earth.native(other)
    difference = earth.cartesian(earth.native(one)) - earth.cartesian(native)
    return np.asarray(np.einsum("rij,rj->ri", earth.frame(native), difference))


def sigmas(covariance: np.ndarray) -> np.ndarray:
    """(r, k) square roots of the diagonals of (r, k, k)."""
    return np.asarray(np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)))


def apart(one: Solution, other: Solution) -> tuple[np.ndarray, np.ndarray]:
    """(n, 6) and (p, 3) differences of stations and ground points of two solutions, each over the other's sigma."""
    return station_difference(one, other.stations), _points(one, other.points.position, other.points.covariance)


def station_difference(solution: Solution, result: Result | AdjustedStations) -> np.ndarray:
    """(n, 6) differences of stations, each over its sigma."""
    turn = solution.stations.attitude - result.attitude
    turn -= 2.0 * np.pi * np.round(turn / (2.0 * np.pi))
    metres = enu_difference(solution.block, solution.stations.position, result.position)
    return np.hstack([metres, turn]) / sigmas(result.covariance)


def point_difference(solution: Solution, result: Result) -> np.ndarray:
    """(p, 3) differences of ground points over their sigmas, NaN where not determined."""
    return _points(solution, result.points, result.point_covariance)


def _points(solution: Solution, points: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    sigma = sigmas(covariance)
    known = np.isfinite(points).all(axis=1)
    difference = np.full(points.shape, np.nan)
    metres = enu_difference(solution.block, solution.points.position[known], points[known])
    # A component held fixed has no sigma. 5 cm stand for it: 1e-6 of that is 5e-8 m, rounding of the geodesy.
    difference[known] = metres / np.where(sigma[known] < 1e-9, 0.05, sigma[known])
    return difference


def free_cofactors(J: np.ndarray, points: np.ndarray | slice, defect: int) -> np.ndarray:
    """Return Q (u, u) under inner constraints over the rows of points, from the eigenvectors of the dense normals.

    `J` is the Jacobian (r, u) of whitened observations; asserts that as many motions are free as the defect says.
    """
    scale = np.linalg.norm(J, axis=0)
    values, vectors = np.linalg.eigh((J / scale).T @ (J / scale))
    assert values[defect] > 1e4 * abs(values[defect - 1])
    H = vectors[:, :defect] / scale[:, None]
    Q = (vectors[:, defect:] / values[defect:]) @ vectors[:, defect:].T / np.outer(scale, scale)
    E = np.zeros_like(H)
    E[points] = H[points]
    S = np.eye(len(Q)) - H @ np.linalg.solve(E.T @ H, E.T)
    return np.asarray(S @ Q @ S.T)


def covariance_difference(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(r, k, k) differences of covariances over the product of the sigmas of `other`."""
    sigma = sigmas(other)
    scale = sigma[..., :, None] * sigma[..., None, :]
    return np.asarray((one - other) / np.where(scale == 0.0, 1.0, scale))
