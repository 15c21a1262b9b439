"""WATPT: the water point correction of MUSAT-IIA, as printed in 1983 and in its differential form.

Per submerged point: apparent intersection, local vertical system, water intersection at each photo's tide,
refraction, multi-ray underwater intersection, new plate coordinates; always from the measured ones.
ETL-0306 section 3.1 with the corrections of docs/theory.md.

How far a result is from the rigorous one: a step of the rigorous triangulation, in its sigmas. And submerged points
as straight rays show them, as a rule of thumb predicts them, and as adjusted, with their depths.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.adjustment import sightings
from musatpy.adjustment.collinear import eliminate
from musatpy.adjustment.ground import settle_group
from musatpy.adjustment.iteration import Linearisation, State
from musatpy.adjustment.network import Network, PointGroup, together
from musatpy.adjustment.normals import PARAMETERS, Factor
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry import collinearity
from musatpy.geometry.geodesy import surface
from musatpy.model import Departure, Solution
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
    refracted: Network,
    line: Linearisation,
    factor: Factor,
    state: State,
) -> Solution:
    """Return a result of WATPT that says how far it is from that of RIGOROUS, with a warning beyond `FAR`.

    By a step of the normals (`line`, `factor`) of the `refracted` network at `state`; all points follow.
    One that has not converged is left as it is.
    The sigmas are those of the result. A second step would change next to nothing: what the first one leaves is of
    second order.
    """
    if not solution.converged:
        return solution
    block, step = solution.block, factor.solve(line.rhs)
    of_stations = step[: refracted.pattern.order].reshape(refracted.photos, -1)[:, :6]
    of_points = np.zeros((refracted.points, 3))
    for group in together((*refracted.groups, *refracted.left_out)):
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
