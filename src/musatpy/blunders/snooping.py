"""Data snooping: one observation after the other is taken out, or comes back, until the tests find no more.

Baarda (1968) for the test of an observation that takes part, v / (sigma sqrt r); one that was taken out is tested
against what the others predict, whose variance is added to its own. Both are divided by the sigma0 of the others
(Pope 1976), so that plates that are all a little worse than their sigmas do not look like blunders.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from musatpy.adjustment.iteration import SingularNormalsError, State, level_corrections
from musatpy.adjustment.normals import SINGULAR, Cofactors, Factor, factorised
from musatpy.adjustment.precision import ErrorSources, spread_to_observations
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.blunders.alternatives import wrong_images
from musatpy.blunders.hypotheses import Hypothesis, common_tides
from musatpy.blunders.scene import (
    IMAGES_CHECKED,
    LIMIT,
    OTHERS_CHECKED,
    Factors,
    StagedBlock,
    deviations,
    plate_scale,
    settled,
    sizes,
    weighted,
)
from musatpy.model import ObservationKind
from musatpy.model.progress import begin
from musatpy.probability import students_of_pope, test_limit

_BACK = 0.9  # of the limit, below which an observation comes back
_RETURNS = 2  # of one observation, at most
_ROUNDS = 25
_START = 6.0  # robust scales beyond which an observation is out from the start
_SHARE = 0.5  # of the largest test value that others must have to go out with it
_FAR = 2.0  # times its limit, of a test: what goes out by it has moved the stations
_LITTLE = 0.1  # of all squares, that those which leave may explain for their sum to be foreseen
_TIED = 0.98  # of the largest test value of a point: no telling which of them it is
_BEST = 0.2  # sigma0 that nothing is better than
_PULL = 1e3  # sigmas up to which what is out keeps that weight: kilometres would still bend the block by it
_TAKEN = 1e-6  # of its weight is left to an observation that is out
_BEYOND = 1e3  # no test value is larger
_UP = 2  # component
_STEPS = 2  # of an adjustment, that the tests of all observations take as much as

_K = ObservationKind


@dataclass(frozen=True, kw_only=True, eq=False)
class Units:
    """The o observations by what can be taken out: images, horizontal or vertical control, stations, and so on.

    Those of a unit follow each other, and so do the units.
    """

    kind: IntArray  # (o,)
    row: IntArray  # (o,)
    component: IntArray  # (o,)
    element: IntArray  # (o,) number in the table of its kind
    weight: FloatArray  # (o,) a priori
    unit: IntArray  # (o,) number of its unit
    place: IntArray  # (o,) ground point, or a number of its own: units of one place compete
    of_kinds: dict[ObservationKind, slice]  # the observations of each kind

    @cached_property
    def limits(self) -> FloatArray:
        """(units,) the limits of the test values, by how many observations there are of each kind.

        In a large block some good image lies beyond the limit of a small one.
        """
        of_kind = np.array([max(LIMIT, test_limit(count)) for count in np.bincount(self.kind).tolist()])
        return np.asarray(of_kind[self.kind[self.first]])

    @cached_property
    def first(self) -> IntArray:
        """(units,) the first observation of every unit."""
        return np.flatnonzero(np.diff(self.unit, prepend=-1))

    def per_unit(self, value: FloatArray) -> FloatArray:
        """Return (units,) the largest value of the observations of each unit, 0 where none is above."""
        return np.asarray(np.maximum(np.nan_to_num(np.fmax.reduceat(value, self.first)), 0.0))

    def gathered(self, tables: Factors) -> FloatArray:
        """Return the values (o,) of all observations in tables of their kinds."""
        out = np.empty(len(self.kind))
        for kind, rows in self.of_kinds.items():
            tables[kind].reshape(-1).take(self.element[rows], out=out[rows])
        return out


@dataclass(frozen=True, kw_only=True, eq=False)
class Judgement:
    """The tests of all observations, with some of their units out."""

    units: Units
    out: BoolArray  # (units,)
    test: FloatArray  # (o,) NaN where nothing checks the observation
    error: FloatArray  # (o,) estimated, likewise: given minus what the others say
    shapes: dict[ObservationKind, tuple[int, ...]]  # of the tables
    sigma0: float
    freedom: float  # degrees of freedom of what is in
    factor: Factor
    covariance: FloatArray  # (p, 3, 3) m2, east, north, up of the points, NaN for those that take no part

    def table(self, kind: ObservationKind, values: FloatArray) -> FloatArray:
        """Return values (o,) of observations in the table of a kind, NaN for what takes no part."""
        table, rows = np.full(self.shapes[kind], np.nan), self.units.of_kinds[kind]
        table.reshape(-1)[self.units.element[rows]] = values[rows]
        return table

    @cached_property
    def predicted(self) -> BoolArray:
        """(units,) whether the others predict all observations of a unit."""
        unknown = np.zeros(len(self.units.first), dtype=bool)
        unknown[self.units.unit[np.isnan(self.test)]] = True
        return ~unknown


@dataclass(frozen=True, kw_only=True, eq=False)
class SnoopingResult:
    """Where the search has come to rest."""

    scene: StagedBlock
    state: State
    judgement: Judgement
    out: Factors  # 1 for the observations that are out, 0 for all others
    tides: tuple[Hypothesis, ...]  # errors that the tides of several photos have in common
    rest: bool  # False: it was stopped

    def rows_out(self, kind: ObservationKind) -> BoolArray:
        """Return which rows (rows,) of the table of a kind have observations that are out."""
        return np.asarray(self.out[kind].any(axis=1))


def snooped(
    scene: StagedBlock,
    state: State,
    first: Factors | None = None,
    returning: bool = True,
) -> SnoopingResult:
    """Return the search at rest.

    `first` is 1 for what is out at the beginning; without it, what robust weights leave far off is. Images are
    chosen anew. Without `returning` nothing of what is out comes back. Raises `SingularNormalsError`.
    """
    units = units_of(scene)
    image, limit = units.kind[units.first] == _K.PLATE, units.limits
    returns = np.full(len(units.first), 0 if returning else _RETURNS)
    out, state = _first_out(scene, state, units, first, returning)
    moved = returning  # and images are to be chosen once more
    tides: tuple[Hypothesis, ...] = ()
    rest = proven = False
    for number in range(_ROUNDS):
        begin(scene.progress, "search for blunders: round of snooping", number + 1, _ROUNDS)
        factors = factors_of(_masks(scene, units, out), sizes(scene, state))
        scene, state, factor = settled(scene, factors, state)
        judgement = judged(scene, state, units, out, factors, factor)
        value = units.per_unit(np.abs(judgement.test))
        fits = judgement.predicted & (value < _BACK * limit)
        back = out & fits & (returns < _RETURNS) & ~image
        if number == 0:  # what nothing predicts can be tested only when it is in
            back |= out & ~judgement.predicted & ~image
        leaving = _leaving(judgement, value)
        common = worst_common_tide(scene, state, judgement)
        most = max(LIMIT, np.where(out, 0.0, value).max(initial=0.0)) * judgement.sigma0
        if common is not None and common.squares > most**2:
            tides, leaving = (*tides, common), _tides_of(units, common.photo)
            returns[leaving] = _RETURNS
        anew = image & (leaving | out) if moved else image & leaving
        wrong, after = _images_anew(scene, state, units, out, anew, judgement.sigma0)
        # one that is out comes back where its point is explained otherwise, unless its own test says no
        back |= anew & out & ~wrong & (fits | ~judgement.predicted)
        leaving |= wrong & ~out
        moved = bool((leaving & (value > _FAR * limit)).any() or (back & image).any())
        if not back.any() and not leaving.any():
            if not tides or proven:
                rest = True
                break
            # what else was wrong when they went out may have looked like them: they have to be found once more
            back, tides, proven = _tides_of(units, np.concatenate([tide.photo for tide in tides])), (), True
        returns[back] += 1
        out, state = (out & ~back) | leaving, after
    gone = _masks(scene, units, judgement.out)
    return SnoopingResult(scene=scene, state=state, judgement=judgement, out=gone, tides=tides, rest=rest)


def _first_out(
    scene: StagedBlock,
    state: State,
    units: Units,
    first: Factors | None,
    returning: bool,
) -> tuple[BoolArray, State]:
    """Return which units (units,) are out as `snooped` begins, and the state with points as others see them."""
    size = sizes(scene, state)
    scale = plate_scale(scene, size)
    beyond, size = (_START * scale, size) if first is None else (0.0, first)
    out = units.per_unit(np.abs(units.gathered(size))) > beyond
    image = units.kind[units.first] == _K.PLATE
    chosen, state = _images_anew(scene, state, units, out, out & image, scale)
    return np.where(image & returning, chosen, out | chosen), state


def _images_anew(
    scene: StagedBlock, state: State, units: Units, out: BoolArray, anew: BoolArray, sigma0: float
) -> tuple[BoolArray, State]:
    """Return which images (units,) are out when those of points with some in `anew` are chosen anew.

    And the state with these points where the others see them. What else is `out` (units,) has no say.
    """
    unit, masks = np.zeros(len(units.first), dtype=bool), _masks(scene, units, out)
    images = np.asarray(_masks(scene, units, anew)[_K.PLATE].any(axis=1))
    if not images.any():
        return unit, state
    factors = factors_of(masks, sizes(scene, state)) | {_K.PLATE: np.ones_like(masks[_K.PLATE])}
    wrong, state = wrong_images(weighted(scene.network, scene.block, factors), state, images, sigma0)
    rows = units.of_kinds[_K.PLATE]
    unit[units.unit[rows][wrong[units.row[rows]]]] = True
    return unit, state


def _tides_of(units: Units, photo: Sequence[int] | IntArray) -> BoolArray:
    """Return the units that are the tides of some photos."""
    tides = np.zeros(len(units.first), dtype=bool)
    tides[units.unit[(units.kind == _K.WATER_LEVEL) & np.isin(units.row, photo)]] = True
    return tides


def units_of(scene: StagedBlock) -> Units:
    """Return the units of the observations of a scene, in the order of `Observations`."""
    block, points, count = scene.block, len(scene.block.points.ids), 0
    point = {
        _K.PLATE: block.plates.point,
        _K.CONTROL: block.control.point,
        _K.EQUAL_ELEVATION: block.equal_elevations.point,
    }
    parts, of_kinds, start = [], {}, 0
    for kind, weight in sorted(scene.weight.items()):
        element = np.flatnonzero(weight > 0.0)
        row, component = np.divmod(element, weight.shape[1])
        piece = 2 * row + (component == _UP) if kind is _K.CONTROL else row
        begins = np.diff(piece, prepend=-1) != 0
        unit = count - 1 + np.cumsum(begins)
        place = point[kind][row] if kind in point else points + unit
        count += int(np.count_nonzero(begins))
        parts.append((np.full(len(row), kind), row, component, element, weight.take(element), unit, place))
        of_kinds[kind], start = slice(start, start + len(row)), start + len(row)
    names = ("kind", "row", "component", "element", "weight", "unit", "place")
    columns = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Units(of_kinds=of_kinds, **dict(zip(names, columns, strict=True)))


def factors_of(out: Factors, size: Factors) -> Factors:
    """Return the factors on the weights with the observations out where `out` is not zero.

    Those whose residuals `size`, in sigmas, are beyond all measure are left less weight: they must not pull.
    """
    factors = {}
    for kind, mask in out.items():
        taken = np.flatnonzero(mask > 0.0)
        beyond = np.maximum(np.nan_to_num(np.abs(size[kind].take(taken))) / _PULL, 1.0)
        factors[kind] = np.ones(mask.shape)
        factors[kind].reshape(-1)[taken] = _TAKEN / np.square(beyond)
    return factors


def _masks(scene: StagedBlock, units: Units, out: BoolArray) -> Factors:
    """Return 1 for the observations of units that are out, 0 for all others."""
    masks = {kind: np.zeros(weight.shape) for kind, weight in scene.weight.items()}
    taken = out[units.unit]
    for kind, rows in units.of_kinds.items():
        masks[kind].reshape(-1)[units.element[rows]] = taken[rows]
    return masks


def judged(
    scene: StagedBlock, state: State, units: Units, out: BoolArray, factors: Factors, factor: Factor | None
) -> Judgement:
    """Return the tests of all observations at the minimum with the weights times `factors`, `out` (units,) out.

    `factor` is that of the normals there, if it is known. Raises `SingularNormalsError`.
    """
    scene.effort.spend_steps(scene.network, _STEPS)
    problem = scene.problem(factors)
    if factor is None:
        matrix = problem.linearise(problem.with_squares(state)).matrix
        factor = factorised(matrix)
        if factor is None:
            raise SingularNormalsError(matrix)
    cofactors = factor.cofactors().holding(scene.held)
    if _is_weak(factor, cofactors):
        raise SingularNormalsError(factor.matrix)
    residuals = deviations(scene.network, scene.block, state)
    errors = ErrorSources(network=problem.network, state=state, cofactors=cofactors, alone=False)
    spread = spread_to_observations(errors, scene.block, residuals[_K.PLATE])
    adjusted = {kind: np.zeros(weight.shape) for kind, weight in scene.weight.items()}
    for part in spread.parts:
        # the priors of tilt and index hold the water of the whole job: no card of one photo or point is to blame
        if part.kind in adjusted:
            observed = part.weight > 0.0
            adjusted[part.kind][part.row[observed], part.component[observed]] = part.cofactor[observed]
    # in a priori sigmas, and their squares
    residual, leverage = units.gathered(residuals), units.weight * units.gathered(adjusted)
    v = residual * np.sqrt(units.weight)
    taken = np.flatnonzero(out[units.unit])  # few, and what is done about them costs little
    r, used = 1.0 - leverage, v.copy()
    least = np.where(units.kind == _K.PLATE, IMAGES_CHECKED, OTHERS_CHECKED)
    r[taken] = 1.0 - units.gathered(factors)[taken] * leverage[taken]
    used[taken], least[taken] = 0.0, 1.0 - IMAGES_CHECKED
    f = float(np.sum(r) - np.sum(r[taken]))
    sigma0 = np.sqrt(float(np.sum(np.square(used))) / f) if f > 1.0 else 1.0
    sigma0 = max(sigma0, _BEST)
    r[~(r > least)] = np.nan
    variance = r.copy()
    variance[taken] = np.where(np.isnan(r[taken]), np.nan, 1.0 + leverage[taken])
    tau = v / (sigma0 * np.sqrt(variance))
    test = tau if f <= 2.0 else np.clip(students_of_pope(tau, f), -_BEYOND, _BEYOND)
    test[taken] = tau[taken]
    return Judgement(
        units=units,
        out=out,
        test=test,
        error=-residual / r,
        shapes={kind: weight.shape for kind, weight in scene.weight.items()},
        sigma0=sigma0,
        freedom=f,
        factor=factor,
        covariance=spread.points * sigma0**2,
    )


def _is_weak(factor: Factor, cofactors: Cofactors) -> bool:
    """Return whether the normal equations leave unknowns free.

    The trace of the inverse of the scaled matrix is larger than that of its smallest eigenvalue.
    """
    trace = float(np.sum(cofactors.diagonal() / np.square(factor.scale)))
    return not trace * SINGULAR < 1.0 and factor.is_weak(SINGULAR)


def worst_common_tide(scene: StagedBlock, state: State, judgement: Judgement) -> Hypothesis | None:
    """Return the common error of the tides of several photos that is the surest one, None where none is tested."""
    units, network = judgement.units, scene.network
    if not network.water.per_photo:
        return None
    inside = np.zeros(network.photos, dtype=bool)
    inside[units.row[units.first[(units.kind[units.first] == _K.WATER_LEVEL) & ~judgement.out]]] = True
    weight = np.where(inside, network.water.level_weight, 0.0)
    errors = common_tides(scene.block, network, weight, level_corrections(network, state), judgement.factor)
    return max(errors, key=lambda error: error.squares, default=None)


def _leaving(judgement: Judgement, value: FloatArray) -> BoolArray:
    """Return the units that go out now: the worst of every place, with what cannot be told from it.

    And those that will be beyond their limits as soon as these have gone, as sigma0 gets smaller by them.
    """
    units, leaving = judgement.units, np.zeros(len(judgement.units.first), dtype=bool)
    value = np.where(judgement.out, 0.0, value)
    limit, f = units.limits, judgement.freedom
    if not (value > limit).any():
        return leaving
    place = units.place[units.first]
    worst = np.zeros(place.max() + 1)
    np.maximum.at(worst, place, value)
    may_leave, smaller = (value >= _SHARE * value.max()) & (value >= _TIED * worst[place]), 1.0
    while not np.array_equal(leaving, more := may_leave & (value > smaller * limit)):
        leaving = more
        squares = float(np.square(worst[np.unique(place[leaving])]).sum())
        if squares < _LITTLE * f:  # else they are not independent of each other
            smaller = float(np.sqrt((f - squares) / (f - np.count_nonzero(leaving))))
    return leaving
