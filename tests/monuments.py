"""Simulated blocks of close-range photographs round a monument, by formulas of this file alone.

Photos look horizontally, down from a lift and up from the ground, cameras turned about their axes by anything. The
block may be turned as a whole, so that nothing hangs on what is up. `python tests/monuments.py DECK` writes a deck.
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
    """Omega, phi, kappa (n, 3) rad of rotations (n, 3, 3); phi within a quarter turn, kappa what omega leaves."""
    omega = np.arctan2(-M[:, 2, 1], M[:, 2, 2])
    phi = np.arctan2(M[:, 2, 0], np.hypot(M[:, 2, 1], M[:, 2, 2]))
    so, co = np.sin(omega), np.cos(omega)
    kappa = np.arctan2(co * M[:, 0, 1] + so * M[:, 0, 2], co * M[:, 1, 1] + so * M[:, 1, 2])
    return np.stack([omega, phi, kappa], axis=1)


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
    turned: np.ndarray | None = None,
    attitude: np.ndarray | None = None,
    share: float = 1.0,
    lens: dict[str, float] | None = None,
    bar: bool = False,
    **options: object,
) -> Monument:
    """A block; `off` are the errors of the given stations, m and degrees, None of those that are not given.

    All of it is `turned` by a rotation; `attitude` (n, 3) rad stands on the cards where it is given.
    `control_sigma` m, `noise` mm; a `share` of the images is measured.
    A `lens` bends the images and is unknown; a scale `bar` is a distance of 0.2 mm.
    """
    rng = np.random.default_rng(seed)
    A = np.eye(3) if turned is None else turned
    X, normal = surface(rng, points, 12.0, 18.0)
    C, M = photographed(rng, photos)
    X, normal, C, M = X @ A.T, normal @ A.T, C @ A.T, M @ A.T
    names = np.array([f"P{number:04d}" for number in range(points)])
    at, measured = C, M
    if off is not None:
        at = C + rng.normal(0.0, 1.0, C.shape) * off[0]
        slips = rng.normal(0.0, 1.0, C.shape) * np.radians(off[1])
        measured = np.array([rotation(*slip) @ m for slip, m in zip(slips, M, strict=True)])
    given = {"program": "IIIA", "system": "LOCL", "refraction": "RIGOROUS", "plate_sigma": max(noise, 1e-4)}
    builder = BlockBuilder("A monument", **{**given, **options})
    builder.add_camera("C35", FOCAL_LENGTH, format_size=FORMAT)
    stated = angles(measured) if attitude is None else attitude
    for row, station in enumerate(at):
        tag = f"R{row:02d}"
        v = X - C[row]
        UVS = v @ M[row].T
        xy = -FOCAL_LENGTH * UVS[:, :2] / UVS[:, 2:]
        facing = np.einsum("pi,pi->p", normal, v) / np.linalg.norm(v, axis=1) < -0.15
        seen = np.flatnonzero(facing & (UVS[:, 2] < 0) & (np.abs(xy) < 0.5 * FORMAT).all(axis=1))
        if off is None:
            builder.add_photo(tag, "C35")
        else:
            builder.add_photo(tag, "C35", position=station, attitude=stated[row])
        if lens:
            xy = bent(xy, lens)
        if share < 1.0:
            seen = rng.choice(seen, round(share * len(seen)), replace=False)
        builder.add_images(tag, names[seen], xy[seen] + rng.normal(0.0, 1.0, (len(seen), 2)) * noise)
    for row in rng.choice(points, control, replace=False).tolist():
        wrong = 0.0 if fixed else A @ rng.normal(0.0, control_sigma, 3)
        sigma = None if fixed else np.full(3, control_sigma)
        builder.add_control(names[row], X[row] + wrong, fixed=fixed, sigma=sigma)
    for name in lens or ():
        builder.add("lens_unknowns", camera="C35", parameter=name)
    if lens:
        builder.add("reduction", side="IDEAL")
    if bar:
        low, high = X @ A[:, 2] < 3.0, X @ A[:, 2] > 15.0
        ends = [int(np.flatnonzero(end)[0]) for end in (low, high)]
        length = float(np.linalg.norm(X[ends[0]] - X[ends[1]]))
        builder.add_distance(names[ends].tolist(), length + rng.normal(0.0, 2e-4), 2e-4)
    return Monument(block=builder.build(), C=C, M=M, X=X, names=names)


def bent(xy: np.ndarray, lens: dict[str, float]) -> np.ndarray:
    """Plate coordinates (k, 2) mm of ideal ones of the focal length of the card, by polynomials of these."""
    x, y = (xy * (1.0 + lens["F"] / FOCAL_LENGTH)).T
    r2 = x**2 + y**2
    radial = r2 * (lens["K1"] + r2 * (lens["K2"] + r2 * lens["K3"]))
    dx = x * radial + lens["P1"] * (r2 + 2.0 * x**2) + 2.0 * lens["P2"] * x * y + lens["XP"]
    dy = y * radial + lens["P2"] * (r2 + 2.0 * y**2) + 2.0 * lens["P1"] * x * y + lens["YP"]
    return np.stack([x + dx, y + dy], axis=1)


def photographed(rng: np.random.Generator, photos: int) -> tuple[np.ndarray, np.ndarray]:
    """Stations (n, 3) and rotations (n, 3, 3) of photos round the tower: one in three from a lift."""
    number = np.arange(photos)
    azimuth = 2.0 * np.pi * number / photos + rng.uniform(-0.03, 0.03, photos)
    radius = 6.0 + rng.uniform(10.0, 26.0, photos)
    height = np.where(number % 3 == 0, rng.uniform(12.0, 28.0, photos), rng.uniform(1.2, 3.0, photos))
    C = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=1)
    target = np.stack([*rng.uniform(-1.5, 1.5, (2, photos)), rng.uniform(6.0, 12.0, photos)], axis=1)
    roll = rng.choice([0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi], photos) + rng.normal(0.0, 0.1, photos)
    return C, looking(C, target, roll)


if __name__ == "__main__":
    write_deck(monument(off=None, initial="COMPUTE").block, Path(sys.argv[1]))
