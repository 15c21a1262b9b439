"""Apparent points and back: identities, limits, the formula of a pair, and what cannot be corrected."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.geometry.rotations import attitude_matrix
from musatpy.refraction.apparent import CLOSE, REASONS, Fault, Stations, apparent_points, true_points
from musatpy.refraction.depth_factor import model_factor

FOOT = 0.3048
HEIGHT, BASE, INDEX = 2500.0 * FOOT, 1126.0 * FOOT, 1.35


def pair(*, vertical: bool = True) -> Stations:
    position = np.array([[0.0, 0.0, HEIGHT], [BASE, 0.0, HEIGHT]])
    axis = np.tile([0.0, 0.0, -1.0], (2, 1)) if vertical else None
    return Stations(position=position, level=np.zeros(2), axis=axis)


def survey(k: int = 7, n: int = 300) -> tuple[Stations, np.ndarray]:
    """Stations with tilts and tides, and true points below all tides."""
    rng = np.random.default_rng(2)
    position = np.column_stack([rng.uniform(-400.0, 400.0, (k, 2)), rng.uniform(800.0, 1000.0, k)])
    axis = -attitude_matrix(rng.normal(0.0, 0.05, (k, 3)))[:, 2]
    stations = Stations(position=position, level=rng.normal(0.0, 0.2, k), axis=axis)
    ground = np.column_stack([rng.uniform(-500.0, 500.0, (n, 2)), rng.uniform(-25.0, -1.0, n)])
    return stations, ground


@pytest.mark.parametrize("sight", [None, 5, 2])
def test_the_true_point_of_an_apparent_point_is_where_it_came_from(sight: int | None) -> None:
    stations, ground = survey()
    seen = None
    if sight is not None:
        rng = np.random.default_rng(sight)
        order = rng.permuted(np.tile(np.arange(7), (len(ground), 1)), axis=1)
        seen = order < sight
    apparent, _ = apparent_points(ground, stations, 1.34, seen)
    found = true_points(apparent, stations, 1.34, seen)
    assert (found.fault == Fault.NONE).all()
    # the iteration ends within CLOSE of the apparent point; depths are worth F < 2 times as much
    np.testing.assert_allclose(found.position, ground, atol=2.0 * CLOSE)
    assert (found.cameras == (sight or 7)).all()


def test_two_stations_at_equal_distances_are_the_formula() -> None:
    """On the middle line both rays make equal angles: (13) is exact there, and the rays meet straight above."""
    apparent_depth = np.array([1.0, 5.0, 30.0])
    y = np.array([0.0, 200.0, 343.0])
    F = model_factor(BASE / 2.0, y, apparent_depth, HEIGHT, BASE, INDEX)
    ground = np.column_stack([np.full(3, BASE / 2.0), y, -F * apparent_depth])
    apparent, parallax = apparent_points(ground, pair(), INDEX)
    np.testing.assert_allclose(apparent[:, 2], -apparent_depth, rtol=1e-12)
    np.testing.assert_allclose(apparent[:, :2], ground[:, :2], atol=1e-9)  # m: rounding of positions of km
    np.testing.assert_allclose(parallax, 0.0, atol=1e-9)
    np.testing.assert_allclose(true_points(apparent, pair(), INDEX).factor, F, rtol=1e-6)


def test_off_the_middle_the_formula_is_approximate() -> None:
    """It forgets that the two rays do not meet: 3e-5 of the factor at the corner of the model, elsewhere less."""
    x, y = (one.ravel() for one in np.meshgrid(np.linspace(0.0, BASE, 9), np.linspace(0.0, BASE, 9)))
    apparent = np.column_stack([x, y, np.full(x.size, -25.0 * FOOT)])
    F = model_factor(x, y, 25.0 * FOOT, HEIGHT, BASE, INDEX)
    apart = np.abs(true_points(apparent, pair(), INDEX).factor / F - 1.0)
    assert 1e-5 < apart.max() < 4e-5


def test_displacement_and_parallax_at_the_corner() -> None:
    """No displacement in X and Y, the paper says: 0.83 feet, and 1.66 feet of y-parallax, at 146 feet of depth."""
    corner = np.array([[0.0, 1126.0, -146.0]]) * FOOT
    apparent, parallax = apparent_points(corner, pair(), INDEX)
    assert abs(apparent - corner)[0, 1] / FOOT == pytest.approx(0.83, abs=0.005)  # two decimals
    assert abs(apparent - corner)[0, 0] / FOOT < 0.002
    assert 2.0 * parallax[0] / FOOT == pytest.approx(1.66, abs=0.005)  # from ray to ray


def test_weights_are_those_of_image_residuals() -> None:
    """The apparent point is where the image residuals of tilted cameras are least: no near point has less."""
    stations, ground = survey(k=4, n=5)
    turned = Stations(position=stations.position, level=stations.level)  # every camera looks at the point
    rotation = [frame_of(axis) for axis in stations.axis]
    apparent, _ = apparent_points(ground, stations, 1.34)
    other, _ = apparent_points(ground, turned, 1.34)
    assert np.abs(apparent - other).max() > 1e-3  # the weights matter here, by millimetres
    for i, G in enumerate(ground):
        meets = [meeting_direction(C, G, level) for C, level in zip(stations.position, stations.level, strict=True)]

        def cost(A: np.ndarray, meets: list = meets) -> float:
            total = 0.0
            for C, M, ray in zip(stations.position, rotation, meets, strict=True):
                a, b = M @ (A - C), M @ ray
                total += float(np.square(a[:2] / a[2] - b[:2] / b[2]).sum())
            return total

        least = cost(apparent[i])
        for step in np.vstack([np.eye(3), -np.eye(3)]) * 0.01:
            assert cost(apparent[i] + step) > least
        # The gradient vanishes: linear weights against the projective cost, 1e-4 of what a step of 1 cm adds
        for step in np.eye(3) * 1e-3:
            slope = (cost(apparent[i] + step) - cost(apparent[i] - step)) / 2.0
            bend = cost(apparent[i] + step) + cost(apparent[i] - step) - 2.0 * least
            assert abs(slope) < 0.2 * bend  # nearer than a fifth of a millimetre


def frame_of(axis: np.ndarray) -> np.ndarray:
    """A rotation whose camera looks along an axis: any turn about it does."""
    third = -axis
    first = np.cross([0.0, 1.0, 0.0], third)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(third, first), third])


def meeting_direction(C: np.ndarray, G: np.ndarray, level: float) -> np.ndarray:
    """The ray in air from C to G by bisection of its angle."""
    gap, low, high = G - C, 0.0, np.pi / 2.0
    D = np.hypot(*gap[:2])
    for _ in range(80):
        angle = (low + high) / 2.0
        reach = (C[2] - level) * np.tan(angle) + (level - G[2]) * np.tan(np.arcsin(np.sin(angle) / 1.34))
        low, high = (angle, high) if reach < D else (low, angle)
    return np.array([*(gap[:2] / D * np.tan(low)), -1.0])


def test_limits() -> None:
    stations, ground = survey()
    apparent, parallax = apparent_points(ground, stations, 1.0)
    np.testing.assert_allclose(apparent, ground, atol=1e-9)  # nothing is refracted; rounding
    np.testing.assert_allclose(parallax, 0.0, atol=1e-9)
    near = Stations(position=np.array([[-1.0, 0.0, 1e3], [1.0, 0.0, 1e3], [0.0, 1.0, 1e3]]), level=np.zeros(3))
    found = true_points(np.array([[0.0, 0.0, -10.0]]), near, 1.34)
    assert found.factor[0] == pytest.approx(1.34, rel=1e-6)  # angles of 1e-3, squared
    # each camera alone gives n times the apparent depth, to the same order
    assert found.spread[0] < 1e-5


def test_spread_and_incidence() -> None:
    """Below one camera the ray is vertical; the other's factor is that of its own ray."""
    found = true_points(np.array([[0.0, 0.0, -10.0]]), pair(), INDEX)
    r = np.arctan(BASE / (HEIGHT + 10.0))
    alone = 10.0 * np.array([INDEX, np.sqrt(INDEX**2 + (INDEX**2 - 1.0) * np.tan(r) ** 2)])
    assert found.spread[0] == pytest.approx(alone.std(ddof=1), rel=1e-12)
    assert found.incidence[0] == pytest.approx(found.largest_incidence[0] / 2.0, rel=1e-6)
    assert found.largest_incidence[0] == pytest.approx(r, rel=2e-3)  # of the refracted ray, not the straight one


