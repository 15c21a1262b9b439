"""Simulated blocks of close-range photographs round a monument, by formulas of this file alone.

Photos look horizontally, down from a lift and up from the ground, cameras turned about their axes by anything. All
of it may be turned as a whole, so that nothing hangs on where up is; `python tests/monuments.py DECK` writes a deck.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from musatpy import BlockBuilder, write_deck
from musatpy.model import Block

FORMAT = np.array([36.0, 24.0])  # mm
FOCAL_LENGTH = 24.3


def rotation(omega: float, phi: float, kappa: float) -> np.ndarray:
    """R3(kappa) R2(phi) R1(omega), ground to photo."""
    (so, sp, sk), (co, cp, ck) = np.sin([omega, phi, kappa]), np.cos([omega, phi, kappa])
    first = np.array([[1, 0, 0], [0, co, so], [0, -so, co]])
    second = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    third = np.array([[ck, sk, 0], [-sk, ck, 0], [0, 0, 1]])
    return third @ second @ first


def angles(M: np.ndarray) -> np.ndarray:
    """Omega, phi, kappa (n, 3) rad of rotations (n, 3, 3); phi within a quarter turn."""
    return np.stack(
        [
            np.arctan2(-M[:, 2, 1], M[:, 2, 2]),
            np.arcsin(np.clip(M[:, 2, 0], -1.0, 1.0)),
            np.arctan2(-M[:, 1, 0], M[:, 0, 0]),
        ],
        axis=1,
    )


@dataclass(frozen=True, kw_only=True)
class Monument:
    """A block with its truth: stations C (n, 3), M (n, 3, 3), ground to photo, points X (p, 3) by their names."""

    block: Block
    C: np.ndarray
    M: np.ndarray
    X: np.ndarray
    names: np.ndarray

    @property
    def ground(self) -> np.ndarray:
        """(p, 3) true points in the order of the block."""
        place = dict(zip(self.names.tolist(), self.X, strict=True))
        return np.array([place[name] for name in self.block.points.ids.tolist()])

    def turns(self, attitude: np.ndarray) -> np.ndarray:
        """(n, 3) rad: by what small turns along the ground axes attitudes are off."""
        M = np.array([rotation(*triple) for triple in attitude])
        off = np.swapaxes(M, 1, 2) @ self.M  # M = true (I - [w]x) to first order
        return np.stack([off[:, 2, 1], off[:, 0, 2], off[:, 1, 0]], axis=1)


def surface(rng: np.random.Generator, points: int, side: float, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Points on the walls and the top of a tower, and on the square about it, with their outward normals."""
    face = rng.choice(6, points, p=[0.2, 0.2, 0.2, 0.2, 0.08, 0.12])
    X, normal = np.zeros((2, points, 3))
    u, v = rng.uniform(-1.0, 1.0, (2, points))
    for number, (x, y) in enumerate(((1, 0), (0, 1), (-1, 0), (0, -1))):
        wall = face == number
        normal[wall] = x, y, 0.0
        along = 0.5 * side * u[wall, None] * [-y, x, 0.0]
        out = 0.5 * side + rng.uniform(-0.8, 0.8, (wall.sum(), 1))  # reliefs and niches
        X[wall] = along + out * normal[wall] + 0.5 * height * (1.0 + v[wall, None]) * [0.0, 0.0, 1.0]
    top, square = face == 4, face == 5
    normal[top | square] = 0.0, 0.0, 1.0
    X[top] = np.stack([0.5 * side * u[top], 0.5 * side * v[top], np.full(top.sum(), height)], axis=1)
    radius, angle = rng.uniform(0.7 * side, 1.1 * side, square.sum()), np.pi * v[square]
    X[square] = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.2 * u[square]], axis=1)
    return X, normal


