"""What the programs have in common: the checks before a run, its network, its iterations, and why it ended."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment import ground as ground_points
from musatpy.adjustment.building import build_network
from musatpy.adjustment.iteration import (
    AT_REST,
    LeastSquares,
    Outcome,
    SingularNormalsError,
    Step,
    iterate,
)
from musatpy.adjustment.kernels import loops_of
from musatpy.adjustment.kinds import UNKNOWNS, kept_movement, largest_movements
from musatpy.adjustment.kinds.kind import in_digits
from musatpy.adjustment.network import (
    Network,
    Participation,
    PointGroup,
    group_points,
    job_frame,
    participation,
)
from musatpy.adjustment.normals import SINGULAR
from musatpy.adjustment.rank import describe_weakness
from musatpy.adjustment.unknowns import State, initial_state, with_turned_axes
from musatpy.adjustment.wavy_water import Sea, sea_of
from musatpy.arrays import BoolArray, finite_rows
from musatpy.errors import AdjustmentError, Problem
from musatpy.model import (
    Block,
    CoordinateSystem,
    Initial,
    Iteration,
    PointStatus,
    Refraction,
    WaterPass,
)
from musatpy.model.progress import Progress, begin
from musatpy.units import ARC_SECOND


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """One run: the measured network, and the record of its iterations."""

    block: Block
    part: Participation
    network: Network
    progress: Progress | None
    iterations: list[Iteration]
    notes: tuple[str, ...]  # warnings of the preparation

    def iterate(self, problem: LeastSquares, network: Network, state: State, outer_pass: int) -> Outcome:
        """Return the outcome of one adjustment. Raises `AdjustmentError` naming what is free."""

        def report(step: Step) -> None:
            turned, rotation, moved, translation = largest_movements(step.step, network)
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

        begin(self.progress, f"pass {outer_pass}, iteration", 1, self.block.options.max_iterations)
        try:
            return iterate(problem, state, self.block.options.max_iterations, report)
        except SingularNormalsError as error:
            # eigenvalues come with rounding of their own: look a little above the limit for the culprits
            reasons = describe_weakness(network, state, error.matrix, 100.0 * SINGULAR, self.block)
            problems = [Problem(message=f"singular normal equations: {reason}") for reason in reasons]
            raise AdjustmentError(problems or [Problem(message="singular normal equations")]) from error

    def with_iterations(self, most: int) -> Job:
        """Return the job with another limit of its iterations."""
        return replace(self, block=replace(self.block, options=replace(self.block.options, max_iterations=most)))

    def water_groups(self) -> tuple[PointGroup, ...]:
        """Return the submerged points with the rays that give their positions."""
        triangulated = self.part.status == PointStatus.TRIANGULATED
        return (
            *self.groups(self.part.used, self.bathymetric & triangulated),
            *self.groups(np.ones(len(self.part.used), dtype=bool), self.bathymetric & self.left_out),
        )

    @property
    def bathymetric(self) -> BoolArray:
        """(p,) the point is submerged."""
        return self.block.points.bathymetric

    @property
    def left_out(self) -> BoolArray:
        return self.part.status == PointStatus.INTERSECTED

    def groups(self, used: BoolArray, selected: BoolArray) -> tuple[PointGroup, ...]:
        return group_points(self.network.photo, self.network.point, used, selected)

    def with_left_out(self, network: Network, state: State) -> State:
        """Return the state with the points that took no part intersected as well."""
        if not self.left_out.any():
            return state
        groups = self.groups(np.ones(len(self.part.used), dtype=bool), self.left_out)
        return ground_points.intersect_freely(network, state, groups)

    def with_submerged_left_out(self, network: Network, state: State) -> State:
        """Return the state with only those of them that are submerged, as near as sides of the water ask for."""
        submerged = self.left_out & self.bathymetric
        if not submerged.any():
            return state
        groups = self.groups(np.ones(len(self.part.used), dtype=bool), submerged)
        _, every, met = ground_points.apart_at_their_best(network, state, groups)
        ground = state.ground.copy()
        for group, alone in zip(groups, every, strict=True):
            ground[group.point] = met.ground[alone.point]
        return replace(state, ground=ground)

    def reason(self, network: Network, outcome: Outcome, passes: tuple[WaterPass, ...]) -> str:
        """Return why the run has not converged and what is most at odds, empty if it has."""
        reason = self._failure(network, outcome) if outcome.failure else ""
        unrest = unrest_of_water(self.block, passes[-1]) if passes and not reason else ""
        if unrest:
            number = "1 pass" if len(passes) == 1 else f"{len(passes)} passes"
            reason = f"water points not at rest in {number}: {unrest}"
        if not reason:
            return ""
        from musatpy.adjustment.misfits import most_at_odds  # only failed runs need it

        worst = most_at_odds(self.block, network, outcome.state)
        return reason + (f"; most at odds: {', '.join(worst)}" if worst else "")

    def suspicions(self, first: State, reason: str) -> tuple[str, ...]:
        """Return a warning that names what is most at odds with the first state of a run that failed.

        Least squares spreads an error wide as a run goes on; a wild one stands out best before it. Images count
        where their points are known: the place of others is only as good as the worst photo that shows them.
        """
        if not reason:
            return ()
        from musatpy.adjustment.misfits import most_at_odds  # only failed runs need it

        network = self.network
        level = ground_points.level_start(network, first)
        counts = np.array(network.priors.known.all(axis=1))
        counts[network.border.kept] = True
        if counts.any():
            level = replace(level, ground=np.where(counts[:, None], level.ground, np.nan))
        worst = most_at_odds(self.block, network, level)
        return (f"at the start of the run most at odds: {', '.join(worst)}",) if worst else ()

    def _failure(self, network: Network, outcome: Outcome) -> str:
        """Return why an iteration has failed, and what is above its limits and by how much."""
        if not outcome.last_step.size:
            return outcome.failure
        ids, options = self.block.photos.ids, self.block.options
        turned, rotation, moved, translation = largest_movements(outcome.last_step, network)
        turn, shift = options.rotation_limit, options.translation_limit
        kept = kept_movement(outcome.last_step, network)
        movements: dict[str, tuple[float, str]] = {}  # levels of the ground and of the water are told as one
        for kind in UNKNOWNS:
            size, text = kind.movement(network, outcome.last_step)
            before = movements.get(kind.change, (0.0, ""))
            movements[kind.change] = max(before, (size / kind.limit(turn, shift), text))
        level, *others = movements.values()
        changes = (
            (translation / shift, f"photo {ids[moved]} still moves {in_digits(translation, 4)} m"),
            (rotation / turn, f"photo {ids[turned]} still turns {in_digits(rotation / ARC_SECOND, 3)} arc seconds"),
            level,
            (kept / shift, f"a tied point still moves {in_digits(kept, 4)} m"),
            *others,
        )
        above = [text for size, text in changes if size >= 1.0]
        if not above and outcome.change >= AT_REST:
            above = [f"adjusted values still change by up to {in_digits(outcome.change, 2)} sigmas"]
            sigmas = ground_points.unrest(network, outcome.state)
            if sigmas.max() >= AT_REST:
                point = self.block.points.ids[sigmas.argmax()]
                above = [f"point {point} still moves {in_digits(sigmas.max(), 2)} sigmas"]
        return f"{outcome.failure}: {', '.join(above)}" if above else outcome.failure


def unrest_of_water(block: Block, last: WaterPass) -> str:
    """Return what still moves after the last pass of the water point correction, empty where all is at rest."""
    points = block.points.ids
    if last.movement >= block.options.water_limit:
        return f"point {points[last.point]} still moves {in_digits(last.movement, 4)} m"
    if last.turning >= 0:
        return f"rays of point {points[last.turning]} still change between wet and dry"
    if last.image_change >= AT_REST:
        point, photo = points[block.plates.point[last.image]], block.photos.ids[block.plates.photo[last.image]]
        change = in_digits(last.image_change, 2)
        return f"the corrected image of point {point} on photo {photo} still changes by {change} sigmas"
    return ""


def prepared(block: Block, progress: Progress | None, sea: Sea | None = None) -> tuple[Job, State]:
    """Return the job of a block and its first state, points intersected from the given stations.

    Raises `AdjustmentError` with every reason where the block cannot be adjusted.
    """
    notes: tuple[str, ...] = ()
    begin(progress, "first values")
    if block.options.initial is not Initial.GIVEN:
        from musatpy.adjustment.initial import started  # costs the start of every run else

        block, notes = started(block)
    _require_water(block)
    _require_control(block)
    sea = sea_of(block, sea)
    frame = job_frame(block)
    part = participation(block)
    network = with_turned_axes(build_network(block, frame, part, sea))
    loops_of(network, ()).get_ready(initial_state(network), lambda: begin(progress, "compiling, once"))
    parallel = np.zeros(network.points, dtype=bool)
    state = ground_points.start_ground(network, initial_state(network), parallel)
    left = _leave_out(block, network, parallel | ~finite_rows(state.ground), part)
    if left.reasons != part.reasons:
        part, network = left, with_turned_axes(build_network(block, frame, left, sea))
        state = ground_points.start_ground(network, initial_state(network))
    if not network.groups:
        raise AdjustmentError([Problem(message="no point can be used: nothing ties the photos together")])
    job = Job(block=block, part=part, network=network, progress=progress, iterations=[], notes=notes)
    return job, state


def _require_water(block: Block) -> None:
    """Raise `AdjustmentError` where refraction is asked for and the block does not say enough of the water."""
    if block.options.refraction is Refraction.NONE:
        return
    problems = []
    submerged = block.points.bathymetric[block.plates.point]
    if submerged.any() and block.water is None:
        problems.append(Problem(message="submerged points, but no refractive index of the water"))
    without = np.isnan(block.photos.tide)
    for photo in np.unique(block.plates.photo[submerged & without[block.plates.photo]]):
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


def _leave_out(block: Block, network: Network, lost: BoolArray, part: Participation) -> Participation:
    """Return the participation without the pass points that are `lost` (p,), their rays as good as parallel."""
    status, used, reasons = part.status.copy(), part.used.copy(), dict(part.reasons)
    for group in network.pass_groups:
        for point in group.point[lost[group.point]]:
            status[point] = PointStatus.NOT_DETERMINED
            reasons[int(point)] = "its rays are parallel"
            used[block.plates.point == point] = False
    return replace(part, status=status, used=used, reasons=reasons)
