"""Local blocks of oblique photographs with known truth, started from poor stations, for tests of convergence.

Images come from the reference projection of `dense_bundle`, so they share nothing with the program.
"""

from dataclasses import dataclass, replace

import numpy as np

from altered import added, altered
from musatpy import model
from musatpy.model.tables import empty
from musatpy.units import DEGREE
from orientation.flights import fly, spread
from reference.networks import project_all, turned
from reference.rays import angles_of, rotation

TIDE = 0.4  # m
SIGMA = 0.010  # mm


@dataclass(frozen=True, kw_only=True)
class Oblique:
    """What to make: cameras tilted by `tilt` (rad) from the vertical, across the flight."""

    tilt: float
    convergent: bool = False  # a second strip on the far side looks back
    submerged: bool = False
    program: model.Program = model.Program.IIIA
    photos: int = 4  # of a strip
    height: float = 3000.0  # m over the ground
    base: float = 0.4  # of the height
    control: int = 5  # full control points
    heading: float = 0.6  # of the flight, rad
    relief: float = 78.0  # m, of the land
    leaning: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rad, that the axes of the job are turned by; dry only
    seed: int = 1


@dataclass(frozen=True, kw_only=True)
class ObliqueBlock:
    """A block at its true stations, and the same started from stations 100 to 500 m and up to 5 degrees off."""

    block: model.Block
    started: model.Block


def make_oblique(plan: Oblique) -> ObliqueBlock:
    """Return the block of a plan; the same plan gives the same numbers."""
    rng = np.random.default_rng(plan.seed)
    C, M = _flight(plan, rng)
    X, wet = _ground(plan, rng)
    axes = rotation(np.array(plan.leaning))
    C, M, X = C @ axes.T, M @ axes.T, X @ axes.T
    n, p = len(C), len(X)
    block = altered(
        fly(C, angles_of(M)).block,  # for its camera and the tables that stay empty
        options=model.Options(
            program=plan.program,
            system=model.CoordinateSystem.LOCAL,
            refraction=model.Refraction.RIGOROUS if plan.submerged else model.Refraction.NONE,
            plate_sigma=SIGMA,
            max_iterations=60,
        ),
        water=model.Water(index=1.34) if plan.submerged else None,
        photos={"position": C, "attitude": angles_of(M), "tide": np.full(n, TIDE if plan.submerged else np.nan)},
        points={"ids": np.arange(p).astype(str), "bathymetric": wet, "dry": np.zeros(p, dtype=bool)},
        plates=empty(model.PlateMeasurements),
        control=empty(model.Control),
    )
    block = replace(block, plates=_measured(block, C, M, X, rng))
    block = replace(block, control=_controlled(plan, block, X, rng))
    size = rng.uniform(100.0, 500.0, (n, 1))
    way = rng.normal(size=(n, 3))
    shift = size * way / np.linalg.norm(way, axis=1, keepdims=True)
    off = {"position": added(..., shift), "attitude": added(..., rng.uniform(-5.0, 5.0, (n, 3)) * DEGREE)}
    return ObliqueBlock(block=block, started=altered(block, photos=off))


def drawn(seed: int) -> ObliqueBlock:
    """Return a block of 2 to 12 photos tilted by 30 to 60 degrees, wet or dry; a third of the dry ones lean."""
    rng = np.random.default_rng([40, seed])
    convergent, submerged = rng.random() < 0.5, rng.random() < 0.5
    return make_oblique(
        Oblique(
            tilt=rng.uniform(30.0, 60.0) * DEGREE,
            convergent=convergent,
            submerged=submerged,
            photos=int(rng.integers(1, 7) if convergent else rng.integers(2, 13)),
            height=rng.uniform(1000.0, 3000.0),
            base=rng.uniform(0.1, 0.5),
            control=int(rng.integers(4, 7)),
            heading=rng.uniform(0.0, 2.0 * np.pi),
            relief=rng.uniform(20.0, 300.0),
            leaning=(0.0, 0.0, 0.0) if submerged or rng.random() < 0.6 else tuple(rng.uniform(-1.0, 1.0, 3)),
            seed=seed,
        )
    )


