"""Linear models of a scene with a few images or control points told otherwise, from one that is known."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from musatpy.adjustment.ground import settle_group
from musatpy.adjustment.kinds import PRIORS
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.updated_factor import UpdatedFactor
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.blunders.factors import Factors, weighted
from musatpy.blunders.linear_model import Inverse, LinearModel, PointChecks, by_images, checks_of, told
from musatpy.blunders.scene import Scene
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
        model, kept = self.model, self.model.kept
        points = _told_otherwise(scene, self.factors, factors)
        same = scene is model.scene and state is self.state
        if not same or kept is None or points is None or np.count_nonzero(points) > _FEW:
            return None
        for known, neighbour in self._told:
            if all(np.array_equal(known[kind], factor) for kind, factor in factors.items()):
                return neighbour
        network = weighted(scene.network, scene.block, factors)
        settled, groups = _settled(network, model.state, points), network.groups
        parts = [part for group in groups for part in group.some(points[group.point])]
        before = list(checks_of(scene, model.network, model.state, parts, model.inverse))
        after = list(checks_of(scene, network, settled, parts, model.inverse))
        none = np.zeros(0, dtype=np.int64)
        unknowns = np.unique(np.concatenate([none, *(checks.unknowns.reshape(-1) for checks in before)]))
        free = ~np.isin(unknowns, model.inverse.held)
        (matrix_before, rhs_before), (matrix, rhs) = (_reduced(unknowns, checks) for checks in (before, after))
        factor = UpdatedFactor.of(kept.factor, unknowns, (matrix - matrix_before) * free[:, None] * free)
        if factor is None:
            return None
        line = replace(kept.line, rhs=kept.line.rhs.copy())
        line.rhs[unknowns] += (rhs - rhs_before) * free
        inverse = UpdatedInverse(factor=factor, held=model.inverse.held, before=model.inverse)
        neighbour = told(scene, network, settled, line, inverse, model, before, after)
        self._told[:] = [(factors, neighbour), *self._told[: _REMEMBERED - 1]]
        return neighbour


def _told_otherwise(scene: Scene, before: Factors, factors: Factors) -> BoolArray | None:
    """Return the points (p,) whose images or control have other weights, None where anything else has."""
    links = {prior.observed: prior.points(scene.block) for prior in PRIORS}
    links[ObservationKind.PLATE] = scene.network.point
    points = np.zeros(scene.network.points, dtype=bool)
    for kind, factor in factors.items():
        rows = np.flatnonzero((factor != before[kind]).any(axis=1))
        if kind in links:
            points[links[kind][rows]] = True
        elif len(rows):
            return None
    return points


def _settled(network: Network, state: State, points: BoolArray) -> State:
    """Return the state with some of the points where a linear model takes them."""
    ground, squares = state.ground.copy(), state.squares.copy()
    for group in (*network.pass_groups, *network.control_groups):
        for part in group.some(points[group.point]):
            at = part.point
            ground[at], squares[at] = settle_group(network, state, part, ground[at])
    return by_images(network, replace(state, ground=ground, squares=squares), points)


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
