"""Starts: of oblique photographs, of poor stations, of waves given too high.

Images of the local blocks come from the reference projection of `dense_bundle`, so they share nothing with the
program.
"""

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from altered import added, altered, with_options
from musatpy import listing, model, read_deck, verdict
from musatpy.adjustment import adjust
from musatpy.model import Grade, Program, Solution
from musatpy.model.tables import empty
from musatpy.units import ARC_SECOND, DEGREE
from orientation.flights import fly, spread
from reference import compare
from reference.networks import project_all, turned
from reference.rays import angles_of, rotation
from reference.wave_scenes import scene

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
    X[:, 2] = 2.0 + rng.uniform(0.0, 78.0, len(X))
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


PAIR = Path(__file__).parent / "starts" / "oblique_pair.crd"


def told(solution: Solution) -> str:
    """Return what the listing says of two starts, in one line."""
    text = " ".join(listing(solution).split())
    return text[text.index("Two starts") :][:200] if "Two starts" in text else ""


def test_an_oblique_pair_converges_from_its_straight_rays() -> None:
    block = read_deck(PAIR)
    solution = adjust(block)
    assert verdict(solution).grade is Grade.ACCEPTED
    other = adjust(with_options(block, program=Program.IIA, refraction="NONE"))
    assert solution.sum_of_squares == pytest.approx(other.sum_of_squares, rel=1e-6)  # both stop within their limits
    assert "from the points where straight rays meet; from level ground it does not converge" in told(solution)
    assert sum(iteration.number == 1 for iteration in solution.iterations) == 1  # those of one start


@pytest.mark.slow
def test_the_lower_of_two_starts_is_taken_and_the_other_told() -> None:
    made = make_oblique(Oblique(tilt=45.0 * DEGREE, seed=3))
    assert not adjust(made.block).start  # the first one does
    wild = with_options(made.block, plate_sigma=0.001)  # sigma0 10: both starts come to rest in one minimum
    solution = adjust(wild)
    assert solution.converged
    assert solution.unit_sigma == pytest.approx(10.0, rel=0.2)  # of 100 degrees of freedom and more
    assert solution.start.startswith("level ground; from the points where straight rays meet the sum of squares is")
    assert f"{solution.sum_of_squares:.2f}" in told(solution)
    assert not adjust(
        with_options(wild, plate_sigma_is="GUESS", sigma0_limit=20.0)
    ).start  # a guess may be so far off


@pytest.mark.slow
def test_waves_given_far_too_high_are_found() -> None:
    made = scene(74)
    cards = made.block.waves
    high = made.waves.values[:, 0] + 2.6 * cards.height_sigma
    solution = adjust(altered(made.block, waves={"height": high}))
    assert solution.converged
    assert solution.unit_sigma < 1.3
    np.testing.assert_allclose(solution.water.waves.value[:, 0], made.waves.values[:, 0], rtol=0.05)


CLOSE_PAIR = {"photos": 2, "base": 0.15, "control": 4}  # narrow and hardly held
LOW = {"height": 1000.0}  # 500 m are half of it
TIGHT = {"rotation_limit": 1e-3 * ARC_SECOND, "translation_limit": 1e-5, "max_iterations": 20}


def assert_same_minimum(one: Solution, other: Solution) -> None:
    """Assert that both converged, to stations within 1e-3 sigma of each other: the limits leave less than that."""
    assert one.converged, one.reason
    assert other.converged, other.reason
    assert np.abs(compare.station_difference(one, other.stations)).max() < 1e-3


SHAPES = {
    "pair": (CLOSE_PAIR, 2),
    "low strip": (LOW, 3),
    "convergent pairs": ({**CLOSE_PAIR, "convergent": True}, 1),
}
STEEP = [  # every two of shape, water and program together
    ("pair", False, Program.IIA),
    ("pair", True, Program.IIIA),
    ("low strip", True, Program.IIA),
    ("low strip", False, Program.IIIA),
    ("convergent pairs", False, Program.IIIA),
    ("convergent pairs", True, Program.IIA),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "submerged", "program", "degrees"),
    [
        *(pytest.param(*case, 45.0, marks=pytest.mark.slow) for case in product(SHAPES, (False, True), Program)),
        *((*case, 60.0) for case in STEEP),
    ],
)
def test_oblique_photographs_from_poor_stations(
    name: str, submerged: bool, program: Program, degrees: float
) -> None:
    shape, seed = SHAPES[name]
    tilt, heading = degrees * DEGREE, 0.7 * seed
    plan = Oblique(tilt=tilt, submerged=submerged, program=program, heading=heading, seed=seed, **shape)
    made = make_oblique(plan)
    assert_same_minimum(adjust(with_options(made.started, **TIGHT)), adjust(with_options(made.block, **TIGHT)))


def test_a_restarted_triangulation_says_so() -> None:
    plan = Oblique(tilt=60.0 * DEGREE, program=Program.IIA, heading=3.5, seed=5, **CLOSE_PAIR)
    solution = adjust(make_oblique(plan).started)
    assert solution.converged
    assert [text for text in solution.warnings if text.endswith("started again from a simultaneous adjustment")]