def looking(C: np.ndarray, target: np.ndarray, roll: np.ndarray) -> np.ndarray:
    """M (n, 3, 3) of cameras at C that look at targets, turned about their axes by roll."""
    axis = (C - target) / np.linalg.norm(C - target, axis=1, keepdims=True)  # +z, away from the target
    side = np.cross([0.0, 0.0, 1.0], axis)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    level = np.stack([side, np.cross(axis, side), axis], axis=1)
    return np.array([rotation(0.0, 0.0, turn) @ M for turn, M in zip(roll, level, strict=True)])


def monument(
    seed: int = 1,
    *,
    photos: int = 60,
    points: int = 600,
    control: int = 12,
    control_sigma: float = 0.003,
    fixed: bool = False,
    noise: float = 0.002,
    off: tuple[float, float] | None = (0.0, 0.0),
    turned: tuple[float, float, float] = (0.0, 0.0, 0.0),
    lens: bool = False,
    pitch: float = 25.0,
    **options: object,
) -> Monument:
    """A block; `off` are the errors of the given stations, m and degrees, None of those that are not given.

    All of it is `turned` by omega, phi, kappa (degrees). With a `lens` the camera has a distortion and is out by
    0.1 mm, as unknowns of the block. Noise is in mm.
    """
    rng = np.random.default_rng(seed)
    X, normal = surface(rng, points, 12.0, 18.0)
    azimuth = 2.0 * np.pi * np.arange(photos) / photos + rng.uniform(-0.03, 0.03, photos)
    radius = 6.0 + rng.uniform(10.0, 26.0, photos)
    height = np.where(np.arange(photos) % 3 == 0, rng.uniform(12.0, 28.0, photos), rng.uniform(1.2, 3.0, photos))
    C = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=1)
    target = np.stack([*rng.uniform(-1.5, 1.5, (2, photos)), rng.uniform(6.0, 12.0, photos)], axis=1)
    roll = rng.choice([0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi], photos) + rng.normal(0.0, 0.1, photos)
    M = looking(C, target, roll)
    A = rotation(*np.radians(turned))
    X, normal, C, M = X @ A.T, normal @ A.T, C @ A.T, M @ A.T
    names = np.array([f"P{number:04d}" for number in range(points)])
    tags = np.array([f"R{number:02d}" for number in range(photos)])
    at, measured, pairs = C.copy(), M.copy(), [0.0, 0.0]
    if off is not None:
        at = C + rng.normal(0.0, max(off[0], 1e-12), C.shape)
        measured = np.array([rotation(*turn) @ m for turn, m in zip(rng.normal(0.0, np.radians(off[1]), C.shape), M, strict=True)])
    builder = BlockBuilder(
        "A monument", program=options.pop("program", "IIIA"), system="LOCL", refraction="RIGOROUS", plate_sigma=max(noise, 1e-4), **options
    )
    builder.add_camera("C35", FOCAL_LENGTH, format_size=FORMAT)
    attitude = angles(measured)
    for row, tag in enumerate(tags.tolist()):
        v = X - C[row]
        UVS = v @ M[row].T
        xy = -FOCAL_LENGTH * UVS[:, :2] / UVS[:, 2:]
        facing = np.einsum("pi,pi->p", normal, v) / np.linalg.norm(v, axis=1) < -0.15
        seen = np.flatnonzero(facing & (UVS[:, 2] < 0) & (np.abs(xy) < 0.5 * FORMAT).all(axis=1))
        if off is None:
            builder.add_photo(tag, "C35")
        else:
            builder.add_photo(tag, "C35", position=at[row], attitude=attitude[row])
        builder.add_images(tag, names[seen], xy[seen] + rng.normal(0.0, 1.0, (len(seen), 2)) * noise)
    spread = rng.choice(points, control, replace=False)
    for row in spread.tolist():
        wrong = np.zeros(3) if fixed else rng.normal(0.0, control_sigma, 3)
        builder.add_control(names[row], X[row] + wrong, fixed=fixed, sigma=None if fixed else np.full(3, control_sigma))
    return Monument(block=builder.build(), C=C, M=M, X=X, names=names)


if __name__ == "__main__":
    write_deck(monument(off=None, initial="COMPUTE").block, Path(sys.argv[1]))
