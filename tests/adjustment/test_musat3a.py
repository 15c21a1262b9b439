"""Program IIIA against independent bundles, and the two forms of the normal equations."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from typing import Any

import numpy as np
import pytest

from adjustment import test_real_cases as real_cases
from adjustment.test_equivalence import assert_covariances_equal, assert_equals_bundle, simulated
from altered import altered, with_options
from blocks import FIXTURES, converged
from musatpy import model, read_deck
from musatpy.adjustment import adjust, musat2a
from musatpy.adjustment.collinear import add_collinear, eliminate, reduced
from musatpy.adjustment.ground import settle
from musatpy.adjustment.iteration import State
from musatpy.adjustment.musat2a import GeodeticRestraint, fully_weighted
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import NormalEquations
from musatpy.adjustment.sightings import image_coordinates
from reference import compare, dense_bundle
from reference.networks import Plan

DECKS = sorted(FIXTURES.glob("cayman/*.crd")) + sorted(FIXTURES.glob("st_thomas/*.crd"))
TIGHT = {"rotation_limit": 1e-9, "translation_limit": 1e-6, "max_iterations": 40}


def simultaneous(block: model.Block, **changes: Any) -> model.Solution:
    return converged(block, program=model.Program.IIIA, **changes)


@lru_cache
def solved(plan: Plan) -> model.Solution:
    return simultaneous(simulated(plan).block)


def assert_same(one: model.Solution, other: model.Solution) -> None:
    """Assert that two solutions of a block agree to 1e-6 sigma, and in their covariances to 1e-6."""
    stations, points = compare.apart(other, one)
    assert np.abs(stations).max() < 1e-6
    assert np.nanmax(np.abs(points)) < 1e-6
    stations = compare.covariance_difference(one.stations.covariance, other.stations.covariance)
    assert np.abs(stations).max() < 1e-6
    assert one.degrees_of_freedom == other.degrees_of_freedom
    assert one.sum_of_squares == pytest.approx(other.sum_of_squares, rel=1e-8)


def strasbourg(variant: str) -> model.Block:
    return real_cases.strasbourg(real_cases.load_case("sxb"), variant)


@pytest.mark.slow
@pytest.mark.parametrize(
    "block",
    [
        *(partial(read_deck, deck) for deck in DECKS),
        *(partial(strasbourg, variant) for variant in ("S1", "S2", "S4")),
    ],
    ids=[*(deck.stem for deck in DECKS), "S1", "S2", "S4"],
)
def test_equals_rigorous_musat2a_on_every_fixture_and_on_a_real_block(block: Callable[[], model.Block]) -> None:
    """The points of S1 and S4 with sigmas of nothing in their covariances are compared in metres."""
    given = with_options(block(), refraction=model.Refraction.RIGOROUS, **TIGHT)
    assert_same(adjust(given), simultaneous(given))


def test_the_refraction_mode_of_the_card_does_not_matter() -> None:
    """IIIA has one mode, says so in its options, and no card can switch the water off."""
    block = read_deck(FIXTURES / "st_thomas" / "st_thomas.crd")
    dry = simultaneous(block, refraction=model.Refraction.NONE)
    assert dry.block.options.refraction is model.Refraction.RIGOROUS
    np.testing.assert_array_equal(dry.points.position, simultaneous(block).points.position)


# --- unknown water, distances, height differences ---


def sea_block(**options: Any) -> model.Block:
    """A strip of four photos with submerged pass points and control, ties between points, priors of the water."""
    plan = Plan(submerged=True, sea_control=True, equal_elevation=True, photos_per_strip=4, keep_out=0, seed=12)
    simulation = simulated(plan)
    block, truth = simulation.block, simulation.truth.points
    n = len(block.photos.ids)
    rng = np.random.default_rng(3)
    photos = replace(
        block.photos,
        tide=block.photos.tide - 0.2,
        tide_sigma=np.array([0.3, 0.4, 0.5, 0.6]),
        tide_group=np.array(["A", "A", "B", "B"]),
        tide_day=np.array(["1", "2", "2", "1"]),
        position=simulation.truth.position + rng.normal(0.0, 2.0, (n, 3)),
        position_sigma=np.full((n, 3), 2.0),
    )
    rays = np.bincount(block.plates.point, minlength=len(truth))
    wet = np.flatnonzero(block.points.bathymetric & (rays >= 2))
    dry = np.flatnonzero(~block.points.bathymetric & (rays >= 2))
    ends = np.array([[dry[0], dry[-1]], [wet[0], dry[1]], [dry[0], wet[1]]])
    length = np.linalg.norm(truth[ends[:, 1]] - truth[ends[:, 0]], axis=1) + np.array([0.03, -0.02, 0.01])
    rise = truth[ends[:2, 1], 2] - truth[ends[:2, 0], 2] + np.array([0.02, -0.04])
    block = altered(
        block,
        photos=photos,
        water={"index": 1.336, "sigma": 0.004, "tilt_east": 2e-5, "tilt_north": -1e-5, "tilt_sigma": 5e-5},
        distances=model.Distances(point=ends, length=length, sigma=[0.05, 0.05, 0.08]),
        height_differences=model.HeightDifferences(point=ends[:2], difference=rise, sigma=[0.03, 0.02]),
    )
    return with_options(block, program=model.Program.IIIA, submerged_factor=1.5, **TIGHT, **options)


def exact_where_known(block: model.Block) -> model.Block:
    """The block whose water has no sigma where it is not adjusted."""
    options, water, photos = block.options, block.water, block.photos
    if options.water_level is model.WaterLevel.KNOWN:
        photos = replace(photos, tide_sigma=np.full(len(photos.ids), np.nan))
    tilt = water.tilt_sigma if options.water_tilt is model.Treatment.ADJUST else None
    index = water.sigma if options.water_index is model.Treatment.ADJUST else None
    return replace(block, photos=photos, water=replace(water, tilt_sigma=tilt, sigma=index))


WATER = {
    "known": {},
    "one level": {"water_level": model.WaterLevel.ONE},
    "level of each photo": {"water_level": model.WaterLevel.PHOTO},
    "levels of groups": {"water_level": model.WaterLevel.GROUP},
    "tilt": {"water_tilt": model.Treatment.ADJUST},
    "index": {"water_index": model.Treatment.ADJUST},
    "all by days": {
        "water_level": model.WaterLevel.DAY,
        "water_tilt": model.Treatment.ADJUST,
        "water_index": model.Treatment.ADJUST,
    },
    "all by photos": {
        "water_level": model.WaterLevel.PHOTO,
        "water_tilt": model.Treatment.ADJUST,
        "water_index": model.Treatment.ADJUST,
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("name", list(WATER))
def test_unknown_water_equals_the_bundle(name: str) -> None:
    block = exact_where_known(sea_block(**WATER[name]))
    solution = converged(block)
    water, start = solution.water, compare.beside(solution)
    # half a metre off, but with the water on the side of every point on which the solution has it
    tides = water.correction if block.options.water_level is not model.WaterLevel.KNOWN else None
    result = dense_bundle.solve(block, replace(start, position=start.position + 0.5, tides=tides), refraction=True)
    assert_equals_bundle(solution, result)
    assert_covariances_equal(solution, result)
    for found, sigma, kind in (
        (water.correction, water.correction_sigma, "tides"),
        (water.tilt, water.tilt_sigma, "tilt"),
        (np.array([water.index]), np.array([water.index_sigma]), "index"),
    ):
        if kind in result.water:
            expected, of_expected = result.water[kind]
            assert (np.abs(found - expected) / of_expected).max() < 1e-6
            np.testing.assert_allclose(sigma, of_expected, rtol=1e-5)
    for ours, theirs in (
        (solution.stations.covariance, result.covariance), (solution.points.covariance, result.point_covariance)
    ):  # fmt: skip
        np.testing.assert_allclose(compare.sigmas(ours), compare.sigmas(theirs), rtol=1e-5)
    between = solution.points.position[block.distances.point]
    lengths = solution.measured[model.ObservationKind.DISTANCE]
    np.testing.assert_allclose(lengths, np.linalg.norm(between[:, 1] - between[:, 0], axis=1))


@pytest.mark.parametrize("system", [model.CoordinateSystem.GEOGRAPHIC, model.CoordinateSystem.GEOCENTRIC])
def test_unknown_water_of_curved_jobs_finds_the_truth(system: model.CoordinateSystem) -> None:
    """Without noise the level, wrong by 0.4 m on the cards, and the index, wrong by 0.003, come out as they are."""
    plan = Plan(system=system, submerged=True, sea_control=True, photos_per_strip=4, noise=0.0, seed=8)
    block = simulated(plan).block
    wrong = altered(
        block,
        photos={"tide": block.photos.tide + 0.4, "tide_sigma": np.full(4, 50.0)},
        water={"index": block.water.index + 0.003, "sigma": 1.0},
    )
    solution = simultaneous(wrong, water_level=model.WaterLevel.ONE, water_index=model.Treatment.ADJUST, **TIGHT)
    # the priors pull by less than this: sigmas of 50 m and 1 against 0.3 m and 0.01
    assert solution.water.correction[0] == pytest.approx(-0.4, abs=1e-3)
    assert solution.water.index == pytest.approx(block.water.index, abs=1e-4)


# --- convergence ---


@pytest.mark.parametrize("start", [-40.0, 60.0])
def test_points_that_start_on_the_wrong_side_of_the_water(start: float) -> None:
    """Stations so far off in height that submerged points start dry, or dry ones deep down."""
    plan = Plan(submerged=True, photos_per_strip=4, seed=9)
    block = simulated(plan).block
    off = altered(block, photos={"position": block.photos.position + np.array([0, 0, start])})
    assert_same(solved(plan), simultaneous(off, **TIGHT))


@pytest.mark.parametrize(("tide", "named"), [(0.0, False), (-0.3, False), (-1.0, True)])
def test_a_submerged_point_above_the_water_by_more_than_three_sigmas_is_named(tide: float, named: bool) -> None:
    """The rock stands 0.29 m above the water of the deck, with a sigma of as much."""
    block = read_deck(FIXTURES / "st_thomas" / "st_thomas.crd")
    lower = altered(block, photos={"tide": block.photos.tide + tide})
    solution = simultaneous(lower)
    rock = block.points.ids.tolist().index("ROCK")
    sigma = float(np.sqrt(solution.points.covariance[rock, 2, 2]))
    height = solution.points.position[rock, 2] - solution.water.tide.min()
    assert height > 0.0 and (height > 3.0 * sigma) == named
    told = [warning for warning in solution.warnings if "point ROCK" in warning]
    assert (
        told
        == [f"point ROCK is flagged as submerged and stands {height:.3f} m above the water (sigma {sigma:.3f} m)"]
        * named
    )


SAME = 1e-9  # of a unit diagonal


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What a triangulation was linearised at last."""

    network: Network
    state: State


