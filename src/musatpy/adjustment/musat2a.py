"""MUSAT-IIA: triangulation by modified geodetic restraint, with the water point correction around it.

One triangulation is a least squares problem of which only stations (and levels of groups) are unknown. Pass points
have m - 1 coplanarity and m - 2 scale restraint conditions for m rays, control enters by collinearity.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from musatpy.adjustment import ground as ground_points
from musatpy.adjustment import result, sightings
from musatpy.adjustment.collinear import add_collinear, eliminate, reduced
from musatpy.adjustment.ground import settle
from musatpy.adjustment.iteration import Linearisation, Outcome, State
from musatpy.adjustment.job import Job, at_rest, prepared
from musatpy.adjustment.kernels import Loops, loops_of, side_by_side
from musatpy.adjustment.kinds import add_direct, direct_squares, largest_movements, redundancy, state_after
from musatpy.adjustment.network import RAYS, Network, PointGroup, parts_of, together
from musatpy.adjustment.normals import NormalEquations, Sums, summed, upper
from musatpy.adjustment.sightings import residuals
from musatpy.adjustment.waterline import SHORT, at_rest_in_water, best_line, water_line
from musatpy.adjustment.watpt import corrected_plates
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import FloatArray, IntArray
from musatpy.errors import AdjustmentError, Problem
from musatpy.geometry.collinearity import coplanarity, scale_restraint
from musatpy.model import Block, Options, Refraction, Solution, WaterPass, Weights
from musatpy.model.progress import Progress, begin


def adjust(block: Block, progress: Progress | None = None, sea: Sea | None = None) -> Solution:
    """Return the MUSAT-IIA solution of a block, converged or not.

    `progress` is called after every iteration. Raises `AdjustmentError` with every reason where the block cannot be
    adjusted: no usable measurements, missing water data, photos without initial values, normal equations that leave
    stations free.
    """
    if block.ports.count:
        cameras = ", ".join(block.cameras.ids[block.ports.camera].tolist())
        raise AdjustmentError([Problem(message=f"camera {cameras} is behind a port: IIIA adjusts it")])
    if block.lens_unknowns.count:
        from musatpy.adjustment.lenses import ideal_plates  # most jobs know their cameras without error

        job, state = prepared(ideal_plates(block), progress, sea)
        return replace(_RunOfIIA(job=job).solution(state), block=block)
    job, state = prepared(block, progress, sea)
    return _RunOfIIA(job=job).solution(state)


@dataclass(frozen=True, kw_only=True, eq=False)
class _RunOfIIA:
    """A run of MUSAT-IIA."""

    job: Job

    def solution(self, state: State) -> Solution:
        measured = self.job.network
        submerged = self.job.bathymetric[measured.point].any()
        mode = self.job.block.options.refraction if submerged else Refraction.NONE
        straight, warnings = self.first_triangulation(state)
        mode = Refraction.NONE if straight.lost else mode
        network = refracted_network = measured
        outcome = straight
        passes: tuple[WaterPass, ...] = ()
        if mode is Refraction.RIGOROUS:
            network, outcome = self.triangulate_refracted(straight)
            refracted_network = network
        elif mode is not Refraction.NONE:
            network, refracted_network, outcome, passes = self.correct_water_points(
                outcome, mode is Refraction.LEGACY
            )
        warnings += self.job.notes
        if outcome is not straight and straight.failure:
            warnings += (f"the triangulation without refraction did not converge: {straight.failure}",)
        reason = self.job.reason(network, outcome, passes)
        if self.job.progress:
            begin(self.job.progress, "covariances")
        return result.solution(
            job=self.job,
            network=network,
            refracted=refracted_network,
            state=self.job.with_left_out(network, outcome.state),
            reason=reason,
            warnings=(*warnings, *self.job.suspicions(state, reason)),
            passes=passes,
            problem=self.problem,
        )

    def problem(self, network: Network, state: State) -> GeodeticRestraint:
        options = self.job.block.options
        equal = options.weights is Weights.EQUAL
        scale = simple_variances(network, state, options.weights) if equal else None
        return GeodeticRestraint(network=network, options=options, fixed_scale=scale)

    def first_triangulation(self, state: State) -> tuple[Outcome, tuple[str, ...]]:
        """Return the outcome without refraction, and warnings. Raises `AdjustmentError` naming what is free.

        Poor stations settle points behind cameras or far off, from where no step leads back. A triangulation that
        fails is started again from what the simultaneous adjustment finds, whose points need not be settled.
        """
        measured, iterations = self.job.network, self.job.iterations
        if self.job.progress:
            begin(self.job.progress, "first triangulation")
        outcome = self.triangulate(measured, state, 0)
        if not outcome.failure:
            return outcome, ()
        count = len(iterations)
        near = self.simultaneous(state)
        if near is not None:
            again = self.triangulate(measured, near, 0)
            if not again.failure:
                text = f"the triangulation did not converge from the given stations: {outcome.failure}"
                return again, (f"{text}; it was started again from a simultaneous adjustment",)
        del iterations[count:]  # those that follow belong to the outcome
        return outcome, ()

    def simultaneous(self, state: State) -> State | None:
        """Return what the simultaneous adjustment without refraction finds, None where it finds nothing."""
        from musatpy.adjustment.collinear import Simultaneous  # few runs need it

        measured = self.job.network
        problem = Simultaneous(network=measured, options=self.job.block.options)
        start = problem.with_squares(ground_points.level_start(measured, state))
        try:
            outcome = self.job.iterate(problem, measured, start, 0)
        except AdjustmentError:
            return None
        return None if outcome.failure else outcome.state

    def triangulate(self, network: Network, state: State, outer_pass: int) -> Outcome:
        """Return the outcome of one triangulation, which settles its points first.

        Raises `AdjustmentError` naming what is free.
        """
        state = settle(network, state)
        return self.job.iterate(self.problem(network, state), network, state, outer_pass)

    def triangulate_refracted(self, outcome: Outcome) -> tuple[Network, Outcome]:
        """Return network and outcome with refracted rays in the conditions.

        Points on a water line are held there while it lasts; in the network they are as free as all others.
        """
        measured = self.job.network
        state = self.job.with_left_out(measured, outcome.state, submerged=True)
        line = water_line(measured, state, self.job.bathymetric)

        def adjusted(network: Network, state: State, number: int) -> Outcome:
            outcome = self.triangulate(network, state, number)
            return replace(outcome, state=self.job.with_left_out(network, outcome.state, submerged=True))

        network, _, outcome = at_rest_in_water(
            measured, line, state, self.job.bathymetric, adjusted, itertools.count(1)
        )
        return measured.with_plates(measured.xy, network.refracted), outcome

    def correct_water_points(
        self, straight: Outcome, legacy: bool
    ) -> tuple[Network, Network, Outcome, tuple[WaterPass, ...]]:
        """Return WATPT iterated with the triangulation: network, network of the refracted rays, outcome, passes."""
        measured, passes, outcome = self.job.network, [], straight
        state = self.job.with_left_out(measured, outcome.state, submerged=True)
        line = water_line(measured, state, self.job.bathymetric)
        network = straightened = measured
        groups = self.job.water_groups()
        xy = corrected_plates(measured, state, groups, line.wet, legacy)
        short = 0
        for number in range(1, self.job.block.options.max_passes + 1):
            ground, last = state.ground, line
            network = measured.with_plates(xy, measured.refracted)
            straightened = measured.with_plates(measured.xy, line.wet)
            outcome = self.triangulate(network, state, number)
            state = self.job.with_left_out(network, outcome.state, submerged=True)
            if not outcome.lost:
                line = best_line(measured, line, state, self.job.bathymetric, held=False)
                xy = corrected_plates(measured, state, groups, line.wet, legacy)
            turning = np.flatnonzero(line.wet != last.wet)
            passes.append(self.water_pass(number, network, state, ground, xy, measured.point[turning]))
            short = short + 1 if outcome.failure else 0
            if outcome.lost or short == SHORT or at_rest(self.job.block, passes[-1]):
                break
        return network, straightened, outcome, tuple(passes)

    def water_pass(
        self, number: int, network: Network, state: State, before: FloatArray, after: FloatArray, turning: IntArray
    ) -> WaterPass:
        """Return the record of a pass: points (p, 3) `before` it, images (m, 2) mm of the next one `after` it."""
        seen = np.bincount(network.point, minlength=network.points) > 0
        points = np.flatnonzero(seen & self.job.bathymetric)
        rays = np.flatnonzero(self.job.part.used & self.job.bathymetric[network.point])
        before_it, after_it, weight = (of.take(rays, axis=0) for of in (network.xy, after, network.weight))
        change = np.nan_to_num(np.abs(after_it - before_it) * np.sqrt(weight))
        change = np.maximum(change[:, 0], change[:, 1])
        movement = np.linalg.norm(state.ground[points] - before[points], axis=1)
        known = np.isfinite(movement)
        movement = np.where(known, movement, 0.0)
        residual = residuals(network, state, rays)
        return WaterPass(
            number=number,
            movement=float(movement.max(initial=0.0)),
            point=int(points[movement.argmax()]),
            rms_movement=float(np.sqrt(np.mean(np.square(movement)))),
            rms_residual=float(np.sqrt(np.mean(np.square(residual)))) if residual.size else 0.0,
            image_change=float(change.max(initial=0.0)),
            image=int(rays[change.argmax()]) if change.any() else 0,
            turning=int(turning[0]) if len(turning) else -1,
        )


Scale = tuple[FloatArray, ...] | None


@dataclass(frozen=True, kw_only=True, eq=False)
class GeodeticRestraint:
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
        scale = self._scale(state)
        if scale is None:
            parts = parts_of((group for group in left if not group.known), RAYS)
            for sums in side_by_side(partial(fully_weighted, network, state), parts, len(network.photo)):
                normals.add_sums(sums)
        else:
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

    def _scale(self, state: State) -> Scale:
        """Return the variances of the conditions, None of full weights."""
        if self.options.weights is Weights.FULL:
            return None
        return self.fixed_scale or simple_variances(self.network, state, self.options.weights)

    def evaluate(self, state: State, context: Scale = None) -> float:
        """Return the weighted sum of squares at `state`."""
        network, scale = self.network, context or self._scale(state)
        total = direct_squares(network, state)
        for number, group in enumerate(network.pass_groups):
            if scale is None:
                total += float(state.squares[group.point].sum())
            else:
                value = measured_conditions(network, state, group).value
                total += float(np.sum(np.square(value) / scale[number]))
        for group in network.control_groups:
            total += float(state.squares[group.point].sum())
        return total if np.isfinite(total) else np.inf

    def apply(self, state: State, step: FloatArray, context: Scale) -> State:
        """Return the state after a step of stations and levels, its points settled again."""
        return settle(self.network, state_after(self.network, state, step))

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
    return rows.take(np.arange(rows.shape[1] - length + 1)[:, None] + np.arange(length), axis=1)


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
