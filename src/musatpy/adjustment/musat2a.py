"""MUSAT-IIA: triangulation by modified geodetic restraint, with the water point correction around it."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment import ground as ground_points
from musatpy.adjustment import result
from musatpy.adjustment.iteration import Outcome
from musatpy.adjustment.job import Job, prepared, unrest_of_water
from musatpy.adjustment.network import Network
from musatpy.adjustment.sightings import residuals
from musatpy.adjustment.triangulation import Triangulation, simple_variances
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.waterline import SHORT, at_rest_in_water, best_line, water_line
from musatpy.adjustment.watpt import corrected_plates
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import FloatArray, IntArray
from musatpy.errors import AdjustmentError
from musatpy.model import Block, Refraction, Solution, WaterPass, Weights
from musatpy.model.progress import Progress, begin


def adjust(block: Block, progress: Progress | None = None, sea: Sea | None = None) -> Solution:
    """Return the MUSAT-IIA solution of a block, converged or not.

    `progress` is called after every iteration. Raises `AdjustmentError` with every reason where the block cannot be
    adjusted: no usable measurements, missing water data, photos without initial values, normal equations that leave
    stations free.
    """
    job, state = prepared(block, progress, sea)
    return _Run(job=job).solution(state)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Run:
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

    def problem(self, network: Network, state: State) -> Triangulation:
        options = self.job.block.options
        equal = options.weights is Weights.EQUAL
        scale = simple_variances(network, state, options.weights) if equal else None
        return Triangulation(network=network, options=options, fixed_scale=scale)

    def first_triangulation(self, state: State) -> tuple[Outcome, tuple[str, ...]]:
        """Return the outcome without refraction, and warnings. Raises `AdjustmentError` naming what is free.

        Poor stations settle points behind cameras or far off, from where no step leads back. A triangulation that
        fails is started again from what the simultaneous adjustment finds, whose points need not be settled.
        """
        measured, iterations = self.job.network, self.job.iterations
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
        from musatpy.adjustment.simultaneous import Simultaneous  # few runs need it

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
        state = ground_points.settle(network, state)
        return self.job.iterate(self.problem(network, state), network, state, outer_pass)

    def triangulate_refracted(self, outcome: Outcome) -> tuple[Network, Outcome]:
        """Return network and outcome with refracted rays in the conditions.

        Points on a water line are held there while it lasts; in the network they are as free as all others.
        """
        measured = self.job.network
        state = self.job.with_left_out(measured, outcome.state)
        line = water_line(measured, state, self.job.bathymetric)

        def adjusted(network: Network, state: State, number: int) -> Outcome:
            outcome = self.triangulate(network, state, number)
            return replace(outcome, state=self.job.with_left_out(network, outcome.state))

        network, _, outcome = at_rest_in_water(
            measured, line, state, self.job.bathymetric, adjusted, itertools.count(1)
        )
        return measured.with_plates(measured.xy, network.refracted), outcome

    def correct_water_points(
        self, straight: Outcome, legacy: bool
    ) -> tuple[Network, Network, Outcome, tuple[WaterPass, ...]]:
        """Return WATPT iterated with the triangulation: network, network of the refracted rays, outcome, passes."""
        measured, passes, outcome = self.job.network, [], straight
        state = self.job.with_left_out(measured, outcome.state)
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
            state = self.job.with_left_out(network, outcome.state)
            if not outcome.lost:
                line = best_line(measured, line, state, self.job.bathymetric, held=False)
                xy = corrected_plates(measured, state, groups, line.wet, legacy)
            turning = np.flatnonzero(line.wet != last.wet)
            passes.append(self.water_pass(number, network, state, ground, xy, measured.point[turning]))
            short = short + 1 if outcome.failure else 0
            if outcome.lost or short == SHORT or not unrest_of_water(self.job.block, passes[-1]):
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
