"""WATPT: the water point correction of MUSAT-IIA, as printed in 1983 and in its differential form.

Per submerged point: apparent intersection, local vertical system, water intersection at each photo's tide,
refraction, multi-ray underwater intersection, new plate coordinates; always from the measured ones.
ETL-0306 section 3.1 with the corrections of docs/theory.md.

How far a result is from the rigorous one: a step of the rigorous triangulation, in its sigmas. And submerged points
as straight rays show them, as a rule of thumb predicts them, and as adjusted, with their depths.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from musatpy.adjustment import sightings
from musatpy.adjustment.collinear import eliminate
from musatpy.adjustment.ground import PARALLEL, settle_group
from musatpy.adjustment.iteration import Linearisation, State
from musatpy.adjustment.network import Network, PointGroup, together
from musatpy.adjustment.normals import PARAMETERS, Factor
from musatpy.adjustment.sightings import straight_rays
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry import collinearity
from musatpy.geometry.collinearity import nearest_point, widest_angle
from musatpy.geometry.geodesy import surface, water_heights
from musatpy.model import BathymetricPoints, Block, Departure, Solution
from musatpy.model.tables import finite_rows
from musatpy.refraction import flat

_ROUNDS = 2  # the second one sets the local vertical system at P''


def water_points(network: Network, state: State, groups: tuple[PointGroup, ...], wet: BoolArray) -> FloatArray:
    """Return the positions P'' (p, 3) of the points of `groups`, NaN elsewhere; `network.xy` as measured.

    `wet` (m,) says which rays go through the water surface.

    A point on one ray keeps its present position, if it has any: there is nothing to intersect.
    """
    ground = np.full((network.points, 3), np.nan)
    for group in groups:
        if group.rays.shape[1] == 1:
            ground[group.point] = state.ground[group.point]
        else:
            ground[group.point] = underwater_intersection(network, state, group, wet)
    return ground


def held_by_control(network: Network, state: State, ground: FloatArray, wet: BoolArray) -> FloatArray:
    """Return P'' (p, 3) with the points of the control groups intersected under their control.

    The rays alone put a control point elsewhere than the triangulation does; the differential form would carry that
    difference into the images (0.3 to 0.5 sigma of the stations). With this step WATPT agrees with RIGOROUS to 0.02
    sigma in shallow water, and to 0.1 over depths of a third of the flying height (docs/theory.md).
    """
    refracted = network.with_plates(network.xy, wet)
    ground = ground.copy()
    for group in together(network.control_groups):
        part = group.part(finite_rows(ground[group.point]))
        if len(part.point):
            ground[part.point], _ = settle_group(refracted, state, part, ground[part.point])
    return ground


def underwater_intersection(network: Network, state: State, group: PointGroup, wet: BoolArray) -> FloatArray:
    """Return P'' (k, 3) of points with two or more rays, ETL-0306 (3.2)-(3.21)."""
    frame = network.frame
    camera, direction = sightings.straight_rays(network, state, group.rays)
    tide, slope = state.tide[network.photo[group.rays]], network.slope(state.tilt)
    P = collinearity.first_pair(camera, direction)  # (3.6): P'
    for _ in range(_ROUNDS):
        axes = frame.axes(P)  # transpose of M-bar, (3.7)
        over = surface(frame, slope, tide, np.repeat(P[:, None], tide.shape[1], axis=1))  # (3.12), at each photo
        height = np.einsum("kmi,kmi->km", over.normal, camera - P[:, None]) - over.depth
        entered, below = flat.ray_below(camera, direction, over.normal, height, state.index)  # (3.13)-(3.17)
        through = wet[group.rays][..., None]
        start = np.where(through, entered, camera)
        ray = np.where(through, below, direction)
        P = P + _meet(axes, start - P[:, None], ray)
    return P


def _meet(axes: FloatArray, start: FloatArray, ray: FloatArray) -> FloatArray:
    """Return the least squares solution of (3.19) for the rays of k points, from P', in working axes."""
    w = np.einsum("kij,kmj->kmi", axes, start)
    u = np.einsum("kij,kmj->kmi", axes, ray)
    slope = u[..., :2] / u[..., 2:]  # (3.20): rows [1 0 -u1/u3], [0 1 -u2/u3]
    right = w[..., :2] - slope * w[..., 2:]
    # of the normal equations the height first: by slopes about their mean the other two have no part in it
    m = slope.shape[1]
    mean, middle = np.einsum("kmi->ki", slope) / m, np.einsum("kmi->ki", right) / m
    about = slope - mean[:, None]
    height = -np.einsum("kmi,kmi->k", about, right) / np.einsum("kmi,kmi->k", about, about)
    local = np.concatenate([middle + mean * height[:, None], height[:, None]], axis=1)
    return np.einsum("kji,kj->ki", axes, local)


