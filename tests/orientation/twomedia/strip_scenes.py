"""Strips of photos over level water, with their truth, in the geometries of a laboratory and from the air."""

from dataclasses import replace

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Sights
from orientation.twomedia.geometries import HOUSE, KINDS, Scene, level_of, scene, sights_of, truth_of

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
