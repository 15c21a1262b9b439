"""What explains the misfit of a block with least: hypotheses taken one by one, those that compete re-adjusted.

It starts with everything in. Each time the hypotheses that explain most in the linear model, and nearly as much as
each other, are really adjusted; the one with the least cost stays. The cost of an explanation is its weighted sum
of squares over sigma0 squared, and a price for each parameter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.iteration import State, iterate
from musatpy.adjustment.kinds import PRIORS
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import BoolArray
from musatpy.blunders.hypotheses import OF_KINDS, Hypothesis, common_errors, hypotheses, moved_state, revised
from musatpy.blunders.linear_model import LinearModel, linear_model
from musatpy.blunders.scene import (
    GIVEN_UP,
    PENALTY,
    Factors,
    StagedBlock,
    at_their_best,
    rebuilt,
    sizes,
    taking_part,
)
from musatpy.blunders.snooping import SnoopingResult, factors_of
from musatpy.errors import AdjustmentError
from musatpy.model import Block, CauseKind, ObservationKind
from musatpy.model.progress import begin
from musatpy.model.tables import falling
from musatpy.probability import FITS, chi_square_limit, test_limit

STEPS = 8  # hypotheses taken one after the other
TRIED = 4  # of each step, that are re-adjusted: with STEPS the limit of the search, in re-adjustments
_SAME = 4.0  # of the costs of two explanations, which says nothing
SENSIBLE = {  # sizes of errors that are common to many observations, and can be revised
    CauseKind.FOCAL_LENGTH: 15.0,  # mm
    CauseKind.PRINCIPAL_POINT: 10.0,  # mm
    CauseKind.DISTORTION: 5.0,  # mm
    CauseKind.INDEX: 0.2,
    CauseKind.TIDES: 30.0,  # m
    **{kind: size for module in OF_KINDS for kind, size in module.SENSIBLE.items()},
}
_DOUBT = 2.0  # times what the linear model has misjudged of the best: by so much more it may of the others
NEARLY = 0.5  # of the squares that the best explains in the linear model: less is not tried
_ITERATIONS = 6  # of a re-adjustment
_REFINEMENTS = 2  # of the size of what is revised
_FEW = 6  # wrong images that hypotheses taken one by one can still explain
_AGREEING = 2  # images that agree with what is known of their point, so that another one is the wrong one
_SHARE = 0.3  # of the images of a photo: more that are wrong are no single ones
_DRY = 0.02  # of the rays of submerged points: as many of these stand dry where an image of theirs is wrong
_CHEAP = list(CauseKind)


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A block under an explanation: what is given up and revised, and its adjustment."""

    block: Block  # revised
    scene: StagedBlock
    state: State
    out: Factors  # 1 for what is given up
    taken: tuple[Hypothesis, ...] = ()
    alike: tuple[Hypothesis, ...] = ()  # revisions that explain the same as those taken
    squares: float = np.inf  # of all that is in; infinite where it is not adjusted yet, or cannot be

    def factors(self) -> Factors:
        """Return the factors on the weights."""
        return factors_of(self.out, sizes(self.scene, self.state))

    def cost(self, variance: float) -> float:
        """Return the cost of the explanation: of a point with no image left, as many as had checked it."""
        network, (x, y) = self.scene.network, (self.out[ObservationKind.PLATE] > 0.0).T
        lost = np.bincount(network.point[x | y], minlength=network.points)
        seen = np.bincount(network.point[taking_part(network)], minlength=network.points)
        known = network.priors.known.sum(axis=1) + (network.priors.group >= 0)
        checks = np.maximum(2 * seen + np.minimum(known, 3) - 3, 0)
        others = (np.count_nonzero(mask) for kind, mask in self.out.items() if kind is not ObservationKind.PLATE)
        revisions = sum(not hypothesis.given_up for hypothesis in self.taken)
        prices = revisions + sum(others) + int(np.minimum(2 * lost, checks).sum())
        return self.squares / variance + PENALTY * prices


def squares_in(scene: StagedBlock, out: Factors, state: State) -> float:
    """Return the weighted squares of all observations that are not out."""
    total = 0.0
    for kind, size in sizes(scene, state).items():
        total += float(np.square(size[out[kind] == 0.0]).sum())
    return total if np.isfinite(total) else np.inf