def test_every_fault_has_its_reason() -> None:
    position = np.array([[0.0, 0.0, 900.0], [0.0, 0.0, 1000.0], [300.0, 0.0, 900.0]])
    stations = Stations(position=position, level=np.array([0.0, 0.0, 0.5]))
    cases = [
        (Fault.NONE, (100.0, 50.0, -5.0), (1, 0, 1)),
        (Fault.NOT_FINITE, (100.0, np.nan, -5.0), (1, 1, 1)),
        (Fault.NOT_FINITE, (np.inf, 50.0, -5.0), (1, 1, 1)),
        (Fault.ABOVE_WATER, (100.0, 50.0, 0.5), (1, 1, 1)),
        (Fault.ABOVE_WATER, (100.0, 50.0, 0.1), (1, 1, 0)),
        (Fault.ABOVE_WATER, (100.0, 50.0, 0.6), (0, 0, 0)),
        (Fault.BETWEEN_TIDES, (100.0, 50.0, 0.1), (1, 0, 1)),
        (Fault.NO_CAMERA, (100.0, 50.0, -5.0), (0, 0, 0)),
        (Fault.ONE_CAMERA, (100.0, 50.0, -5.0), (0, 1, 0)),
        (Fault.PARALLEL_RAYS, (0.0, 0.0, -5.0), (1, 1, 0)),  # both cameras straight above
    ]
    apparent = np.array([place for _, place, _ in cases])
    seen = np.array([sight for *_, sight in cases], dtype=bool)
    found = true_points(apparent, stations, 1.34, seen)
    assert found.fault.tolist() == [fault for fault, *_ in cases]
    bad = found.fault != Fault.NONE
    for values in (found.position[:, 2], found.depth, found.factor, found.spread, found.incidence):
        assert (np.isnan(values) == bad).all()
    assert set(REASONS) == set(Fault) and all(REASONS[fault] for fault in Fault if fault != Fault.NONE)


