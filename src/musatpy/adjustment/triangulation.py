"""One MUSAT-IIA triangulation as a least squares problem: only stations (and levels of groups) are unknown.

Pass points have m - 1 coplanarity and m - 2 scale restraint conditions for m rays, control enters by collinearity.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from musatpy.adjustment import sightings
from musatpy.adjustment.collinear import add_collinear, eliminate, reduced
from musatpy.adjustment.ground import settle
from musatpy.adjustment.iteration import Linearisation
from musatpy.adjustment.kernels import Loops, loops_of
from musatpy.adjustment.kinds import add_direct, direct_squares, largest_movements, state_after
from musatpy.adjustment.network import RAYS, Network, PointGroup, parts_of, together
from musatpy.adjustment.normals import NormalEquations, Sums, summed, upper
from musatpy.adjustment.propagation import redundancy
from musatpy.adjustment.threads import side_by_side
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray
from musatpy.geometry.collinearity import coplanarity, scale_restraint
from musatpy.model import Options, Weights

Scale = tuple[FloatArray, ...] | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Triangulation:
    """The modified geodetic restraint of a network (ETL-0306 section 3, docs/theory.md).

    States that it sees have their points settled; `apply` settles those that it returns.
    """

    network: Network
    options: Options  # weights and limits
    fixed_scale: Scale = None  # the variances of equal weights, the same for the whole triangulation

    @cached_property
    def _loops(self) -> Loops:
        """Over the points that enter by elimination; pass points by full weights do as well (docs/theory.md)."""
        network = self.network
        groups = network.pass_groups if self.options.weights is Weights.FULL else ()
        return loops_of(network, (*groups, *network.control_groups))

    @cached_property
    def _redundancy(self) -> int:
        return redundancy(self.network)

    def linearise(self, state: State) -> Linearisation:
        """Return the reduced normal equations of stations and levels at `state`."""
        network = self.network
        normals = NormalEquations(network.pattern, network.border.size)
        left, _ = self._loops.eliminate(state, normals, [])
        scale: Scale = None
        if self.options.weights is Weights.FULL:
            parts = parts_of((group for group in left if not group.known), RAYS)
            for sums in side_by_side(partial(fully_weighted, network, state), parts, len(network.photo)):
                normals.add_sums(sums)
        else:
            scale = self.fixed_scale or simple_variances(network, state, self.options.weights)
            for group, variance in zip(network.pass_groups, scale, strict=True):
                conditions = measured_conditions(network, state, group)
                normals.add_sums(diagonally_weighted(network, group, conditions, variance))
        for group in together([group for group in left if group.known]):
            E = eliminate(network, state, group)
            add_collinear(network, group, E, reduced(network, group, E), normals)
        add_direct(network, state, normals)
        matrix, rhs = normals.finished()
        return Linearisation(
            matrix=matrix,
            rhs=rhs,
            objective=self.evaluate(state, scale),
            context=scale,
            redundancy=self._redundancy,
        )

    def evaluate(self, state: State, context: Scale) -> float:
        """Return the weighted sum of squares at `state`."""
        network = self.network
        total = direct_squares(network, state)
        for number, group in enumerate(network.pass_groups):
            if context is None:
                total += float(state.squares[group.point].sum())
            else:
                value = measured_conditions(network, state, group).value
                total += float(np.sum(np.square(value) / context[number]))
        for group in network.control_groups:
            total += float(state.squares[group.point].sum())
        return total if np.isfinite(total) else np.inf

    def apply(self, state: State, step: FloatArray, context: Scale) -> State:
        """Return the state after a step of stations and levels, its points settled again."""
        return self.settled(state_after(self.network, state, step))

    def settled(self, state: State) -> State:
        """Return the state with its points at their optimum."""
        return settle(self.network, state)

    def converged(self, step: FloatArray) -> bool:
        """Return whether the largest differential rotation and translation are below their limits."""
        _, rotation, _, translation = largest_movements(step, self.network)
        return rotation < self.options.rotation_limit and translation < self.options.translation_limit


@dataclass(frozen=True, kw_only=True, eq=False)
class Conditions:
    """c = 2m - 3 conditions of each of k points, coplanarities first: g + A dx + G v = 0."""

    value: FloatArray  # (k, c)
    A: FloatArray  # (k, c, m, 6) by stations
    G: FloatArray  # (k, c, m, 2) by plate coordinates
    covariance: FloatArray  # (k, c, c) G Q G'


def conditions(network: Network, state: State, group: PointGroup, xy: FloatArray, ground: FloatArray) -> Conditions:
    """Return the conditions of a group linearised at plate coordinates xy (k, m, 2); m >= 2."""
    k, m = group.rays.shape
    X = np.repeat(ground[:, None], m, axis=1)
    rays = sightings.condition_rays(network, state, group.rays, xy, X)
    P, u = rays.origin, rays.direction
    c = 2 * m - 3
    value, partials = np.empty((k, c)), np.zeros((k, c, m, 6))
    row = np.arange(m - 1)
    value[:, : m - 1], pair = coplanarity(_windows(P, 2), _windows(u, 2))
    for side in range(2):
        partials[:, row, row + side] = pair[:, :, side]
    if m > 2:
        row = np.arange(m - 2)
        value[:, m - 1 :], triple = scale_restraint(_windows(P, 3), _windows(u, 3))
        for side in range(3):
            partials[:, m - 1 + row, row + side] = triple[:, :, side]
    # (k, c, m, 6) x (k, m, 6, 6): each ray's partials by its own station and image
    A = np.einsum("kcmi,kmij->kcmj", partials, rays.by_station)
    G = np.einsum("kcmi,kmij->kcmj", partials, rays.by_xy)
    Q = 1.0 / network.weight[group.rays]
    covariance = np.einsum("kcma,kma,kdma->kcd", G, Q, G)
    return Conditions(value=value, A=A, G=G, covariance=covariance)


def _windows(rows: FloatArray, length: int) -> FloatArray:
    """Return the runs of consecutive rays, (k, m - length + 1, length, 3)."""
    m = rows.shape[1]
    return np.stack([rows[:, i : m - length + 1 + i] for i in range(length)], axis=2)


def fully_weighted(network: Network, state: State, group: PointGroup) -> Sums:
    """Return the normal equations of the conditions of a group with full weights, at its adjusted images."""
    ground = np.repeat(state.ground[group.point][:, None], group.rays.shape[1], axis=1)
    adjusted = sightings.image_coordinates(network, state, group.rays, ground)
    C = conditions(network, state, group, adjusted, state.ground[group.point])
    # misclosure at the measured coordinates: g(l0) + G (l - l0)
    w = C.value + np.einsum("kcma,kma->kc", C.G, network.xy[group.rays] - adjusted)
    scale = 1.0 / np.sqrt(np.einsum("kcc->kc", C.covariance))
    k, c, m, _ = C.A.shape
    A, right = (C.A * scale[:, :, None, None]).reshape(k, c, 6 * m), (w * scale)[..., None]
    S = C.covariance * scale[:, :, None] * scale[:, None, :]
    weighted = np.linalg.solve(S, np.concatenate([A, right], axis=-1))
    At = np.swapaxes(A, 1, 2)
    return _sums(network, group, At @ weighted[..., :-1], -(At @ weighted[..., -1:])[..., 0])


def diagonally_weighted(network: Network, group: PointGroup, C: Conditions, variance: FloatArray) -> Sums:
    """Return the normal equations of the conditions of a group by a diagonal weight matrix, 1/variance (k, c)."""
    k, c, m, _ = C.A.shape
    A = C.A.reshape(k, c, 6 * m)
    PA = A / variance[..., None]
    return _sums(network, group, np.swapaxes(A, 1, 2) @ PA, -np.einsum("kci,kc->ki", PA, C.value))


def _sums(network: Network, group: PointGroup, matrix: FloatArray, rhs: FloatArray) -> Sums:
    k, m = group.rays.shape
    blocks = upper(matrix.reshape(k, m, 6, m, 6))
    return summed(network.pattern, network.photo[group.rays], blocks, rhs.reshape(k, m, 6))


def simple_variances(network: Network, state: State, weights: Weights) -> tuple[FloatArray, ...]:
    """Return the variances (k, c) of the conditions of every pass group, at the measured plate coordinates.

    As a program of the 1970s had them: the diagonal of G Q G' only, or (equal weights) one variance, the median,
    for all coplanarities and one for all scale restraints.
    """
    variances = [
        np.einsum("kcc->kc", measured_conditions(network, state, group).covariance).copy()
        for group in network.pass_groups
    ]
    if weights is Weights.EQUAL:
        coplanarities = [v[:, : (v.shape[1] + 1) // 2] for v in variances]
        restraints = [v[:, (v.shape[1] + 1) // 2 :] for v in variances]
        for kind in (coplanarities, restraints):
            together = np.concatenate([v.reshape(-1) for v in kind]) if kind else np.empty(0)
            for v in kind:
                v[...] = np.median(together) if together.size else 1.0
    return tuple(variances)


def measured_conditions(network: Network, state: State, group: PointGroup) -> Conditions:
    """Return the conditions of a group linearised at its measured plate coordinates."""
    return conditions(network, state, group, network.xy[group.rays], state.ground[group.point])
