"""From the last state of an adjustment to the Solution that statistics and reports read."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.adjustment import kernels
from musatpy.adjustment.datum import describe_weakness
from musatpy.adjustment.ground import PARALLEL, all_residuals, point_squares, settle_group
from musatpy.adjustment.held_parameters import held_parameters
from musatpy.adjustment.iteration import (
    LEVEL,
    LeastSquares,
    State,
    attitude_in,
    heights_and_water,
    level_corrections,
    water_over,
)
from musatpy.adjustment.job import Job
from musatpy.adjustment.kinds import count, measured_values
from musatpy.adjustment.network import Network, Participation, PointGroup, unknown_name
from musatpy.adjustment.normals import ILL_DETERMINED
from musatpy.adjustment.parameters import adjusted_parameters
from musatpy.adjustment.precision import (
    Covariances,
    RayReach,
    dependence,
    factor_of,
    limits_of_water,
    mean_depth,
    precision,
    reach_of,
    undetermined_points,
    undetermined_water,
)
from musatpy.adjustment.sightings import straight_rays
from musatpy.adjustment.watpt import refraction_displacement, with_departure
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.geometry.collinearity import nearest_point, turn_about_one_line, widest_angle
from musatpy.geometry.geodesy import surface, water_heights
from musatpy.model import (
    AdjustedStations,
    AdjustedWater,
    AdjustedWaves,
    BathymetricPoints,
    Block,
    GroundPoints,
    ObservationKind,
    PlateResiduals,
    PointStatus,
    Solution,
    WaterPass,
)
from musatpy.model.findings import named
from musatpy.model.tables import finite_rows
from musatpy.units import DEGREE

if TYPE_CHECKING:
    from musatpy.adjustment.datum import Freedom
    from musatpy.adjustment.normals import Cofactors
    from musatpy.adjustment.wave_search import OtherCrests


STRANDED = 3.0  # sigmas of a height above the water, from which a submerged point is told of
NOT_MET = "its images are kept out of the solution, and their rays do not meet"
_APART = 100.0  # sigmas by which rays of a point miss each other that say nothing of it


def solution(
    job: Job,
    network: Network,
    refracted: Network,
    state: State,
    reason: str,
    warnings: tuple[str, ...],
    passes: tuple[WaterPass, ...],
    problem: Callable[[Network, State], LeastSquares],
    free: Freedom | None = None,  # None: nothing may be free
    crests: OtherCrests | None = None,  # None: no unknown waves, or nobody has looked for other crests of them
) -> Solution:
    """Return the Solution at `state`: residuals of `network`, in which WATPT has straightened the rays.

    Errors go through `refracted`, its true rays: straight ones would make depths look n times as sure.
    """
    block, part, measured = job.block, job.part, job.network
    line = problem(refracted, state).linearise(state)
    squares = line.objective if refracted is network else problem(network, state).evaluate(state)
    factor, idle = factor_of(line.matrix), _idle_photos(network, part)
    dof = (counts := count(network, len(idle), free.count if free else 0)).degrees_of_freedom
    sigma0 = float(np.sqrt(squares / dof)) if dof > 0 else 1.0
    part, state = _without_unmet(network, part, state, sigma0)
    if factor.is_weak(ILL_DETERMINED):
        weak = describe_weakness(network, state, line.matrix, 10.0 * ILL_DETERMINED, block)
        warnings += tuple(f"ill-determined: {sentence}" for sentence in weak)
    warnings += _what_is_odd(block.photos.ids[idle], free, dof) + _steep(block, network, state)
    plates = _plate_residuals(network, measured, state, part)
    known = precision(block, refracted, state, factor, free, plates.residual, squares, dof)
    reach = reach_of(network, state, part.used)
    stated, points = _points(block, refracted, state, part, known, reach)
    name = unknown_name(refracted, block)
    waves = _waves(refracted, state, known, name, crests)
    found = Solution(
        block=block,
        converged=not reason,
        reason=reason,
        warnings=(*warnings, *_stranded(block, network, stated, points), *(waves.warnings if waves else ())),
        iterations=tuple(job.iterations),
        passes=passes,
        sigma0=sigma0,
        degrees_of_freedom=dof,
        sum_of_squares=squares,
        observations=counts.observations,
        unknowns=counts.unknowns,
        stations=_stations(block, network, state, known, idle),
        points=points,
        plates=plates,
        bathymetric=bathymetric_points(block, measured, stated, job.water_groups(), np.sqrt(known.depths)),
        levels=state.levels,
        level_sigmas=_group_sigmas(network, state, known),
        measured=measured_values(block, network, state),
        water=_water(block, refracted, state, part, known, reach.height, waves),
        observed=known.observed,
        pairs=known.pairs,
        level_pairs=known.levels,
        water_precision=known.water,
        considered=known.considered,
        kernels=kernels.name_of(network.photos),
        dependence=dependence(refracted, known.diagonal, known.cofactors, known.unknowns, name),
        **_parameters(block, refracted, state, known, name, free, reach.height),
        held=None if reason else held_parameters(block, refracted, state, part, known, free),
    )
    return found if refracted is network else with_departure(found, refracted, line, factor, state)


def _without_unmet(
    network: Network, part: Participation, state: State, sigma0: float
) -> tuple[Participation, State]:
    """Return participation and state without points that were kept out and whose rays miss each other.

    Nothing says where they are.
    """
    unmet: dict[int, str] = {}
    for group in network.left_out:
        squares = point_squares(network, state, group, state.ground[group.point])
        known = finite_rows(state.ground[group.point])
        apart = known & ~(squares <= np.square(_APART * max(sigma0, 1.0)))
        unmet |= dict.fromkeys(group.point[apart].tolist(), NOT_MET)
    return replace(part, reasons=part.reasons | unmet), _without(state, unmet)


def _without(state: State, points: Collection[int]) -> State:
    """Return the state without positions of points; without any, what was computed at it is still so."""
    if not points:
        return state
    ground = state.ground.copy()
    ground[list(points)] = np.nan
    return replace(state, ground=ground)


def _waves(
    network: Network, state: State, known: Covariances, name: Callable[[int], str], crests: OtherCrests | None
) -> AdjustedWaves | None:
    """Return the unknown waves, None without any."""
    if not network.border.count(ObservationKind.WAVE):
        return None
    from musatpy.adjustment.adjusted_waves import adjusted_waves  # most jobs have none

    return adjusted_waves(network, state, known.diagonal, known.cofactors, known.unknowns, name, crests)


def _group_sigmas(network: Network, state: State, known: Covariances) -> FloatArray:
    """Return the sigmas (g,) m of the levels of groups of equal elevation, NaN where there is no level."""
    sigmas = known.border_sigma[network.border.at(ObservationKind.EQUAL_ELEVATION)]
    return np.where(np.isnan(state.levels), np.nan, sigmas)


def _parameters(
    block: Block,
    network: Network,
    state: State,
    known: Covariances,
    name: Callable[[int], str],
    free: Freedom | None,
    height: float,
) -> dict[str, Any]:
    """Return the further parameters that were unknown, and what those of lenses do; nothing without any."""
    if not network.parameters:
        return {}
    depth = None if free and free.count else mean_depth(block, network, state, known)
    motions = free.directions if free and free.count else np.zeros((network.pattern.order + network.border.size, 0))
    f = float(np.median(block.cameras.focal_length[block.photos.camera]))
    camera = float(np.median(block.plate_sigmas)), f, height
    parameters = adjusted_parameters(network, state, known, name, depth, motions, camera)
    return {"parameters": parameters, "grid": network.lenses and parameters and network.lenses.grid(parameters)}


def _water(
    block: Block,
    network: Network,
    state: State,
    part: Participation,
    known: Covariances,
    height: float,
    waves: AdjustedWaves | None,
) -> AdjustedWater | None:
    """Return the water, None without any: what is not determined has no sigma, and such a level no number."""
    if block.water is None:
        return None
    knowledge, border, diagonal = network.water, network.border, known.diagonal
    at = border.at(ObservationKind.WATER_LEVEL)
    told = diagonal.stations[:, LEVEL] if knowledge.per_photo else diagonal.border[at]
    adjusted = knowledge.group >= 0 if knowledge.per_photo else np.ones(len(told), dtype=bool)

    def spread(cofactors: Cofactors) -> dict[str, FloatArray]:
        of_border = np.where(diagonal.border > 0.0, np.sqrt(np.diagonal(cofactors.corner)), np.nan)
        return {
            "level": np.where(adjusted & (told > 0.0), _level_sigmas(network, cofactors), np.nan),
            "tilt": of_border[border.at(ObservationKind.WATER_TILT)],
            "index": of_border[border.at(ObservationKind.WATER_INDEX)],
        }

    # what is determined does not hang on residuals: small ones would make everything sure
    limits, a_priori = limits_of_water(block, height), spread(known.cofactors)
    sigmas = {
        of: np.where(a_priori[of] <= limits[of], values, np.nan) for of, values in spread(known.unknowns).items()
    }
    loose = adjusted & np.isnan(sigmas["level"])
    return AdjustedWater(
        tide=state.tide,
        correction=np.where(loose, np.nan, level_corrections(network, state)),
        correction_ids=knowledge.ids,
        correction_sigma=sigmas["level"],
        tilt=state.tilt,
        tilt_sigma=sigmas["tilt"] if len(sigmas["tilt"]) else np.full(2, np.nan),
        index=state.index,
        index_sigma=float(sigmas["index"][0]) if len(sigmas["index"]) else np.nan,
        undetermined=undetermined_water(block, network, part, loose, sigmas),
        waves=waves,
    )


def _idle_photos(network: Network, part: Participation) -> IntArray:
    """Return the photos that neither a used measurement nor an observation of their own holds."""
    busy = np.zeros(network.photos, dtype=bool)
    busy[network.photo[part.used]] = True
    for measured in network.measured.values():
        busy[measured.photo.reshape(-1)] = True
    busy |= network.position_weight.any(axis=1) | network.attitude_weight.any(axis=1)
    return np.flatnonzero(~busy)


def _what_is_odd(idle: TextArray, free: Freedom | None, dof: int) -> tuple[str, ...]:
    odd = [f"photo {photo} has no usable measurement: it stays where it was given" for photo in idle]
    if dof <= 0:
        odd.append("no redundancy: sigma0 is the a priori 1, and no observation is checked by another")
    if free and free.weak:
        odd.append(f"free network: {free.weak} of its {free.count} free motions the observations hold a little")
    return tuple(odd)


def _steep(block: Block, network: Network, state: State) -> tuple[str, ...]:
    """Return a warning on the photos whose omega and kappa are only known together."""
    attitude = attitude_in(state, network.frame.axes(state.position), np.zeros(3))
    rows = np.flatnonzero(turn_about_one_line(attitude, DEGREE))
    why = "Y-tilt within a degree of 90: X-tilt and heading turn about nearly one line, and only together are known"
    return (f"{named('photo', block.photos.ids[rows])}: {why} well",) if len(rows) else ()


def _stranded(block: Block, network: Network, state: State, points: GroundPoints) -> tuple[str, ...]:
    """Return a warning for every submerged point above the water at a photo that sees it, by more than its sigma.

    A point without a sigma is told of wherever it stands above the water.
    """
    if not block.points.bathymetric.any():
        return ()
    height, water = heights_and_water(network, state, block.points.bathymetric)
    rays = np.flatnonzero(height > water)
    highest = np.full(network.points, -np.inf)
    np.maximum.at(highest, network.point[rays], (height - water)[rays])
    sigma = np.sqrt(np.maximum(points.covariance[:, 2, 2], 0.0))
    chosen = [point for point in np.unique(network.point[rays]) if not highest[point] <= STRANDED * sigma[point]]
    return tuple(
        f"point {block.points.ids[point]} is flagged as submerged and stands {highest[point]:.3f} m above the water"
        + (f" (sigma {sigma[point]:.3f} m)" if np.isfinite(sigma[point]) else "")
        for point in chosen
    )


def _stations(block: Block, network: Network, state: State, known: Covariances, idle: IntArray) -> AdjustedStations:
    covariance = known.unknowns.of_single_photos()[:, :6, :6].copy()
    covariance[idle] = np.nan
    return AdjustedStations(
        position=network.frame.system(state.position),
        attitude=attitude_in(state, network.frame.axes(state.position), block.photos.attitude),
        covariance=covariance,
    )


def _points(
    block: Block,
    network: Network,
    state: State,
    part: Participation,
    known: Covariances,
    reach: RayReach,
) -> tuple[State, GroundPoints]:
    """Return the state without points that have no number, and the points with the water over them."""
    unstated = undetermined_points(network, state, reach, known)
    state, rays = _without(state, unstated), np.zeros(network.points, dtype=int)
    for group in (*network.groups, *network.left_out):
        rays[group.point] = group.rays.shape[1]
    status, reasons = part.status.copy(), part.reasons | unstated
    lost = ~finite_rows(state.ground) & (status == PointStatus.INTERSECTED)
    for point in np.flatnonzero(lost).tolist():
        if point not in unstated and reasons.get(point) != NOT_MET:
            reasons[point] = "its rays are parallel"
    status[lost] = status[list(unstated)] = PointStatus.NOT_DETERMINED
    determined = status != PointStatus.NOT_DETERMINED
    position = np.where(determined[:, None], network.frame.system(state.ground), np.nan)
    water, tide_sigma = water_over(network, state), _tide_sigmas(block, network, known)
    lowest, highest, water_sigma = np.full((3, network.points), np.nan)
    np.fmin.at(lowest, network.point, water)
    np.fmax.at(highest, network.point, water)
    np.fmax.at(water_sigma, network.point, tide_sigma[network.photo])
    points = GroundPoints(
        position=position,
        covariance=np.where(determined[:, None, None], known.points, np.nan),
        status=status,
        rays=np.where(determined, rays, 0),
        water=np.stack([lowest, highest], axis=1),
        water_sigma=water_sigma,
        reasons=reasons,
        lost=tuple(point for point in unstated if part.status[point] == PointStatus.TRIANGULATED),
    )
    return state, points


def _level_sigmas(network: Network, covariances: Cofactors) -> FloatArray:
    """Return the sigmas (c,) m of the corrections of tides."""
    if network.water.per_photo:
        return np.sqrt(covariances.of_single_photos()[:, LEVEL, LEVEL])
    return np.sqrt(np.diagonal(covariances.corner))[network.border.at(ObservationKind.WATER_LEVEL)]


def _tide_sigmas(block: Block, network: Network, known: Covariances) -> FloatArray:
    """Return the sigmas (n,) m of the tides, adjusted or of the cards, 0 without error; NaN without a tide."""
    sigma, adjusted = np.nan_to_num(block.photos.tide_sigma), network.water.group >= 0
    sigma[adjusted] = _level_sigmas(network, known.unknowns)[network.water.group[adjusted]]
    return np.where(np.isnan(block.photos.tide), np.nan, sigma)


def _plate_residuals(network: Network, measured: Network, state: State, part: Participation) -> PlateResiduals:
    known = finite_rows(state.ground)[network.point]
    residual = all_residuals(network, state, known)
    correction = network.xy - measured.xy
    bent = np.flatnonzero(known & network.refracted)
    if len(bent):
        wet = np.ones(len(bent), dtype=bool)
        correction[bent] = refraction_displacement(network, state, bent, state.ground[network.point[bent]], wet)[1]
    return PlateResiduals(residual=residual, triangulated=part.used, correction=correction)


def bathymetric_points(
    block: Block, measured: Network, state: State, groups: Iterable[PointGroup], depth_sigma: FloatArray
) -> BathymetricPoints:
    """Return the submerged points of a block at `state`.

    `measured` is the network with the images as they were measured, its rays straight; `groups` are all points with
    the rays that give their positions; `depth_sigma` (p,) m of all points.
    """
    chosen, submerged = np.flatnonzero(block.points.bathymetric), block.points.bathymetric
    known = submerged & finite_rows(state.ground)
    wet = [part for group in groups for part in (group.part(known[group.point]),) if len(part.point)]
    apparent = _straight_intersections(measured, state, wet)
    level = _water_levels(measured, state, submerged, wet)
    depth = level - measured.frame.height(apparent)
    # a dry point stays where it is; without a WTR card there is no index to predict by
    factor = np.where(depth > 0.0, state.index if block.water else np.nan, 1.0)
    predicted_depth = depth * factor
    predicted = _at_heights(measured, apparent, level - predicted_depth)
    return BathymetricPoints(
        point=chosen,
        apparent=measured.frame.system(apparent)[chosen],
        predicted=measured.frame.system(predicted)[chosen],
        water_level=level[chosen],
        incidence=_incidence(measured, state, wet)[chosen],
        apparent_depth=depth[chosen],
        predicted_depth=predicted_depth[chosen],
        depth=(level - measured.frame.height(state.ground))[chosen],
        depth_sigma=depth_sigma[chosen],
    )


def _straight_intersections(measured: Network, state: State, groups: Iterable[PointGroup]) -> FloatArray:
    """Return where straight rays meet best (p, 3), working; nothing else known of the points enters.

    NaN where there are not two rays, these are parallel, or meet behind a camera.
    """
    ground = np.full((measured.points, 3), np.nan)
    for group in groups:
        origin, direction = straight_rays(measured, state, group.rays)
        meets = widest_angle(direction) >= PARALLEL
        part = replace(group.part(meets), known=False)  # nothing else enters
        if len(part.point):
            start = nearest_point(origin[meets], direction[meets])
            X, squares = settle_group(measured, state, part, start)
            ground[part.point] = np.where(np.isfinite(squares)[:, None], X, np.nan)
    return ground


def _incidence(measured: Network, state: State, groups: Iterable[PointGroup]) -> FloatArray:
    """Return the mean angle (p,) rad, in air, between the rays of a point and the normal of the water over it.

    The water is the level or tilted surface of the adjustment, without its waves.
    """
    angle = np.full(measured.points, np.nan)
    for group in groups:
        _, direction = straight_rays(measured, state, group.rays)
        ground = np.broadcast_to(state.ground[group.point][:, None], direction.shape)
        over = surface(measured.frame, measured.slope(state.tilt), state.tide[measured.photo[group.rays]], ground)
        down = -np.einsum("kmi,kmi->km", over.normal, direction)
        angle[group.point] = np.arccos(np.clip(down, -1.0, 1.0)).mean(axis=1)
    return angle


def _water_levels(
    measured: Network, state: State, submerged: BoolArray, groups: Iterable[PointGroup]
) -> FloatArray:
    """Return the mean height (p,) m of the water at submerged points, over the photos that give them.

    That of a point without a position is over all photos that show it.
    """
    lost, giving = submerged.copy(), np.zeros(len(measured.point), dtype=bool)
    for group in groups:
        lost[group.point], giving[group.rays] = False, True
    rays = np.flatnonzero(giving | lost[measured.point])
    point = measured.point[rays]
    water = water_heights(measured.slope(state.tilt), state.tide[measured.photo[rays]], state.ground[point])
    number = np.bincount(point, minlength=measured.points)
    total = np.bincount(point, weights=water, minlength=measured.points)
    return np.divide(total, number, out=np.full(measured.points, np.nan), where=number > 0)


def _at_heights(network: Network, working: FloatArray, height: FloatArray) -> FloatArray:
    """Return points moved along their local verticals to heights (p,), NaN where either is unknown."""
    # along the local vertical, not along geocentric Z as in Table 6.9
    level = network.frame.level(working)
    level[:, 2] = height
    return np.where(np.isfinite(height)[:, None], network.frame.from_level(level), np.nan)