def refraction_displacement(
    network: Network, state: State, rays: IntArray, ground: FloatArray, wet: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return straight images and straight minus refracted images, (r, 2) mm each, of points (r, 3); wet (r,)."""
    photo = network.photo[rays]
    camera, M = state.position[photo], state.M[photo]
    f, pp = network.focal_length[photo], network.principal_point[photo]
    over = surface(network.frame, network.slope(state.tilt), state.tide[photo], ground)
    bent = flat.water_vector(camera, ground, over.normal, over.depth, state.index, wet)
    straight = collinearity.image(ground - camera, M, f, pp)
    return straight, straight - collinearity.image(bent, M, f, pp)


def corrected_plates(
    network: Network, state: State, groups: tuple[PointGroup, ...], wet: BoolArray, legacy: bool
) -> FloatArray:
    """Return plate coordinates (m, 2) in which the measurements of the points of `groups` are free of refraction.

    `network.xy` are the measured ones; `wet` (m,) says which rays go through the water surface. Legacy, (3.22) to
    (3.26): the straight image of P'' itself, which carries no residual. Otherwise the differential form: the
    measured image plus the straight minus the refracted image of P'', which keeps the residual (docs/theory.md,
    WATPT). Where P'' is unknown the measurement stays.
    """
    points = water_points(network, state, groups, wet)
    if not legacy:
        points = held_by_control(network, state, points, wet)
    known = np.isfinite(points[:, 0] + points[:, 1] + points[:, 2])
    rays = np.flatnonzero(known[network.point])
    ground = points.take(network.point.take(rays), axis=0)
    straight, displacement = refraction_displacement(network, state, rays, ground, wet[rays])
    xy = network.xy.copy()
    xy[rays] = straight if legacy else network.xy.take(rays, axis=0) + displacement
    return xy


FAR = 0.3  # sigmas: what a reader of the listing would want to know
_LEAST_SIGMA0 = 0.1  # images that fit better than that are made, without errors: their sigmas mean nothing


def with_departure(
    solution: Solution,
    network: Network,
    refracted: Network,
    line: Linearisation,
    factor: Factor,
    state: State,
    kept_out: tuple[PointGroup, ...],
) -> Solution:
    """Return a result of WATPT that says how far it is from that of RIGOROUS, with a warning beyond `FAR`.

    By a step of the normals (`line`, `factor`) of the `refracted` network at `state`; all points follow.
    One that has not converged, or whose own `network` has refracted rays, is left as it is.
    The sigmas are those of the result. A second step would change next to nothing: what the first one leaves is of
    second order.
    """
    if refracted is network or not solution.converged:
        return solution
    block, step = solution.block, factor.solve(line.rhs)
    of_stations = step[: refracted.pattern.order].reshape(refracted.photos, -1)[:, :6]
    of_points = np.zeros((refracted.points, 3))
    for group in (*refracted.groups, *kept_out):
        follow = eliminate(refracted, state, group).follow(group)
        axes, local = refracted.frame.axes(state.ground[group.point]), follow.step(refracted, step)
        of_points[group.point] = np.einsum("kij,klj,kl->ki", axes, follow.axes, local)
    sizes = (
        _in_sigmas(of_stations, solution.stations.covariance),
        _in_sigmas(of_points, solution.points.covariance),
    )
    photo, parameter = np.unravel_index(sizes[0].argmax(), sizes[0].shape)
    point, component = np.unravel_index(sizes[1].argmax(), sizes[1].shape)
    largest, name = max(
        (sizes[0].max(), f"{PARAMETERS[parameter]} of photo {block.photos.ids[photo]}"),
        (sizes[1].max(), f"{PARAMETERS[component]} of point {block.points.ids[point]}"),
    )
    away = Departure(sigmas=float(largest) * min(1.0, solution.sigma0 / _LEAST_SIGMA0), farthest=name)
    far = (f"the result of {block.options.refraction} is {away}",) if away.sigmas > FAR else ()
    return replace(solution, departure=away, warnings=solution.warnings + far)


def _in_sigmas(change: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the sizes of changes (k, u) in sigmas; 0 of what is held, or has no covariance (k, u, u)."""
    variance = np.einsum("kuu->ku", covariance)
    known = np.isfinite(variance) & (variance > 0.0) & np.isfinite(change)
    return np.abs(np.where(known, change, 0.0)) / np.sqrt(np.where(known, variance, 1.0))


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
    depth = level - _where_known(measured.frame.height, apparent)
    # a dry point stays where it is; without a WTR card there is no index to predict by
    factor = np.where(depth > 0.0, state.index if block.water else np.nan, 1.0)
    predicted_depth = depth * factor
    predicted = _at_heights(measured, apparent, level - predicted_depth)
    return BathymetricPoints(
        point=chosen,
        apparent=_where_known(measured.frame.system, apparent)[chosen],
        predicted=_where_known(measured.frame.system, predicted)[chosen],
        water_level=level[chosen],
        incidence=_incidence(measured, state, wet)[chosen],
        apparent_depth=depth[chosen],
        predicted_depth=predicted_depth[chosen],
        depth=(level - _where_known(measured.frame.height, state.ground))[chosen],
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


def _where_known(convert: Callable[[FloatArray], FloatArray], working: FloatArray) -> FloatArray:
    """Return what becomes of points (p, 3), NaN for those without a position."""
    known = finite_rows(working)
    of_known = convert(working[known])
    out = np.full((len(working), *of_known.shape[1:]), np.nan)
    out[known] = of_known
    return out


def _at_heights(network: Network, working: FloatArray, height: FloatArray) -> FloatArray:
    """Return points moved along their local verticals to heights (p,), NaN where either is unknown."""
    moved = np.full(working.shape, np.nan)
    known = np.isfinite(height) & finite_rows(working)
    # along the local vertical, not along geocentric Z as in Table 6.9
    level = network.frame.level(working[known])
    level[:, 2] = height[known]
    moved[known] = network.frame.from_level(level)
    return moved
