"""Linear models of a scene with a few images or control points told otherwise, from one that is known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from musatpy.adjustment.collinear import eliminate, local_normals
from musatpy.adjustment.ground import settle_group
from musatpy.adjustment.kinds import PRIORS
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.updated_factor import UpdatedFactor
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.blunders.factors import Factors, weighted
from musatpy.blunders.linear_model import Inverse, LinearModel, by_images, solved
from musatpy.blunders.scene import Scene
from musatpy.model import ObservationKind

_FEW = 8  # points: with more of them a new factor is cheaper


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

    def neighbour(self, scene: Scene, factors: Factors, state: State) -> LinearModel | None:
        """Return the linear model with the weights times other `factors`.

        None where scene or state are others, where a new factor is cheaper, or where too little is left of one.
        """
        model, kept = self.model, self.model.kept
        points = _told_otherwise(scene, self.factors, factors)
        same = scene is model.scene and state is self.state
        if not same or kept is None or points is None or np.count_nonzero(points) > _FEW:
            return None
        network = weighted(scene.network, scene.block, factors)
        settled = _settled(network, model.state, points)
        unknowns, matrix, rhs = _reduced(network, settled, points)
        _, matrix_before, rhs_before = _reduced(model.network, model.state, points)
        free = ~np.isin(unknowns, model.inverse.held)
        factor = UpdatedFactor.of(kept.factor, unknowns, (matrix - matrix_before) * free[:, None] * free)
        if factor is None:
            return None
        line = replace(kept.line, rhs=kept.line.rhs.copy())
        line.rhs[unknowns] += (rhs - rhs_before) * free
        inverse = UpdatedInverse(factor=factor, held=model.inverse.held, before=model.inverse)
        return solved(scene, network, settled, line, inverse)


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
    met = by_images(network, replace(state, ground=ground, squares=squares)).ground
    return replace(state, ground=np.where(points[:, None], met, ground), squares=squares)


def _reduced(network: Network, state: State, points: BoolArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the unknowns (s,) of some of the points, and their reduced normals (s, s) and right sides (s,)."""
    every = []
    for part in [part for group in network.groups for part in group.some(points[group.point])]:
        E = eliminate(network, state, part)
        every.append((network.unknowns(part, E.extras.index), *local_normals(network, part, E)))
    unknowns = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(of.reshape(-1) for of, _, _ in every)]))
    matrix, rhs = np.zeros((len(unknowns), len(unknowns))), np.zeros(len(unknowns))
    for of, matrices, sides in every:
        rows = np.searchsorted(unknowns, of)
        np.add.at(matrix, (rows[:, :, None], rows[:, None, :]), matrices)
        np.add.at(rhs, rows, sides)
    return unknowns, matrix, rhs
