"""MUSAT-IIA: triangulation by modified geodetic restraint, with the water point correction around it."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment import ground as ground_points
from musatpy.adjustment import result
from musatpy.adjustment.conditions import simple_variances
from musatpy.adjustment.iteration import Outcome, SingularNormalsError, Step, iterate
from musatpy.adjustment.network import (
    Network,
    Participation,
    PointGroup,
    build_network,
    group_points,
    job_frame,
    participation,
)
from musatpy.adjustment.normals import SINGULAR
from musatpy.adjustment.rank import describe_weakness
from musatpy.adjustment.sightings import image_coordinates, straight_rays
from musatpy.adjustment.triangulation import Triangulation, largest_movements
from musatpy.adjustment.unknowns import State, initial_state
from musatpy.adjustment.waterline import moved, water_line
from musatpy.adjustment.watpt import corrected_plates
from musatpy.errors import AdjustmentError, Problem
from musatpy.geometry.intersection import widest_angle
from musatpy.model import (
    Block,
    CoordinateSystem,
    Initial,
    Iteration,
    PointStatus,
    Refraction,
    Solution,
    WaterPass,
    Weights,
)
from musatpy.units import ARC_SECOND

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Progress = Callable[[Iteration], None]

_PARALLEL = 1e-5  # rad; rays nearer to parallel than this give no position, only trouble


def adjust(block: Block, progress: Progress | None = None) -> Solution:
    """Return the MUSAT-IIA solution of a block, converged or not.

    `progress` is called after every iteration. Raises `AdjustmentError` with every reason where the block cannot be
    adjusted: no usable measurements, missing water data, photos without initial values, normal equations that leave
    stations free.
    """
    notes: tuple[str, ...] = ()
    if block.options.initial is not Initial.GIVEN:
        from musatpy.adjustment.initial import started  # costs the start of every run else

        block, notes = started(block)
    _require_water(block)
    _require_control(block)
    frame = job_frame(block)
    part = participation(block)
    network = build_network(block, frame, part)
    state = ground_points.start_ground(network, initial_state(network))
    part = _leave_out_parallel(block, network, state, part)
    network = build_network(block, frame, part)
    if not (network.pass_groups or network.control_groups):
        raise AdjustmentError([Problem(message="no point can be used: nothing ties the photos together")])
    state = ground_points.settle(network, ground_points.start_ground(network, initial_state(network)))
    solution = _Job(block=block, part=part, network=network, progress=progress, iterations=[]).run(state)
    return replace(solution, warnings=(*notes, *solution.warnings))


@dataclass(frozen=True, kw_only=True)
class _Job:
    """One run: the measured network, and the record of its iterations."""

    block: Block
    part: Participation
    network: Network
    progress: Progress | None
    iterations: list[Iteration]

    def run(self, state: State) -> Solution:
        measured = self.network
        submerged = self.bathymetric[measured.point].any()
        straight = self.triangulate(measured, state, 0)
        mode = self.block.options.refraction if submerged and not straight.lost else Refraction.NONE
        apparent = self.with_left_out(measured, straight.state).ground
        network = refracted = measured
        outcome = straight
        passes: tuple[WaterPass, ...] = ()
        if mode is Refraction.RIGOROUS:
            network, outcome = self.triangulate_refracted(straight)
            refracted = network
        elif mode is not Refraction.NONE:
            network, refracted, outcome, passes = self.correct_water_points(outcome, mode is Refraction.LEGACY)
        warnings: tuple[str, ...] = ()
        if outcome is not straight and straight.failure:
            warnings = (f"the triangulation without refraction did not converge: {straight.failure}",)
        return result.solution(
            block=self.block,
            part=self.part,
            measured=measured,
            network=network,
            refracted=refracted,
            state=self.with_left_out(network, outcome.state),
            apparent=apparent,
            reason=self.reason(outcome, passes),
            warnings=warnings,
            iterations=tuple(self.iterations),
            passes=passes,
            problem=self.problem,
        )

    def problem(self, network: Network, state: State) -> Triangulation:
        options = self.block.options
        equal = options.weights is Weights.EQUAL
        return Triangulation(
            network=network,
            weights=options.weights,
            rotation_limit=options.rotation_limit,
            translation_limit=options.translation_limit,
            fixed_scale=simple_variances(network, state, options.weights) if equal else None,
        )

    def triangulate(self, network: Network, state: State, outer_pass: int) -> Outcome:
        """Return the outcome of one triangulation. Raises `AdjustmentError` naming what is free."""

        def report(step: Step) -> None:
            turned, rotation, moved, translation = largest_movements(step.step, network.photos)
            iteration = Iteration(
                outer_pass=outer_pass,
                number=step.number,
                rotation=rotation,
                rotation_photo=turned,
                translation=translation,
                translation_photo=moved,
                sum_of_squares=step.objective,
                damping=step.damping,
            )
            self.iterations.append(iteration)
            if self.progress:
                self.progress(iteration)

        try:
            return iterate(self.problem(network, state), state, self.block.options.max_iterations, report)
        except SingularNormalsError as error:
            photos, groups = self.block.photos.ids.tolist(), self.block.equal_elevations.ids.tolist()
            # eigenvalues come with rounding of their own: look a little above the limit for the culprits
            reasons = describe_weakness(network, state, error.matrix, 100.0 * SINGULAR, photos, groups)
            problems = [Problem(message=f"singular normal equations: {reason}") for reason in reasons]
            raise AdjustmentError(problems or [Problem(message="singular normal equations")]) from error

    def triangulate_refracted(self, outcome: Outcome) -> tuple[Network, Outcome]:
        """Return network and outcome with refracted rays in the conditions."""
        measured = self.network
        state = self.with_left_out(measured, outcome.state)
        line = water_line(measured, state.ground, self.bathymetric)
        for number in itertools.count(1):
            network = measured.with_plates(measured.xy, line.wet)
            outcome = self.triangulate(network, ground_points.settle(network, state), number)
            state = self.with_left_out(network, outcome.state)
            if outcome.lost:
                break
            before, line = line, moved(measured, line, state.ground, self.bathymetric)
            if np.array_equal(line.wet, before.wet):
                break
        return network, outcome

    def correct_water_points(
        self, outcome: Outcome, legacy: bool
    ) -> tuple[Network, Network, Outcome, tuple[WaterPass, ...]]:
        """Return WATPT iterated with the triangulation: network, network of the refracted rays, outcome, passes."""
        measured, passes = self.network, []
        state = self.with_left_out(measured, outcome.state)
        line = water_line(measured, state.ground, self.bathymetric)
        network = refracted = measured
        for number in range(1, self.block.options.max_passes + 1):
            before = state.ground
            xy = corrected_plates(measured, state, self.water_groups(), line.wet, legacy)
            network = measured.with_plates(xy, measured.refracted)
            refracted = measured.with_plates(measured.xy, line.wet)
            outcome = self.triangulate(network, ground_points.settle(network, state), number)
            state = self.with_left_out(network, outcome.state)
            passes.append(self.water_pass(number, network, state, before))
            last, line = line, moved(measured, line, state.ground, self.bathymetric)
            at_rest = passes[-1].movement < self.block.options.water_limit
            if outcome.lost or (at_rest and np.array_equal(line.wet, last.wet)):
                break
        return network, refracted, outcome, tuple(passes)

    def water_pass(self, number: int, network: Network, state: State, before: FloatArray) -> WaterPass:
        points = np.unique(network.point[self.bathymetric[network.point]])
        movement = np.linalg.norm(state.ground[points] - before[points], axis=1)
        known = np.isfinite(movement)
        movement = np.where(known, movement, 0.0)
        rays = np.flatnonzero(self.part.used & self.bathymetric[network.point])
        residual = image_coordinates(network, state, rays, state.ground[network.point[rays]]) - network.xy[rays]
        return WaterPass(
            number=number,
            movement=float(movement.max(initial=0.0)),
            point=int(points[movement.argmax()]),
            rms_movement=float(np.sqrt(np.mean(np.square(movement)))),
            rms_residual=float(np.sqrt(np.mean(np.square(residual)))) if residual.size else 0.0,
        )

    def water_groups(self) -> tuple[PointGroup, ...]:
        """Return the submerged points with the rays that give their positions."""
        triangulated = self.part.status == PointStatus.TRIANGULATED
        return (
            *self._groups(self.part.used, self.bathymetric & triangulated),
            *self._groups(np.ones(len(self.part.used), dtype=bool), self.bathymetric & self._left_out),
        )

    @property
    def bathymetric(self) -> BoolArray:
        """(p,) the point is submerged."""
        return self.block.points.bathymetric

    @property
    def _left_out(self) -> BoolArray:
        return np.asarray(self.part.status == PointStatus.INTERSECTED)

    def _groups(self, used: BoolArray, selected: BoolArray) -> tuple[PointGroup, ...]:
        return group_points(self.network.photo, self.network.point, used, selected)

    def with_left_out(self, network: Network, state: State) -> State:
        """Return the state with the points that took no part intersected as well."""
        groups = self._groups(np.ones(len(self.part.used), dtype=bool), self._left_out)
        return ground_points.intersect_freely(network, state, groups)

    def reason(self, outcome: Outcome, passes: tuple[WaterPass, ...]) -> str:
        """Return why the run has not converged, empty if it has."""
        ids = self.block.photos.ids
        if outcome.failure:
            if not outcome.last_step.size:
                return outcome.failure
            turned, rotation, moved, translation = largest_movements(outcome.last_step, len(ids))
            return (
                f"{outcome.failure}: photo {ids[moved]} still moves {translation:.4f} m, "
                f"photo {ids[turned]} still turns {rotation / ARC_SECOND:.3f} arc seconds"
            )
        if passes and passes[-1].movement >= self.block.options.water_limit:
            point = self.block.points.ids[passes[-1].point]
            number = "1 pass" if len(passes) == 1 else f"{len(passes)} passes"
            return f"water points not at rest in {number}: point {point} still moves {passes[-1].movement:.4f} m"
        return ""


def _require_water(block: Block) -> None:
    """Raise `AdjustmentError` where refraction is asked for and the block does not say enough of the water."""
    if block.options.refraction is Refraction.NONE:
        return
    problems = []
    submerged = block.points.bathymetric[block.plates.point]
    if submerged.any() and block.water is None:
        problems.append(Problem(message="submerged points, but no refractive index of the water"))
    for photo in np.unique(block.plates.photo[submerged]):
        if np.isnan(block.photos.tide[photo]):
            message = f"photo {block.photos.ids[photo]} shows submerged points, but its tide is not given"
            problems.append(Problem(message=message))
    if problems:
        raise AdjustmentError(problems)


def _require_control(block: Block) -> None:
    """Raise `AdjustmentError` where a component that control should hold has no value, or no sigma."""
    control = block.control
    known = control.known
    value = np.isfinite(control.position)
    if block.options.system is CoordinateSystem.GEOCENTRIC:
        value = np.repeat(value.all(axis=1, keepdims=True), 3, axis=1)
    held = control.fixed[:, None] | (control.sigma > 0.0)
    problems = []
    for row in np.flatnonzero((known & ~(value & held)).any(axis=1)):
        what = "coordinates" if (known & ~value)[row].any() else "sigmas"
        point = block.points.ids[control.point[row]]
        problems.append(Problem(message=f"control point {point}: its {what} are not all given"))
    if problems:
        raise AdjustmentError(problems)


def _leave_out_parallel(block: Block, network: Network, state: State, part: Participation) -> Participation:
    """Return the participation without pass points whose rays are as good as parallel."""
    status, used, reasons = part.status.copy(), part.used.copy(), dict(part.reasons)
    for group in network.pass_groups:
        _, direction = straight_rays(network, state, group.rays)
        angle = widest_angle(direction)
        for point in group.point[(angle < _PARALLEL) | ~np.isfinite(state.ground[group.point]).all(axis=1)]:
            status[point] = PointStatus.NOT_DETERMINED
            reasons[int(point)] = "its rays are parallel"
            used[block.plates.point == point] = False
    return replace(part, status=status, used=used, reasons=reasons)
