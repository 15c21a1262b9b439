"""A robust adjustment of the stations found, so that long strips do not bend and gross errors do not draw them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment import ground as ground_points
from musatpy.adjustment.iteration import SingularNormalsError, State, initial_state, iterate, with_turned_axes
from musatpy.adjustment.job import build_network
from musatpy.adjustment.musat2a import GeodeticRestraint
from musatpy.adjustment.network import Network, participation
from musatpy.adjustment.sightings import image_coordinates, residuals, straight_rays
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry import collinearity, similarity
from musatpy.geometry.collinearity import attitude_from_matrix, widest_angle
from musatpy.model import AntennaPositions, Block, ControlKind, Options, Treatment, WaterLevel
from musatpy.model.tables import empty

if TYPE_CHECKING:
    from musatpy.adjustment.initial import PhotoPlaces

_STEPS = 12  # of an adjustment: what comes to rest needs 2 or 3 of them, rarely 10
_LEAST = 1e-11  # weight that keeps a point determined; with more, errors of kilometres pull
_LOST = 1e3  # sigmas, for residuals that make no sense
_CYCLES = 3  # in which bad points may come back
_PARALLEL = 1e-3  # rad; rays nearer to parallel give no point worth having here
_WILD = 0.2  # of the focal length: residuals at the start beyond which a point is left out
_LOOSE_PLACE, _LOOSE_TURN = 0.1, 0.1  # of the flying height, and rad: how far stations are held
_CLOSE = 3e-4  # rad, and with the flying height m: steps that matter no longer


def refined_stations(block: Block, place: PhotoPlaces, height: float) -> PhotoPlaces:
    """Return the places after a robust adjustment, the same ones where it fails.

    Photos that were not found, and control that contradicts the rest, take no part. Stations are held loosely, by
    a part of the flying height (m) and some degrees: what nothing else holds stays where it is. Points left out
    because of a bad start come back when that is better.
    """
    before: int | None = None
    for _ in range(_CYCLES):
        part_block = _without_the_lost(block, place, height)
        part = participation(part_block)
        network = with_turned_axes(build_network(part_block, place.frame, part))
        bad = _bad_points(network, ground_points.start_ground(network, initial_state(network)))
        if before is not None and bad.sum() >= before:
            break
        before = int(bad.sum())
        entering = replace(part, used=part.used & ~bad[network.point], status=np.where(bad, -1, part.status))
        network = with_turned_axes(build_network(part_block, place.frame, entering))
        if not (network.pass_groups or network.control_groups):
            break
        state = ground_points.start_ground(network, initial_state(network))
        try:
            state = _adjusted(network, state, entering.used)
        except SingularNormalsError:
            break
        placed = place.found != ""
        C, M = place.C.copy(), place.M.copy()
        C[placed], M[placed] = state.position[placed], state.M[placed]
        place = replace(place, C=C, M=M)
    return place


def _without_the_lost(block: Block, place: PhotoPlaces, height: float) -> Block:
    """Return the block with the places found, loosely held, without images of lost photos and wrong control."""
    photos, frame, lost = block.photos, place.frame, place.found == ""
    C = np.where(lost[:, None], 0.0, place.C)
    M = np.where(lost[:, None, None], np.eye(3), place.M)
    attitude = attitude_from_matrix(M @ np.swapaxes(frame.axes(C), 1, 2))
    loose = np.ones(C.shape)
    control = block.control
    # the rays are straight: what is unknown of the water has no part in them
    known = replace(
        block.options, water_level=WaterLevel.KNOWN, water_tilt=Treatment.KNOWN, water_index=Treatment.KNOWN
    )
    return replace(
        block,
        options=known,
        photos=replace(
            photos,
            position=frame.system(C),
            attitude=attitude,
            position_sigma=_LOOSE_PLACE * height * loose,
            attitude_sigma=_LOOSE_TURN * loose,
        ),
        plates=replace(block.plates, triangulated=block.plates.triangulated & ~lost[block.plates.photo]),
        control=replace(control, kind=np.where(place.wrong, ControlKind.CHECK, control.kind)),
        antenna_positions=empty(AntennaPositions),  # whose errors no weights take out here
    )


def _bad_points(network: Network, state: State) -> BoolArray:
    """Return (p,) True for points behind a camera, with parallel rays, or with wild residuals."""
    bad = np.zeros(network.points, dtype=bool)
    for group in (*network.pass_groups, *network.control_groups):
        photo, ground = network.photo[group.rays], state.ground[group.point]
        X = np.repeat(ground[:, None], group.rays.shape[1], axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            seen = collinearity.in_front(X - state.position[photo], state.M[photo]).all(axis=1)
            error = np.abs(image_coordinates(network, state, group.rays, X) - network.xy[group.rays])
            wild = ~(error.max(axis=(1, 2)) < _WILD * network.focal_length[photo].min(axis=1))
        parallel = np.zeros(len(ground), dtype=bool)
        if group.rays.shape[1] > 1:
            parallel = widest_angle(straight_rays(network, state, group.rays)[1]) < _PARALLEL
        bad[group.point] = ~seen | wild | parallel
    return bad


def _adjusted(network: Network, state: State, used: BoolArray) -> State:
    """Return the state adjusted with robust weights. Raises `SingularNormalsError`."""
    weighted = replace(network, weight=_robust_weights(network, state, np.flatnonzero(used)))
    problem = GeodeticRestraint(network=weighted, options=Options(rotation_limit=_CLOSE, translation_limit=1.0))
    return iterate(problem, ground_points.settle(weighted, state), _STEPS).state


def _robust_weights(network: Network, state: State, rays: IntArray) -> FloatArray:
    """Return the weights (m, 2) of the rays by the residuals at `state`, with their robust scale."""
    size = np.sqrt(np.square(residuals(network, state, rays)) * network.weight[rays])
    robust = network.weight.copy()
    robust[rays] *= cauchy(size, robust_scale(size))
    return robust


def cauchy(size: FloatArray, scale: float) -> FloatArray:
    """Return Cauchy's weights of residuals `size` in sigmas; NaN counts as lost."""
    size = np.nan_to_num(size, nan=_LOST, posinf=_LOST, neginf=-_LOST)
    return np.maximum(similarity.cauchy(size, scale), _LEAST)


def robust_scale(size: FloatArray) -> float:
    """Return the scale of residuals in sigmas by their median, at least 1: what is good stays so."""
    return similarity.spread(np.abs(size[np.isfinite(size)]), 1.0)