def _reach(plan: Oblique) -> float:
    """Return how far from the flight line the axes meet the ground, m."""
    return float(plan.height * np.tan(plan.tilt))


def _flight(plan: Oblique, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return stations (n, 3), and (n, 3, 3) the matrices of photos whose axes look to the left of the flight."""
    along = (np.arange(plan.photos) - 0.5 * (plan.photos - 1)) * plan.base * plan.height
    near = np.column_stack([along, np.zeros(plan.photos), np.full(plan.photos, plan.height)])
    sides = [(near, 1.0)]
    if plan.convergent:
        sides.append((near + np.array([0.0, 2.0 * _reach(plan), 0.0]), -1.0))
    C, M = [], []
    for stations, side in sides:
        s, c = side * np.sin(plan.tilt), np.cos(plan.tilt)
        axis = np.array([0.0, s, -c])  # where the camera looks; its x-axis along the flight, as its film runs
        x = np.array([side, 0.0, 0.0])
        level = np.stack([x, np.cross(-axis, x), -axis])
        for station in stations:
            C.append(station + rng.normal(0.0, 20.0, 3))
            M.append(rotation(rng.normal(0.0, 1.5 * DEGREE, 3)) @ level)
    return turned(np.array(C), plan.heading), np.array(M) @ turned(np.eye(3), plan.heading)


def _ground(plan: Oblique, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return points (p, 3) from 20 degrees below the axes to 15 above them, and which are submerged."""
    low, high = (plan.height * np.tan(plan.tilt + part * DEGREE) for part in (-20.0, 15.0))
    if plan.convergent:
        low, high = (_reach(plan) + part * plan.height for part in (-0.6, 0.6))
    half = 0.5 * (plan.photos - 1) * plan.base * plan.height + 0.5 * plan.height
    along = np.linspace(-half, half, 2 * plan.photos + 1)
    across = np.linspace(low, high, 6)
    X = np.array([[x, y, 0.0] for x in along for y in across])
    X[:, :2] += rng.uniform(-100.0, 100.0, (len(X), 2))
    X[:, 2] = 2.0 + rng.uniform(0.0, plan.relief, len(X))
    wet = np.zeros(len(X), dtype=bool)
    if plan.submerged:
        wet[1::2] = True
        X[wet, 2] = -rng.uniform(1.0, 15.0, wet.sum())
    return turned(X, plan.heading), wet


def _measured(
    block: model.Block, C: np.ndarray, M: np.ndarray, X: np.ndarray, rng: np.random.Generator
) -> model.PlateMeasurements:
    xy = project_all(block, X, refraction=block.points.bathymetric.any())
    front = np.einsum("nij,npj->npi", M, X[None] - C[:, None])[..., 2] < 0.0
    seen = front & (np.abs(xy) < 105.0).all(axis=2)
    seen &= seen.sum(axis=0) > 1
    photo, point = np.nonzero(seen)
    noisy = xy[photo, point] + rng.normal(0.0, SIGMA, (len(photo), 2))
    return model.PlateMeasurements(photo=photo, point=point, xy=noisy)


def _controlled(plan: Oblique, block: model.Block, X: np.ndarray, rng: np.random.Generator) -> model.Control:
    """Return full control on dry points with rays, far from each other."""
    rays = np.bincount(block.plates.point, minlength=len(X))
    dry = np.flatnonzero((rays > 1) & ~block.points.bathymetric)
    point = dry[spread(X[dry], plan.control)]
    return model.Control(
        point=point,
        kind=np.full(plan.control, int(model.ControlKind.FULL)),
        position=X[point] + rng.normal(0.0, 0.1, (plan.control, 3)),
        sigma=np.full((plan.control, 3), 0.1),
    )
