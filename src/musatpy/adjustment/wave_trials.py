"""The search for other crests: which of all answers has the lowest sum of squares, and which is nearly as low.

While a block is adjusted with waves held at a wrong guess, it bends to them. Set free from there, waves and block
can rest in a false geometry, whose sigma0 need not be conspicuous. So no answer is taken for the best before the
block with level water has said where else crests might be: the spectrum costs a few iterations, and another start
is iterated only where it may come as low as the best one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.iteration import Outcome
from musatpy.adjustment.job import Job
from musatpy.adjustment.network import Network
from musatpy.adjustment.propagation import redundancy
from musatpy.adjustment.simultaneous import Simultaneous
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.wave_search import SHORTEST, SIGMAS, Nodes, alike, nodes_of, starts
from musatpy.adjustment.wave_spectrum import LevelBlock, UnknownSea, levelled
from musatpy.adjustment.wavy_water import HEIGHT, LENGTH
from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import AdjustmentError
from musatpy.model import ObservationKind
from musatpy.units import DEGREE

_PLAIN = 8  # iterations by first derivatives alone: where these serve, they need no more
_WORST = 3.0  # times what waves can shift images: more than that is another error
_POOR = 10.0  # sigma0 that may be noise, or plates worse than their sigmas
_STARTS = 4  # other crests of a wave that are iterated at most
_ROUNDS = 4  # over the waves, at most: each finds another start for one of them at least
_SAME = 0.01  # squares: where iterations come to rest in one minimum
_GAIN = 1.0  # squares: a round that gains less is the last one
_SHOWS = 25.0  # squares that a wave explains: five sigmas of its height, below which it is lost in the noise
_RIVAL = 14.0  # squares: what fits worse by more is as good as out of the question, one to a thousand


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherCrests:
    """What the search for other crests says of k waves.

    rival (k, 4): parameters of other crests that fit nearly as well, NaN where there are none; excess (k,): by how
    much the sum of squares is higher with them; searched (k,): all that the sigmas allow was looked through.
    """

    rival: FloatArray
    excess: FloatArray
    searched: BoolArray


@dataclass(frozen=True, kw_only=True, eq=False)
class WaveTrials:
    """The trials of one job, with rays on the sides of the water that its network has."""

    job: Job
    network: Network

    def problem(self, network: Network, curved: bool = False) -> Simultaneous:
        """Return the adjustment of a network of the job."""
        return Simultaneous(network=network, options=self.job.block.options, curved=curved)

    def freed(self, state: State, number: int) -> Outcome:
        """Return the outcome with the waves unknown, by second derivatives where first ones do not get there.

        Where something else is plainly wrong there is nothing that waves could fit to: the outcome is lost.
        """
        network, problem = self.network, self.problem(self.network)
        sigma0 = np.sqrt(problem.evaluate(problem.with_squares(state), []) / redundancy(network))
        sigma = 1.0 / np.sqrt(np.median(network.weight)) / np.median(network.focal_length)
        if sigma0 * sigma > _WORST * self.shift(state) + _POOR * sigma:
            degrees = f"{sigma0 * sigma / DEGREE:.2g} degrees"
            failure = f"images are about {degrees} off with the waves as given, more than waves could explain"
            return Outcome(state=state, last_step=np.zeros(0), failure=failure, lost=True)
        few = self.job.with_iterations(min(_PLAIN, self.job.block.options.max_iterations))
        outcome = few.iterate(problem, network, state, number)
        if outcome.failure and not outcome.lost:
            outcome = self.job.iterate(self.problem(self.network, True), self.network, outcome.state, 0)
        return self.with_likeliest_waves(self.job, outcome)

    def shift(self, state: State) -> float:
        """Return by how much (rad) waves as steep as their sigmas allow shift the images of their points."""
        network = self.network
        if network.sea is None or network.sea.sea.sigma is None:
            return 0.0
        values, sigma = network.sea.waves, SIGMAS * np.nan_to_num(network.sea.sea.sigma)
        length = np.maximum(values[:, LENGTH] - sigma[:, LENGTH], SHORTEST * values[:, LENGTH])
        slope = np.pi * np.sum((np.abs(values[:, HEIGHT]) + sigma[:, HEIGHT]) / length)
        photo, ground = network.photo[network.refracted], state.ground[network.point[network.refracted]]
        depth = state.tide[photo] - network.frame.height(ground)
        distance = np.linalg.norm(ground - state.position[photo], axis=1)
        share = np.median(np.abs(depth) / distance) if len(depth) else 0.0
        return float((1.0 - 1.0 / state.index) * slope * share)

    def with_likeliest_waves(self, job: Job, outcome: Outcome) -> Outcome:
        """Return the outcome with waves by the numbers nearest to those given, of all that mean the same waves."""
        network = self.network
        if network.sea is None or outcome.lost:
            return outcome
        waves = network.sea.likeliest(outcome.state.waves)
        if np.array_equal(waves, outcome.state.waves):
            return outcome
        state = replace(outcome.state, waves=waves)
        return job.iterate(self.problem(network, bool(outcome.failure)), network, state, 0)

    def best(self, outcome: Outcome) -> tuple[Outcome, OtherCrests]:
        """Return the lowest of this outcome and those from other waves, and what else fits nearly as well.

        One wave at a time is looked for from level water, with the others free, until no other start is better. The
        record of iterations goes on with those of what is taken.
        """
        sea = UnknownSea.of(self.network, outcome.state)
        if not len(sea.time):  # nothing is seen through the waves
            return outcome, nothing_searched(len(sea.sigma))
        nodes = {wave: nodes_of(sea, wave) for wave in sea.unknown}
        minima = Minima(sea=sea, lowest=outcome, squares=self.squares(outcome))
        searched = np.ones(len(sea.sigma), dtype=bool)
        for _ in range(_ROUNDS):
            before = minima.squares
            for wave in sea.unknown:
                block = self.level_block(sea, wave, minima.lowest.state)
                searched[wave] = block is not None and nodes[wave].whole
                if block is not None:
                    self.try_starts(block, nodes[wave], minima)
            if len(sea.unknown) == 1 or minima.squares > before - _GAIN:
                break
        return minima.lowest, minima.other_crests(searched)

    def try_starts(self, block: LevelBlock, nodes: Nodes, minima: Minima) -> None:
        """Iterate from the other waves from which the sum of squares may come as low as the lowest, or near to it.

        Of a wave that hardly shows any crests fit as well: there, only what may be lower is of interest.
        """
        margin = _RIVAL if block.squares > minima.squares + _SHOWS or minima.lowest.failure else 0.0
        for start in starts(block, nodes, _STARTS):
            if start.least > minima.squares + margin or minima.near(start.waves):
                continue
            minima.tried.append(start.waves)
            job = self.quiet
            outcome = self.from_start(job, block.state, start.waves)
            if outcome is not None and not outcome.failure and minima.add(outcome, self.squares(outcome)):
                self.job.iterations.extend(job.iterations)

    def squares(self, outcome: Outcome) -> float:
        """Return the sum of squares of an outcome."""
        return self.problem(self.network).evaluate(outcome.state, [])

    def level_block(self, sea: UnknownSea, wave: int, state: State) -> LevelBlock | None:
        """Return the block adjusted with one wave level, from a state; None where that does not converge."""
        network, waves = levelled(self.network, wave), state.waves.copy()
        waves[wave, HEIGHT] = 0.0
        problem = self.problem(network, bool(network.border.count(ObservationKind.WAVE)))
        try:
            outcome = self.quiet.iterate(problem, network, problem.with_squares(replace(state, waves=waves)), 0)
        except AdjustmentError:
            return None
        if outcome.failure:
            return None
        squares = problem.evaluate(outcome.state, [])
        return LevelBlock(
            sea=sea, wave=wave, network=network, state=outcome.state, squares=squares, problem=self.problem
        )

    @property
    def quiet(self) -> Job:
        """The job with a record of its own, which nobody follows."""
        return replace(self.job, iterations=[], progress=None)

    def held(self, job: Job, state: State, waves: FloatArray) -> Outcome | None:
        """Return the outcome from a state with waves (k, 4) that are known; None where there is none."""
        network = self.network.with_known_waves(waves)
        problem = self.problem(network)
        try:
            return job.iterate(problem, network, problem.with_squares(replace(state, waves=waves)), 0)
        except AdjustmentError:
            return None

    def from_start(self, job: Job, state: State, waves: FloatArray) -> Outcome | None:
        """Return the outcome from other waves (k, 4), to which the block fits itself first; None without any."""
        outcome = self.held(job, state, waves)
        if outcome is None or outcome.lost:
            return None
        problem = self.problem(self.network, True)
        try:
            outcome = job.iterate(problem, self.network, problem.with_squares(outcome.state), 0)
            return self.with_likeliest_waves(job, outcome)
        except AdjustmentError:
            return None


def nothing_searched(waves: int) -> OtherCrests:
    """Return what is said of the crests of so many waves where nothing else was looked at."""
    return OtherCrests(
        rival=np.full((waves, 4), np.nan), excess=np.full(waves, np.nan), searched=np.zeros(waves, dtype=bool)
    )


class Minima:
    """The minima of the sum of squares that have been met, and the lowest of them."""

    def __init__(self, sea: UnknownSea, lowest: Outcome, squares: float) -> None:
        self.sea, self.lowest, self.squares = sea, lowest, squares
        # an outcome that has not converged is no minimum, and gives way to any
        self._met: list[tuple[float, FloatArray]] = [] if lowest.failure else [(squares, lowest.state.waves)]
        self.tried: list[FloatArray] = []  # starts

    def near(self, waves: FloatArray) -> bool:
        """Return whether one of the minima, or of the starts that were tried, has the crests of waves (k, 4)."""
        others = [*(met for _, met in self._met), *self.tried]
        return any(all(self._same(wave, waves, other) for wave in self.sea.unknown) for other in others)

    def add(self, outcome: Outcome, squares: float) -> bool:
        """Add the minimum of a converged outcome; return whether it is the lowest."""
        self._met.append((squares, outcome.state.waves))
        lower = bool(self.lowest.failure) or squares < self.squares - _SAME
        if lower:
            self.lowest, self.squares = outcome, squares
        return lower

    def other_crests(self, searched: BoolArray) -> OtherCrests:
        """Return what else is nearly as low as the lowest."""
        crests = nothing_searched(len(searched))
        waves = self.lowest.state.waves
        for squares, met in sorted(self._met, key=lambda minimum: -minimum[0]):  # the lowest comes last, and stays
            for wave in self.sea.unknown:
                if squares <= self.squares + _RIVAL and not self._same(wave, met, waves):
                    crests.rival[wave], crests.excess[wave] = met[wave], squares - self.squares
        return replace(crests, searched=searched)

    def _same(self, wave: int, waves: FloatArray, other: FloatArray) -> bool:
        return bool(alike(self.sea, wave, waves[wave][None], other[wave])[0])