def test_rays_along_the_horizon() -> None:
    """Between the stations, equally far from them, the formula holds; beyond both nothing is to be found."""
    stations = Stations(position=np.array([[0.0, 0.0, 1.0], [3000.0, 0.0, 1.0]]), level=np.zeros(2))
    found = true_points(np.array([[1500.0, 0.0, -40.0], [9000.0, 0.0, -40.0]]), stations, 1.34)
    assert found.fault.tolist() == [Fault.NONE, Fault.NO_CONVERGENCE]
    assert found.factor[0] == pytest.approx(model_factor(1500.0, 0.0, 40.0, 1.0, 3000.0, 1.34), rel=1e-6)


def test_chunks_do_not_matter() -> None:
    stations, ground = survey(k=3, n=5000)  # more than a chunk
    apparent, _ = apparent_points(ground, stations, 1.34)
    whole = true_points(apparent, stations, 1.34)
    for part in (slice(0, 7), slice(2040, 2060), slice(4990, 5000)):
        found = true_points(apparent[part], stations, 1.34)
        # sums and roots of vectors of other lengths may differ in the last bit
        np.testing.assert_allclose(found.position, whole.position[part], rtol=0.0, atol=1e-11)


def test_a_station_under_water_is_refused() -> None:
    with pytest.raises(ValueError, match="station 2 is not above the water"):
        Stations(position=np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 1.0]]), level=np.array([0.0, 1.0]))
