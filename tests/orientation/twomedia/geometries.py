"""Geometries in which the methods are tried, with their truth: a laboratory, a tank, photos from the air, strips.

Built in the paper's axes (Z down, image vectors (x, y, c), plane a X + b Y + Z + d = 0) by a ray trace of its own,
and given in those of the house.
"""

from dataclasses import dataclass, replace

import numpy as np

from musatpy import model
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.collinearity import attitude_from_matrix
from musatpy.geometry.geodesy import middle_of
from musatpy.model.tables import taken
from musatpy.orientation.twomedia.methods import METHODS as METHODS
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Method, Sights
from musatpy.units import ARC_SECOND
from orientation.flights import fly

HOUSE = np.array([1.0, -1.0, -1.0])  # the axes of the house from those of the paper
N, A, B = 1.34, 0.03, -0.02
ANGLES = np.radians([(2.0, -1.5, 3.0), (-1.0, 2.0, -2.0), (1.5, 1.0, -1.0)])  # phi, omega, kappa of the paper


@dataclass(frozen=True)
class Kind:
    """Lengths in metres: height, base, least and largest depth, half width, principal distance."""

    H: float
    B: float
    least: float
    largest: float
    width: float
    c: float


KINDS = {
    "lab": Kind(2.0, 1.0, 0.5, 1.2, 1.2, 0.15),
    "tank": Kind(1.0, 0.6, 1.0, 2.0, 1.0, 0.15),
    "aerial": Kind(3000.0, 1800.0, 5.0, 25.0, 1700.0, 0.1524),
}


def rotation(phi: float, omega: float, kappa: float) -> FloatArray:
    """Return R = R_phi R_omega R_kappa, (2)."""
    (sp, so, sk), (cp, co, ck) = np.sin([phi, omega, kappa]), np.cos([phi, omega, kappa])
    return (
        np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        @ np.array([[1, 0, 0], [0, co, -so], [0, so, co]])
        @ np.array([[ck, -sk, 0], [sk, ck, 0], [0, 0, 1]])
    )


@dataclass(frozen=True)
class Scene:
    """In the paper's axes: points (p, 3), stations (m, 3), angles (m, 3), images (m, p, 2) in metres, wet (p,)."""

    kind: Kind
    points: FloatArray
    stations: FloatArray
    angles: FloatArray
    images: FloatArray
    wet: BoolArray
    d: float


def points_of(
    kind: Kind, seed: int, number: int = 20, shift: float = 0.0, second_seed: int | None = None
) -> FloatArray:
    """Return the points of a geometry, to the last random number."""
    draws = np.random.default_rng(seed)
    draws.random(20)
    low, high = (-0.1, 1.1) if kind.H > 100 else (0.5 - kind.width / kind.B, 0.5 + kind.width / kind.B)
    X = draws.uniform(low * kind.B, high * kind.B, number)
    Y = draws.uniform(-kind.width, kind.width, number)
    depth = draws.uniform(kind.least, kind.largest, number)
    if second_seed is not None:
        draws = np.random.default_rng(second_seed)
        draws.random(20)
        depth = draws.uniform(kind.least, kind.largest, number)
    X = X + shift
    return np.stack([X, Y, -(A * X + B * Y + level_of(kind)) + depth], axis=-1)


def level_of(kind: Kind) -> float:
    """Return d."""
    return -(kind.H + A * kind.B / 2)


def dry(kind: Kind, points: FloatArray, number: int) -> FloatArray:
    """Return the points with the first of them above the water."""
    raised = points.copy()
    top = 0.25 * min(kind.H, 3.0 * kind.largest)
    heights = np.linspace(0.02 * min(kind.H, 3.0 * kind.largest), top, number)
    raised[:number, 2] = -(A * points[:number, 0] + B * points[:number, 1] + level_of(kind)) - heights
    return raised


def scene(
    kind: Kind,
    points: FloatArray,
    stations: FloatArray,
    angles: FloatArray,
    plane: tuple[float, float] = (A, B),
) -> Scene:
    """Return a scene with its images: Newton on the point of the plane, by Snell's law."""
    d = level_of(kind)
    upright = np.array([*plane, 1.0])
    normal = upright / np.linalg.norm(upright)
    below = (points @ upright + d) / np.linalg.norm(upright)
    images = np.empty((len(stations), len(points), 2))
    for m, (C, angle) in enumerate(zip(stations, angles, strict=True)):
        height = -(C @ upright + d) / np.linalg.norm(upright)
        gap = points - C
        across = gap - (gap @ normal)[:, None] * normal
        D = np.linalg.norm(across, axis=1)
        t = D / (height + np.where(below > 0, below / N, below))
        for _ in range(60):
            sine = t / np.sqrt(1 + t * t)
            water = sine / N / np.sqrt(1 - (sine / N) ** 2)
            f = height * t + np.where(below > 0, below * water, below * t) - D
            slope = height + np.where(
                below > 0, below * (1 / N) / ((1 + t * t) ** 1.5 * (1 - (sine / N) ** 2) ** 1.5), below
            )
            t = t - f / slope
        ray = across / D[:, None] * t[:, None] + normal
        inside = ray @ rotation(*angle)
        images[m] = kind.c * inside[:, :2] / inside[:, 2:]
    return Scene(kind, points, stations, angles, images, below > 0, d)


