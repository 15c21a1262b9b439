"""A job: from a block to its network and its iterations by the program that its options name, and why it ended.

Where the plate sigma is a guess, the job is adjusted again with its variance component until that is 1 (Foerstner
1979): v'Pv of the plate coordinates over the sum of their redundancy numbers estimates the factor of their variance
alone, whatever the sigmas of stations and control are worth, which stay as their cards have them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment import ground as ground_points
from musatpy.adjustment.datum import describe_weakness
from musatpy.adjustment.iteration import (
    AT_REST,
    LeastSquares,
    Outcome,
    SingularNormalsError,
    State,
    Step,
    initial_state,
    iterate,
    water_knowledge,
    with_turned_axes,
)
from musatpy.adjustment.kernels import loops_of
from musatpy.adjustment.kinds import (
    MEASURED,
    UNKNOWNS,
    further_parameters,
    global_unknowns,
    kept_movement,
    largest_movements,
    measured_in,
)
from musatpy.adjustment.kinds.kind import in_digits
from musatpy.adjustment.misfits import most_at_odds, unrest_of_water
from musatpy.adjustment.network import (
    Border,
    GroundPriors,
    Network,
    Participation,
    PointGroup,
    decorrelated,
    group_points,
    inverse_squares,
    job_frame,
    participation,
)
from musatpy.adjustment.normals import SINGULAR
from musatpy.adjustment.sparse import Pattern
from musatpy.adjustment.wavy_water import Sea, WorkingSea, sea_of
from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import AdjustmentError, NumericalError, Problem, and_warnings, numerical, numerics
from musatpy.geometry.geodesy import Frame
from musatpy.model import (
    Block,
    CoordinateSystem,
    Initial,
    Iteration,
    ObservationKind,
    PlateSigma,
    PointStatus,
    Program,
    Refraction,
    Solution,
    WaterPass,
)
from musatpy.model.progress import Progress, begin
from musatpy.model.tables import finite_rows, taken
from musatpy.units import ARC_SECOND

_ADJUSTMENTS = 20  # at most: plates that check themselves take three to five
_COMPONENT_AT_REST = 1e-4  # of the plate sigma: a hundredth of what a million images tell of it
_CHECKED = 1.0  # redundancy of all plates together, below which they say nothing of their sigma
_FINEST = 1e-5  # mm: coordinates of six decimals without error have residuals below


def adjust(block: Block, progress: Progress | None = None, sea: Sea | None = None) -> Solution:
    """Return the solution of a block by the program of its options, converged or not.

    Of a plate sigma that is a guess, stations and points are those by its variance component. `progress` is called
    after every iteration; with a `sea`, rays are refracted by its waves (refraction RIGOROUS, and IIIA). Raises
    `AdjustmentError` with every reason where the block cannot be adjusted.
    """
    # each run loads the program that it needs
    if block.options.program is Program.IIIA:
        from musatpy.adjustment.musat3a import adjust as program
    else:
        from musatpy.adjustment.musat2a import adjust as program
    try:
        if block.options.plate_sigma_is is PlateSigma.KNOWN:
            solution = program(block, progress, sea)
        else:
            solution = estimated(block, lambda weighted: program(weighted, progress, sea))
        return replace(solution, cards=block.photos.position)
    except (NumericalError, ArithmeticError, ValueError) as error:
        refused = numerical(error, "the adjustment")
        if refused is None:
            raise
        advice = "OP2 editing EDIT looks for gross errors and takes them out"
        raise NumericalError(and_warnings(refused.problems, (*_suspicions(block, sea), advice))) from error


def _suspicions(block: Block, sea: Sea | None) -> tuple[str, ...]:
    """Return which photos and points are most at odds at the start of a run; none where that makes no sense."""
    try:
        with numerics("the start"), np.errstate(all="ignore"):
            job, state = prepared(block, None, sea)
            return job.suspicions(state, "failed")
    except AdjustmentError:
        return ()


def with_plate_sigmas(block: Block, factor: float) -> Block:
    """Return the block with all its plate sigmas, of the job and of single images, times a factor."""
    options = replace(block.options, plate_sigma=block.options.plate_sigma * factor)
    return replace(block, options=options, plates=replace(block.plates, sigma=block.plates.sigma * factor))


def estimated(block: Block, adjust: Callable[[Block], Solution]) -> Solution:
    """Return the solution by the plate sigma that its own residuals show; its block has that one.

    What has not converged, and plates that nothing checks, keep the sigma that they came with.
    """
    factor = 1.0
    solution = adjust(block)
    for _ in range(_ADJUSTMENTS):
        component = plate_component(solution)
        if not solution.converged or component is None:
            break
        component = max(component, _FINEST / float(np.median(solution.block.plate_sigmas)))
        if abs(component - 1.0) < _COMPONENT_AT_REST:
            break
        factor *= component
        solution = adjust(with_plate_sigmas(block, factor))
    return replace(solution, plate_factor=factor)


def plate_component(solution: Solution) -> float | None:
    """Return the factor of the plate sigmas that the residuals of the plates show; None where nothing checks them.

    What errors of considered water add to the residuals is no error of the plates.
    """
    observed = solution.observed
    if observed is None:
        return None
    plates = observed.kind == ObservationKind.PLATE
    redundancy = observed.redundancy[plates]
    if redundancy.sum() < _CHECKED:
        return None
    variances = np.square(observed.sigma[plates])
    squares = np.square(observed.residual[plates]) - observed.considered[plates]
    return float(np.sqrt(max(np.sum(squares / variances), 0.0) / redundancy.sum()))


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

        most = self.block.options.max_iterations
        if self.progress:
            begin(self.progress, f"pass {outer_pass}, iteration", 1, most)
        try:
            return iterate(problem, state, most, report)
        except SingularNormalsError as error:
            # eigenvalues come with rounding of their own: look a little above the limit for the culprits
            reasons = describe_weakness(network, state, error.matrix, 100.0 * SINGULAR, self.block)
            problems = [Problem(message=f"singular normal equations: {reason}") for reason in reasons]
            raise AdjustmentError(problems or [Problem(message="singular normal equations")]) from error

    def with_iterations(self, most: int) -> Job:
        """Return the job with another limit of its iterations."""
        return replace(self, block=replace(self.block, options=replace(self.block.options, max_iterations=most)))

    @property
    def bathymetric(self) -> BoolArray:
        """(p,) the point is submerged."""
        return self.block.points.bathymetric

    def water_groups(self) -> tuple[PointGroup, ...]:
        """Return the submerged points with the rays that give their positions."""
        network, status = self.network, self.part.status
        giving = self.part.used | (status == PointStatus.INTERSECTED)[network.point]
        submerged = self.bathymetric & (status != PointStatus.NOT_DETERMINED)
        return group_points(network.photo, network.point, giving, submerged)

    def with_left_out(self, network: Network, state: State, submerged: bool = False) -> State:
        """Return the state with the points that took no part intersected as well: all, or the `submerged` ones."""
        groups = network.left_out
        if submerged:
            groups = tuple(part for group in groups for part in group.some(self.bathymetric[group.point]))
        return ground_points.intersect_freely(network, state, groups) if groups else state

    def reason(self, network: Network, outcome: Outcome, passes: tuple[WaterPass, ...]) -> str:
        """Return why the run has not converged and what is most at odds, empty if it has."""
        reason = self._failure(network, outcome) if outcome.failure else ""
        if not reason and passes and not at_rest(self.block, passes[-1]):
            number = "1 pass" if len(passes) == 1 else f"{len(passes)} passes"
            reason = f"water points not at rest in {number}: {unrest_of_water(self.block, passes[-1])}"
        worst = most_at_odds(self.block, network, outcome.state) if reason else ()
        return reason + (f"; what fits worst: {', '.join(worst)}" if worst else "")

    def suspicions(self, first: State, reason: str) -> tuple[str, ...]:
        """Return a warning that names what is most at odds with the first state of a run that failed.

        Least squares spreads an error wide as a run goes on; a wild one stands out best before it. Images count
        where their points are known: the place of others is only as good as the worst photo that shows them.
        """
        if not reason:
            return ()
        network = self.network
        level = ground_points.level_start(network, first)
        counts = np.array(network.priors.known.all(axis=1))
        counts[network.border.kept] = True
        if counts.any():
            level = replace(level, ground=np.where(counts[:, None], level.ground, np.nan))
        worst = most_at_odds(self.block, network, level)
        return (f"what fitted worst at the start of the run: {', '.join(worst)}",) if worst else ()

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


def at_rest(block: Block, last: WaterPass) -> bool:
    """Return whether the last pass of the water point correction has moved no point, ray or image any more."""
    return last.movement < block.options.water_limit and last.turning < 0 and last.image_change < AT_REST


def prepared(block: Block, progress: Progress | None, sea: Sea | None = None) -> tuple[Job, State]:
    """Return the job of a block and its first state, points intersected from the given stations.

    Raises `AdjustmentError` with every reason where the block cannot be adjusted.
    """
    notes: tuple[str, ...] = ()
    if progress:
        begin(progress, "first values")
    for kind in MEASURED:
        block = kind.with_starts(block) if getattr(block, kind.observed.attribute).count else block
    if block.options.initial is not Initial.GIVEN:
        from musatpy.adjustment.initial import started  # costs the start of every run else

        if block.lens_unknowns.count or block.ports.count:
            from musatpy.adjustment.first_lenses import with_first_lenses  # most jobs hold their cameras
            from musatpy.adjustment.ports import without_ports

            block, seen, notes = with_first_lenses(block)
            first, of_stations = started(without_ports(seen))
            block, notes = replace(block, photos=first.photos), (*notes, *of_stations)
        else:
            block, notes = started(block)
    _require_water(block)
    _require_control(block)
    sea = sea_of(block, sea) if sea or len(block.waves.ids) else None  # most jobs have none
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


def build_network(block: Block, frame: Frame, part: Participation, sea: Sea | None = None) -> Network:
    """Return the network of a block, with the measured plate coordinates and straight rays."""
    photos, plates = block.photos, block.plates
    position = frame.working(photos.position)
    enters = part.status == PointStatus.TRIANGULATED
    priors = _ground_priors(block, frame, enters)
    by_collinearity = priors.known.any(axis=1) | (priors.group >= 0)
    measured = measured_in(block, enters)
    kept = np.unique(np.concatenate([of.point.reshape(-1) for of in measured.values()]))
    eliminated = enters.copy()
    eliminated[kept] = False
    pass_groups, control_groups, kept_groups = (
        group_points(plates.photo, plates.point, part.used, chosen)
        for chosen in (eliminated & ~by_collinearity, eliminated & by_collinearity, enters & ~eliminated)
    )
    control_groups = tuple(replace(group, known=True) for group in control_groups)
    left_out = group_points(
        plates.photo, plates.point, np.ones_like(part.used), part.status == PointStatus.INTERSECTED
    )
    together = [plates.photo[group.rays] for group in (*pass_groups, *control_groups, *left_out)]
    water, cameras = water_knowledge(block), block.cameras
    parameters = further_parameters(block) if block.options.program is Program.IIIA else {}
    focal_length, principal_point = cameras.focal_length[photos.camera], cameras.principal_point[photos.camera]
    network = Network(
        frame=frame,
        position=position,
        attitude=photos.attitude,
        axes=frame.axes(position),
        position_weight=inverse_squares(photos.position_sigma),
        attitude_weight=inverse_squares(photos.attitude_sigma),
        focal_length=focal_length,
        principal_point=principal_point,
        water=water,
        sea=None if sea is None else WorkingSea.of(sea, frame),
        parameters=parameters,
        tilt_axes=np.asarray(frame.axes(np.zeros(3)))[:2],
        photo=plates.photo,
        point=plates.point,
        xy=plates.xy,
        weight=inverse_squares(block.plate_sigmas),
        refracted=np.zeros(len(plates.photo), dtype=bool),
        priors=priors,
        border=Border(columns=global_unknowns(block, water, sea, parameters), kept=kept),
        pass_groups=pass_groups,
        control_groups=control_groups,
        kept_groups=tuple(replace(group, kept=True, known=True) for group in kept_groups),
        left_out=left_out,
        measured=measured,
        pattern=Pattern.of(
            len(photos.ids),
            7 if water.per_photo else 6,
            [*together, *(of.photo for of in measured.values() if of.photo.shape[1] > 1)],
            position if np.isfinite(position).all() else None,
        ),
    )
    if network.lenses is None:
        return network
    focal_length, principal_point = network.lenses.cameras()
    return replace(network, focal_length=focal_length, principal_point=principal_point)


def _ground_priors(block: Block, frame: Frame, enters: BoolArray) -> GroundPriors:
    control, groups, p = block.control, block.equal_elevations, len(block.points.ids)
    given = np.full((p, 3), np.nan)
    given[control.point] = level_coordinates(block, frame)
    known = np.zeros((p, 3), dtype=bool)
    known[control.point] = control.known & enters[control.point][:, None]
    held = np.zeros((p, 3), dtype=bool)
    held[control.point] = known[control.point] & control.fixed[:, None]
    weight = np.zeros((p, 3))
    weight[control.point] = inverse_squares(control.sigma)
    decorrelation = None
    if (correlated := control.correlated).any():
        decorrelation = np.tile(np.eye(3), (p, 1, 1))
        some = taken(control, correlated)
        decorrelation[some.point], weight[some.point] = decorrelated(some)
    group, group_weight = np.full(p, -1), np.zeros(p)
    member = enters[groups.point]
    group[groups.point[member]] = groups.group[member]
    group_weight[groups.point[member]] = inverse_squares(groups.sigma)[groups.group[member]]
    return GroundPriors(
        given=given,
        known=known,
        held=held,
        weight=np.where(known & ~held, weight, 0.0),
        group=group,
        group_weight=group_weight,
        decorrelation=decorrelation,
    )


def level_coordinates(block: Block, frame: Frame) -> FloatArray:
    """Return control in level coordinates (k, 3); geocentric control must be complete to have any."""
    position = block.control.position
    if block.options.system is CoordinateSystem.GEOCENTRIC:
        return frame.level(frame.working(position))
    return np.array(position)
