"""Simulated blocks of vertical photographs as `Block`s, made from arrays: no deck, any number of photos."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from musatpy.geometry.collinearity import attitude_matrix, image
from musatpy.model import (
    AirBases,
    Block,
    Cameras,
    Control,
    ControlKind,
    CoordinateSystem,
    Distortion,
    EqualElevations,
    FiducialMeasurements,
    Fiducials,
    Options,
    Photos,
    PlateMeasurements,
    Points,
    Program,
    Refraction,
    Water,
)
from musatpy.refraction import flat
from musatpy.units import DEGREE

HEIGHT, FOCAL_LENGTH, FORMAT = 3000.0, 152.0, 228.6
FOOTPRINT = HEIGHT * FORMAT / FOCAL_LENGTH
BASE, SPACING = 0.4 * FOOTPRINT, 0.7 * FOOTPRINT  # 60 % forward, 30 % side overlap
IMAGES = 90  # per photo
SIGMA = 0.010
INDEX = 1.34
NONE = np.zeros(0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """What a block does not say, in the order of its photos and of its points."""

    station: np.ndarray  # (n, 3) m
    attitude: np.ndarray  # (n, 3) rad
    ground: np.ndarray  # (p, 3) m


def make_block(
    photos: int,
    *,
    submerged: float = 0.0,
    seed: int = 1,
    program: Program = Program.IIIA,
    images: int = IMAGES,
    gruber: bool = False,
    corners: bool = False,
) -> Block:
    """Return the block of `simulated` without its truth."""
    block, _ = simulated(
        photos,
        submerged=submerged,
        seed=seed,
        program=program,
        images=images,
        gruber=gruber,
        corners=corners,
    )
    return block


def simulated(
    photos: int,
    *,
    submerged: float = 0.0,
    seed: int = 1,
    program: Program = Program.IIIA,
    depth: float = 12.0,
    images: int = IMAGES,
    gruber: bool = False,
    corners: bool = False,
) -> tuple[Block, Truth]:
    """Return a local block of vertical photos with a share of submerged points, 10 um noise and fixed control.

    The first stations are 10 m, the attitudes 0.5 degrees off. The sea is `depth` m deep at most. Points lie
    anywhere, so many `images` on a photo, or near the positions of von Gruber; fixed control is under every fourth
    photo, or at the `corners` only.
    """
    rng = np.random.default_rng(seed)
    strips = max(1, round(np.sqrt(photos * BASE / SPACING)))
    while photos % strips:
        strips -= 1
    per_strip = photos // strips
    grid = np.stack(np.meshgrid(np.arange(per_strip) * BASE, np.arange(strips) * SPACING), axis=-1).reshape(-1, 2)
    station = np.column_stack([grid, np.full(photos, HEIGHT)]) + rng.normal(0.0, 15.0, (photos, 3))
    attitude = rng.normal(0.0, 0.8 * DEGREE, (photos, 3))
    low, high = grid.min(axis=0) - 0.45 * FOOTPRINT, grid.max(axis=0) + 0.45 * FOOTPRINT
    count = int(images / FOOTPRINT**2 * np.prod(high - low) * 1.05)
    place = _gruber(grid, images, rng) if gruber else rng.uniform(low, high, (count, 2))
    count = len(place)
    ground = np.column_stack([place, rng.uniform(5.0, 60.0, count)])
    wet = rng.random(count) < submerged
    ground[wet, 2] = -rng.uniform(1.0, depth, wet.sum())
    photo, point, xy = _measured(station, attitude, ground, wet)
    rays = np.bincount(point, minlength=count)
    kept = np.flatnonzero(rays >= 2)
    number = np.full(count, -1)
    number[kept] = np.arange(len(kept))
    row = number[point] >= 0
    photo, point, xy = photo[row], number[point[row]], xy[row] + rng.normal(0.0, SIGMA, (int(row.sum()), 2))
    ground, wet = ground[kept], wet[kept]
    control = _control_points(ground, wet, grid[:0] if corners else grid[::4], grid)
    block = Block(
        titles=("BENCHMARK",),
        options=Options(
            program=program,
            system=CoordinateSystem.LOCAL,
            refraction=Refraction.RIGOROUS,
            plate_sigma=SIGMA,
        ),
        ellipsoid=None,
        water=Water(index=INDEX),
        cameras=Cameras(
            ids=["CAM"],
            focal_length=[FOCAL_LENGTH],
            principal_point=[[0.0, 0.0]],
            format_size=[[FORMAT, FORMAT]],
        ),
        distortion=Distortion(camera=NONE, kind=[], values=np.zeros((0, 3))),
        fiducials=Fiducials(camera=NONE, ids=[], xy=np.zeros((0, 2)), sigma=np.zeros((0, 2))),
        photos=Photos(
            ids=np.arange(photos).astype(str),
            camera=np.zeros(photos, dtype=int),
            position=station + rng.normal(0.0, 10.0, station.shape),
            position_sigma=np.full((photos, 3), np.nan),
            attitude=attitude + rng.normal(0.0, 0.5 * DEGREE, attitude.shape),
            attitude_sigma=np.full((photos, 3), np.nan),
            tide=np.zeros(photos),
            tide_sigma=np.full(photos, np.nan),
        ),
        fiducial_measurements=FiducialMeasurements(photo=NONE, ids=[], xy=np.zeros((0, 2)), sigma=np.zeros((0, 2))),
        points=Points(ids=np.arange(len(ground)).astype(str), bathymetric=wet),
        plates=PlateMeasurements(
            photo=photo,
            point=point,
            xy=xy,
            sigma=np.full(xy.shape, np.nan),
            triangulated=np.ones(len(photo), dtype=bool),
        ),
        control=Control(
            point=control,
            kind=np.full(len(control), int(ControlKind.FULL)),
            fixed=np.ones(len(control), dtype=bool),
            position=ground[control],
            sigma=np.full((len(control), 3), np.nan),
        ),
        equal_elevations=EqualElevations(ids=[], sigma=NONE, group=NONE, point=NONE),
        air_bases=AirBases(photo=np.zeros((0, 2)), length=NONE, sigma=NONE),
    )
    return block, Truth(station=station, attitude=attitude, ground=ground)


def _gruber(grid: np.ndarray, images: int, rng: np.random.Generator) -> np.ndarray:
    """Return the places of points beside and between the photos of a grid, so many images on each."""
    corner, last = grid.min(axis=0), grid.max(axis=0)
    along = np.arange(corner[0] - BASE, last[0] + 1.5 * BASE, BASE)
    across = np.arange(corner[1] - 0.5 * SPACING, last[1] + 0.75 * SPACING, 0.5 * SPACING)
    places = np.stack(np.meshgrid(along, across), axis=-1).reshape(-1, 2)
    places = np.repeat(places, max(1, images // 9), axis=0)
    return places + rng.normal(0.0, 0.02 * FOOTPRINT, places.shape)


def _measured(
    station: np.ndarray, attitude: np.ndarray, ground: np.ndarray, wet: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return photo, point and exact image of everything inside the formats."""
    near = cKDTree(ground[:, :2]).query_ball_point(station[:, :2], 0.75 * FOOTPRINT)
    photo = np.repeat(np.arange(len(station)), [len(points) for points in near])
    point = np.concatenate([np.sort(points) for points in near]).astype(int)
    v = ground[point] - station[photo]
    depth = np.where(wet[point], -ground[point, 2], -1.0)
    up = np.broadcast_to([0.0, 0.0, 1.0], v.shape)
    v = flat.incidence(station[photo], ground[point], up, depth, INDEX).v
    xy = image(v, attitude_matrix(attitude)[photo], np.full(len(v), FOCAL_LENGTH), np.zeros(2))
    inside = (np.abs(xy) < 0.5 * FORMAT - 4.0).all(axis=1)
    return photo[inside], point[inside], xy[inside]


def _control_points(ground: np.ndarray, wet: np.ndarray, near: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Return dry points at the corners of a grid of photos, and those near to places."""
    dry = np.flatnonzero(~wet)
    middle = grid.mean(axis=0)
    corners = [[x, y] for x in (grid[:, 0].min(), grid[:, 0].max()) for y in (grid[:, 1].min(), grid[:, 1].max())]
    spread = np.array(corners) + 0.3 * FOOTPRINT * np.sign(np.array(corners) - middle + 1e-9)
    _, found = cKDTree(ground[dry, :2]).query(np.vstack([near, spread]))
    return np.unique(dry[found])
