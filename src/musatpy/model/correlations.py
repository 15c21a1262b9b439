"""Covariances of three coordinates as cards have them: sigmas, and correlations of 1 and 2, 1 and 3, 2 and 3."""

import numpy as np

from musatpy.arrays import FloatArray

LEAST_EIGENVALUE = 1e-6  # of a matrix of correlations: a millionth is their last digit on cards
_PAIRS = np.triu_indices(3, 1)


def correlations_of(values: FloatArray) -> FloatArray:
    """Return the matrices (k, 3, 3) of correlations (k, 3)."""
    matrix = np.tile(np.eye(3), (len(values), 1, 1))
    matrix[:, _PAIRS[0], _PAIRS[1]] = matrix[:, _PAIRS[1], _PAIRS[0]] = values
    return matrix


def smallest_eigenvalues(values: FloatArray) -> FloatArray:
    """Return those (k,) of the matrices of correlations (k, 3)."""
    return np.asarray(np.linalg.eigvalsh(correlations_of(values))[:, 0])


def on_cards(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return sigmas (k, 3), and correlations (k, 3), NaN where a sigma is zero, of covariances (k, 3, 3)."""
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = covariance / (sigma[:, :, None] * sigma[:, None, :])
    return sigma, scaled[:, _PAIRS[0], _PAIRS[1]]