def stations_of(kind: Kind, number: int) -> FloatArray:
    """Return the stations."""
    b = kind.B
    return np.array([(0, 0, 0), (b, 0.03 * b, -0.02 * b), (2 * b, -0.02 * b, 0.03 * b)])[:number]


def sights_of(scene: Scene, control: int = 0, sigma: float = 5e-6, control_sigma: float = 0.0) -> Sights:
    """Return a scene in the axes of the house: the first `control` points are known."""
    m, p = scene.images.shape[:2]
    known = np.full((p, 3), np.nan)
    known[:control] = scene.points[:control] * HOUSE
    return Sights(
        photos=np.array([f"P{photo}" for photo in range(m)]),
        points=np.array([str(point) for point in range(p)]),
        photo=np.repeat(np.arange(m), p),
        point=np.tile(np.arange(p), m),
        image=scene.images.reshape(-1, 2) * HOUSE[:2] / scene.kind.c,
        image_sigma=np.full((m * p, 2), sigma / scene.kind.c),
        wet=scene.wet,
        control=known,
        control_sigma=np.full((p, 3), control_sigma),
    )


def truth_of(scene: Scene) -> Orientation:
    """Return the true orientation (1,) in the axes of the house."""
    M = np.array([(HOUSE[:, None] * rotation(*angles) * HOUSE).T for angles in scene.angles])
    return Orientation(
        attitude=attitude_from_matrix(M)[None],
        station=(scene.stations * HOUSE)[None],
        slope=np.array([[A, -B]]),
        level=np.array([scene.d]),
        index=np.array([N]),
    )


def scaled_errors(at: Orientation, true: Scene) -> FloatArray:
    """Return the errors of an orientation, of lengths in flying heights."""
    lengths = [1.0] * 3 + [true.kind.H] * 3
    unit = np.array(lengths * at.photos + [1.0, 1.0, true.kind.H, 1.0])
    return np.abs(at.vector - truth_of(true).vector[0]) / unit


def geometry(name: str, method: str, draw: int = 0) -> Scene:
    """Return the geometry of a method, by the names of both; `draw` counts others with points of their own."""
    kind = KINDS[name]
    if method.startswith("SINGLE"):
        return scene(kind, points_of(kind, 11 + 100 * draw), stations_of(kind, 1), ANGLES[:1])
    if method == "COMBINED":
        return scene(kind, points_of(kind, 11 + 100 * draw), stations_of(kind, 2), ANGLES[:2])
    if method == "PAIR-SUCCESSIVE":
        return scene(kind, points_of(kind, 11 + 100 * draw), stations_of(kind, 2), ANGLES[:2] * [[0.0], [1.0]])
    photos = 3 if method == "TRIPLET" else 2
    stations, angles = stations_of(kind, photos), ANGLES[:photos].copy()
    stations[1], angles[0, 1] = (kind.B, 0.0, 0.0), 0.0
    if method == "TRIPLET":
        return scene(kind, points_of(kind, 13 + 100 * draw, 30, kind.B / 2, 3 + 100 * draw), stations, angles)
    return scene(kind, points_of(kind, 12 + 100 * draw), stations, angles)


def control_of(method: Method) -> int:
    """Return the number of control points that a method is tried with."""
    return {"SINGLE-RAY": 20, "SINGLE-FERMAT": 20, "COMBINED": 5}.get(method.name, 0)


REACH = 1.4  # bases that a photo sees along the strip, to either side


def strip_scene(name: str, photos: int, per_photo: int = 40, seed: int = 5) -> Scene:
    """Return a strip along X, its stations and attitudes by chance."""
    kind = KINDS[name]
    draws, B = np.random.default_rng(seed), kind.B
    stations = np.stack([np.arange(photos) * B, *draws.normal(size=(2, photos)) * 0.02 * B], axis=1)
    angles = 0.03 * draws.normal(size=(photos, 3))
    number = int(per_photo * (photos + 2 * REACH) / (2 * REACH))
    X = draws.uniform(-REACH * B, (photos - 1 + REACH) * B, number)
    Y = draws.uniform(-kind.width, kind.width, number)
    depth = draws.uniform(kind.least, kind.largest, number)
    points = np.stack([X, Y, depth - level_of(kind)], axis=1)
    return scene(kind, points, stations, angles, plane=(0.0, 0.0))


