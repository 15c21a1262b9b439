"""How far a result of WATPT is from the rigorous one: a step of the rigorous triangulation, in its sigmas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.adjustment.collinear import eliminate
from musatpy.adjustment.iteration import Linearisation
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import PARAMETERS, Factor
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray
from musatpy.model import Departure, Solution

FAR = 0.3  # sigmas: what a reader of the listing would want to know
_LEAST_SIGMA0 = 0.1  # images that fit better than that are made, without errors: their sigmas mean nothing


def with_departure(
    solution: Solution,
    network: Network,
    refracted: Network,
    line: Linearisation,
    factor: Factor,
    state: State,
    kept_out: tuple[PointGroup, ...],
) -> Solution:
    """Return a result of WATPT that says how far it is from that of RIGOROUS, with a warning beyond `FAR`.

    By a step of the normals (`line`, `factor`) of the `refracted` network at `state`; all points follow.
    One that has not converged, or whose own `network` has refracted rays, is left as it is.
    The sigmas are those of the result. A second step would change next to nothing: what the first one leaves is of
    second order.
    """
    if refracted is network or not solution.converged:
        return solution
    block, step = solution.block, factor.solve(line.rhs)
    of_stations = step[: refracted.pattern.order].reshape(refracted.photos, -1)[:, :6]
    of_points = np.zeros((refracted.points, 3))
    for group in (*refracted.groups, *kept_out):
        follow = eliminate(refracted, state, group).follow(group)
        axes, local = refracted.frame.axes(state.ground[group.point]), follow.step(refracted, step)
        of_points[group.point] = np.einsum("kij,klj,kl->ki", axes, follow.axes, local)
    sizes = (
        _in_sigmas(of_stations, solution.stations.covariance),
        _in_sigmas(of_points, solution.points.covariance),
    )
    photo, parameter = np.unravel_index(sizes[0].argmax(), sizes[0].shape)
    point, component = np.unravel_index(sizes[1].argmax(), sizes[1].shape)
    largest, name = max(
        (sizes[0].max(), f"{PARAMETERS[parameter]} of photo {block.photos.ids[photo]}"),
        (sizes[1].max(), f"{PARAMETERS[component]} of point {block.points.ids[point]}"),
    )
    away = Departure(sigmas=float(largest) * min(1.0, solution.sigma0 / _LEAST_SIGMA0), farthest=name)
    far = (f"the result of {block.options.refraction} is {away}",) if away.sigmas > FAR else ()
    return replace(solution, departure=away, warnings=solution.warnings + far)


def _in_sigmas(change: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the sizes of changes (k, u) in sigmas; 0 of what is held, or has no covariance (k, u, u)."""
    variance = np.einsum("kuu->ku", covariance)
    known = np.isfinite(variance) & (variance > 0.0) & np.isfinite(change)
    return np.abs(np.where(known, change, 0.0)) / np.sqrt(np.where(known, variance, 1.0))
