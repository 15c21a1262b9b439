"""Every sighting of a point from a station: its image and its ray, straight or refracted, with partials.

Partials by a station are q = 6 columns: east, north, up of the station (in `Network.axes`), omega, phi, kappa; a
seventh is the level of the water at the photo, where each photo has its own as an unknown.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.adjustment.iteration import State
from musatpy.adjustment.network import Network
from musatpy.adjustment.wavy_water import SeaIncidence
from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry import collinearity
from musatpy.geometry.geodesy import TiltedWater, by_tilt, surface
from musatpy.model import ObservationKind
from musatpy.refraction import flat

if TYPE_CHECKING:
    from musatpy.adjustment.lenses import CameraLenses
    from musatpy.adjustment.ports import CameraPorts

_MOST_STEPS = 30  # of rays through port and water, until their start moves less than
_REST = 1e-13  # m


@dataclass(frozen=True, kw_only=True, eq=False)
class RayImages:
    """Images of ground points: xy (..., 2) mm, partials by station (..., 2, q) and by ground point (..., 2, 3).

    By the water (..., 2, 4 + w): level, tilt east, tilt north, index, w parameters of waves; None where nothing of
    it is unknown. By the unknown parameters of lenses (..., 2, x) and all of ports (..., 2, 6); None where there
    are none.
    """

    xy: FloatArray
    by_station: FloatArray
    by_ground: FloatArray
    by_water: FloatArray | None
    by_lens: FloatArray | None = None
    by_port: FloatArray | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class BentRays:
    """Rays of images: origin and direction (..., 3), partials of both by station (..., 6, 6) and xy (..., 6, 2)."""

    origin: FloatArray
    direction: FloatArray
    by_station: FloatArray
    by_xy: FloatArray


def images(network: Network, state: State, rays: IntArray, ground: FloatArray, stations: bool = True) -> RayImages:
    """Return the images of ground points (..., 3) on the plates of the measurements `rays` (...).

    Without `stations` there are no partials by these, nor by the water: (..., 2, 0) and None.
    """
    photo, refracted = network.photo[rays], network.refracted[rays]
    every = network.sea is None and refracted.all()
    wet: Any = ... if every else np.nonzero(refracted)  # all are taken without a copy
    camera, M, f, pp = _of_photos(network, state, photo)
    v, bent, by_lens, by_port = ground - camera, None, None, None
    if refracted.any():
        start = camera[wet]
        if network.ports is not None:
            start, v[wet] = _through_port_and_water(network, state, photo[wet], start, M[wet], ground[wet])
        over, bent = _incidence(network, state, photo[wet], start, ground[wet])
        if network.ports is None:
            v[wet] = bent.v
    if network.ports is not None:
        v, *port = _behind_ports(network.ports, state, photo, v, M, wet, bent)
    if not stations:
        xy, by_v = collinearity.image_by_vector(v, M, f, pp)
        if network.lenses is not None:
            xy, by_ideal, _ = _lens_partials(network.lenses, network, state, rays, xy - pp, f, pp)
            by_v = by_v if by_ideal is None else by_ideal @ by_v
        if network.ports is not None:
            by_v = by_v @ port[0]
        by_station, by_water = np.zeros((*v.shape[:-1], 2, 0)), None
    else:
        xy, by_v, by_attitude = collinearity.image_partials(v, M, state.dM.take(photo, axis=0), f, pp)
        if network.lenses is not None:
            xy, by_ideal, by_lens = _lens_partials(network.lenses, network, state, rays, xy - pp, f, pp)
            if by_ideal is not None:
                by_v, by_attitude = by_ideal @ by_v, by_ideal @ by_attitude
        if network.ports is not None:
            by_v, by_attitude, by_port = (by_v @ partials for partials in port)
        waves = network.border.count(ObservationKind.WAVE)
        unknown = network.water.unknown or waves > 0
        by_camera, by_water = -by_v, np.zeros((*v.shape[:-1], 2, 4 + waves)) if unknown else None
        if bent is not None:
            by_camera[wet] = by_v[wet] @ bent.by_camera
        if bent is not None and by_water is not None:
            by_water[wet] = by_v[wet] @ _by_water(network, over, bent, start, ground[wet])
        axes = np.swapaxes(network.axes.take(photo, axis=0), -1, -2)
        own_level = () if by_water is None or not network.water.per_photo else (by_water[..., :1],)
        by_station = np.concatenate([by_camera @ axes, by_attitude, *own_level], axis=-1)
    if bent is not None:
        by_v[wet] = by_v[wet] @ bent.by_ground
    return RayImages(
        xy=xy, by_station=by_station, by_ground=by_v, by_water=by_water, by_lens=by_lens, by_port=by_port
    )


def image_coordinates(network: Network, state: State, rays: IntArray, ground: FloatArray) -> FloatArray:
    """Return only the plate coordinates (..., 2) mm of `images`."""
    photo, wet = network.photo[rays], network.refracted[rays]
    camera, M, f, pp = _of_photos(network, state, photo)
    v = ground - camera
    if wet.any():
        _, v[wet] = _through_port_and_water(network, state, photo[wet], camera[wet], M[wet], ground[wet])
    if network.ports is not None:
        v = network.ports.vectors(state.parameters[ObservationKind.PORT], photo, v, M)
    xy = collinearity.image(v, M, f, pp)
    return xy if network.lenses is None else _through_lenses(network.lenses, network, state, rays, xy - pp, pp)


def _through_lenses(
    lenses: CameraLenses, network: Network, state: State, rays: IntArray, ideal: FloatArray, pp: FloatArray
) -> FloatArray:
    """Return plate coordinates (..., 2) of images with ideal places (..., 2) about the principal point."""
    values, measured = state.parameters[ObservationKind.LENS], network.xy.take(rays, axis=0)
    return lenses.places(values, network.photo[rays], measured, ideal, pp)


def _lens_partials(
    lenses: CameraLenses,
    network: Network,
    state: State,
    rays: IntArray,
    ideal: FloatArray,
    f: FloatArray,
    pp: FloatArray,
) -> tuple[FloatArray, FloatArray | None, FloatArray]:
    """Return the same, and its partials by ideal places (..., 2, 2) and by unknown parameters (..., 2, x)."""
    values, measured = state.parameters[ObservationKind.LENS], network.xy.take(rays, axis=0)
    partials = lenses.partials(values, network.photo[rays], measured, ideal, f, pp)
    return _through_lenses(lenses, network, state, rays, ideal, pp), *partials


def _of_photos(network: Network, state: State, photo: IntArray) -> tuple[FloatArray, ...]:
    """Return stations, rotations, focal lengths and principal points of photos (...)."""
    cameras = (network.focal_length, network.principal_point)
    if network.lenses is not None:
        changes = network.lenses.changes(state.parameters[ObservationKind.LENS])
        cameras = (cameras[0] + changes[0], cameras[1] + changes[1])
    tables = (state.position, state.M, *cameras)
    return tuple(table.take(photo, axis=0) for table in tables)  # several times as fast as by index


def index_partials(network: Network, state: State, rays: IntArray) -> FloatArray:
    """Return the partials (r, 2) mm of the images of wet `rays` (r,) by the index of the water: of `images`."""
    asked = replace(network, water=replace(network.water, index_unknown=True))
    by_water = images(asked, state, rays, state.ground[network.point[rays]]).by_water
    assert by_water is not None, "the index is unknown"
    return by_water[..., 3]


def residuals(network: Network, state: State, rays: IntArray) -> FloatArray:
    """Return adjusted minus measured plate coordinates (r, 2) mm of measurements (r,), their points as they are."""
    ground = state.ground.take(network.point.take(rays), axis=0)
    return image_coordinates(network, state, rays, ground) - network.xy.take(rays, axis=0)


def _surface(network: Network, state: State, photo: IntArray, ground: FloatArray) -> TiltedWater:
    return surface(network.frame, network.slope(state.tilt), state.tide[photo], ground)


def _incidence(
    network: Network, state: State, photo: IntArray, camera: FloatArray, ground: FloatArray
) -> tuple[TiltedWater, flat.Incidence]:
    """Return the level water over ground points (N, 3), and their rays through it and through its waves, if any."""
    over = _surface(network, state, photo, ground)
    if network.sea is None:
        return over, flat.incidence(camera, ground, over.normal, over.depth, state.index, wet=True)
    sea = network.sea.at(state.waves)
    return over, sea.incidence(photo, camera, ground, state.tide[photo], state.index)


def _water_vectors(
    network: Network, state: State, photo: IntArray, camera: FloatArray, ground: FloatArray
) -> FloatArray:
    """Return only the vectors (N, 3) from cameras to water points of `_incidence`."""
    if network.sea is not None:
        return _incidence(network, state, photo, camera, ground)[1].v
    over = _surface(network, state, photo, ground)
    return flat.water_vector(camera, ground, over.normal, over.depth, state.index, wet=True)


def _behind_ports(
    ports: CameraPorts,
    state: State,
    photo: IntArray,
    v: FloatArray,
    M: FloatArray,
    wet: Any,
    bent: flat.Incidence | None,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return what `CameraPorts.view` does of vectors v; those of `wet` rays, an index, change with the port too.

    Their v = a + w(C + a), with a on the axis of the port and w of the water (`bent`), and a follows from v again:
    dv = (1 - (1 + w_C) a_v)^-1 [(1 + w_C) da + dw], where da and dw are what changes while v is held.
    """
    values, dM = state.parameters[ObservationKind.PORT], state.dM.take(photo, axis=0)
    u, by_v, by_attitude, by_port = ports.view(values, photo, v, M, dM)
    if bent is not None:
        a_v, *changes = ports.axis_partials(values, photo[wet], v[wet], M[wet], dM[wet])
        moved = np.eye(3) + bent.by_camera
        by_v[wet] = by_v[wet] @ np.linalg.inv(np.eye(3) - moved @ a_v)
        for partials, a in zip((by_attitude, by_port), changes, strict=True):
            partials[wet] += by_v[wet] @ moved @ a
    return u, by_v, by_attitude, by_port


