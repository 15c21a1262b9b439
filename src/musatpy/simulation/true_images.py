"""True images: which points each photo sees, and where exactly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from musatpy.arrays import BoolArray, FloatArray, InRows, IntArray
from musatpy.errors import SpecError
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.simulation.raytrace import TracedRays, through_port, trace
from musatpy.simulation.terrain import Scene
from musatpy.simulation.true_lens import PortKeys, through_lens, true_lens

_PASSES = 8  # each gains two digits, and more
REACH = 1.3  # times the plan's reach: room for tilts and relief in the search for candidates


@dataclass(frozen=True, kw_only=True)
class TrueImages(InRows):
    """m images without error, photo by photo, points in the order of the ground."""

    photo: IntArray  # (m,) row of the flight
    point: IntArray  # (m,) row of the ground
    xy: FloatArray  # (m, 2) mm
    refracted: BoolArray  # (m,) seen through the water surface

    def rays(self, points: int) -> IntArray:
        """Return the number of images of each of so many points."""
        return np.bincount(self.point, minlength=points)


def take_images(scene: Scene) -> TrueImages:
    """Return the images of all points that lie well inside the plates, of points on two photos at least.

    Given points may name their photos. Raises `SpecError` for points beyond all numbers.
    """
    camera, images = scene.spec.camera, project(scene, *_candidates(scene))
    half = np.array(camera.format) / 2.0 - camera.margin
    wanted = np.all(np.abs(images.xy - camera.principal_point) <= half, axis=1)
    for point, given in enumerate(scene.spec.point):
        if given.photos:
            wanted &= (images.point != point) | np.isin(np.array(scene.flight.ids)[images.photo], given.photos)
    images = images[wanted]
    return images[images.rays(len(scene.ground.ids))[images.point] >= 2]


def project(scene: Scene, photo: IntArray, point: IntArray) -> TrueImages:
    """Return the exact images of points on photos (row by row), NaN where the point is behind the camera.

    A bathymetric point below the water of the photo's own tide, and below its waves, is seen through the water; one
    that is dry, like one on land, along a straight line.
    """
    flight, ground, water, camera = scene.flight, scene.ground, scene.spec.water, scene.spec.camera
    stations, places = flight.stations[photo], ground.places[point]
    direction = places.xyz - stations.xyz
    level = flight.water.levels(places, flight.tide[photo])
    refracted = ground.bathymetric[point] & (level > places.natural[:, 2])
    waves, time = flight.waves.true, flight.time[photo]
    if waves is not None:
        over = places.xyz + (level - places.natural[:, 2])[:, None] * places.vertical[:, 2]
        refracted &= level + waves.rise(over, time)[0] > places.natural[:, 2]
    wet = np.flatnonzero(refracted)
    if wet.size and water:
        rise = None if waves is None else partial(waves.rise, time=time[wet])
        C, G = stations.xyz[wet], places.natural[wet]
        ellipsoid = scene.world.axes_of_ellipsoid

        def rays(start: FloatArray) -> TracedRays:
            return trace(start, G, level[wet], water.index, ellipsoid, flight.water.slope, rise)

        M = attitude_matrix(flight.attitude)[photo[wet]] @ stations.vertical[wet]
        direction[wet] = rays(C).air if scene.spec.port is None else _behind_port(scene.spec.port, C, M, rays)
    local = np.einsum("kij,kj->ki", stations.vertical, direction)
    seen = np.einsum("kij,kj->ki", attitude_matrix(flight.attitude)[photo], local)
    if scene.spec.port is not None:
        seen = through_port(seen, *scene.spec.port.values)
    U, V, S = seen.T
    S = np.where(S < 0.0, S, np.nan)
    f = true_lens(scene.spec)["F"]
    xy = np.column_stack([-f * U / S, -f * V / S])
    xy = xy + camera.principal_point if scene.spec.lens is None else through_lens(scene.spec, xy)
    return TrueImages(photo=photo, point=point, xy=xy, refracted=refracted)


def _behind_port(
    port: PortKeys, C: FloatArray, M: FloatArray, rays: Callable[[FloatArray], TracedRays]
) -> FloatArray:
    """Return the vectors (k, 3) from cameras C (k, 3) to where rays go into the water that leave a port into air.

    M (k, 3, 3) takes them to the axes of the image; `rays` traces those from anywhere. Glass shifts rays and does
    not turn them: behind the water point, the ray that the port sees leads to where one without glass would start.
    """
    start = C
    for _ in range(_PASSES):
        there = rays(start).incidence - C
        seen = through_port(np.einsum("kij,kj->ki", M, there), *port.values)
        size = np.linalg.norm(there, axis=1) / np.linalg.norm(seen, axis=1)
        back = size[:, None] * np.einsum("kji,kj->ki", M, seen)
        start = np.where(np.isnan(back), C, C + there - back)  # points beside the glass stay unseen
    return there


def _candidates(scene: Scene) -> tuple[IntArray, IntArray]:
    """Return pairs of photo and point that are near enough in plan, sorted by photo, then point."""
    if not np.isfinite(scene.ground.plan).all():
        raise SpecError.of("points lie beyond all numbers", field="flight, points or point")
    tree, nadirs = cKDTree(scene.ground.plan), scene.world.plan(scene.flight.stations)
    near = [tree.query_ball_point(nadir, REACH * scene.plan.reach, return_sorted=True) for nadir in nadirs]
    counts = [len(points) for points in near]
    photo = np.repeat(np.arange(len(counts)), counts)
    return photo, np.concatenate([np.asarray(points, dtype=np.int64) for points in near])
