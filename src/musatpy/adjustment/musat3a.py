"""MUSAT-IIIA: the simultaneous adjustment of all points by collinearity, with the refraction in its equations.

It has two starts: points on level ground and, where that does not do, where their straight rays meet. Level ground
is never so wrong as what poor stations intersect, and all rays are wet: where a poor start has put the points says
nothing. But rays that look along the ground, or a job whose vertical is not that of the ground, reach a level
height far from their points; good stations intersect these well. What poor ones intersect behind a camera, or out
of all proportion, starts as far from its cameras as the control is.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment import ground as ground_points
from musatpy.adjustment import result, sightings
from musatpy.adjustment.collinear import Simultaneous, sum_of_squares
from musatpy.adjustment.datum import NOTHING_FREE, Freedom, freedom, moved_to
from musatpy.adjustment.ground import level_start, looks_along
from musatpy.adjustment.iteration import Outcome, State, not_raised
from musatpy.adjustment.job import Job, prepared
from musatpy.adjustment.kinds import largest_movements, redundancy
from musatpy.adjustment.kinds.water import WaterIndex
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import factorised
from musatpy.adjustment.waterline import (
    WaterLine,
    at_rest_in_water,
    best_line,
    every_ray_wet,
    starting_line,
)
from musatpy.adjustment.wavy_water import HEIGHT, Sea
from musatpy.arrays import FloatArray
from musatpy.errors import AdjustmentError
from musatpy.model import (
    INDEX_RANGE,
    Block,
    Datum,
    Iteration,
    ObservationKind,
    PlateSigma,
    Refraction,
    Solution,
    Weights,
)
from musatpy.model.progress import Progress, begin
from musatpy.probability import chi_square_limit
from musatpy.units import DEGREE

if TYPE_CHECKING:  # most jobs have no unknown waves
    from musatpy.adjustment.wave_search import OtherCrests, WaveTrials


Adjusted = tuple[Network, Outcome, "OtherCrests | None"]
_LEVEL, _STRAIGHT = "level ground", "the points where straight rays meet"
_FAR = 4.0  # times as far as the known points: oblique photographs show some thrice as far as others
_UNUSUAL = 3.090232306167813  # normal quantile of .999: beyond it sigma0 is doubtful
_FIT = 25.0  # weighted squares of an image of most points: five sigmas, where poor stations have hundreds
_AT_REST = (1e-5, 0.1)  # rad, m: what the digits of the cards leave to be done in a restart
_LOOSEST = 5.0 * DEGREE  # of a rotation: beyond such a sigma no misalignment is determined
_MOVES = 4  # to the inner constraints: a motion that is not quite free takes a second one


def adjust(block: Block, progress: Progress | None = None, sea: Sea | None = None) -> Solution:
    """Return the MUSAT-IIIA solution of a block, converged or not.

    `progress` is called after every iteration. Raises `AdjustmentError` with every reason where the block cannot be
    adjusted: no usable measurements, missing water data, photos without initial values, normal equations that leave
    unknowns free.
    """
    # it has no other ones, whatever the option card says
    options = replace(block.options, refraction=Refraction.RIGOROUS, weights=Weights.FULL)
    job, state = prepared(replace(block, options=options), progress, sea)
    return _RunOfIIIA(job=job).solution(state)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Attempt:
    """An adjustment from one start, with its sum of squares: infinite where it has not converged."""

    adjusted: Adjusted | AdjustmentError
    squares: float
    end: str  # in words
    iterations: tuple[Iteration, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class _RunOfIIIA:
    """A run of MUSAT-IIIA."""

    job: Job

    def solution(self, state: State) -> Solution:
        """Return the solution from a first state."""
        job = self.job
        restart = self.restarted(state)
        (network, outcome, crests), start = (self.adjusted(*restart), "") if restart else self.best_of_starts(state)
        free = self.freedom(network, outcome.state)
        if free.count and not outcome.failure:
            outcome = self.at_rest(network, outcome, free, state.ground)
            free = self.freedom(network, outcome.state)
        reason = job.reason(network, outcome, ())
        # points were held on water lines for the iteration only: they are as free as all others
        network = job.network.with_plates(job.network.xy, network.refracted)
        final = job.with_left_out(network, outcome.state)
        begin(job.progress, "covariances")
        solution = result.solution(
            job=job,
            network=network,
            refracted=network,
            state=final,
            reason=reason,
            warnings=(*job.notes, *job.suspicions(state, reason)),
            passes=(),
            problem=lambda network, state: self.problem(network, free),
            free=free,
            crests=crests,
        )
        limit = chi_square_limit(max(solution.degrees_of_freedom, 1), _UNUSUAL)
        doubtful = bool(reason) or solution.sum_of_squares > limit
        return replace(solution, start=start, misread=self.misread(network) if doubtful else "")

    def misread(self, network: Network) -> str:
        """Return how inertial attitudes would fit that do not, by a run without them; empty where that is lost."""
        block = self.job.block
        if not block.inertial_attitudes.count:
            return ""
        from musatpy.adjustment.body_conventions import fitting_convention, without_inertial  # most jobs have none

        try:
            job, first = prepared(without_inertial(block), None)
            (without, outcome, _), _ = replace(self, job=job).best_of_starts(first)
        except AdjustmentError:
            return ""
        sound = sum_of_squares(without, outcome.state) < block.options.sigma0_limit**2 * redundancy(without)
        return fitting_convention(block, network, outcome.state) if sound and not outcome.failure else ""

    def restarted(self, state: State) -> tuple[State, WaterLine] | None:
        """Return the state of a restart, points at their best, and where rays are; None where that is no minimum.

        Stations that fit the plates need not be at a minimum: what the plates hardly hold may be far off.
        """
        job, measured = self.job, self.job.network
        line = every_ray_wet(measured, job.bathymetric)
        squares = self.problem(measured, NOTHING_FREE).with_squares(state).squares
        fit = np.concatenate([squares[group.point] / group.rays.shape[1] for group in measured.groups])
        if np.median(fit) > _FIT:
            return None
        network = measured.with_plates(measured.xy, line.wet)
        state = job.with_left_out(network, ground_points.settle(network, state))
        # a point that turns back here does so for these stations; the adjusted ones may put it metres elsewhere
        line = starting_line(best_line(measured, line, state, job.bathymetric).wet, measured.points)
        network = measured.with_plates(measured.xy, line.wet)
        state = job.with_left_out(network, ground_points.settle(network, state))
        equations = self.problem(network, self.freedom(network, state)).linearise(state)
        factor = factorised(equations.matrix) if equations.matrix.sensible() else None
        if factor is None:
            return None
        _, rotation, _, translation = largest_movements(factor.solve(equations.rhs), network)
        return (state, line) if rotation < _AT_REST[0] and translation < _AT_REST[1] else None

    def best_of_starts(self, state: State) -> tuple[Adjusted, str]:
        """Return what comes of level ground or, where that does not do, the lower one of two, and in words which.

        Where most rays look along the ground, that is the second one. `state` has the points where straight rays
        meet. The record of iterations is that of the start. Raises `AdjustmentError` where no start has normal
        equations that can be solved.
        """
        job, options = self.job, self.job.block.options
        # of a guessed plate sigma the limit of sigma0 is that of the card
        unit = 1.0 if options.plate_sigma_is is PlateSigma.KNOWN else options.sigma0_limit**2
        starts = ((_LEVEL, level_start), (_STRAIGHT, straight_start))
        first, second = starts[::-1] if looks_along(job.network, state) else starts
        best = self.attempt(first[1](job.network, state))
        if not isinstance(best.adjusted, AdjustmentError) and best.squares <= unit * chi_square_limit(
            redundancy(best.adjusted[0]), _UNUSUAL
        ):
            return best.adjusted, ""
        other = self.attempt(second[1](job.network, state))
        if not isinstance(other.adjusted, AdjustmentError) and not not_raised(best.squares, other.squares):
            return other.adjusted, f"{second[0]}; from {first[0]} {best.end}"
        if isinstance(best.adjusted, AdjustmentError):
            raise best.adjusted
        job.iterations[:] = best.iterations
        return best.adjusted, f"{first[0]}; from {second[0]} {other.end}"

    def attempt(self, start: State) -> _Attempt:
        """Return the attempt from a start, all rays of submerged points wet."""
        job = self.job
        job.iterations.clear()
        try:
            network, outcome, crests = self.adjusted(start, every_ray_wet(job.network, job.bathymetric))
        except AdjustmentError as error:
            return _Attempt(adjusted=error, squares=np.inf, end="the normal equations are singular")
        squares = np.inf if outcome.failure else sum_of_squares(network, outcome.state)
        end = "it does not converge" if outcome.failure else f"the sum of squares is {squares:.2f}"
        iterations = tuple(job.iterations)
        return _Attempt(adjusted=(network, outcome, crests), squares=squares, end=end, iterations=iterations)

    def problem(self, network: Network, free: Freedom) -> Simultaneous:
        return Simultaneous(network=network, options=self.job.block.options, held=free.held)

    def adjusted(self, state: State, line: WaterLine) -> Adjusted:
        """Return network and outcome, and what the search for other crests says where there are unknown waves."""
        network, line, outcome = self.at_rest_in_water(
            state, line, bool(self.job.network.border.count(ObservationKind.WAVE))
        )
        trials = self.free_waves(network)
        if trials is None or outcome.lost:
            return network, outcome, None
        lowest, crests = trials.best(outcome)
        if lowest is not outcome:  # with other waves, points may come to stand on another side of the water
            line = starting_line(line.wet, network.points)
            network, _, lowest = self.at_rest_in_water(lowest.state, line, False)
        return network, lowest, crests

    def at_rest_in_water(self, state: State, line: WaterLine, given: bool) -> tuple[Network, WaterLine, Outcome]:
        """Return network, line and outcome with every ray on the side of the water where its point comes to rest.

        Waves stay as `given`, in the state, at first: poor points, on level ground, would lead them astray.
        """
        measured, bathymetric = self.job.network, self.job.bathymetric
        first = 1 + max((iteration.outer_pass for iteration in self.job.iterations), default=0)
        if given:
            known = measured.with_known_waves(state.waves)
            only = range(first, first + 1)
            network, line, outcome = at_rest_in_water(known, line, state, bathymetric, self.adjusted_once, only)
            if outcome.lost:
                return network, line, self.with_index_in_range(network, outcome)
            state, first = outcome.state, first + 1
        network, line, outcome = at_rest_in_water(
            measured, line, state, bathymetric, self.adjusted_once, itertools.count(first)
        )
        return network, line, self.with_index_in_range(network, outcome)

    def adjusted_once(self, network: Network, state: State, number: int) -> Outcome:
        """Return the outcome with the rays of a network as they are, submerged points that took no part besides."""
        job = self.job
        problem = self.problem(network, NOTHING_FREE)
        state = problem.with_squares(state)
        free, trials = self.freedom(network, state), self.free_waves(network)
        if trials:
            outcome = trials.freed(state, number)
        else:
            problem = self.problem(network, free) if free.count else problem
            outcome = job.iterate(problem, network, state, number)
            if outcome.failure and not outcome.lost and not free.count and network.parameters:
                # free parameters, not determined then, take up motions: all else comes to rest
                taken_up = freedom(network, outcome.state, problem.linearise(outcome.state).matrix, _LOOSEST)
                if taken_up.count:
                    outcome = job.iterate(self.problem(network, taken_up), network, outcome.state, number)
                    outcome = replace(outcome, factor=None)
        factor = None if free.count else outcome.factor
        return replace(outcome, state=job.with_left_out(network, outcome.state, submerged=True), factor=factor)

    def with_index_in_range(self, network: Network, outcome: Outcome) -> Outcome:
        """Return the outcome, saying so where it failed because the refractive index would leave its range."""
        if not outcome.failure or outcome.lost or not network.border.count(ObservationKind.WATER_INDEX):
            return outcome
        line = self.problem(network, NOTHING_FREE).linearise(outcome.state)
        factor = factorised(line.matrix)
        if factor is None:
            return outcome
        step = float(WaterIndex().part_of(network, factor.solve(line.rhs))[0])
        wanted, (low, high) = outcome.state.index + step, INDEX_RANGE
        if low <= wanted <= high:
            return outcome
        why = f"the refractive index would go to {wanted:.3g}, which is not within {low:g} to {high:g}"
        failure = f"{why}: the observations do not determine it"
        return replace(outcome, failure=failure, last_step=np.zeros(0))

    def free_waves(self, network: Network) -> WaveTrials | None:
        """Return the trials of the waves of a network, None where it has no unknown ones."""
        if not network.border.count(ObservationKind.WAVE):
            return None
        from musatpy.adjustment.wave_search import WaveTrials  # most jobs have none

        return WaveTrials(job=self.job, network=network)

    def at_rest(self, network: Network, outcome: Outcome, free: Freedom, first: FloatArray) -> Outcome:
        """Return the outcome moved to the inner constraints: its points lie about `first` (p, 3)."""
        for _ in range(_MOVES):
            state, distance = moved_to(network, outcome.state, free, first)
            free = self.freedom(network, state)
            problem = self.problem(network, free)
            outcome = self.job.iterate(problem, network, problem.with_squares(state), 0)
            if distance < self.job.block.options.translation_limit or outcome.failure:
                break
        return outcome

    def freedom(self, network: Network, state: State) -> Freedom:
        """Return what the datum option lets the block be free in."""
        if self.job.block.options.datum is not Datum.FREE:
            return NOTHING_FREE
        return freedom(network, state, self.problem(network, NOTHING_FREE).linearise(state).matrix)


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
        typical = np.median(share, axis=1)  # some camera may be near
        meets = ((share > 0.0).all(axis=1) & (typical > 1.0 / _FAR) & (typical < _FAR)) | known[group.point]
        usually = np.mean(origin + usual[..., None] * direction, axis=1)
        ground[group.point] = np.where(meets[:, None], ground[group.point], usually)
    waves, sea = state.waves.copy(), network.sea
    if len(waves) and sea is not None:
        waves[sea.sea.unknown[:, HEIGHT], HEIGHT] *= 0.5
    return replace(state, ground=ground, waves=waves)
