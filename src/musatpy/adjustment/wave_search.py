"""The search for other crests of unknown waves: which of all answers has the lowest sum of squares.

While a block is adjusted with waves held at a wrong guess, it bends to them. Set free from there, waves and block
can rest in a false geometry, whose sigma0 need not be conspicuous. So no answer is taken for the best before the
block with level water has said where else crests might be.

With length and azimuth held, a wave is linear in two numbers: the heights of a wave with a crest at the origin, and
of one with it a quarter of a length on. From the block adjusted without the wave, one linearisation says what these
would change, for as many lengths and azimuths as one likes, all other unknowns allowed for: their spectrum. From
where that is low enough, the block is adjusted again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.collinear import Curved, Simultaneous, sum_of_squares
from musatpy.adjustment.iteration import Outcome, State
from musatpy.adjustment.job import Job
from musatpy.adjustment.kinds import redundancy
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import NormalMatrix, factorised
from musatpy.adjustment.wavy_water import AZIMUTH, CREST, HEIGHT, LENGTH, WorkingSea, wave_names
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import AdjustmentError
from musatpy.model import ObservationKind
from musatpy.model.tables import finite_rows
from musatpy.refraction.waves import Trains
from musatpy.units import DEGREE

SIGMAS = 3.0  # that are looked through to either side
STARTS = 4  # other crests of a wave that are iterated at most
_PLAIN = 8  # iterations by first derivatives alone: where these serve, they need no more
_WORST = 3.0  # times what waves can shift images: more than that is another error
_POOR = 10.0  # sigma0 that may be noise, or plates worse than their sigmas
_ROUNDS = 4  # over the waves, at most: each finds another start for one of them at least
_SAME = 0.01  # squares: where iterations come to rest in one minimum
_GAIN = 1.0  # squares: a round that gains less is the last one
_SHOWS = 25.0  # squares that a wave explains: five sigmas of its height, below which it is lost in the noise
_RIVAL = 14.0  # squares: what fits worse by more is as good as out of the question, one to a thousand
_MESH = 0.12  # of a length, RMS over the rays: half a mesh off, 0.86 of what a wave explains is left of it
_LOSS = 1.0 / 3.0  # of what a wave explains at a node: by so much more it may explain between nodes
_NODES = 800  # at most: of worse guesses, too many would have to be looked at
_PHASES = 16  # of the crest that are looked at
_SHORTEST = 0.2  # of the length given
_ALIKE = 0.5  # correlation of two waves over the rays above which least squares goes from one to the other
_PART = 48  # waves of a spectrum at a time, at most
_CELLS = 4e6  # of the normal equations of single points: what they need in memory stays within some ten megabytes
_FREE = 1e3  # m, sigma of the heights of a spectrum: so good as unknown


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherCrests:
    """What the search for other crests says of k waves.

    rival (k, 4): parameters of other crests that fit nearly as well, NaN where there are none; excess (k,): by how
    much the sum of squares is higher with them; searched (k,): all that the sigmas allow was looked through.
    """

    rival: FloatArray
    excess: FloatArray
    searched: BoolArray


def nothing_searched(waves: int) -> OtherCrests:
    """Return what is said of the crests of so many waves where nothing else was looked at."""
    return OtherCrests(
        rival=np.full((waves, 4), np.nan), excess=np.full(waves, np.nan), searched=np.zeros(waves, dtype=bool)
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class WaveTrials:
    """The trials of one job, with rays on the sides of the water that its network has."""

    job: Job
    network: Network

    def freed(self, state: State, number: int) -> Outcome:
        """Return the outcome with the waves unknown, by second derivatives where first ones do not get there.

        Where something else is plainly wrong there is nothing that waves could fit to: the outcome is lost.
        """
        network, problem = self.network, self.problem(self.network)
        off = np.sqrt(sum_of_squares(network, problem.with_squares(state)) / redundancy(network))
        sigma = 1.0 / np.sqrt(np.median(network.weight)) / np.median(network.focal_length)
        if off * sigma > _WORST * self._shift(state) + _POOR * sigma:
            degrees = f"{off * sigma / DEGREE:.2g} degrees"
            failure = f"images are about {degrees} off with the waves as given, more than waves could explain"
            return Outcome(state=state, last_step=np.zeros(0), failure=failure, lost=True)
        few = self.job.with_iterations(min(_PLAIN, self.job.block.options.max_iterations))
        outcome = few.iterate(problem, network, state, number)
        if outcome.failure and not outcome.lost:
            outcome = self.job.iterate(self.problem(network, True), network, outcome.state, 0)
        return self._with_likeliest_waves(self.job, outcome)

    def best(self, outcome: Outcome) -> tuple[Outcome, OtherCrests]:
        """Return the lowest of this outcome and those from other waves, and what else fits nearly as well.

        One wave at a time is looked for from level water, with the others free, until no other start is better. The
        record of iterations goes on with those of what is taken.
        """
        search = CrestSearch(self, outcome)
        if not len(search.time):  # nothing is seen through the waves
            return outcome, nothing_searched(len(search.sigma))
        searched = np.ones(len(search.sigma), dtype=bool)
        for _ in range(_ROUNDS):
            before = search.squares
            for wave in search.unknown:
                searched[wave] = search.from_level_water(wave)
            if len(search.unknown) == 1 or search.squares > before - _GAIN:
                break
        return search.lowest, replace(search.rivals(), searched=searched)

    def level(self, wave: int, state: State) -> Level | None:
        """Return the block adjusted with one wave level, from a state; None where that does not converge."""
        sea, trains, sigma = _unknown(self.network)
        values, sigma, waves = trains.values.copy(), sigma.copy(), state.waves.copy()
        values[wave, HEIGHT], sigma[wave], waves[wave, HEIGHT] = 0.0, np.nan, 0.0
        network = _with_waves(self.network, sea, trains.with_values(values), sigma)
        curved = bool(network.border.count(ObservationKind.WAVE))
        outcome = self._iterated(self._quiet, network, replace(state, waves=waves), curved)
        if outcome is None or outcome.failure:
            return None
        return Level(network=network, state=outcome.state, squares=sum_of_squares(network, outcome.state))

    def from_start(self, state: State, waves: FloatArray) -> tuple[Job, Outcome] | None:
        """Return the outcome from other waves (k, 4), to which the block fits itself first; None without any.

        With it the job that has the record of its iterations.
        """
        job = self._quiet
        outcome = self._iterated(job, self.network.with_known_waves(waves), replace(state, waves=waves), False)
        if outcome is None or outcome.lost:
            return None
        outcome = self._iterated(job, self.network, outcome.state, True)
        try:
            return None if outcome is None else (job, self._with_likeliest_waves(job, outcome))
        except AdjustmentError:
            return None

    def problem(self, network: Network, curved: bool = False) -> Simultaneous:
        """Return the adjustment of a network of the job, by second derivatives where it is `curved`."""
        return (Curved if curved else Simultaneous)(network=network, options=self.job.block.options)

    @property
    def _quiet(self) -> Job:
        """The job with a record of its own, which nobody follows."""
        return replace(self.job, iterations=[], progress=None)

    def _iterated(self, job: Job, network: Network, state: State, curved: bool) -> Outcome | None:
        problem = self.problem(network, curved)
        try:
            return job.iterate(problem, network, problem.with_squares(state), 0)
        except AdjustmentError:
            return None

    def _with_likeliest_waves(self, job: Job, outcome: Outcome) -> Outcome:
        """Return the outcome with waves by the numbers nearest to those given, of all that mean the same waves."""
        sea, _, _ = _unknown(self.network)
        waves = outcome.state.waves if outcome.lost else sea.likeliest(outcome.state.waves)
        if np.array_equal(waves, outcome.state.waves):
            return outcome
        problem = self.problem(self.network, bool(outcome.failure))
        return job.iterate(problem, self.network, replace(outcome.state, waves=waves), 0)

    def _shift(self, state: State) -> float:
        """Return by how much (rad) waves as steep as their sigmas allow shift the images of their points."""
        network, (_, trains, sigma) = self.network, _unknown(self.network)
        values, sigma = trains.values, SIGMAS * np.nan_to_num(sigma)
        length = np.maximum(values[:, LENGTH] - sigma[:, LENGTH], _SHORTEST * values[:, LENGTH])
        slope = np.pi * np.sum((np.abs(values[:, HEIGHT]) + sigma[:, HEIGHT]) / length)
        photo, ground = network.photo[network.refracted], state.ground[network.point[network.refracted]]
        depth = state.tide[photo] - network.frame.height(ground)
        distance = np.linalg.norm(ground - state.position[photo], axis=1)
        share = np.median(np.abs(depth) / distance) if len(depth) else 0.0
        return float((1.0 - 1.0 / state.index) * slope * share)


@dataclass(frozen=True, kw_only=True, eq=False)
class Level:
    """A block adjusted with one of its waves level, and the others as unknown as they are."""

    network: Network
    state: State
    squares: float


class CrestSearch:
    """The search from one outcome: the minima of the sum of squares that have been met, and the lowest of them.

    sigma (k, 4) of the waves is 0 where a parameter is known. The rays of the outcome see the bottom at place
    (N, 2) m about the origin of the waves, at time (N,) s.
    """

    def __init__(self, trials: WaveTrials, outcome: Outcome) -> None:
        network, state, (sea, trains, sigma) = trials.network, outcome.state, _unknown(trials.network)
        rays = np.flatnonzero(network.refracted & finite_rows(state.ground[network.point]))
        self.trials, self.trains, self.sigma = trials, trains, np.nan_to_num(sigma)
        self.unknown: list[int] = np.flatnonzero((self.sigma > 0.0).any(axis=1)).tolist()
        self.place = (state.ground[network.point[rays]] - sea.origin) @ sea.axes[:2].T
        self.time = sea.sea.time[network.photo[rays]]
        self.lowest, self.squares = outcome, sum_of_squares(network, state)
        # an outcome that has not converged is no minimum, and gives way to any
        self._met: list[tuple[float, FloatArray]] = [] if outcome.failure else [(self.squares, state.waves)]
        self._tried: list[FloatArray] = []

    def from_level_water(self, wave: int) -> bool:
        """Iterate from other crests of one wave that may come as low as the lowest; return whether all were seen.

        Of a wave that hardly shows any crests fit as well: there, only what may be lower is of interest.
        """
        level = self.trials.level(wave, self.lowest.state)
        if level is None:
            return False
        nodes, shift, whole = self.nodes(wave)
        margin = _RIVAL if level.squares > self.squares + _SHOWS or self.lowest.failure else 0.0
        for waves, least in self._starts(wave, level, nodes, shift):
            if least > self.squares + margin or self._near(waves):
                continue
            self._tried.append(waves)
            trial = self.trials.from_start(level.state, waves)
            if trial and not trial[1].failure and self._add(trial[1]):
                self.trials.job.iterations.extend(trial[0].iterations)
        return whole

    def nodes(self, wave: int) -> tuple[FloatArray, float, bool]:
        """Return lengths and azimuths of one wave, so near to one another that a wave between two shows at both.

        As parameters (c, 4); with what may be missing of their crest (m), and whether they cover what the sigmas
        allow.
        """
        given, sigma = self.trains.values[wave], self.sigma[wave]
        meshes, sides, shift = [0.0, 0.0], [0, 0], 0.0
        for axis, of in enumerate((LENGTH, AZIMUTH)):
            if sigma[of] == 0.0:
                continue
            step = np.zeros(4)
            step[of] = 1e-3 * sigma[of]
            first, second = self._phases(wave, np.stack([given + step, given - step]))
            turns = (first - second) / (2e-3 * 2.0 * np.pi)  # (N,) lengths that a sigma moves the crest
            mesh = min(_MESH / max(float(turns.std()), _MESH / SIGMAS), SIGMAS)  # sigmas
            meshes[axis], sides[axis] = mesh * sigma[of], max(int(np.ceil(SIGMAS / mesh - 0.5)), 0)
            shift += (0.5 * mesh * float(turns.mean()) * given[LENGTH]) ** 2
        wanted = list(sides)
        while (2 * sides[0] + 1) * (2 * sides[1] + 1) > _NODES:
            sides[int(sides[1] > sides[0])] -= 1
        offsets = [np.arange(-side, side + 1) * mesh for side, mesh in zip(sides, meshes, strict=True)]
        length, azimuth = (axis.ravel() for axis in np.meshgrid(*offsets, indexing="ij"))
        values = np.tile(given, (len(length), 1))
        values[:, LENGTH] += length
        values[:, AZIMUTH] += azimuth
        return values[values[:, LENGTH] > _SHORTEST * given[LENGTH]], float(np.sqrt(shift)), sides == wanted

    def spectrum(self, wave: int, level: Level, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return matrices S (c, 2, 2) and pulls g (c, 2) of one wave with lengths and azimuths of `values` (c, 4).

        With a height H and a phase p of the crest, the wave changes the squares of the block without it by
        H^2 e'S e - 2 H e'g, e = (cos p, sin p).
        """
        part = max(1, min(_PART, int(0.5 * np.sqrt(_CELLS / level.network.points))))
        parts = [self._reduced(wave, level, values[first : first + part]) for first in range(0, len(values), part)]
        matrix, pull = zip(*parts, strict=True)
        return np.concatenate(matrix), np.concatenate(pull)

    def rivals(self) -> OtherCrests:
        """Return what else is nearly as low as the lowest."""
        crests, waves = nothing_searched(len(self.sigma)), self.lowest.state.waves
        for squares, met in sorted(self._met, key=lambda minimum: -minimum[0]):  # the lowest comes last, and stays
            for wave in self.unknown:
                if squares <= self.squares + _RIVAL and not self._alike(wave, met[wave][None], waves[wave])[0]:
                    crests.rival[wave], crests.excess[wave] = met[wave], squares - self.squares
        return crests

    def _add(self, outcome: Outcome) -> bool:
        """Add the minimum of a converged outcome; return whether it is the lowest."""
        squares = sum_of_squares(self.trials.network, outcome.state)
        self._met.append((squares, outcome.state.waves))
        lower = bool(self.lowest.failure) or squares < self.squares - _SAME
        if lower:
            self.lowest, self.squares = outcome, squares
        return lower

    def _near(self, waves: FloatArray) -> bool:
        """Return whether one of the minima, or of the starts that were tried, has the crests of waves (k, 4)."""
        others = [*(met for _, met in self._met), *self._tried]
        return any(
            all(self._alike(wave, waves[wave][None], other[wave])[0] for wave in self.unknown) for other in others
        )

    def _alike(self, wave: int, values: FloatArray, other: FloatArray) -> BoolArray:
        """Return (c,) whether one wave with `values` (c, 4) has the crests that it has with `other` (4,)."""
        first, second = (self._phases(wave, rows) for rows in (values, other[None]))
        same = np.mean(np.cos(first - second), axis=1) * np.sign(values[:, HEIGHT]) * np.sign(other[HEIGHT])
        return same > _ALIKE

    def _phases(self, wave: int, values: FloatArray) -> FloatArray:
        """Return the phases (c, N) rad of one wave with each of `values` (c, 4)."""
        surface = _rows_of(self.trains, [wave] * len(values), values).surface
        return surface.vector @ self.place.T - surface.frequency[:, None] * self.time - surface.phase[:, None]

    def _starts(self, wave: int, level: Level, nodes: FloatArray, shift: float) -> list[tuple[FloatArray, float]]:
        """Return the best waves (k, 4) to start from, no two with the same crests, and how low they may come."""
        values, squares, least = self._minima(wave, level, nodes, shift)
        left = np.argsort(squares, kind="stable")
        out: list[tuple[FloatArray, float]] = []
        while len(left) and len(out) < STARTS:
            waves = level.state.waves.copy()
            waves[wave] = values[left[0]]
            if self.trains.with_values(waves).sensible:
                out.append((waves, float(least[left[0]])))
            left = left[1:][~self._alike(wave, values[left[1:]], waves[wave])]
        return out

    def _minima(
        self, wave: int, level: Level, nodes: FloatArray, shift: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return parameters (s, 4) at the minima over the crest at every node, the squares there, the least near.

        The squares have the priors of the wave in them.
        """
        given, sigma, length = self.trains.values[wave], self.sigma[wave], nodes[:, LENGTH, None]
        matrix, pull = self.spectrum(wave, level, nodes)
        phase = np.broadcast_to(2.0 * np.pi * np.arange(_PHASES) / _PHASES, (len(length), _PHASES))
        if sigma[CREST] == 0.0:
            phase = 2.0 * np.pi * given[CREST] / length
        e = np.stack([np.cos(phase), np.sin(phase)], axis=-1)
        curve, pull = np.einsum("cpi,cij,cpj->cp", e, matrix, e), np.einsum("cpi,ci->cp", e, pull)
        height = np.full_like(pull, given[HEIGHT])
        if sigma[HEIGHT]:  # the height that is best for the crest
            weight = 1.0 / np.square(sigma[HEIGHT])
            height = (pull + weight * given[HEIGHT]) / (curve + weight)
        explained = 2.0 * height * pull - np.square(height) * curve
        crest = phase / (2.0 * np.pi) * length
        crest = crest - np.rint((crest - given[CREST]) / length) * length
        values = np.repeat(nodes[:, None], crest.shape[1], axis=1)
        values[..., HEIGHT], values[..., CREST] = height, crest
        spread = sigma + np.array([0.0, 0.0, 0.0, shift]) * (sigma[CREST] > 0.0)
        known = spread > 0.0
        prior = np.sum(np.square((values - given)[..., known] / spread[known]), axis=-1)
        squares = level.squares - explained + prior
        lowest = (squares <= np.roll(squares, 1, axis=1)) & (squares <= np.roll(squares, -1, axis=1))
        least = squares - _LOSS * np.maximum(explained, 0.0)
        return values[lowest], squares[lowest], least[lowest]

    def _reduced(self, wave: int, level: Level, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the spectrum for c `values` at once.

        By the heights of two waves each, which have a sigma that is as good as none; all else is eliminated.
        """
        network, state, sea = level.network, level.state, level.network.sea
        assert sea is not None, "there are waves"
        doubled = np.repeat(values, 2, axis=0)
        doubled[:, HEIGHT] = 0.0
        doubled[0::2, CREST], doubled[1::2, CREST] = 0.0, 0.25 * values[:, LENGTH]
        given = sea.trains.values if sea.trains else state.waves
        trains = _rows_of(
            self.trains, [*range(len(given)), *[wave] * len(doubled)], np.concatenate([given, doubled])
        )
        of_doubled = np.full(doubled.shape, np.nan)
        of_doubled[:, HEIGHT] = _FREE
        sigma = np.full(given.shape, np.nan) if sea.sea.sigma is None else sea.sea.sigma
        tried = _with_waves(network, sea, trains, np.concatenate([sigma, of_doubled]))
        line = self.trials.problem(tried).linearise(replace(state, waves=np.concatenate([state.waves, doubled])))
        last = tried.border.first_kept
        S, g = _eliminated(line.matrix, line.rhs, np.arange(last - len(doubled), last))
        index = np.arange(len(doubled)).reshape(-1, 2)
        return S[index[:, :, None], index[:, None, :]], g.reshape(-1, 2)


def _unknown(network: Network) -> tuple[WorkingSea, Trains, FloatArray]:
    """Return the sea of a network with unknown waves, these, and their sigmas (k, 4), NaN where they are known."""
    sea = network.sea
    assert sea is not None and sea.trains is not None and sea.sea.sigma is not None, "there are unknown waves"
    return sea, sea.trains, sea.sea.sigma


def _rows_of(trains: Trains, waves: list[int], values: FloatArray) -> Trains:
    """Return trains each of which is one of `waves` (c,), with other values (c, 4)."""
    return replace(
        trains,
        values=values,
        number=trains.number[waves],
        frequency=trains.frequency[waves],
        depth=trains.depth[waves],
        steady=trains.steady[waves],
    )


def _with_waves(network: Network, sea: WorkingSea, trains: Trains, sigma: FloatArray) -> Network:
    """Return the network with other waves, unknown where they have a sigma (k, 4)."""
    given = replace(sea.sea, surface=trains.surface, sigma=sigma, names=())
    border = network.border.having(ObservationKind.WAVE, wave_names(given))
    known = not given.unknown.any()
    return replace(network, sea=replace(sea, sea=given, trains=None if known else trains), border=border)


def _eliminated(matrix: NormalMatrix, rhs: FloatArray, columns: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the normal equations (g, g), (g,) of some columns of the border, with all other unknowns eliminated.

    Zeros where these are not determined.
    """
    split = len(matrix.border)
    others = np.setdiff1d(np.arange(len(matrix.corner)), columns)
    rest = replace(matrix, border=matrix.border[:, others], corner=matrix.corner[np.ix_(others, others)])
    factor = factorised(rest)
    if factor is None:
        return np.zeros((len(columns), len(columns))), np.zeros(len(columns))
    cross = np.concatenate([matrix.border[:, columns], matrix.corner[np.ix_(others, columns)]])
    solved = factor.solve_scaled(cross * factor.scale[:, None]) * factor.scale[:, None]
    right = np.concatenate([rhs[:split], rhs[split:][others]])
    return matrix.corner[np.ix_(columns, columns)] - cross.T @ solved, rhs[split:][columns] - solved.T @ right
