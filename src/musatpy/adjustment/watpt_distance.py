"""How far a result of WATPT is from the rigorous one: a step of the rigorous triangulation, in its sigmas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment.ground import settle
from musatpy.adjustment.iteration import LeastSquares
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import PARAMETERS, Factor
from musatpy.adjustment.unknowns import State
from musatpy.model import AdjustedStations, Block, GroundPoints

FloatArray = NDArray[np.float64]

LEAST_SIGMA0 = 0.1  # images that fit better than that are made, without errors: their sigmas mean nothing
FAR = 0.3  # sigmas: more than a tenth of the variance, and what a reader of the listing would want to know


@dataclass(frozen=True, kw_only=True)
class Distance:
    """The largest change of an adjusted value by the step, in its sigmas, and what has it."""

    sigmas: float
    name: str


def distance_from_rigorous(
    block: Block,
    refracted: Network,
    problem: LeastSquares,
    factor: Factor,
    state: State,
    stations: AdjustedStations,
    points: GroundPoints,
) -> Distance:
    """Return how far the result of WATPT in `state` is from that of RIGOROUS; the state stays as it is.

    One Gauss-Newton step of `problem`, the triangulation of the `refracted` network, from the points that its rays
    give; `factor` is that of its normals. The sigmas are those of the result. Another step changes next to nothing:
    what is left of the first one is of the second order.
    """
    start = settle(refracted, state)
    line = problem.linearise(start)
    step = factor.solve(line.rhs)
    end = problem.apply(start, step, line.context)
    of_stations = step[: 6 * refracted.photos].reshape(-1, 6)
    axes = np.full((refracted.points, 3, 3), np.nan)
    used = np.concatenate([group.point for group in refracted.groups])
    axes[used] = refracted.frame.axes(state.ground[used])
    of_points = np.einsum("pij,pj->pi", axes, end.ground - state.ground)
    away = [
        _in_sigmas(of_stations, stations.covariance),
        _in_sigmas(of_points, points.covariance),
    ]
    photo, parameter = np.unravel_index(away[0].argmax(), away[0].shape)
    point, component = np.unravel_index(away[1].argmax(), away[1].shape)
    named = (
        (away[0].max(), f"{PARAMETERS[parameter]} of photo {block.photos.ids[photo]}"),
        (away[1].max(), f"{PARAMETERS[component]} of point {block.points.ids[point]}"),
    )
    sigmas, name = max(named)
    return Distance(sigmas=float(sigmas), name=name)


def _in_sigmas(change: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the sizes of changes (k, u) in sigmas; 0 of what is held, or has no covariance (k, u, u)."""
    variance = np.einsum("kuu->ku", covariance)
    known = np.isfinite(variance) & (variance > 0.0) & np.isfinite(change)
    return np.asarray(np.abs(np.where(known, change, 0.0)) / np.sqrt(np.where(known, variance, 1.0)))
