"""True images: which points each photo sees, and where exactly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import Problem, SpecError
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.simulation.flight import FlightPlan, TrueFlight
from musatpy.simulation.raytrace import trace
from musatpy.simulation.scene_keys import CameraKeys
from musatpy.simulation.simulation_spec import SimulationSpec
from musatpy.simulation.terrain import TrueGround
from musatpy.simulation.world import World

REACH = 1.3  # times the plan's reach: room for tilts and relief in the search for candidates


@dataclass(frozen=True, kw_only=True)
class TrueImages:
    """m images without error, photo by photo, points in the order of the ground."""

    photo: IntArray  # (m,) row of the flight
    point: IntArray  # (m,) row of the ground
    xy: FloatArray  # (m, 2) mm
    refracted: BoolArray  # (m,) seen through the water surface

    def rays(self, points: int) -> IntArray:
        """Return the number of images of each of so many points."""
        return np.bincount(self.point, minlength=points)

    def __getitem__(self, rows: BoolArray | IntArray) -> TrueImages:
        return TrueImages(**{name: values[rows] for name, values in vars(self).items()})


def take_images(
    spec: SimulationSpec, plan: FlightPlan, flight: TrueFlight, ground: TrueGround, world: World
) -> TrueImages:
    """Return the images of all points that lie well inside the plates, of points on two photos at least."""
    photo, point = _candidates(plan, flight, ground, world)
    index = spec.water.index if spec.water else 1.0
    images = project(spec.camera, flight, ground, world, index, photo, point)
    half = np.array(spec.camera.format) / 2.0 - spec.camera.margin
    seen = np.all(np.abs(images.xy - spec.camera.principal_point) <= half, axis=1)
    images = images[seen & _wanted(spec, flight, images)]
    return images[images.rays(len(ground.ids))[images.point] >= 2]


def project(
    camera: CameraKeys,
    flight: TrueFlight,
    ground: TrueGround,
    world: World,
    index: float,
    photo: IntArray,
    point: IntArray,
) -> TrueImages:
    """Return the exact images of points on photos (row by row), NaN where the point is behind the camera.

    A bathymetric point below the water of the photo's own tide, and below its waves, is seen through the water; one
    that is dry, like one on land, along a straight line.
    """
    stations, places = flight.stations[photo], ground.places[point]
    direction = places.xyz - stations.xyz
    level = flight.water.levels(places, flight.tide[photo])
    refracted = ground.bathymetric[point] & (level > places.natural[:, 2])
    waves, time = flight.waves.true, flight.time[photo]
    if waves is not None:
        over = places.xyz + (level - places.natural[:, 2])[:, None] * places.vertical[:, 2]
        refracted &= level + waves.rise(over, time)[0] > places.natural[:, 2]
    wet = np.flatnonzero(refracted)
    if wet.size:
        rise = None if waves is None else partial(waves.rise, time=time[wet])
        C, G = stations.xyz[wet], places.natural[wet]
        rays = trace(C, G, level[wet], index, world.axes_of_ellipsoid, flight.water.slope, rise)
        direction[wet] = rays.air
    local = np.einsum("kij,kj->ki", stations.vertical, direction)
    U, V, S = np.einsum("kij,kj->ki", attitude_matrix(flight.attitude)[photo], local).T
    S = np.where(S < 0.0, S, np.nan)
    f = camera.focal_length
    xy = np.column_stack([-f * U / S, -f * V / S]) + camera.principal_point
    return TrueImages(photo=photo, point=point, xy=xy, refracted=refracted)


def _candidates(
    plan: FlightPlan, flight: TrueFlight, ground: TrueGround, world: World
) -> tuple[IntArray, IntArray]:
    """Return pairs of photo and point that are near enough in plan, sorted by photo, then point.

    Raises `SpecError`.
    """
    if not np.isfinite(ground.plan).all():
        raise SpecError([Problem(field="flight, points or point", message="points lie beyond all numbers")])
    tree = cKDTree(ground.plan)
    reach = REACH * plan.reach
    near = [tree.query_ball_point(nadir, reach, return_sorted=True) for nadir in world.plan(flight.stations)]
    counts = [len(points) for points in near]
    photo = np.repeat(np.arange(len(counts)), counts)
    return photo, np.concatenate([np.asarray(points, dtype=np.int64) for points in near])


def _wanted(spec: SimulationSpec, flight: TrueFlight, images: TrueImages) -> BoolArray:
    """Return which images (m,) are to be measured: given points may name their photos."""
    wanted = np.ones(len(images.photo), dtype=bool)
    ids = np.array(flight.ids)
    for i, given in enumerate(spec.point):
        if given.photos:
            wanted &= (images.point != i) | np.isin(ids[images.photo], given.photos)
    return wanted
