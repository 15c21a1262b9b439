"""All exact solutions of a minimum set of points, of which no residual chooses one."""

from __future__ import annotations

import numpy as np

from musatpy.orientation.twomedia.helmert import Adjusted, Problem, adjust
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.rejections import rejections

STARTS = 200
_SPREADS = (1.0, 3.0)  # of the starts, in turns: to the roots nearby, and to those farther away
_ANGLE, _LENGTH, _SLOPE = np.radians(5.0), 0.1, 0.05  # standard deviations; of lengths in heights over the water
_EXACT = 1e-3  # sigmas of the misclosures that an exact root may leave
_SAME = 1e-6  # rad and heights over the water, up to which two roots are one


def exact_roots(problem: Problem, near: Adjusted, starts: int = STARTS) -> Orientation:
    """Return all exact solutions (r,) that random starts lead to, `near` (one solution) the first of them.

    Those that no camera over the water can have taken are left out.
    """
    trials = adjust(problem, random_starts(near.at[0], problem, starts))
    exact = trials.converged & (trials.squares < _EXACT**2 * max(int(problem.unknown.sum()), 1))
    exact &= ~rejections(problem, trials).any(axis=1)
    units, roots = near.at[0].units, [near.at.vector[0]]
    for vector in trials.at.vector[exact]:
        if all(np.abs((vector - root) / units).max() > _SAME for root in roots):
            roots.append(vector)
    return Orientation.of(np.array(roots))


def random_starts(at: Orientation, problem: Problem, count: int) -> Orientation:
    """Return starts (count,) around one orientation, of what is unknown."""
    scatter = np.random.default_rng(count).normal(size=(count, len(problem.unknown)))
    scatter *= np.resize(_SPREADS, count)[:, None] * at.units * problem.unknown
    sizes = np.array(([_ANGLE] * 3 + [_LENGTH] * 3) * at.photos + [_SLOPE, _SLOPE, _LENGTH, 0.0])
    return Orientation.of(at.vector + scatter * sizes)
