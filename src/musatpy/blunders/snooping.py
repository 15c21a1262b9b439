"""Data snooping: one observation after the other is taken out, or comes back, until the tests find no more.

Baarda (1968) for the test of an observation that takes part, v / (sigma sqrt r); one that was taken out is tested
against what the others predict, whose variance is added to its own. Both are divided by the sigma0 of the others
(Pope 1976), so that plates that are all a little worse than their sigmas do not look like blunders.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from musatpy.adjustment.iteration import Kept, Near, SingularNormalsError
from musatpy.adjustment.normals import SINGULAR, factorised
from musatpy.adjustment.precision import Errors, Spread, spread_to_observations
from musatpy.adjustment.unknowns import State
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.blunders.alternatives import wrong_images
from musatpy.blunders.factors import Factors, weighted
from musatpy.blunders.linear_model import Inverse
from musatpy.blunders.scene import AROUND, Scene, plate_scale, settled, sizes
from musatpy.blunders.tides import CommonTide, common_tides
from musatpy.model import ObservationKind
from musatpy.model.progress import begin
from musatpy.statistics.quality import test_limit

LIMIT = 4.0  # of the test values at least: one good observation in 16,000 lies beyond
_BACK = 0.9  # of the limit, below which an observation comes back
_RETURNS = 2  # of one observation, at most
_ROUNDS = 25
_START = 6.0  # robust scales beyond which an observation is out from the start
_SHARE = 0.5  # of the largest test value that others must have to go out with it
_LITTLE = 0.1  # of all squares, that those which leave may explain for their sum to be foreseen
_TIED = 0.98  # of the largest test value of a point: no telling which of them it is
_CHECKED, _PREDICTED = 0.01, 0.99  # redundancy numbers that make tests of images in, and out, worth anything
_ROUNDING = 1e-5  # that of observations held tightly, such as control without error and tides
_BEST = 0.2  # sigma0 that nothing is better than
_PULL = 1e3  # sigmas up to which what is out keeps that weight: kilometres would still bend the block by it
_TAKEN = 1e-6  # of its weight is left to an observation that is out
_UP = 2  # component

_K = ObservationKind


@dataclass(frozen=True, kw_only=True, eq=False)
class Units:
    """The o observations by what can be taken out: images, horizontal or vertical control, stations, and so on.

    Those of a unit follow each other, and so do the units.
    """

    kind: IntArray  # (o,)
    row: IntArray  # (o,)
    component: IntArray  # (o,)
    unit: IntArray  # (o,) number of its unit
    place: IntArray  # (o,) ground point, or a number of its own: units of one place compete

    @cached_property
    def of_kinds(self) -> dict[ObservationKind, slice]:
        """The observations of each kind."""
        kinds, first = np.unique(self.kind, return_index=True)
        cut = [*first.tolist(), len(self.kind)]
        return {_K(kind): slice(*cut[at : at + 2]) for at, kind in enumerate(kinds.tolist())}

    @property
    def count(self) -> int:
        """Number of units."""
        return int(self.unit.max(initial=-1)) + 1

    def limits(self) -> FloatArray:
        """Return (units,) the limits of the test values, by how many observations there are of each kind.

        In a large block some good image lies beyond the limit of a small one.
        """
        of_kind = np.array([max(LIMIT, test_limit(count)) for count in np.bincount(self.kind).tolist()])
        return np.asarray(of_kind[self.kind[self.first()]])

    def first(self) -> IntArray:
        """Return (units,) the first observation of every unit."""
        return np.flatnonzero(np.diff(self.unit, prepend=-1))

    def per_unit(self, value: FloatArray) -> FloatArray:
        """Return (units,) the largest value of the observations of each unit."""
        largest = np.maximum.reduceat(np.nan_to_num(value), self.first())
        return np.asarray(np.maximum(largest, 0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Judgement:
    """The tests of all observations, with some of their units out."""

    units: Units
    out: BoolArray  # (units,)
    test: FloatArray  # (o,) NaN where nothing checks the observation
    error: FloatArray  # (o,) estimated: given minus what the others say
    sigma0: float
    redundancy: float  # of what is in
    normals: Kept
    inverse: Inverse
    covariance: FloatArray  # (p, 3, 3) m2, east, north, up of the points that take part

    @property
    def unit_test(self) -> FloatArray:
        """(units,) the largest test value, without its sign, of each unit; 0 where nothing checks it."""
        return self.units.per_unit(np.abs(self.test))


@dataclass(frozen=True, kw_only=True, eq=False)
class Snooped:
    """Where the search has come to rest."""

    scene: Scene
    state: State
    judgement: Judgement
    tides: tuple[CommonTide, ...]  # errors that the tides of several photos have in common
    rest: bool  # False: it was stopped

    @property
    def units(self) -> Units:
        """The units of the judgement."""
        return self.judgement.units

    def out(self) -> Factors:
        """Return 1 for the observations that are out, 0 for all others."""
        return _masks(self.scene, self.units, self.judgement.out)

    def is_rest_with(self, scene: Scene, out: BoolArray) -> bool:
        """Return whether it is where a scene comes to rest with these units (units,) out."""
        return (
            self.rest
            and not self.tides
            and self.scene.block is scene.block
            and np.array_equal(self.judgement.out, out)
            and np.array_equal(self.scene.line.wet, scene.line.wet)
        )


def snooped(
    scene: Scene,
    state: State,
    first: Factors | None = None,
    returning: bool = True,
    before: Snooped | None = None,
) -> Snooped:
    """Return the search at rest.

    `first` is 1 for what is out at the beginning; without it, what robust weights leave far off is. Without
    `returning` nothing of that comes back but images whose points are explained otherwise. Where what is out comes
    to be that of the search `before`, it has come to the same rest. Raises `SingularNormalsError`.
    """
    units = units_of(scene)
    image, limit = units.kind[units.first()] == _K.PLATE, units.limits()
    returns = np.full(units.count, 0 if returning else _RETURNS)
    if first is None:
        size, near = sizes(scene, state), AROUND
        scale = plate_scale(scene, size)
        out = units.per_unit(np.abs(_gathered(size, units))) > _START * scale
        chosen, state = _images_anew(scene, state, units, out & image, scale)
        out = np.where(image, chosen, out)
    else:
        near, out = Near(), units.per_unit(_gathered(first, units)) > 0.0
    tides: tuple[CommonTide, ...] = ()
    rest = proven = False
    for number in range(_ROUNDS):
        if before is not None and before.is_rest_with(scene, out):
            return replace(before, tides=tides)
        begin(scene.progress, "search for blunders: round of snooping", number + 1, _ROUNDS)
        factors = factors_of(_masks(scene, units, out), sizes(scene, state))
        scene, state, normals = settled(scene, factors, state, near)
        near = Near()
        judgement = judged(scene, state, units, out, factors, normals)
        value = judgement.unit_test
        fits = _predicted(judgement) & (value < _BACK * limit)
        back = out & fits & (returns < _RETURNS) & ~image
        if number == 0:  # what nothing predicts can be tested only when it is in
            back |= out & ~_predicted(judgement) & ~image
        leaving = _leaving(judgement, value)
        common = worst_common_tide(scene, state, judgement)
        if common is not None and common.test > max(LIMIT, np.where(out, 0.0, value).max(initial=0.0)):
            tides, leaving = (*tides, common), _tides_of(units, common.photo)
            returns[leaving] = _RETURNS
        # an image comes back where its point is explained otherwise, unless its own test says no
        sure = image & (leaving | (out & ~fits & _predicted(judgement)))
        wrong, after = _images_anew(scene, state, units, image & (out | leaving), judgement.sigma0)
        stays = sure | wrong | (out & (number > 0))
        back, leaving = np.where(image, out & ~stays, back), np.where(image, stays & ~out, leaving)
        if not back.any() and not leaving.any():
            if not tides or proven:
                rest = True
                break
            # what else was wrong when they went out may have looked like them: they have to be found once more
            back, tides, proven = _tides_of(units, np.concatenate([tide.photo for tide in tides])), (), True
        returns[back] += 1
        out, state = (out & ~back) | leaving, after
    return Snooped(scene=scene, state=state, judgement=judgement, tides=tides, rest=rest)


def _images_anew(
    scene: Scene, state: State, units: Units, anew: BoolArray, sigma0: float
) -> tuple[BoolArray, State]:
    """Return which images (units,) are out when those of points with some in `anew` are chosen anew.

    And the state with these points where the others see them.
    """
    out = _masks(scene, units, anew)
    out, state = images_anew(scene, state, out, np.asarray(out[_K.PLATE].any(axis=1)), sigma0)
    return units.per_unit(_gathered(out, units)) > 0.0, state


def images_anew(scene: Scene, state: State, out: Factors, anew: BoolArray, sigma0: float) -> tuple[Factors, State]:
    """Return what is out with the images chosen anew of the points that have some in `anew` (m,), no others out.

    And the state with these points where the others see them.
    """
    factors = factors_of(out, sizes(scene, state)) | {_K.PLATE: np.ones_like(out[_K.PLATE])}
    wrong, state = wrong_images(weighted(scene.network, scene.block, factors), state, anew, sigma0)
    return out | {_K.PLATE: np.repeat(wrong[:, None], 2, axis=1).astype(float)}, state


def _tides_of(units: Units, photo: IntArray) -> BoolArray:
    """Return the units that are the tides of some photos."""
    tides = np.zeros(units.count, dtype=bool)
    tides[units.unit[(units.kind == _K.WATER_LEVEL) & np.isin(units.row, photo)]] = True
    return tides


def units_of(scene: Scene) -> Units:
    """Return the units of the observations of a scene, in the order of `Observations`."""
    kinds = [np.argwhere(weight > 0.0) for weight in scene.weight.values()]
    kind = np.repeat([int(of) for of in scene.weight], [len(rows) for rows in kinds])
    row, component = np.concatenate(kinds).T
    order = np.lexsort((component, row, kind))
    kind, row, component = kind[order], row[order], component[order]
    part = (kind == _K.CONTROL) & (component == _UP)
    begins = np.diff(kind, prepend=-1) | np.diff(row, prepend=-1) | np.diff(part.astype(int), prepend=0)
    unit = np.cumsum(begins != 0) - 1
    block, points = scene.block, len(scene.block.points.ids)
    place = points + unit
    for of, table in (
        (_K.PLATE, block.plates.point),
        (_K.CONTROL, block.control.point),
        (_K.EQUAL_ELEVATION, block.equal_elevations.point),
    ):
        place[kind == of] = table[row[kind == of]]
    return Units(kind=kind, row=row, component=component, unit=unit, place=place)


def factors_of(out: Factors, size: Factors) -> Factors:
    """Return the factors on the weights with the observations out where `out` is not zero.

    Those whose residuals `size`, in sigmas, are beyond all measure are left less weight: they must not pull.
    """
    factors = {}
    for kind, mask in out.items():
        beyond = np.maximum(np.nan_to_num(np.abs(size[kind])) / _PULL, 1.0)
        factors[kind] = np.where(mask > 0.0, _TAKEN / np.square(beyond), 1.0)
    return factors


def _masks(scene: Scene, units: Units, out: BoolArray) -> Factors:
    """Return 1 for the observations of units that are out, 0 for all others."""
    masks = {kind: np.zeros_like(weight) for kind, weight in scene.weight.items()}
    taken = out[units.unit]
    for kind, rows in units.of_kinds.items():
        masks[kind][units.row[rows], units.component[rows]] = taken[rows]
    return masks


def _gathered(values: Factors, units: Units) -> FloatArray:
    """Return the values (o,) of all observations."""
    out = np.zeros(len(units.kind))
    for kind, rows in units.of_kinds.items():
        out[rows] = values[kind][units.row[rows], units.component[rows]]
    return out


def judged(
    scene: Scene, state: State, units: Units, out: BoolArray, factors: Factors, normals: Kept | None
) -> Judgement:
    """Return the tests of all observations at the minimum with the weights times `factors`, `out` (units,) out.

    `normals` are those there, if they are known. Raises `SingularNormalsError`.
    """
    problem = scene.problem(factors)
    if normals is None:
        line = problem.linearise(problem.with_squares(state))
        factor = factorised(line.matrix)
        if factor is None:
            raise SingularNormalsError(line.matrix)
        normals = Kept(line=replace(line, context=None), factor=factor)
    inverse = Inverse(factor=normals.factor, held=scene.held)
    if _is_weak(inverse):
        raise SingularNormalsError(normals.line.matrix)
    residuals, _ = scene.residuals_and_sizes(state)
    errors = Errors(network=problem.network, state=state, cofactors=inverse.cofactors)
    spread = spread_to_observations(errors, scene.block, residuals[_K.PLATE])
    taken = out[units.unit]
    weight, v = _gathered(scene.weight, units), _gathered(residuals, units)
    sigma, cofactor = 1.0 / np.sqrt(weight), _cofactors(scene, units, spread)
    r = 1.0 - weight * _gathered(factors, units) * cofactor
    variance = np.where(taken, np.square(sigma) + cofactor, np.square(sigma) * r)
    checked = r > np.where(taken, _PREDICTED, np.where(units.kind == _K.PLATE, _CHECKED, _ROUNDING))
    f = float(r[~taken].sum())
    sigma0 = np.sqrt(float(np.square(v / sigma)[~taken].sum()) / f) if f > 1.0 else 1.0
    sigma0 = max(sigma0, _BEST)
    tau = v / (sigma0 * np.sqrt(np.where(checked, variance, np.nan)))
    with np.errstate(divide="ignore", invalid="ignore"):
        left = f - np.square(tau)
        student = np.where(left > 0.0, tau * np.sqrt((f - 1.0) / left), np.sign(tau) * 1e3)
    return Judgement(
        units=units,
        out=out,
        test=np.where(taken | (f <= 2.0), tau, student),
        error=-v / np.where(checked, r, np.nan),
        sigma0=sigma0,
        redundancy=f,
        normals=normals,
        inverse=inverse,
        covariance=spread.points * sigma0**2,
    )


def _is_weak(inverse: Inverse) -> bool:
    """Return whether the normal equations leave unknowns free.

    The trace of the inverse of the scaled matrix is larger than that of its smallest eigenvalue.
    """
    factor = inverse.factor
    trace = float(np.sum(inverse.cofactors.diagonal() / np.square(factor.scale)))
    return not trace * SINGULAR < 1.0 and factor.is_weak(SINGULAR)


def _cofactors(scene: Scene, units: Units, spread: Spread) -> FloatArray:
    """Return the cofactors (o,) of the adjusted observations."""
    cofactor = {kind: np.zeros_like(weight) for kind, weight in scene.weight.items()}
    for part in spread.parts:
        # the priors of tilt and index hold the water of the whole job: no card of one photo or point is to blame
        if part.kind in cofactor:
            observed = part.weight > 0.0
            cofactor[part.kind][part.row[observed], part.component[observed]] = part.cofactor[observed]
    return _gathered(cofactor, units)


def worst_common_tide(scene: Scene, state: State, judgement: Judgement) -> CommonTide | None:
    """Return the common error of the tides of several photos that is the surest one, None where none is tested."""
    units, block = judgement.units, scene.block
    if not scene.network.water.per_photo:
        return None
    taken = np.ones(len(block.photos.ids), dtype=bool)
    inside = units.kind[units.first()] == _K.WATER_LEVEL
    taken[units.row[units.first()][inside & ~judgement.out]] = False
    errors = common_tides(block, scene.network, state, judgement.normals.factor, taken, judgement.sigma0)
    return max(errors, key=lambda error: error.test, default=None)


def _predicted(judgement: Judgement) -> BoolArray:
    """Return (units,) whether the others predict all observations of a unit."""
    unknown = np.zeros(judgement.units.count, dtype=bool)
    unknown[judgement.units.unit[np.isnan(judgement.test)]] = True
    return ~unknown


def _leaving(judgement: Judgement, value: FloatArray) -> BoolArray:
    """Return the units that go out now: the worst of every place, with what cannot be told from it.

    And those that will be beyond their limits as soon as these have gone, as sigma0 gets smaller by them.
    """
    units, leaving = judgement.units, np.zeros(judgement.units.count, dtype=bool)
    value = np.where(judgement.out, 0.0, value)
    limit, f = units.limits(), judgement.redundancy
    if not (value > limit).any():
        return leaving
    place = units.place[units.first()]
    worst = np.zeros(place.max() + 1)
    np.maximum.at(worst, place, value)
    may_leave, smaller = (value >= _SHARE * value.max()) & (value >= _TIED * worst[place]), 1.0
    while not np.array_equal(leaving, more := may_leave & (value > smaller * limit)):
        leaving = more
        squares = float(np.square(worst[np.unique(place[leaving])]).sum())
        if squares < _LITTLE * f:  # else they are not independent of each other
            smaller = float(np.sqrt((f - squares) / (f - np.count_nonzero(leaving))))
    return leaving
