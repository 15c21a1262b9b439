"""How far a result of WATPT is from the rigorous one: a step of the rigorous triangulation, in its sigmas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.adjustment.collinear import eliminate
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import PARAMETERS
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray
from musatpy.model import AdjustedStations, Block, GroundPoints

_LEAST_SIGMA0 = 0.1  # images that fit better than that are made, without errors: their sigmas mean nothing
FAR = 0.3  # sigmas: what a reader of the listing would want to know


@dataclass(frozen=True, kw_only=True)
class Distance:
    """The largest change of an adjusted value by the step, in its sigmas, and what has it."""

    sigmas: float
    name: str


def far_from_rigorous(
    block: Block,
    refracted: Network,
    step: FloatArray,
    state: State,
    stations: AdjustedStations,
    points: GroundPoints,
    sigma0: float,
) -> tuple[str, ...]:
    """Return a warning where a result of WATPT is farther from the rigorous one than `FAR`."""
    away = distance_from_rigorous(block, refracted, step, state, stations, points)
    sigmas = away.sigmas * min(1.0, sigma0 / _LEAST_SIGMA0)
    if not sigmas > FAR:
        return ()
    return (f"the result of {block.options.refraction} is {sigmas:.2f} sigma from that of RIGOROUS: {away.name}",)


def distance_from_rigorous(
    block: Block,
    refracted: Network,
    step: FloatArray,
    state: State,
    stations: AdjustedStations,
    points: GroundPoints,
) -> Distance:
    """Return how far the result of WATPT in `state` is from that of RIGOROUS; the state stays as it is.

    `step` is that of the normals of the `refracted` network at `state`, which the points follow. The sigmas are
    those of the result. A second step would change next to nothing: what the first one leaves is of second order.
    """
    q = refracted.pattern.size
    of_stations = step[: q * refracted.photos].reshape(-1, q)[:, :6]
    of_points = np.zeros((refracted.points, 3))
    for group in refracted.groups:
        X = state.ground[group.point]
        E = eliminate(refracted, state, group)
        moved = E.shift - np.einsum("kimj,kmj->ki", E.by_station, of_stations[refracted.photo[group.rays]])
        moved -= np.einsum("kie,ke->ki", E.by_extra, step[q * refracted.photos :][E.extras.index])
        of_points[group.point] = np.einsum("kij,klj,kl->ki", refracted.frame.axes(X), E.normals.axes, moved)
    away = (_in_sigmas(of_stations, stations.covariance), _in_sigmas(of_points, points.covariance))
    photo, parameter = np.unravel_index(away[0].argmax(), away[0].shape)
    point, component = np.unravel_index(away[1].argmax(), away[1].shape)
    sigmas, name = max(
        (away[0].max(), f"{PARAMETERS[parameter]} of photo {block.photos.ids[photo]}"),
        (away[1].max(), f"{PARAMETERS[component]} of point {block.points.ids[point]}"),
    )
    return Distance(sigmas=float(sigmas), name=name)


def _in_sigmas(change: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the sizes of changes (k, u) in sigmas; 0 of what is held, or has no covariance (k, u, u)."""
    variance = np.einsum("kuu->ku", covariance)
    known = np.isfinite(variance) & (variance > 0.0) & np.isfinite(change)
    return np.abs(np.where(known, change, 0.0)) / np.sqrt(np.where(known, variance, 1.0))
