"""Robust estimation by weights that depend on the residuals: gross errors lose theirs while the block settles."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray
from musatpy.geometry import similarity

Weights = TypeVar("Weights")

STEPS = 24  # of an adjustment, each with weights of its own
_LEAST = 1e-11  # weight that keeps a point determined; with more, errors of kilometres pull
_LOST = 1e3  # sigmas, for residuals that make no sense
FITS = 4.0  # normal quantile of the squares with which observations still fit


def chi_square_limit(redundancy: int, normal: float = FITS) -> float:
    """Return the quantile of chi-square (Wilson and Hilferty 1931), as rare as a `normal` one: so far it fits."""
    part = 2.0 / (9.0 * redundancy)
    return float(redundancy * (1.0 - part + normal * np.sqrt(part)) ** 3)


def cauchy(size: FloatArray, scale: float) -> FloatArray:
    """Return Cauchy's weights of residuals `size` in sigmas; NaN counts as lost."""
    size = np.nan_to_num(size, nan=_LOST, posinf=_LOST, neginf=-_LOST)
    return np.maximum(similarity.cauchy(size, scale), _LEAST)


def robust_scale(size: FloatArray) -> float:
    """Return the scale of residuals in sigmas by their median, at least 1: what is good stays so."""
    return similarity.spread(np.abs(size[np.isfinite(size)]), 1.0)


def reweighted(
    state: State, weights_at: Callable[[State], Weights], stepped: Callable[[Weights, State], tuple[State, bool]]
) -> State:
    """Return the state after steps of an adjustment, each with new weights, until one says that it is the last.

    Raises `SingularNormalsError`.
    """
    for _ in range(STEPS):
        state, last = stepped(weights_at(state), state)
        if last:
            break
    return state
