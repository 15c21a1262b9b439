"""Linear models of a scene with a few images or control points told otherwise, from one that is known."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from musatpy.adjustment import ground as ground_points
from musatpy.adjustment.iteration import Kept, Linearisation
from musatpy.adjustment.kinds import PRIORS
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.updated_factor import UpdatedFactor
from musatpy.arrays import FloatArray, IntArray
from musatpy.blunders.checks import CheckedPoints, Inverse, PointChecks, checked_points
from musatpy.blunders.common_errors import CommonErrors
from musatpy.blunders.factors import Factors, weighted
from musatpy.blunders.linear_model import LinearModel, by_images, linear_model, solved
from musatpy.blunders.scene import Scene, sizes
from musatpy.blunders.snooping import Snooped, factors_of
from musatpy.model import ObservationKind

_FEW = 8  # points: with more of them a new factor is cheaper
_REMEMBERED = 4  # models: the one of the best of some trials is asked for again


@dataclass(frozen=True, kw_only=True, eq=False)
class UpdatedInverse(Inverse):
    """The inverse of updated normal equations, from that of those before."""

    factor: UpdatedFactor
    before: Inverse

    @cached_property
    def cofactors(self) -> Cofactors:
        """The cofactors of all photos that meet."""
        return self.factor.updated(self.before.cofactors)

    def with_border(self, photo: IntArray, index: IntArray) -> FloatArray:
        """Return what `Cofactors.with_border` does."""
        return self.before.with_border(photo, index) - self.factor.fall(photo, index)

    def cofactors_of(self, photo: IntArray, index: IntArray, partials: FloatArray) -> FloatArray:
        """Return what `Cofactors.cofactors_of` does."""
        before = self.before.cofactors_of(photo, index, partials)
        return before - self.factor.fall_of(photo, index, partials)


@dataclass(frozen=True, kw_only=True, eq=False)
class ToldModel(LinearModel):
    """A linear model told from another one, `model`: some points are `before` there what they are `after` here.

    Both by the step of this one.
    """

    model: LinearModel
    before: CheckedPoints
    after: CheckedPoints

    @cached_property
    def common(self) -> CommonErrors:
        """What errors do that are common to many observations."""
        return self.model.common.told(self.step - self.model.step, self.scene.block, self.before, self.after)


@dataclass(frozen=True, kw_only=True, eq=False)
class Origin:
    """The linear model of a scene at a state with its weights times `factors`, from which others are told."""

    model: LinearModel
    state: State
    factors: Factors
    _told: list[tuple[Factors, LinearModel]] = field(default_factory=list, repr=False)

    def neighbour(self, scene: Scene, factors: Factors, state: State) -> LinearModel | None:
        """Return the linear model with the weights times other `factors`.

        None where scene or state are others, where a new factor is cheaper, or where too little is left of one.
        """
        if scene is not self.model.scene or state is not self.state or self.model.kept is None:
            return None
        for known, neighbour in [(self.factors, self.model), *self._told]:
            if all(np.array_equal(known[kind], factor) for kind, factor in factors.items()):
                return neighbour
        parts = _told_otherwise(scene, self.factors, factors)
        told = parts and _told(self.model, self.model.kept, weighted(scene.network, scene.block, factors), parts)
        if told:
            self._told[:] = [(factors, told), *self._told[: _REMEMBERED - 1]]
        return told or None


def at_rest(last: Snooped) -> Origin:
    """Return the linear model of a search at rest, by the normal equations there.

    Raises `SingularNormalsError`.
    """
    scene, state, judgement = last.scene, last.state, last.judgement
    factors = factors_of(last.out(), sizes(scene, state))
    if state is not judgement.state:  # it was stopped
        return Origin(model=linear_model(scene, factors, state), state=state, factors=factors)
    network = scene.problem(factors).network
    model = solved(scene, network, state, judgement.normals.line, judgement.inverse)
    return Origin(model=model, state=state, factors=factors)


def _told_otherwise(scene: Scene, before: Factors, factors: Factors) -> list[PointGroup] | None:
    """Return the points whose images or control have other weights.

    None where anything else has, or where a new factor is cheaper: they are many, or none are eliminated.
    """
    links = {prior.observed: prior.points(scene.block) for prior in PRIORS}
    links[ObservationKind.PLATE] = scene.network.point
    told = np.zeros(scene.network.points, dtype=bool)
    for kind, factor in factors.items():
        rows = np.flatnonzero(factor != before[kind]) // max(factor.shape[1], 1)
        if kind in links:
            told[links[kind][rows]] = True
        elif len(rows):
            return None
    parts = [part for group in scene.network.groups for part in group.some(told[group.point])]
    many = np.count_nonzero(told) > _FEW
    return None if many or any(part.kept for part in parts) else parts


def _told(model: LinearModel, kept: Kept, network: Network, parts: list[PointGroup]) -> LinearModel | None:
    """Return the linear model of a network that has other weights of some points, None where too little is left.

    It is told from a model, whose normals are `kept`.
    """
    was, (alone, state) = _apart(model.network, model.state, parts), _apart(network, model.state, parts)
    state = by_images(alone, ground_points.settle(alone, state))
    (point, rays), nothing = _numbers(parts), np.zeros_like(model.step)
    before, after = (
        checked_points(model.scene.block, *of, model.inverse, nothing, point) for of in (was, (alone, state))
    )
    old, new = list(before.points), list(after.points)
    updated = _updated(kept, model.inverse, old, new)
    if updated is None:
        return None
    line, inverse = updated
    step, others = inverse.factor.solve(line.rhs), np.ones(network.points, dtype=bool)
    others[point], moved = False, step - model.step
    stay = (checks.part(others[checks.point]).after(moved, inverse) for checks in model.points)
    told = (replace(at, point=point[at.point], rays=rays[at.rays]).after(step, inverse) for at in new)
    ground, squares = model.state.ground.copy(), model.state.squares.copy()
    ground[point], squares[point] = state.ground, state.squares
    return ToldModel(
        network=network,
        state=replace(model.state, ground=ground, squares=squares),
        points=(*stay, *told),
        scene=model.scene,
        factor=inverse.factor,
        kept=Kept(line=line, factor=inverse.factor),
        inverse=inverse,
        step=step,
        stations=model.stations + moved[: model.stations.size].reshape(model.stations.shape),
        station_weight=model.station_weight,
        model=model,
        before=_after(before, step, inverse),
        after=_after(after, step, inverse),
    )


def _updated(
    kept: Kept, before: Inverse, old: list[PointChecks], new: list[PointChecks]
) -> tuple[Linearisation, UpdatedInverse] | None:
    """Return the normal equations, and their inverse, with `new` checks of some points in place of the `old` ones.

    None where too little is left.
    """
    unknowns = np.unique(np.concatenate([checks.unknowns.reshape(-1) for checks in old]))
    free = ~np.isin(unknowns, before.held)
    (matrix_before, rhs_before), (matrix, rhs) = (_reduced(unknowns, checks) for checks in (old, new))
    factor = UpdatedFactor.of(kept.factor, unknowns, (matrix - matrix_before) * free[:, None] * free)
    if factor is None:
        return None
    line = replace(kept.line, rhs=kept.line.rhs.copy())
    line.rhs[unknowns] += (rhs - rhs_before) * free
    return line, UpdatedInverse(factor=factor, held=before.held, before=before)


def _numbers(parts: list[PointGroup]) -> tuple[IntArray, IntArray]:
    """Return points and rays, one after the other."""
    point, rays = zip(*((part.point, part.rays.reshape(-1)) for part in parts), strict=True)
    return np.concatenate(point), np.concatenate(rays)


def _apart(network: Network, state: State, parts: list[PointGroup]) -> tuple[Network, State]:
    """Return a network of some points alone, and its state."""
    point, rays = _numbers(parts)
    alone, _ = network.apart(parts, network.xy[rays], network.refracted[rays])
    return alone, replace(state, ground=state.ground[point], squares=state.squares[point])


def _after(points: CheckedPoints, step: FloatArray, inverse: Inverse) -> CheckedPoints:
    """Return points whose checks are those before any step, after a step (u,), by other normals."""
    checks = tuple(of_group.after(step, inverse) for of_group in points.points)
    return replace(points, points=checks)


def _reduced(unknowns: IntArray, points: list[PointChecks]) -> tuple[FloatArray, FloatArray]:
    """Return the reduced normals (s, s) and right sides (s,) that points have by unknowns, all of theirs.

    With partials A of observations that the point follows, A'PA and -A'Pv.
    """
    matrix, rhs = np.zeros((len(unknowns), len(unknowns))), np.zeros(len(unknowns))
    for checks in points:
        rows = np.searchsorted(unknowns, checks.unknowns)
        weighted = np.swapaxes(checks.partials * checks.weight[..., None], 1, 2)
        np.add.at(matrix, (rows[:, :, None], rows[:, None, :]), weighted @ checks.partials)
        np.add.at(rhs, rows, -(weighted @ checks.residual[..., None])[..., 0])
    return matrix, rhs
