"""How far a result of WATPT is from the rigorous one: a step of the rigorous triangulation, in its sigmas."""

from __future__ import annotations

import numpy as np

from musatpy.adjustment.collinear import eliminate
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import PARAMETERS
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray
from musatpy.model import AdjustedStations, Block, GroundPoints

_LEAST_SIGMA0 = 0.1  # images that fit better than that are made, without errors: their sigmas mean nothing
FAR = 0.3  # sigmas: what a reader of the listing would want to know


def far_from_rigorous(
    block: Block,
    refracted: Network,
    step: FloatArray,
    state: State,
    stations: AdjustedStations,
    points: GroundPoints,
    sigma0: float,
) -> tuple[str, ...]:
    """Return a warning, with what is farthest, where a result of WATPT is farther from that of RIGOROUS than `FAR`.

    `step` is that of the normals of the `refracted` network at `state`, which the points follow. The sigmas are
    those of the result. A second step would change next to nothing: what the first one leaves is of second order.
    """
    of_stations = step[: refracted.pattern.order].reshape(refracted.photos, -1)[:, :6]
    of_points = np.zeros((refracted.points, 3))
    for group in refracted.groups:
        follow = eliminate(refracted, state, group).follow(group)
        axes, local = refracted.frame.axes(state.ground[group.point]), follow.step(refracted, step)
        of_points[group.point] = np.einsum("kij,klj,kl->ki", axes, follow.axes, local)
    away = (_in_sigmas(of_stations, stations.covariance), _in_sigmas(of_points, points.covariance))
    photo, parameter = np.unravel_index(away[0].argmax(), away[0].shape)
    point, component = np.unravel_index(away[1].argmax(), away[1].shape)
    largest, name = max(
        (away[0].max(), f"{PARAMETERS[parameter]} of photo {block.photos.ids[photo]}"),
        (away[1].max(), f"{PARAMETERS[component]} of point {block.points.ids[point]}"),
    )
    sigmas = float(largest) * min(1.0, sigma0 / _LEAST_SIGMA0)
    if not sigmas > FAR:
        return ()
    return (f"the result of {block.options.refraction} is {sigmas:.2f} sigma from that of RIGOROUS: {name}",)


def _in_sigmas(change: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the sizes of changes (k, u) in sigmas; 0 of what is held, or has no covariance (k, u, u)."""
    variance = np.einsum("kuu->ku", covariance)
    known = np.isfinite(variance) & (variance > 0.0) & np.isfinite(change)
    return np.abs(np.where(known, change, 0.0)) / np.sqrt(np.where(known, variance, 1.0))