def corners(true: Scene) -> list[int]:
    """Return six points: near both sides of the strip at its beginning, middle and end."""
    length = true.stations[-1, 0]
    places = [(X, Y) for X in (0.0, length / 2.0, length) for Y in (-0.6 * true.kind.width, 0.6 * true.kind.width)]
    return [int(np.argmin(np.hypot(*(true.points[:, :2] - place).T))) for place in places]


def strip_sights(
    true: Scene, noise: float = 0.0, seed: int = 1, control: list[int] | None = None
) -> tuple[Sights, IntArray]:
    """Return sights of a strip, errors of `noise` sigmas in images and control, and the rows of the points."""
    every = sights_of(true)
    draws = np.random.default_rng(seed)
    image = every.image + noise * draws.normal(size=every.image.shape) * every.image_sigma
    off = np.abs(true.points[every.point] - true.stations[every.photo])[:, :2]
    seen = (off < [REACH * true.kind.B, 1.02 * true.kind.width]).all(axis=1)
    seen &= np.bincount(every.point[seen], minlength=len(true.points))[every.point] >= 2
    rows, point = np.unique(every.point[seen], return_inverse=True)
    known = np.full(true.points.shape, np.nan)
    sigma = np.full(true.points.shape, 1e-5 * true.kind.H)
    known[control or []] = true.points[control or []] * HOUSE
    known = known + noise * sigma * draws.normal(size=known.shape)
    return (
        replace(
            every,
            photo=every.photo[seen],
            point=point,
            points=np.array([f"{row:05d}" for row in rows]),
            image=image[seen],
            image_sigma=every.image_sigma[seen],
            wet=every.wet[rows],
            control=known[rows],
            control_sigma=sigma[rows],
        ),
        rows,
    )


def strip_truth(true: Scene) -> tuple[Orientation, FloatArray]:
    """Return the true photos over level water, and the points, in the axes of the house."""
    return replace(truth_of(true)[0], slope=np.zeros(2)), true.points * HOUSE


def block_of(scene: Scene, sights: Sights, start: Orientation) -> model.Block:
    """Return the block of a scene: IIIA, level and tilt of the water unknown, started at an orientation."""
    m = len(sights.photos)
    bare = fly(np.tile([0.0, 0.0, 3000.0], (3, 1)), np.zeros((3, 3)), control=1).block
    f = 1000.0 * scene.kind.c
    known = np.flatnonzero(sights.is_control)
    return replace(
        bare,
        options=model.Options(
            program=model.Program.IIIA,
            system=model.CoordinateSystem.LOCAL,
            refraction=model.Refraction.RIGOROUS,
            water_level=model.WaterLevel.ONE,
            water_tilt=model.Treatment.ADJUST,
            plate_sigma=f * float(sights.image_sigma[0, 0]),
            max_iterations=60,
            rotation_limit=1e-7 * ARC_SECOND,
            translation_limit=1e-12 * scene.kind.H,
        ),
        water=model.Water(index=float(start.index)),
        cameras=replace(bare.cameras, focal_length=np.array([f]), format_size=np.full((1, 2), 5 * f)),
        photos=replace(
            taken(bare.photos, np.arange(m) % 3),
            ids=np.array([str(photo) for photo in range(m)]),
            position=start.station,
            attitude=start.attitude,
            tide=np.full(m, float(start.level + start.station[:, :2].mean(axis=0) @ start.slope)),
        ),
        points=model.Points(ids=sights.points, bathymetric=sights.wet),
        plates=replace(
            bare.plates,
            photo=sights.photo,
            point=sights.point,
            xy=f * sights.image,
            sigma=f * sights.image_sigma,
            triangulated=np.ones(len(sights.photo), dtype=bool),
        ),
        control=replace(
            bare.control,
            point=known,
            kind=np.full(len(known), model.ControlKind.FULL),
            fixed=(sights.control_sigma[known] == 0.0).all(axis=1),
            position=sights.control[known],
            sigma=np.where(sights.control_sigma[known] > 0.0, sights.control_sigma[known], np.nan),
            correlation=np.full((len(known), 3), np.nan),
        ),
    )


def level_of_origin(solution: model.Solution) -> float:
    """Return the level of the water at (0, 0): its tides hold at the origin of the axes of the adjustment."""
    assert solution.water is not None
    origin = middle_of(solution.block.photos.position)
    return float(solution.water.tide[0] - origin[:2] @ solution.water.tilt)
