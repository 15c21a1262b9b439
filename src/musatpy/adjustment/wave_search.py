"""A better start for unknown waves: least squares only finds the crest that it starts next to.

Where what is given of a wave leaves more than a good part of a length open, over the points that see it, the images
may fit it with its crests one off here and there: a minimum of the sum of squares, but not the least. From waves on
a mesh over what the sigmas allow, one step of all else tells which to start from.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import factorised
from musatpy.adjustment.sea import AZIMUTH, CREST, LENGTH, WorkingSea
from musatpy.adjustment.simultaneous import Simultaneous
from musatpy.adjustment.unknowns import State

FloatArray = NDArray[np.float64]

_SIGMAS = 2.0  # that are looked through to either side
_MESH = 0.3  # of a length: a start that near is near enough
_SIDE = 2  # meshes to either side, at most: of worse guesses, too many would have to be tried


def starts(network: Network, state: State) -> Iterator[FloatArray]:
    """Yield parameters (k, 4) of waves on the mesh, one wave at a time, the others as given."""
    sea = network.sea
    if sea is None or sea.sea.sigma is None:
        return
    reach = reach_of(network, state, sea)
    for wave, (values, sigma) in enumerate(zip(sea.waves, np.nan_to_num(sea.sea.sigma), strict=True)):
        shift = shifts(values, sigma, reach)
        sides = [min(_SIDE, round(_SIGMAS * one / _MESH)) for one in shift.values()]
        offsets = [np.linspace(-_SIGMAS, _SIGMAS, 2 * m + 1) if m else np.zeros(1) for m in sides]
        for offset in itertools.product(*offsets):
            start = sea.waves.copy()
            start[wave, list(shift)] += np.array(offset) * sigma[list(shift)]
            if start[wave, LENGTH] > 0.0:
                yield start


def shifts(values: FloatArray, sigma: FloatArray, reach: float) -> dict[int, float]:
    """Return the lengths by which sigmas (4,) of a wave (4,) shift its crests at a distance (m), by parameter."""
    L = values[LENGTH]
    return {
        LENGTH: reach * sigma[LENGTH] / L**2,
        AZIMUTH: reach * sigma[AZIMUTH] / L,
        CREST: sigma[CREST] / L,
    }


def reach_of(network: Network, state: State, sea: WorkingSea) -> float:
    """Return the RMS distance (m) of the points that are seen through the waves from their origin."""
    wet = np.zeros(network.points, dtype=bool)
    wet[network.point[network.refracted]] = True
    wet &= np.isfinite(state.ground).all(axis=1)
    if not wet.any():
        return 0.0
    plan = (state.ground[wet] - sea.origin) @ sea.axes[:2].T
    return float(np.sqrt(np.mean(np.sum(np.square(plan), axis=1))))


def best_starts(
    network: Network, state: State, problem: Callable[[Network], Simultaneous], most: int
) -> list[FloatArray]:
    """Return the `most` best parameters (k, 4) to start from; `problem` makes the problem of a network."""
    sea = network.sea
    if sea is None or sea.sea.sigma is None:
        return []
    found: list[tuple[float, int, FloatArray]] = []
    for waves in starts(network, state):
        away = np.nan_to_num((waves - sea.waves) / sea.sea.sigma)
        held = replace(network, sea=sea.at(waves).known, border=replace(network.border, waves=()))
        found.append((_after_a_step(problem(held), state) + float(np.sum(np.square(away))), len(found), waves))
    return [waves for _, _, waves in sorted(found)[:most]]


def _after_a_step(problem: Simultaneous, state: State) -> float:
    """Return the sum of squares after one step from a state; infinite where there is none."""
    state = problem.with_squares(state)
    line = problem.linearise(state)
    factor = factorised(line.matrix)
    if factor is None:
        return np.inf
    return problem.evaluate(problem.apply(state, factor.solve(line.rhs), line.context), line.context)
