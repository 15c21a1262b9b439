"""The two starts of MUSAT-IIIA: points on level ground, and where that does not do, where their straight rays meet.

Level ground is never so wrong as what poor stations intersect, and all rays are wet: where a poor start has put the
points says nothing. But rays that look along the ground, or a job whose vertical is not that of the ground, reach a
level height far from their points; good stations intersect these well. What poor ones intersect behind a camera, or
out of all proportion, starts as far from its cameras as the control is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment import sightings
from musatpy.adjustment.ground import level_start
from musatpy.adjustment.iteration import Outcome, not_raised
from musatpy.adjustment.job import Job
from musatpy.adjustment.network import Network
from musatpy.adjustment.propagation import redundancy
from musatpy.adjustment.robust import chi_square_limit
from musatpy.adjustment.simultaneous import sum_of_squares
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.waterline import WaterLine, every_ray_wet
from musatpy.adjustment.wavy_water import HEIGHT
from musatpy.errors import AdjustmentError
from musatpy.model import Iteration, Options, PlateSigma

if TYPE_CHECKING:  # most jobs have no unknown waves
    from musatpy.adjustment.wave_search import OtherCrests

Adjusted = tuple[Network, Outcome, "OtherCrests | None"]
_LEVEL, _STRAIGHT = "level ground", "the points where straight rays meet"
_FAR = 4.0  # times as far as the known points: oblique photographs show some thrice as far as others
_UNUSUAL = 3.090232306167813  # normal quantile of .999: beyond it sigma0 is doubtful


@dataclass(frozen=True, kw_only=True, eq=False)
class Attempt:
    """An adjustment from one start, its iterations, and in words which start it was where two were made."""

    network: Network
    outcome: Outcome
    crests: OtherCrests | None
    iterations: tuple[Iteration, ...] = ()
    start: str = ""

    @classmethod
    def of(cls, adjusted: Adjusted) -> Attempt:
        """Return the attempt that came to what is adjusted."""
        network, outcome, crests = adjusted
        return cls(network=network, outcome=outcome, crests=crests)

    @property
    def squares(self) -> float:
        """Its sum of squares, infinite where it has not converged."""
        return np.inf if self.outcome.failure else sum_of_squares(self.network, self.outcome.state)

    def does(self, options: Options) -> bool:
        """Return whether it converged with sigma0 within its limit: of a guessed plate sigma, that of the card."""
        freedom = redundancy(self.network)
        unit = 1.0 if options.plate_sigma_is is PlateSigma.KNOWN else options.sigma0_limit**2
        return self.squares <= unit * chi_square_limit(freedom, _UNUSUAL)


def best_of_starts(job: Job, adjust: Callable[[State, WaterLine], Adjusted], state: State) -> Attempt:
    """Return the attempt from level ground or, where that does not do, the lower one of two.

    `state` has the points where straight rays meet. The record of iterations is that of the attempt. Raises
    `AdjustmentError` where no start has normal equations that can be solved.
    """
    wet = every_ray_wet(job.network, job.bathymetric)

    def attempt(start: State) -> Attempt | AdjustmentError:
        job.iterations.clear()
        try:
            return replace(Attempt.of(adjust(start, wet)), iterations=tuple(job.iterations))
        except AdjustmentError as error:
            return error

    level = attempt(level_start(job.network, state))
    if isinstance(level, Attempt) and level.does(job.block.options):
        return level
    straight = attempt(straight_start(job.network, state))
    first = level.squares if isinstance(level, Attempt) else np.inf
    if isinstance(straight, Attempt) and not not_raised(first, straight.squares):
        return replace(straight, start=f"{_STRAIGHT}; from {_LEVEL} {_end(level)}")
    if isinstance(level, AdjustmentError):
        raise level
    job.iterations[:] = level.iterations
    return replace(level, start=f"{_LEVEL}; from {_STRAIGHT} {_end(straight)}")


def straight_start(network: Network, state: State) -> State:
    """Return the state with points where their straight rays meet, as `state` has them, those apart that do not.

    They start at the distance of the known points, along their rays, on the average. Unknown waves start half as
    high as given: a block that is held to steeper ones than there are bends to them, and stays in that.
    """
    ground, known = state.ground.copy(), np.asarray(network.priors.known.all(axis=1))
    middle = np.nanmedian(state.ground[known] if known.any() else state.ground, axis=0)
    for group in network.groups:
        origin, direction = sightings.straight_rays(network, state, group.rays)
        away = ground[group.point, None] - origin
        usual = np.linalg.norm(middle - origin, axis=-1)
        share = np.einsum("kmi,kmi->km", away, direction) / usual
        meets = np.all((share > 1.0 / _FAR) & (share < _FAR), axis=1) | known[group.point]
        usually = np.mean(origin + usual[..., None] * direction, axis=1)
        ground[group.point] = np.where(meets[:, None], ground[group.point], usually)
    waves, sea = state.waves.copy(), network.sea
    if len(waves) and sea is not None:
        waves[sea.sea.unknown[:, HEIGHT], HEIGHT] *= 0.5
    return replace(state, ground=ground, waves=waves)


def _end(attempt: Attempt | AdjustmentError) -> str:
    """Return in words how the other attempt ended."""
    if isinstance(attempt, AdjustmentError):
        return "the normal equations are singular"
    if attempt.outcome.failure:
        return "it does not converge"
    return f"the sum of squares is {attempt.squares:.2f}"
