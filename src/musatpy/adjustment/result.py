"""From the last state of an adjustment to the Solution that statistics and reports read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment import reliability, sightings
from musatpy.adjustment.bathymetric import bathymetric_points
from musatpy.adjustment.dependence import Diagonal, dependence
from musatpy.adjustment.direct import air_bases, level_corrections
from musatpy.adjustment.ground import point_squares
from musatpy.adjustment.iteration import LeastSquares
from musatpy.adjustment.network import Network, Participation, PointGroup, group_points
from musatpy.adjustment.normals import ILL_DETERMINED, SINGULAR, Cofactors, Factor, NormalMatrix, factorised
from musatpy.adjustment.propagation import count, pieces, point_covariances
from musatpy.adjustment.rank import describe_weakness, unknown_name
from musatpy.adjustment.unknowns import State, attitude_in
from musatpy.adjustment.waterline import heights_and_water
from musatpy.adjustment.watpt import refraction_displacement
from musatpy.adjustment.watpt_distance import far_from_rigorous
from musatpy.errors import AdjustmentError, Problem
from musatpy.model import (
    AdjustedStations,
    AdjustedWater,
    AdjustedWaves,
    Block,
    GroundPoints,
    Iteration,
    Observations,
    PlateResiduals,
    PointStatus,
    Program,
    Solution,
    WaterPass,
    Weights,
)

if TYPE_CHECKING:
    from musatpy.adjustment.datum import Freedom, InnerConstraints
    from musatpy.adjustment.wave_trials import OtherCrests

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

STRANDED = 3.0  # sigmas of a height above the water, from which a submerged point is told of
NOT_MET = "its images are kept out, and do not meet"
_APART = 100.0  # sigmas by which rays of a point miss each other that say nothing of it


def solution(
    *,
    block: Block,
    part: Participation,
    measured: Network,
    network: Network,
    refracted: Network,
    state: State,
    apparent: FloatArray,
    reason: str,
    warnings: tuple[str, ...],
    iterations: tuple[Iteration, ...],
    passes: tuple[WaterPass, ...],
    problem: Callable[[Network, State], LeastSquares],
    free: Freedom | None = None,  # None: nothing may be free
    crests: OtherCrests | None = None,  # None: no unknown waves, or nobody has looked for other crests of them
) -> Solution:
    """Return the Solution at `state`; `apparent` (p, 3) are the points of the first triangulation, working.

    Residuals are those of `network`, in which WATPT has straightened the rays. Errors are propagated through
    `refracted`, the same network with its true rays: straight ones would make depths look n times as sure.
    """
    line = problem(network, state).linearise(state)
    bent = line if refracted is network else problem(refracted, state).linearise(state)
    factor = _factor(bent.matrix)
    idle = _idle_photos(network, part)
    counts = count(network, len(idle), free.count if free else 0)
    dof = counts.degrees_of_freedom
    sigma0 = float(np.sqrt(line.objective / dof)) if dof > 0 else 1.0
    part, state, apparent = _without_unmet(network, part, state, apparent, sigma0)
    warnings += _weakness(block, network, state, bent.matrix, factor)
    warnings += _what_is_odd(block, network, state, idle, free, dof)
    held, inner, cofactors = _held(refracted, state, factor, free)
    residuals = _plate_residuals(network, measured, state, part)
    points, observed, diagonal = _ground_points(block, refracted, state, part, held, inner, sigma0, residuals)
    waves = _waves(block, refracted, state, diagonal, cofactors, sigma0, crests)
    stations = _stations(block, network, state, cofactors, sigma0, idle)
    if refracted is not network and not reason:
        warnings += far_from_rigorous(block, refracted, factor.solve(bent.rhs), state, stations, points, sigma0)
    return Solution(
        block=block,
        converged=not reason,
        reason=reason,
        warnings=(*warnings, *_stranded(block, network, state, points), *(waves.warnings if waves else ())),
        iterations=iterations,
        passes=passes,
        sigma0=sigma0,
        degrees_of_freedom=dof,
        sum_of_squares=line.objective,
        observations=counts.observations,
        unknowns=counts.unknowns,
        stations=stations,
        points=points,
        plates=residuals,
        bathymetric=bathymetric_points(block, measured, state, apparent, np.sqrt(points.covariance[:, 2, 2])),
        levels=state.levels,
        level_sigmas=_level_sigmas(network, state, cofactors, sigma0),
        base_lengths=air_bases(network, state)[0],
        water=None if block.water is None else _water(refracted, state, cofactors, sigma0, waves),
        distances=_distances(block, network, state),
        height_differences=_height_differences(block, network, state),
        observed=observed,
        dependence=dependence(refracted, diagonal, cofactors, unknown_name(network, block), sigma0),
    )


def _without_unmet(
    network: Network, part: Participation, state: State, apparent: FloatArray, sigma0: float
) -> tuple[Participation, State, FloatArray]:
    """Return participation, state and apparent points (p, 3) without points that took no part and whose rays miss.

    Nothing says where they are.
    """
    unmet = [np.zeros(0, dtype=int)]
    for group in _left_out(network, part):
        squares = point_squares(network, state, group, state.ground[group.point], with_priors=False)
        known = np.isfinite(state.ground[group.point]).all(axis=1)
        unmet.append(group.point[known & ~(squares <= np.square(_APART * max(sigma0, 1.0)))])
    points = np.concatenate(unmet)
    reasons = {**part.reasons, **dict.fromkeys(points.tolist(), NOT_MET)}
    state = replace(state, ground=_without(state.ground, points))
    return replace(part, reasons=reasons), state, _without(apparent, points)


def _without(ground: FloatArray, points: IntArray) -> FloatArray:
    """Return positions (p, 3) without those of some points."""
    ground = ground.copy()
    ground[points] = np.nan
    return ground


def _held(
    network: Network, state: State, factor: Factor, free: Freedom | None
) -> tuple[Cofactors, InnerConstraints | None, Cofactors]:
    """Return the cofactors, unknowns held as in the iteration; the inner constraints; the cofactors under these."""
    if free is None or not free.count:
        cofactors = factor.cofactors()
        return cofactors, None, cofactors
    from musatpy.adjustment.datum import inner_constraints  # most jobs do without

    held, inner = factor.cofactors().holding(free.held), inner_constraints(network, state, factor, free)
    return held, inner, inner.cofactors(held)


def _level_sigmas(network: Network, state: State, cofactors: Cofactors, sigma0: float) -> FloatArray:
    sigma = np.sqrt(np.diagonal(cofactors.corner))[: network.border.levels] * sigma0
    return np.where(np.isnan(state.levels), np.nan, sigma)


def _factor(matrix: NormalMatrix) -> Factor:
    factor = factorised(matrix) or factorised(matrix, SINGULAR)
    if factor is None:
        message = "the normal equations of the last iteration cannot be solved: points have run away"
        advice = "gross errors make them (OP2 editing EDIT looks for these and takes them out)"
        raise AdjustmentError([Problem(message=f"{message}, as {advice}")])
    return factor


def _waves(
    block: Block,
    network: Network,
    state: State,
    diagonal: Diagonal,
    cofactors: Cofactors,
    sigma0: float,
    crests: OtherCrests | None,
) -> AdjustedWaves | None:
    if not network.border.waves:
        return None
    from musatpy.adjustment import swell  # most jobs have no waves

    name = unknown_name(network, block)
    return swell.adjusted_waves(network, state, diagonal, cofactors, name, sigma0, crests)


def _water(
    network: Network, state: State, cofactors: Cofactors, sigma0: float, waves: AdjustedWaves | None
) -> AdjustedWater:
    knowledge, border = network.water, network.border
    sigma = np.sqrt(np.diagonal(cofactors.corner)) * sigma0
    levels = sigma[border.first_water : border.first_tilt]
    if knowledge.per_photo:
        levels = np.sqrt(cofactors.of_single_photos()[:, 6, 6]) * sigma0
        levels = np.where(knowledge.group >= 0, levels, np.nan)
    return AdjustedWater(
        tide=state.tide,
        correction=level_corrections(network, state),
        correction_ids=knowledge.ids,
        correction_sigma=levels,
        tilt=state.tilt,
        tilt_sigma=sigma[border.first_tilt : border.index_column] if border.tilts else np.full(2, np.nan),
        index=state.index,
        index_sigma=float(sigma[border.index_column]) if border.indices else np.nan,
        waves=waves,
    )


def _distances(block: Block, network: Network, state: State) -> FloatArray:
    ends = state.ground[block.distances.point]
    return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))


def _height_differences(block: Block, network: Network, state: State) -> FloatArray:
    height = np.full(network.points, np.nan)
    known = np.isfinite(state.ground).all(axis=1)
    height[known] = network.frame.height(state.ground[known])
    ends = height[block.height_differences.point]
    return np.asarray(ends[:, 1] - ends[:, 0])


def _idle_photos(network: Network, part: Participation) -> IntArray:
    """Return the photos that neither a used measurement nor an observation of their own holds."""
    busy = np.zeros(network.photos, dtype=bool)
    busy[network.photo[part.used]] = True
    busy[network.base_photo.reshape(-1)] = True
    busy |= network.position_weight.any(axis=1) | network.attitude_weight.any(axis=1)
    return np.flatnonzero(~busy)


def _weakness(
    block: Block, network: Network, state: State, matrix: NormalMatrix, factor: Factor
) -> tuple[str, ...]:
    if factor.smallest_eigenvalue() >= ILL_DETERMINED:
        return ()
    weak = describe_weakness(network, state, matrix, 10.0 * ILL_DETERMINED, unknown_name(network, block))
    return tuple(f"ill-determined: {sentence}" for sentence in weak)


def _what_is_odd(
    block: Block, network: Network, state: State, idle: IntArray, free: Freedom | None, dof: int
) -> tuple[str, ...]:
    unchecked = "no redundancy: sigma0 is the a priori 1, and nothing is checked by anything else"
    weak = ""
    if free and free.weak:
        weak = f"free network: {free.weak} of its {free.count} free motions the observations hold a little"
    return (
        *(f"photo {block.photos.ids[i]} has no usable measurement: it stays where it was given" for i in idle),
        *((unchecked,) if dof <= 0 else ()),
        *((weak,) if weak else ()),
    )


def _stranded(block: Block, network: Network, state: State, points: GroundPoints) -> tuple[str, ...]:
    """Return a warning for every submerged point above the water at a photo that sees it, by more than its sigma.

    A point without a sigma is told of wherever it stands above the water.
    """
    height, water = heights_and_water(network, state)
    rays = np.flatnonzero(block.points.bathymetric[network.point] & (height > water))
    highest = np.full(network.points, -np.inf)
    np.maximum.at(highest, network.point[rays], (height - water)[rays])
    sigma = np.sqrt(np.maximum(points.covariance[:, 2, 2], 0.0))
    chosen = [point for point in np.unique(network.point[rays]) if not highest[point] <= STRANDED * sigma[point]]
    return tuple(
        f"point {block.points.ids[point]} is flagged as submerged and stands {highest[point]:.3f} m above the water"
        + (f" (sigma {sigma[point]:.3f} m)" if np.isfinite(sigma[point]) else "")
        for point in chosen
    )


def _stations(
    block: Block, network: Network, state: State, cofactors: Cofactors, sigma0: float, idle: IntArray
) -> AdjustedStations:
    covariance = cofactors.of_single_photos()[:, :6, :6] * sigma0**2
    covariance[idle] = np.nan
    return AdjustedStations(
        position=network.frame.system(state.position),
        attitude=attitude_in(state, network.frame.axes(state.position), block.photos.attitude),
        covariance=covariance,
    )


def _ground_points(
    block: Block,
    network: Network,
    state: State,
    part: Participation,
    cofactors: Cofactors,
    inner: InnerConstraints | None,
    sigma0: float,
    residuals: PlateResiduals,
) -> tuple[GroundPoints, Observations, Diagonal]:
    """Return the points with their covariances, and what comes with these: all observations, and the diagonal."""
    p = network.points
    covariance, rays = np.full((p, 3, 3), np.nan), np.zeros(p, dtype=int)
    parts, diagonal = list(reliability.direct(network, state, block, cofactors)), Diagonal(network)
    diagonal.add_direct(network, state)
    for group in network.groups:
        rays[group.point] = group.rays.shape[1]
        for rows, piece in pieces(network, state, group, group.known, cofactors):
            covariance[group.point[rows]] = point_covariances(network, piece, cofactors, inner)
            parts += [reliability.images(network, piece, residuals.residual), *reliability.priors(piece, block)]
            diagonal.add(network, piece)
    for group in _left_out(network, part):
        rays[group.point] = group.rays.shape[1]
        for rows, piece in pieces(network, state, group, False, cofactors):
            covariance[group.point[rows]] = point_covariances(network, piece, cofactors, inner)
    points = _points_of(network, state, part, covariance * sigma0**2, rays)
    if block.options.program is Program.IIA and block.options.weights is not Weights.FULL:
        return points, *_as_with_full_weights(block, network, state, residuals)
    return points, reliability.joined(parts), diagonal


def _left_out(network: Network, part: Participation) -> tuple[PointGroup, ...]:
    every_ray = np.ones(len(network.photo), dtype=bool)
    return group_points(network.photo, network.point, every_ray, part.status == PointStatus.INTERSECTED)


def _points_of(
    network: Network, state: State, part: Participation, covariance: FloatArray, rays: IntArray
) -> GroundPoints:
    status, reasons = part.status.copy(), dict(part.reasons)
    lost = ~np.isfinite(state.ground).all(axis=1) & (status == PointStatus.INTERSECTED)
    status[lost] = PointStatus.NOT_DETERMINED
    for point in np.flatnonzero(lost):
        if reasons.get(int(point)) != NOT_MET:
            reasons[int(point)] = "its rays are parallel"
    determined = status != PointStatus.NOT_DETERMINED
    position = np.full((network.points, 3), np.nan)
    position[determined] = network.frame.system(state.ground[determined])
    covariance[~determined] = np.nan
    return GroundPoints(
        position=position,
        covariance=covariance,
        status=status,
        rays=np.where(determined, rays, 0),
        reasons=reasons,
    )


def _as_with_full_weights(
    block: Block, network: Network, state: State, residuals: PlateResiduals
) -> tuple[Observations, Diagonal]:
    """Return the observations as an adjustment with full weights would check them.

    Conditions with simple weights have no redundancy numbers of single observations.
    """
    from musatpy.adjustment.simultaneous import Simultaneous  # only here, and it would load with every run

    problem = Simultaneous(network=network, rotation_limit=0.0, translation_limit=0.0, held=np.zeros(0, dtype=int))
    cofactors, diagonal = _factor(problem.linearise(state).matrix).cofactors(), Diagonal(network)
    parts = list(reliability.direct(network, state, block, cofactors))
    diagonal.add_direct(network, state)
    for group in network.groups:
        for _, piece in pieces(network, state, group, group.known, cofactors):
            parts += [reliability.images(network, piece, residuals.residual), *reliability.priors(piece, block)]
            diagonal.add(network, piece)
    return reliability.joined(parts), diagonal


def _plate_residuals(network: Network, measured: Network, state: State, part: Participation) -> PlateResiduals:
    rays = np.arange(len(network.photo))
    ground = state.ground[network.point]
    known = np.isfinite(ground).all(axis=1)
    residual = np.full((len(rays), 2), np.nan)
    residual[known] = image_coordinates_of(network, state, rays[known]) - network.xy[known]
    correction = network.xy - measured.xy
    bent = known & network.refracted
    wet = np.ones(np.count_nonzero(bent), dtype=bool)
    correction[bent] = refraction_displacement(network, state, rays[bent], ground[bent], wet)[1]
    return PlateResiduals(residual=residual, triangulated=part.used, correction=correction)


def image_coordinates_of(network: Network, state: State, rays: IntArray) -> FloatArray:
    """Return the images (r, 2) mm of the points of the measurements `rays` at their present positions."""
    return sightings.image_coordinates(network, state, rays, state.ground[network.point[rays]])