@cache
def last_of(deck: str, refraction: model.Refraction | None) -> Seen:
    """Return the last network and state of a job by IIA; its control known in all components, in some, or held."""
    block: model.Block = read_deck(FIXTURES / deck)
    options = {"program": model.Program.IIA, "weights": model.Weights.FULL}
    block = with_options(block, **options, **({} if refraction is None else {"refraction": refraction}))
    seen: list[Seen] = []
    linearise = GeodeticRestraint.linearise

    def spied(self: GeodeticRestraint, state: State) -> object:
        seen.append(Seen(network=self.network, state=state))
        return linearise(self, state)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(GeodeticRestraint, "linearise", spied)
        adjust(block, lambda *_: None)  # anew
    return seen[-1]


def both(network: Network, state: State) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Return S and the right side of the pass points by their conditions and by elimination, scaled alike."""
    state = settle(network, settle(network, state))
    conditions, eliminated = (NormalEquations(network.pattern, network.border.size) for _ in range(2))
    for group in network.pass_groups:
        conditions.add_sums(fully_weighted(network, state, group))
        E = eliminate(network, state, group)
        add_collinear(network, group, E, reduced(network, group, E), eliminated)
    (a, rhs_a), (b, rhs_b) = conditions.finished(), eliminated.finished()
    scale = 1.0 / np.sqrt(b.diagonal())
    return (a.scaled(scale).blocks, rhs_a * scale), (b.scaled(scale).blocks, rhs_b * scale)


def differences(network: Network, state: State) -> tuple[float, float]:
    """Return the largest differences of S and of the right sides."""
    (S, rhs), (of_points, rhs_of_points) = both(network, state)
    assert np.abs(rhs).max() > 1e-3  # stations are off: there is something to compare
    return float(np.abs(S - of_points).max()), float(np.abs(rhs - rhs_of_points).max() / np.abs(rhs).max())


def off(seen: Seen, near: bool = False) -> tuple[Network, State]:
    """Return the network with stations off by decimetres; `near`: the second stands 200 m from the first."""
    network, state = seen.network, seen.state
    position = state.position + np.random.default_rng(3).normal(0.0, 0.1, state.position.shape)
    if near:
        position[1] = position[0] + [200.0, 0.0, 0.0]
        attitude = state.attitude.copy()
        attitude[1] = attitude[0]
        state = replace(state, attitude=attitude)
        rows, xy = np.flatnonzero(network.photo == 1), network.xy.copy()
        ground = state.ground[network.point[rows]]
        xy[rows] = image_coordinates(network, replace(state, position=position), rows, ground)
        network = replace(network, xy=xy + np.random.default_rng(4).normal(0.0, 1e-3, xy.shape))
    return network, replace(state, position=position)


MODES = [
    ("st_thomas/st_thomas.crd", model.Refraction.NONE),
    ("st_thomas/st_thomas.crd", model.Refraction.LEGACY),
    ("st_thomas/st_thomas.crd", model.Refraction.WATPT),
    ("st_thomas/st_thomas.crd", model.Refraction.RIGOROUS),
    ("cayman/cayman_modified.crd", model.Refraction.RIGOROUS),
    ("waves/strip.crd", None),
]


@pytest.mark.parametrize(
    ("deck", "refraction", "near"),
    # nearly parallel rays through waves go by other crests than their images
    [(*mode, near) for mode in MODES for near in (False, True) if not near or mode[1] is not None],
)
def test_conditions_and_elimination_have_the_same_normal_equations(
    deck: str, refraction: model.Refraction | None, near: bool
) -> None:
    """With control, with points that are known in part, and with rays that are nearly parallel."""
    of_S, of_rhs = differences(*off(last_of(deck, refraction), near))
    assert of_S < SAME and of_rhs < SAME


@pytest.mark.parametrize("name", ["coplanarity", "scale_restraint"])
@pytest.mark.parametrize(("ray", "column"), [(0, 0), (1, 2), (1, 4)])
@pytest.mark.parametrize("refraction", [model.Refraction.NONE, model.Refraction.RIGOROUS])
def test_a_sign_that_is_turned_is_seen(
    monkeypatch: pytest.MonkeyPatch, name: str, ray: int, column: int, refraction: model.Refraction
) -> None:
    """Of the partials by a coordinate of an origin, or of a direction; values are 0 at adjusted images."""
    right = getattr(musat2a, name)

    def turned(P: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, partials = right(P, u)
        partials = partials.copy()
        partials[..., ray, column] *= -1.0
        return value, partials

    seen = last_of("st_thomas/st_thomas.crd", refraction)
    monkeypatch.setattr(musat2a, name, turned)
    assert max(differences(*off(seen))) > 1e-4
