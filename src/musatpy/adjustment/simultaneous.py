"""One MUSAT-IIIA adjustment as a least squares problem: stations, water and all ground points at once.

Collinearity of every image, the refraction in its equations (ETL-0306 section 4 with the corrections of
docs/theory.md). The ground points are eliminated from the normal equations point by point, and follow the step of
the stations by back substitution.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from musatpy.adjustment.collinear import Elimination, Follow, Reduced, add_collinear, eliminate, reduced
from musatpy.adjustment.ground import point_squares, settle_group
from musatpy.adjustment.iteration import Linearisation, not_raised
from musatpy.adjustment.kernels import Loops, loops_of
from musatpy.adjustment.kinds import (
    UNKNOWNS,
    add_direct,
    direct_squares,
    kept_movement,
    largest_movements,
    state_after,
)
from musatpy.adjustment.network import RAYS, Network, PointGroup, parts_of, together
from musatpy.adjustment.normals import NormalEquations, factorised
from musatpy.adjustment.propagation import redundancy
from musatpy.adjustment.threads import side_by_side
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry import collinearity
from musatpy.model import INDEX_RANGE, ObservationKind, Options

_FLATTEST = 0.1  # of the curvature of the normal equations
_SHARE = 1e-5  # of the sigmas of waves: steps of the central differences, which lose ten digits of sixteen


def sum_of_squares(network: Network, state: State) -> float:
    """Return the weighted sum of squares at a state that has those of its points; infinite if it is senseless."""
    total = direct_squares(network, state)
    total += sum(float(state.squares[group.point].sum()) for group in network.groups)
    return total if np.isfinite(total) else np.inf


def sensible_water(network: Network, state: State) -> bool:
    """Return whether waves and index, where they are unknown, are such as water has: no step was too long."""
    index = INDEX_RANGE[0] <= state.index <= INDEX_RANGE[1] or not network.border.count(ObservationKind.WATER_INDEX)
    return index and (network.sea is None or network.sea.at(state.waves).sensible)


@dataclass(frozen=True, kw_only=True, eq=False)
class Simultaneous:
    """The simultaneous adjustment of a network."""

    network: Network
    options: Options  # its limits
    held: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # what holds a free block

    @cached_property
    def _loops(self) -> Loops:
        return loops_of(self.network, self.network.groups)

    @cached_property
    def _redundancy(self) -> int:
        return redundancy(self.network)

    def linearise(self, state: State) -> Linearisation:
        """Return the normal equations of stations and globals at `state`, the ground points eliminated."""
        network = self.network
        normals = NormalEquations(network.pattern, network.border.size)
        follows: list[Follow] = []

        def eliminated(part: PointGroup) -> tuple[Elimination, Reduced]:
            E = eliminate(network, state, part)
            return E, reduced(network, part, E)

        left, of_points = self._loops.eliminate(state, normals, follows)
        parts = parts_of(together(left), RAYS)
        for part, (E, equations) in zip(parts, side_by_side(eliminated, parts, len(network.photo)), strict=True):
            add_collinear(network, part, E, equations, normals)
            follows.append(E.follow(part))
            of_points += E.gain
        add_direct(network, state, normals)
        matrix, rhs = normals.finished(self.held)
        return Linearisation(
            matrix=matrix,
            rhs=rhs,
            objective=self.evaluate(state, follows),
            context=follows,
            redundancy=self._redundancy,
            of_points=of_points,
        )

    def evaluate(self, state: State, context: list[Follow]) -> float:
        """Return the weighted sum of squares at `state`."""
        return sum_of_squares(self.network, state)

    def apply(self, state: State, step: FloatArray, context: list[Follow]) -> State:
        """Return the state after a step, which the ground points follow by back substitution.

        However short the step of the stations, the points take their whole one: where that would raise the sum of
        squares, the points that got worse go from where they were to their optimum instead. So a step that is
        damped enough lowers the sum always.
        """
        network, before = self.network, self.evaluate(state, context)
        new = state_after(network, state, step)
        ground = new.ground.copy()
        for follow in context:
            follow.move(network, state, step, ground)
        after = replace(new, ground=ground)
        if not sensible_water(network, new):
            squares = np.full_like(state.squares, np.inf)  # the step was too long
            return replace(after, squares=squares)
        after = self.with_squares(after)
        if not_raised(self.evaluate(after, context), before):
            return after
        return self._settled(after, state)

    def _settled(self, after: State, before: State) -> State:
        """Return the state `after` with those eliminated points at their optimum that fitted better `before`."""
        network, ground, squares = self.network, after.ground.copy(), after.squares.copy()
        for group in together(network.groups):
            worse = after.squares[group.point] > before.squares[group.point]
            if worse.any() and not group.kept:
                part = group.part(worse)
                start = before.ground[part.point]
                ground[part.point], squares[part.point] = settle_group(network, after, part, start, trial=True)
        return replace(after, ground=ground, squares=squares)

    def with_squares(self, state: State) -> State:
        """Return the state with the weighted squares of its points where they are."""
        squares = state.squares.copy()
        for group in together(self._loops.set_squares(state, squares)):
            squares[group.point] = point_squares(self.network, state, group, state.ground[group.point])
        return replace(state, squares=squares)

    def converged(self, step: FloatArray) -> bool:
        """Return whether the largest steps of stations and water are below their limits."""
        _, rotation, _, translation = largest_movements(step, self.network)
        turn, shift = self.options.rotation_limit, self.options.translation_limit
        rest = all(kind.movement(self.network, step)[0] < kind.limit(turn, shift) for kind in UNKNOWNS)
        return rest and rotation < turn and max(translation, kept_movement(step, self.network)) < shift


@dataclass(frozen=True, kw_only=True, eq=False)
class Curved(Simultaneous):
    """The simultaneous adjustment with the second derivatives of the images by unknown waves.

    In the effect of length, azimuth and crest the height is a factor. Of a wave that hardly shows, steps that take
    the images for linear go from one side of the minimum to the other, or have to be damped to a crawl. With the
    second derivatives by the waves alone, steps are those of Newton's method in them. Those by waves and points, or
    stations, are left out: these move by less than a hundredth of a length.
    """

    def linearise(self, state: State) -> Linearisation:
        """Return the normal equations at `state`, their corner with the curvature by the waves."""
        line, border = super().linearise(state), self.network.border
        matrix, factor = line.matrix, factorised(line.matrix)
        if factor is None:
            return line
        waves, corner = border.at(ObservationKind.WAVE), matrix.corner.copy()
        rows = len(matrix.border) + border.numbers(ObservationKind.WAVE)
        units = np.zeros((matrix.size, len(rows)))
        units[rows, np.arange(len(rows))] = factor.scale[rows]
        cofactor = factor.solve_scaled(units)[rows] * factor.scale[rows, None]
        corner[waves, waves] += safe_curvature(wave_curvature(self.network, state), cofactor)
        return replace(line, matrix=replace(matrix, corner=corner))


def safe_curvature(curvature: FloatArray, cofactor: FloatArray) -> FloatArray:
    """Return the curvature C (w, w) so that N + C is positive definite; `cofactor` (w, w) is N^-1 of the waves.

    Against N, N + C has the eigenvalues 1 + m. Where they are below zero, or hardly above, the sum of squares
    curves down, or not at all: their sizes count then, and no less than `_FLATTEST`. So no step goes to a maximum.
    """
    L = np.linalg.cholesky(np.linalg.inv(0.5 * (cofactor + cofactor.T)))
    inner = np.linalg.solve(L, np.linalg.solve(L, curvature).T)
    m, U = np.linalg.eigh(0.5 * (inner + inner.T))
    turned = L @ U
    return (turned * (np.maximum(np.abs(1.0 + m), _FLATTEST) - 1.0)) @ turned.T


def wave_curvature(network: Network, state: State) -> FloatArray:
    """Return sum of P r times the second derivatives of the images by the unknown parameters of the waves (w, w).

    r are the residuals (adjusted minus measured) at `state`, P their weights. The waves act through their height
    and gradient at the incidence points: the partials of these by the parameters are differenced, all else stays.
    """
    sea = network.sea
    assert sea is not None and sea.trains is not None and sea.sea.sigma is not None, "there are unknown waves"
    trains, sigma = sea.trains, sea.sea.sigma
    rays = np.concatenate([group.rays.reshape(-1) for group in network.groups])
    rays = rays[network.refracted[rays]]
    photo, ground = network.photo[rays], state.ground[network.point[rays]]
    bent = sea.at(state.waves).incidence(photo, state.position[photo], ground, state.tide[photo], state.index)
    f, pp = network.focal_length[photo], network.principal_point[photo]
    xy, by_v = collinearity.image_by_vector(bent.v, state.M[photo], f, pp)
    pull = np.einsum("na,nai->ni", network.weight[rays] * (xy - network.xy[rays]), by_v)
    by_height = np.einsum("ni,ni->n", pull, bent.by_level)
    by_slope = np.einsum("ni,nia->na", pull, bent.by_slope)
    unknown, time = sea.sea.unknown, sea.sea.time[photo]

    def gradient(waves: FloatArray) -> FloatArray:
        height, slope = trains.with_values(waves).by_parameters(bent.place, time)
        return by_height @ height[:, unknown] + np.einsum("na,naw->w", by_slope, slope[..., unknown])

    rows = []
    for wave, of in np.argwhere(unknown):
        step = np.zeros_like(state.waves)
        step[wave, of] = _SHARE * sigma[wave, of]
        rows.append((gradient(state.waves + step) - gradient(state.waves - step)) / (2.0 * step[wave, of]))
    matrix = np.array(rows).reshape(len(rows), len(rows))
    return 0.5 * (matrix + matrix.T)