def starts(last: SnoopingResult) -> list[tuple[Factors, bool]]:
    """Return what is out where the search for a simpler explanation starts, and whether only common ones serve.

    Single images of points with others, of which nothing is known, or what is known agrees with the others, stay
    out where they are many: they are what they seem to be. Errors common to all may look like many such images.
    Where nothing else is out, the search is at rest under that explanation.
    """
    out, network = last.out, last.scene.network
    nothing = {kind: np.zeros_like(mask) for kind, mask in out.items()}
    wrong = last.rows_out(ObservationKind.PLATE)
    used = taking_part(network)
    lost = np.bincount(network.photo[wrong], minlength=network.photos)
    share = lost > _SHARE * np.bincount(network.photo[used], minlength=network.photos)
    sure = wrong & ~_doubtful_points(last)[network.point] & ~share[network.photo]
    if np.count_nonzero(sure) <= _FEW:
        return [(nothing, False)]
    kept = nothing | {ObservationKind.PLATE: np.repeat(sure[:, None], 2, axis=1).astype(float)}
    at_rest = all(np.array_equal(kept[kind], mask) for kind, mask in out.items())
    return [(nothing, True), *([] if at_rest else [(kept, False)])]


def _doubtful_points(last: SnoopingResult) -> BoolArray:
    """Return (p,) the points of which something is known, but for those with one image out and that alone.

    Two more images that agree with what is known of the point leave no doubt.
    """
    network, block = last.scene.network, last.scene.block
    known = np.asarray(network.priors.known.any(axis=1) | (network.priors.group >= 0))
    wrong = last.rows_out(ObservationKind.PLATE)
    lost = np.bincount(network.point[wrong], minlength=network.points)
    good = np.bincount(network.point[taking_part(network) & ~wrong], minlength=network.points)
    denied = np.zeros(network.points, dtype=bool)
    for prior in PRIORS:
        denied[prior.points(block)[last.rows_out(prior.observed)]] = True
    return known & ~((lost == 1) & (good >= _AGREEING) & ~denied)


def submerged_points_dry(last: SnoopingResult) -> bool:
    """Return whether so many rays of points flagged as submerged stand dry that the tides may be wrong."""
    scene = last.scene
    submerged = scene.block.points.bathymetric[scene.network.point] & taking_part(scene.network)
    submerged &= ~last.rows_out(ObservationKind.PLATE)
    dry = np.count_nonzero(submerged & ~scene.line.wet)
    return bool(dry > _DRY * np.count_nonzero(submerged))


def first_case(block: Block, scene: StagedBlock, state: State) -> Case:
    """Return a block with nothing explained."""
    nothing = {kind: np.zeros_like(weight) for kind, weight in scene.weight.items()}
    return Case(block=block, scene=scene, state=state, out=nothing)


def readjusted(case: Case, factors: Factors | None = None) -> Case:
    """Return the case after a re-adjustment, of infinite squares where that fails.

    `factors` on the weights may be those of a state before.
    """
    problem = case.scene.problem(case.factors() if factors is None else factors)
    try:
        state = iterate(problem, problem.with_squares(case.state), _ITERATIONS).state
    except GIVEN_UP:
        return replace(case, squares=np.inf)
    return replace(case, state=state, squares=squares_in(case.scene, case.out, state))


def explained(case: Case, variance: float, sea: Sea | None, only_common: bool = False) -> Case:
    """Return the case under the explanation that is found, re-adjusted.

    With `only_common` it ends where something else than what is common to many observations would explain more, not
    adjusted again if that is at once. Raises `SingularNormalsError`.
    """
    begun = case.block
    for step in range(1, STEPS + 1):
        begin(case.scene.progress, "search for blunders: hypothesis", step, STEPS)
        model = model_of(case)
        options = shortlist(case, model, variance)
        if not options or (only_common and options[0].given_up):
            break
        if len(options) == 1 and options[0].given_up:
            best = _taking(case, options[0])
        else:
            best = cheapest(_trials(case, model, options, variance, sea), variance)
            if not np.isfinite(best.squares):
                break
        case = best
    untouched = only_common and case.block is begun
    return case if untouched or np.isfinite(case.squares) else readjusted(case)


def model_of(case: Case) -> LinearModel:
    """Return the linear model of a case. Raises `SingularNormalsError`."""
    return linear_model(case.scene, case.factors(), case.state)