def _through_port_and_water(
    network: Network, state: State, photo: IntArray, camera: FloatArray, M: FloatArray, ground: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return from where rays go to water points, and the vectors (N, 3) from cameras to these.

    From the cameras, or from those points on the axes of their ports that the rays through the water agree with: a
    few millimetres change their angles by parts of a thousand, so that each step gains digits.
    """
    start, v = camera, _water_vectors(network, state, photo, camera, ground)
    if network.ports is None:
        return start, v
    along = np.zeros_like(camera)
    for _ in range(_MOST_STEPS):
        last, along = along, network.ports.axis_points(state.parameters[ObservationKind.PORT], photo, v, M)
        start = camera + along
        v = along + _water_vectors(network, state, photo, start, ground)
        if not (np.abs(along - last) > _REST).any():
            break
    return start, v


def _by_water(
    network: Network, over: TiltedWater, bent: flat.Incidence, camera: FloatArray, ground: FloatArray
) -> FloatArray:
    """Return the partials (..., 3, 4 + w) of v by water level, tilt east, tilt north, index and waves.

    Those by a tilt that is known are not asked for: 0.
    """
    east = north = np.zeros_like(bent.by_level)
    if network.border.count(ObservationKind.WATER_TILT):
        east, north = (
            by_tilt(over, axis, ground, camera, bent.v, bent.by_camera, bent.by_level) for axis in network.tilt_axes
        )
    partials = np.stack([bent.by_level / over.secant[..., None], east, north, bent.by_index], axis=-1)
    return np.concatenate([partials, bent.by_waves], axis=-1) if isinstance(bent, SeaIncidence) else partials


def _refracted_ray(
    network: Network, state: State, photo: IntArray, camera: FloatArray, direction: FloatArray, ground: FloatArray
) -> tuple[flat.RefractedRay, FloatArray]:
    """Return rays under water, and the partials (N, 3, 3) of their direction by camera: none below level water."""
    if network.sea is not None:
        return network.sea.at(state.waves).refracted_ray(
            photo, camera, direction, ground, state.tide[photo], state.index
        )
    over = _surface(network, state, photo, ground)
    height = np.einsum("...i,...i->...", over.normal, camera - ground) - over.depth
    bent = flat.refracted_ray(camera, direction, over.normal, height, state.index)
    return bent, np.zeros((*camera.shape, 3))


def straight_rays(network: Network, state: State, rays: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return origins and unit directions (..., 3) of the measured rays: in air, or in the water outside a port."""
    photo = network.photo[rays]
    camera, M, f, pp = _of_photos(network, state, photo)
    xy = network.xy.take(rays, axis=0)
    if network.lenses is not None:
        xy = network.lenses.ideal(state.parameters[ObservationKind.LENS], photo, xy, pp)
    direction = collinearity.ray(xy, M, f, pp)
    if network.ports is None:
        return camera, direction
    return network.ports.rays(state.parameters[ObservationKind.PORT], photo, camera, direction, M)


def rays_to(network: Network, state: State, rays: IntArray, ground: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return origins and unit directions (..., 3) of the measured rays where they come to `ground` (..., 3).

    Refracted ones start at the water, taken as level: waves shift them by little.
    """
    origin, direction = straight_rays(network, state, rays)
    wet = network.refracted[rays]
    if wet.any():
        camera, over = origin[wet], _surface(network, state, network.photo[rays][wet], ground[wet])
        height = np.einsum("ri,ri->r", over.normal, camera - ground[wet]) - over.depth
        origin[wet], direction[wet] = flat.ray_below(camera, direction[wet], over.normal, height, state.index)
    return origin, direction


def condition_rays(network: Network, state: State, rays: IntArray, xy: FloatArray, ground: FloatArray) -> BentRays:
    """Return the rays that enter the conditions, of images xy (..., 2) of the points `ground` (..., 3).

    Straight ones start at the station; refracted ones at the water point, with their direction under water. The
    ground point only says where the water surface and its vertical are.
    """
    photo = network.photo[rays]
    camera, M, f, pp = _of_photos(network, state, photo)
    dM, axes = state.dM.take(photo, axis=0), np.swapaxes(network.axes.take(photo, axis=0), -1, -2)
    direction, by_attitude, direction_by_xy = collinearity.ray_partials(xy, M, dM, f, pp)
    shape = direction.shape[:-1]
    by_station = np.zeros((*shape, 6, 6))
    by_station[..., :3, :3] = axes
    by_station[..., 3:, 3:] = by_attitude
    by_xy = np.zeros((*shape, 6, 2))
    by_xy[..., 3:, :] = direction_by_xy
    origin = camera
    wet = network.refracted[rays]
    if wet.any():
        bent, direction_by_camera = _refracted_ray(
            network, state, photo[wet], camera[wet], direction[wet], ground[wet]
        )
        by_station[wet, 3:, :3] = direction_by_camera @ axes[wet]
        by_station[wet, :3, :3] = bent.origin_by_camera @ axes[wet]
        by_station[wet, :3, 3:] = bent.origin_by_direction @ by_attitude[wet]
        by_station[wet, 3:, 3:] = bent.direction_by_direction @ by_attitude[wet]
        by_xy[wet, :3] = bent.origin_by_direction @ direction_by_xy[wet]
        by_xy[wet, 3:] = bent.direction_by_direction @ direction_by_xy[wet]
        origin, direction = camera.copy(), direction.copy()
        origin[wet], direction[wet] = bent.origin, bent.direction
    return BentRays(origin=origin, direction=direction, by_station=by_station, by_xy=by_xy)
