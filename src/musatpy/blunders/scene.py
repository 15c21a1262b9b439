"""The block as the search for blunders sees it, and its adjustment with some observations taken out.

Whatever the program of the job: all points at once by collinearity, the refraction in the equations. What a job
holds without error is held by a tenth of what the images can tell, and the tides by centimetres, each photo its
own: only an observation with a residual can be tested.

An observation that is taken out keeps a millionth of its weight. Its residual is then what the others predict, and
the inverse of the normal equations says how well they predict it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment import ground as ground_points
from musatpy.adjustment.collinear import Follow, Simultaneous
from musatpy.adjustment.datum import NOTHING_FREE, freedom
from musatpy.adjustment.ground import all_residuals
from musatpy.adjustment.iteration import Outcome, SingularNormalsError, State, attitude_in, iterate
from musatpy.adjustment.job import Job, prepared
from musatpy.adjustment.kinds import MEASURED, SEARCHED
from musatpy.adjustment.musat3a import straight_start
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import Factor
from musatpy.adjustment.refinement import cauchy, robust_scale
from musatpy.adjustment.waterline import WaterLine, at_rest_in_water, every_ray_wet, starting_line
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model import (
    AdjustedStations,
    Block,
    Datum,
    Initial,
    ObservationKind,
    Photos,
    Program,
    Refraction,
    Treatment,
    WaterLevel,
    Weights,
)
from musatpy.model.progress import Progress
from musatpy.model.water import known_waves

Factors = dict[ObservationKind, FloatArray]  # on weights: (rows, components), those of `Observations`
_K = ObservationKind

LIMIT = 4.0  # of test values at least: one good observation in 16,000 lies beyond
PENALTY = LIMIT**2  # squares over sigma0 squared that a parameter must explain: less tells no two apart
IMAGES_CHECKED, OTHERS_CHECKED = 0.01, 1e-5  # redundancy below which nothing is said of an observation
_TIDE_SIGMA = 0.05  # m, of tides whose card gives none: below what images can tell of them
_HELD = 0.1  # of the ground sigma of an image, for what the job holds without error
_TURNS = 5  # of the rays between wet and dry
_ITERATIONS = 12  # of one adjustment: where that many do not do, something is still wrong, and is looked for
STEP = 1500  # images that a step takes as much as, however few there are
_WAVES = 8  # times the effort of a step on a plane
START = 3  # of the least steps, that a computed start takes as much as for each photo


class SearchLimitError(Exception):
    """The search has spent its effort: what it has found by then stands, or nothing does."""


GIVEN_UP = (SingularNormalsError, SearchLimitError)  # why a trial of the search comes to nothing


@dataclass(kw_only=True, eq=False)
class Effort:
    """What a search may still spend, in images of steps on a plane; a deck beyond repair would take minutes.

    Work is counted, never timed: every machine stops at the same place.
    """

    left: float

    def spend(self, work: float) -> None:
        """Take work off. Raises `SearchLimitError` where less than that is left, and nothing is from then on."""
        if self.left < work:
            self.left = 0.0
            raise SearchLimitError
        self.left -= work

    def spend_steps(self, network: Network, steps: float = 1.0) -> None:
        """Take steps of an adjustment off. Raises `SearchLimitError`."""
        self.spend(steps * (STEP + len(network.photo)) * (1 if network.sea is None else _WAVES))

    def spend_start(self, photos: int) -> None:
        """Take a computed start of some photos off. Raises `SearchLimitError`."""
        self.spend(START * STEP * photos)


@dataclass(frozen=True, kw_only=True, eq=False)
class Limited(Simultaneous):
    """An adjustment of the search, whose steps cost effort."""

    effort: Effort

    def apply(self, state: State, step: FloatArray, context: list[Follow]) -> State:
        """Return what `Simultaneous.apply` does. Raises `SearchLimitError`."""
        self.effort.spend_steps(self.network)
        return super().apply(state, step, context)


@dataclass(frozen=True, kw_only=True, eq=False)
class StagedBlock:
    """A block with the network in which its blunders are looked for."""

    block: Block
    network: Network  # with all its weights
    line: WaterLine
    weight: Factors  # of all observations, a priori
    held: IntArray  # unknowns of photos that hold a free network
    effort: Effort  # that of the whole search
    progress: Progress | None = None  # whoever watches the search

    def problem(self, factors: Factors) -> Limited:
        """Return the adjustment with the weights times `factors`."""
        network = weighted(self.network, self.block, factors)
        return Limited(network=network, options=self.block.options, held=self.held, effort=self.effort)


def sees_water(block: Block) -> bool:
    """Return whether a job takes notice of the water."""
    straight = block.options.refraction is Refraction.NONE and block.options.program is Program.IIA
    return block.water is not None and not straight


def search_block(block: Block, sea: Sea | None) -> Block:
    """Return the block as the search adjusts it: by IIIA, with what the job's own program uses of it.

    Water that has a sigma is unknown and observed: its errors are nobody's blunder. Water with waves, of the
    block or `sea`, is level, and they are known.
    """
    given, options, points, photos, water = block, block.options, block.points, block.photos, block.water
    if not sees_water(block):
        points = replace(points, bathymetric=np.zeros(len(points.ids), dtype=bool))
    wet = water if points.bathymetric.any() else None
    waves = sea is not None or bool(len(block.waves.ids))
    own_levels = options.water_level is WaterLevel.KNOWN and wet is not None
    if own_levels:
        sigma = np.where(photos.tide_sigma > 0.0, photos.tide_sigma, _TIDE_SIGMA)
        photos = replace(photos, tide_sigma=sigma)
    searching = replace(
        options,
        program=Program.IIIA,
        refraction=Refraction.RIGOROUS,
        weights=Weights.FULL,
        water_level=WaterLevel.PHOTO if own_levels else options.water_level,
        water_tilt=Treatment.ADJUST if wet and wet.tilt_sigma and not waves else options.water_tilt,
        water_index=Treatment.ADJUST if wet and wet.sigma else options.water_index,
    )
    block = replace(block, options=searching, points=points, photos=photos, waves=known_waves(block.waves))
    for kind in MEASURED:
        if not kind.applies(given):
            block = kind.without(block, np.ones(getattr(block, kind.observed.attribute).count, dtype=bool))
    return block


def staged(block: Block, progress: Progress | None, sea: Sea | None, effort: Effort) -> tuple[StagedBlock, State]:
    """Return the scene of a block, and its state after robust weights.

    Raises `AdjustmentError` where the block cannot be adjusted, `SingularNormalsError` and `SearchLimitError`.
    """
    if block.options.initial is not Initial.GIVEN:
        effort.spend_start(len(block.photos.ids))
    job, state = prepared(search_block(block, sea), progress, sea)
    scene = scene_of(job, state, effort)
    network = scene.network.with_unknown_points()  # no wrong control puts any
    if ground_points.looks_along(network, state):
        state = straight_start(network, ground_points.start_ground(network, state))
    else:
        state = ground_points.level_start(network, state)
    if job.block.options.datum is Datum.FREE:
        problem = scene.problem(ones(scene))
        matrix = problem.linearise(problem.with_squares(state)).matrix
        scene = replace(scene, held=freedom(scene.network, state, matrix).held)
    return scene, _robust(scene, job.with_iterations(1), state)


def scene_of(job: Job, state: State, effort: Effort) -> StagedBlock:
    """Return the scene of a job, every ray of a submerged point wet."""
    line = every_ray_wet(job.network, job.bathymetric)
    network = _softened(job.network, state).with_plates(job.network.xy, line.wet)
    return StagedBlock(
        block=job.block,
        network=network,
        line=line,
        weight=weights(network, job.block),
        held=NOTHING_FREE.held,
        effort=effort,
        progress=job.progress,
    )


def rebuilt(scene: StagedBlock, block: Block, state: State, sea: Sea | None) -> tuple[StagedBlock, State]:
    """Return the scene of a block in which something was revised, and in it the state of the scene before.

    `block` has the photos, points and measurements of that before, some of them with other values, names or flags;
    it stands where its stations are given. Rays keep their sides of the water, but for those of points that are
    flagged otherwise. Raises `AdjustmentError`.
    """
    given = replace(block, options=replace(block.options, initial=Initial.GIVEN))
    job, fresh = prepared(search_block(given, sea), None, sea)
    again = replace(scene_of(job, fresh, scene.effort), held=scene.held, progress=scene.progress)
    flagged = scene.block.points.bathymetric[scene.network.point]
    line = replace(scene.line, wet=np.where(again.line.wet == flagged, scene.line.wet, again.line.wet))
    old, new = scene.network.frame, again.network.frame
    return (
        replace(again, line=line, network=again.network.with_plates(again.network.xy, line.wet)),
        replace(
            fresh,
            position=new.working(old.system(state.position)),
            attitude=attitude_in(state, fresh.axes, fresh.attitude),
            ground=new.working(old.system(state.ground)),
            tide=state.tide,
            tilt=state.tilt,
            index=state.index,
        ),
    )


def standing(block: Block, stations: Photos | AdjustedStations) -> Block:
    """Return the block with given stations where they are observed, and other `stations` where they are not."""
    photos = block.photos
    values = {
        name: np.where(
            np.isfinite(getattr(photos, f"{name}_sigma")).any(axis=1)[:, None],
            getattr(photos, name),
            getattr(stations, name),
        )
        for name in ("position", "attitude")
    }
    return replace(block, options=replace(block.options, initial=Initial.GIVEN), photos=replace(photos, **values))


def _softened(network: Network, state: State) -> Network:
    """Return the network with what is held without error held by a small sigma."""
    priors = network.priors
    if not priors.held.any():
        return network
    reach = np.linalg.norm(state.ground[network.point] - state.position[network.photo], axis=1)
    scale = np.nanmedian(reach / network.focal_length[network.photo])  # m on the ground for 1 mm on the plate
    sigma = _HELD * scale / np.sqrt(np.median(network.weight))
    weight = np.where(priors.held, 1.0 / sigma**2, priors.weight)
    return replace(network, priors=replace(priors, held=np.zeros_like(priors.held), weight=weight))


def ones(scene: StagedBlock) -> Factors:
    """Return the factors that change nothing."""
    return {kind: np.ones_like(weight) for kind, weight in scene.weight.items()}


def settled(scene: StagedBlock, factors: Factors, state: State) -> tuple[StagedBlock, State, Factor | None]:
    """Return scene and state at the minimum, the rays on the sides of the water on which their points rest.

    And the factor of the normal equations there, None where the iteration has not converged. Points stand elsewhere
    with other observations: where they turned back before does not count. Raises `SingularNormalsError`.
    """
    steps = min(scene.block.options.max_iterations, _ITERATIONS)
    measured, bathymetric = weighted(scene.network, scene.block, factors), scene.block.points.bathymetric

    def adjusted_once(network: Network, state: State, number: int) -> Outcome:
        problem = Limited(network=network, options=scene.block.options, held=scene.held, effort=scene.effort)
        return iterate(problem, problem.with_squares(state), steps)

    line = starting_line(scene.line.wet, scene.network.points)
    _, line, outcome = at_rest_in_water(measured, line, state, bathymetric, adjusted_once, range(_TURNS))
    network = scene.network.with_plates(scene.network.xy, line.wet)
    return replace(scene, network=network, line=line), outcome.state, outcome.factor


def at_their_best(scene: StagedBlock, factors: Factors, state: State, point: IntArray | tuple[int, ...]) -> State:
    """Return the state with some points at their best, by the weights times `factors`; the stations stay."""
    some = np.zeros(scene.network.points, dtype=bool)
    some[np.asarray(point, dtype=int)] = True
    return ground_points.at_their_best(weighted(scene.network, scene.block, factors), state, some)


def sizes(scene: StagedBlock, state: State) -> Factors:
    """Return the residuals in a priori sigmas."""
    residuals = deviations(scene.network, scene.block, state)
    return {kind: residuals[kind] * np.sqrt(weight) for kind, weight in scene.weight.items()}


def plate_scale(scene: StagedBlock, size: Factors) -> float:
    """Return the robust scale of the plate residuals, at least 1."""
    return robust_scale(size[ObservationKind.PLATE][scene.weight[ObservationKind.PLATE] > 0.0])


def _robust(scene: StagedBlock, job: Job, state: State) -> State:
    """Return the state after robust weights of all observations.

    From the first step on: gross errors of centimetres would bend a block beyond recognition.
    """

    for _ in range(_ITERATIONS):
        size = sizes(scene, state)
        scale = plate_scale(scene, size)
        problem = scene.problem({kind: cauchy(value, scale) for kind, value in size.items()})
        start = problem.with_squares(state)
        before = problem.evaluate(start)
        outcome = job.iterate(problem, problem.network, start, 0)
        state, after = outcome.state, problem.evaluate(outcome.state)
        # where a full step gains less than the misfits that it leaves, their weights hardly change
        if not outcome.failure or (outcome.change > 0.0 and before - after <= after):
            break
    return state


def weights(network: Network, block: Block) -> Factors:
    """Return the weights of the observations, 0 for those that take no part."""
    plate = np.where(taking_part(network)[:, None], network.weight, 0.0)
    return {_K.PLATE: plate, **{kind.observed: kind.weights(network, block) for kind in SEARCHED}}


def weighted(network: Network, block: Block, factors: Factors) -> Network:
    """Return the network with its weights times the factors."""
    network = replace(network, weight=network.weight * factors[_K.PLATE])
    for kind in SEARCHED:
        if (factors[kind.observed] != 1.0).any():  # else what is kept of it serves on
            network = kind.weighted(network, block, factors[kind.observed])
    return network


def deviations(network: Network, block: Block, state: State) -> Factors:
    """Return the residuals of the observations, adjusted minus observed, in their units."""
    used = taking_part(network)
    plate = all_residuals(network, state, used)
    plate[~used] = 0.0
    return {_K.PLATE: plate, **{kind.observed: kind.residuals(network, block, state) for kind in SEARCHED}}


def taking_part(network: Network) -> BoolArray:
    """Return which measurements (m,) take part."""
    used = np.zeros(len(network.photo), dtype=bool)
    for group in network.groups:
        used[group.rays] = True
    return used