def shortlist(case: Case, model: LinearModel, variance: float) -> list[Hypothesis]:
    """Return the hypotheses to be tried, none where nothing more has to be explained.

    They are as many as the observations: in a large block some good one lies beyond the limit of a small one.
    """
    observations = sum(int(np.count_nonzero(weight)) for weight in case.scene.weight.values())
    normal, known = max(FITS, test_limit(observations)), {option.key for option in case.taken}
    options = [
        option
        for option in hypotheses(model)
        if option.squares > variance * chi_square_limit(option.parameters, normal)
        and sensible(option)
        and ((option.values_in(case.out) == 0.0).any() if option.given_up else option.key not in known)
    ]
    if not options:
        return []
    options = [options[row] for row in falling([option.gain(variance) for option in options]).tolist()]
    best = max(option.squares for option in options)
    return [option for option in options if option.squares >= NEARLY * best][:TRIED]


def _trials(
    case: Case, model: LinearModel, options: list[Hypothesis], variance: float, sea: Sea | None
) -> list[Case]:
    """Return the cases with those of the hypotheses that may cost least, adjusted, the most promising first.

    The others cost more by about as much as their linear model says, which errs by what all of them leave in: by
    as much as it has misjudged those before.
    """
    size = sizes(case.scene, case.state)
    factors = factors_of(case.out, size)
    given_up_before = (
        float(np.nansum((factors[kind] * np.square(size[kind]))[mask > 0.0])) for kind, mask in case.out.items()
    )
    foreseen, misjudged, trials = model.squares - sum(given_up_before), 0.0, []
    for option in options:
        if options[0].gain(variance) - option.gain(variance) > _SAME + _DOUBT * misjudged:
            break
        trials.append(with_hypothesis(case, option, sea))
        misjudged = max(misjudged, abs(trials[-1].squares + option.squares - foreseen) / variance)
    return trials


def sensible(hypothesis: Hypothesis) -> bool:
    """Return whether what is common to many observations has a size that makes sense."""
    return bool(abs(hypothesis.error[0]) < SENSIBLE.get(hypothesis.kind, np.inf))


def cheapest(cases: list[Case], variance: float) -> Case:
    """Return the case of least cost; of those that cost alike, that whose last cause is the cheapest to check."""
    least = min(case.cost(variance) for case in cases)
    alike = [case for case in cases if case.cost(variance) <= least + _SAME]
    return min(alike, key=lambda case: _CHEAP.index(case.taken[-1].kind))


def with_hypothesis(case: Case, hypothesis: Hypothesis, sea: Sea | None) -> Case:
    """Return the case with a hypothesis more, re-adjusted."""
    if not hypothesis.given_up:
        return _revised(replace(case, taken=(*case.taken, hypothesis)), hypothesis, sea)
    case = _taking(case, hypothesis)
    factors = case.factors()
    # of points of which something is given up: the stations follow little
    state = at_their_best(case.scene, factors, case.state, hypothesis.point)
    return readjusted(replace(case, state=state), factors)


def _taking(case: Case, hypothesis: Hypothesis) -> Case:
    return replace(case, out=given_up(case.out, hypothesis), taken=(*case.taken, hypothesis), squares=np.inf)


def given_up(out: Factors, hypothesis: Hypothesis, value: float = 1.0) -> Factors:
    """Return what is out with the observations of a hypothesis, or with these in again (0)."""
    masks = {kind: mask.copy() for kind, mask in out.items()}
    for part in hypothesis.given_up:
        masks[part.kind][part.row, part.component] = value
    return masks


def _revised(case: Case, hypothesis: Hypothesis, sea: Sea | None) -> Case:
    """Return the case with what its last hypothesis says revised, the size of it at the minimum."""
    value = float(hypothesis.error[0])
    case = with_revision(case, replace(hypothesis, value=value), sea)
    if hypothesis.kind not in SENSIBLE or not np.isfinite(case.squares):
        return case
    for _ in range(_REFINEMENTS):
        model = model_of(case)
        rest = next((option for option in common_errors(model) if option.key == hypothesis.key), None)
        if rest is None:
            break
        value += float(rest.error[0])
        case = with_revision(case, replace(hypothesis, value=float(rest.error[0])), sea)
        sized = replace(hypothesis, error=np.array([value]), sigma=rest.sigma)
        case = replace(case, taken=(*case.taken[:-1], sized))
    return case


def with_revision(case: Case, revision: Hypothesis, sea: Sea | None) -> Case:
    """Return the case with something revised, re-adjusted."""
    try:
        scene, state = rebuilt(
            case.scene, revised(case.scene.block, revision), moved_state(case.state, revision), sea
        )
    except AdjustmentError:
        return replace(case, squares=np.inf)
    return readjusted(replace(case, block=revised(case.block, revision), scene=scene, state=state))
