"""Local blocks of any flying pattern, imaged straight, for tests of orientation: the truth and a bare block."""

from dataclasses import dataclass

import numpy as np

from musatpy import model
from musatpy.geometry import collinearity
from musatpy.geometry.collinearity import attitude_matrix

FOCAL_LENGTH = 152.0  # mm
HALF_FORMAT = 109.0  # mm
HEIGHT = 3000.0  # m over the ground


@dataclass(frozen=True, kw_only=True)
class Flight:
    """The truth of n photos and p points, and their block: no station or attitude is given."""

    C: np.ndarray  # (n, 3)
    attitude: np.ndarray  # (n, 3)
    X: np.ndarray  # (p, 3)
    block: model.Block


def strip(
    count: int, heading: float, middle: tuple[float, float], overlap: float = 0.6
) -> tuple[np.ndarray, np.ndarray]:
    """Return stations (count, 3) of a strip and its headings (count,): the x-axis of the plate along the flight."""
    base = 2.0 * HALF_FORMAT * (1.0 - overlap) * HEIGHT / FOCAL_LENGTH
    along = (np.arange(count) - (count - 1) / 2.0) * base
    C = np.stack([middle[0] + along * np.cos(heading), middle[1] + along * np.sin(heading)], axis=1)
    return np.column_stack([C, np.full(count, HEIGHT)]), np.full(count, heading)


def fly(
    C: np.ndarray,
    attitude: np.ndarray,
    *,
    seed: int = 1,
    per_photo: int = 25,
    relief: float = 100.0,
    noise: float = 0.01,
    blunders: float = 0.0,
    control: int = 10,
) -> Flight:
    """Return the flight of stations C with points below each photo; noise in mm, gross errors up to 5 mm."""
    rng = np.random.default_rng(seed)
    n = len(C)
    M = attitude_matrix(attitude)
    plate = rng.uniform(-HALF_FORMAT, HALF_FORMAT, (n, per_photo, 2)) / FOCAL_LENGTH
    ray = np.concatenate([plate, -np.ones((n, per_photo, 1))], axis=2) @ M
    Z = relief * rng.uniform(-1.0, 1.0, (n, per_photo))
    X = (C[:, None] + ray * ((Z - C[:, None, 2]) / ray[..., 2])[..., None]).reshape(-1, 3)
    v = X[None] - C[:, None]
    xy = collinearity.image(v, M[:, None], FOCAL_LENGTH, np.zeros(2))
    seen = (np.abs(xy) < HALF_FORMAT).all(axis=2) & collinearity.in_front(v, M[:, None])
    kept = seen.sum(axis=0) > 1
    X, seen, xy = X[kept], seen[:, kept], xy[:, kept]
    photo, point = np.nonzero(seen)
    measured = xy[photo, point] + noise * rng.standard_normal((len(photo), 2))
    wrong = rng.random(len(photo)) < blunders
    measured[wrong] += rng.choice([-1.0, 1.0], (wrong.sum(), 2)) * rng.uniform(0.1, 5.0, (wrong.sum(), 2))
    return Flight(
        C=C, attitude=attitude, X=X, block=_block(n, X, photo, point, measured, noise, spread(X, control))
    )


def spread(X: np.ndarray, count: int) -> np.ndarray:
    """Return `count` points far from each other."""
    chosen = [int(np.argmin(X[:, 0] + X[:, 1]))]
    while len(chosen) < count:
        distance = np.linalg.norm(X[:, None] - X[chosen], axis=2).min(axis=1)
        chosen.append(int(distance.argmax()))
    return np.array(chosen)


def _block(
    n: int, X: np.ndarray, photo: np.ndarray, point: np.ndarray, xy: np.ndarray, noise: float, control: np.ndarray
) -> model.Block:
    unknown = np.full((n, 3), np.nan)
    return model.Block(
        titles=(),
        options=model.Options(
            system=model.CoordinateSystem.LOCAL,
            refraction=model.Refraction.NONE,
            plate_sigma=max(noise, 0.001),
            initial=model.Initial.COMPUTE,
        ),
        cameras=model.Cameras(
            ids=["CAM"],
            focal_length=[FOCAL_LENGTH],
            principal_point=[[0.0, 0.0]],
            format_size=[[2 * HALF_FORMAT, 2 * HALF_FORMAT]],
        ),
        photos=model.Photos(
            ids=[str(number) for number in range(n)],
            camera=np.zeros(n, dtype=int),
            position=unknown,
            attitude=unknown,
        ),
        points=model.Points(ids=[f"P{number}" for number in range(len(X))]),
        plates=model.PlateMeasurements(photo=photo, point=point, xy=xy),
        control=model.Control(
            point=control,
            kind=np.full(len(control), model.ControlKind.FULL),
            position=X[control],
            sigma=np.full((len(control), 3), 0.1),
        ),
    )
