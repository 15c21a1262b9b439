"""Apparent points of two rays, and the depth factors of Groeneveld Meijer."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from musatpy.depth.views import departure, pair_factor
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.refraction.apparent import (
    CLOSE,
    REASONS,
    Fault,
    Stations,
    apparent_points,
    true_points,
)
from reference.rays import incidence_distance

FOOT = 0.3048
HEIGHT, BASE, INDEX = 2500.0 * FOOT, 1126.0 * FOOT, 1.35


def model_factor(x, y, apparent_depth, height: float, base: float, index: float) -> np.ndarray:
    """F at x along the base from the first nadir and y across it, Groeneveld Meijer (14)."""
    x, y = np.asarray(x), np.asarray(y)
    return pair_factor(np.hypot(x, y), np.hypot(base - x, y), x, base - x, apparent_depth, height, index)


def pair() -> Stations:
    position = np.array([[0.0, 0.0, HEIGHT], [BASE, 0.0, HEIGHT]])
    return Stations(position=position, level=np.zeros(2), axis=np.tile([0.0, 0.0, -1.0], (2, 1)))


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
    stations, ground = survey(n=300 if sight else 2100)  # more than are worked at together
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


def test_displacement_and_parallax_at_the_corner() -> None:
    """No displacement in X and Y, the paper says: 0.83 feet, and 1.66 feet of y-parallax, at 146 feet of depth."""
    corner = np.array([[0.0, 1126.0, -146.0]]) * FOOT
    apparent, parallax = apparent_points(corner, pair(), INDEX)
    assert abs(apparent - corner)[0, 1] / FOOT == pytest.approx(0.83, abs=0.005)  # two decimals
    assert abs(apparent - corner)[0, 0] / FOOT < 0.002
    assert 2.0 * parallax[0] / FOOT == pytest.approx(1.66, abs=0.005)  # from ray to ray


def test_weights_are_those_of_image_residuals() -> None:
    """The apparent point is where the image residuals of tilted cameras are least."""
    stations, ground = survey(k=4, n=5)
    turned = Stations(position=stations.position, level=stations.level)  # every camera looks at the point
    apparent, _ = apparent_points(ground, stations, 1.34)
    other, _ = apparent_points(ground, turned, 1.34)
    assert np.abs(apparent - other).max() > 1e-3  # the weights matter here, by millimetres
    cameras = [Rotation.align_vectors([[0.0, 0.0, -1.0]], [axis])[0] for axis in stations.axis]
    for place, G in zip(apparent, ground, strict=True):
        rays = [meeting_direction(C, G, level) for C, level in zip(stations.position, stations.level, strict=True)]

        def residuals(A: np.ndarray, rays: list = rays) -> np.ndarray:
            seen = [
                camera.apply([A - C, ray]) for camera, C, ray in zip(cameras, stations.position, rays, strict=True)
            ]
            return np.concatenate([a[:2] / a[2] - b[:2] / b[2] for a, b in seen])

        least = least_squares(residuals, place, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        np.testing.assert_allclose(place, least, rtol=0.0, atol=2e-4)  # of linear weights


def meeting_direction(C: np.ndarray, G: np.ndarray, level: float) -> np.ndarray:
    """The ray in air from C to G by bisection of its angle."""
    gap, height = G - C, C[2] - level
    D = np.hypot(*gap[:2])
    Q = incidence_distance(height, level - G[2], D, 1.34, tolerance=1e-9)
    return np.array([*(gap[:2] / D * Q / height), -1.0])


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

    # no refraction is no factor; at a small angle the factor is the index
    assert model_factor(300.0, 400.0, 25.0, H_TABLE, B_TABLE, 1.0) == pytest.approx(1.0, abs=1e-15)
    # the angle is 1e-4: its square over two is what is left
    assert model_factor(0.1, 0.0, 0.0, 1e3, 0.2, 1.34) == pytest.approx(1.34, rel=1e-8)
    # along the horizon: between the stations the formula holds; beyond both nothing is to be found
    low = Stations(position=np.array([[0.0, 0.0, 1.0], [3000.0, 0.0, 1.0]]), level=np.zeros(2))
    found = true_points(np.array([[1500.0, 0.0, -40.0], [9000.0, 0.0, -40.0]]), low, 1.34)
    assert found.fault.tolist() == [Fault.NONE, Fault.NO_CONVERGENCE]
    assert found.factor[0] == pytest.approx(model_factor(1500.0, 0.0, 40.0, 1.0, 3000.0, 1.34), rel=1e-6)
    with pytest.raises(ValueError, match="station 2 is not above the water"):
        Stations(position=low.position, level=np.array([0.0, 1.0]))


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


TABLE_1 = Path(__file__).parents[2] / "fixtures" / "groeneveld_meijer" / "table1.csv"
H_TABLE, B_TABLE, N_TABLE = 2500.0, 1126.0, 1.35  # feet
DEPTHS = np.array([0.0, 10.0, 25.0, 50.0, 100.0])
CORNER = (1126.0, 1600.0, 0.0, 1126.0)
# Misprints: (d1, d2) and apparent depth -> what must have been meant, the value at d = 1200, s = 563 in the same
# table being equal to the first at every other depth
MISPRINTS = {(400.0, 1200.0, 0.0): 1.4184, (326.0, 800.0, 0.0): 1.3733}
# The paper was computed with desk calculators: 4 decimals, of which the last is wrong by up to 2
PRINTED = 2.5e-4

# Table 2 at the corner: apparent depth -> F, true depth, by F of 25 feet, difference, per cent
TABLE_2 = {
    0.0: (1.4696, None, None, None, -0.16),
    10.0: (1.4685, 14.685, 14.673, -0.012, -0.08),
    25.0: (1.4673, 36.68, 36.68, 0.0, 0.0),
    50.0: (1.4651, 73.255, 73.365, 0.110, 0.15),
    100.0: (1.4608, 146.08, 146.73, 0.65, 0.44),
}
# Table 3, a single value of 1.410 at 25 feet: contour, depth, difference, per cent
TABLE_3 = [
    (1.467, 36.68, 1.43, 4.1),
    (1.460, 36.50, 1.25, 3.5),
    (1.450, 36.25, 1.00, 2.8),
    (1.440, 36.00, 0.75, 2.1),
    (1.430, 35.75, 0.50, 1.4),
    (1.420, 35.50, 0.25, 0.7),
    (1.410, 35.25, 0.00, 0.0),
    (1.400, 35.00, -0.25, -0.7),
    (1.390, 34.75, -0.50, -1.4),
    (1.380, 34.50, -0.75, -2.1),
    (1.370, 34.25, -1.00, -2.8),
    (1.365, 34.13, -1.12, -3.2),  # printed -1.22 and -3.5, which no contour of 1.365 can have
]


def table_1() -> list[dict[str, float]]:
    with TABLE_1.open() as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def test_table_1() -> None:
    """All 110 cells by (13) with the listed distances; the two misprints are further off, and only they."""
    rows = table_1()
    assert len(rows) == 22
    wrong = {}
    for row in rows:
        place = [row[name] for name in ("d1", "d2", "s", "t")]
        found = pair_factor(*place, DEPTHS, H_TABLE, N_TABLE)
        for depth, value in zip(DEPTHS.tolist(), found.tolist(), strict=True):
            if abs(value - row[f"F_ha{depth:g}"]) > PRINTED:
                wrong[(place[0], place[1], depth)] = value
    assert set(wrong) == set(MISPRINTS)
    for place, value in wrong.items():
        assert value == pytest.approx(MISPRINTS[place], abs=PRINTED)
    # the most unfavourable place at 25 feet, with the indices of fresh and salt water of Table 4; four decimals
    for index, printed in ((1.33402, 1.4466), (1.34158, 1.4564)):
        assert pair_factor(*CORNER, 25.0, H_TABLE, index) == pytest.approx(printed, abs=5e-5)


def test_table_2() -> None:
    factor = pair_factor(*CORNER, DEPTHS, H_TABLE, N_TABLE)
    off = departure(factor, factor[2], DEPTHS)
    for i, (depth, (F, true, approximate, error, per_cent)) in enumerate(TABLE_2.items()):
        assert factor[i] == pytest.approx(F, abs=PRINTED)
        # 0.16 and 0.15 per cent are differences of two printed factors: 1.4 times their error
        assert 100.0 * off.relative[i] == pytest.approx(per_cent, abs=1.4e2 * PRINTED / 1.46)
        if true is not None:
            # depths are printed factors times the apparent depth, to half a unit of the last figure
            assert off.depth[i] == pytest.approx(true, abs=PRINTED * depth + 0.005)
            assert off.other_depth[i] == pytest.approx(approximate, abs=PRINTED * depth + 0.005)
            assert off.error[i] == pytest.approx(error, abs=1.4 * PRINTED * depth)


def test_table_2_to_the_printed_digit_by_the_printed_factors() -> None:
    F = np.array([row[0] for row in TABLE_2.values()])
    off = departure(F, F[2], DEPTHS)
    # a half unit of the last printed figure; 1.4673 * 25 = 36.6825 and 0.645 print as 36.68 and 0.65
    np.testing.assert_allclose(100.0 * off.relative, [row[4] for row in TABLE_2.values()], atol=0.0051)
    for i, (_, true, approximate, error, _) in enumerate(TABLE_2.values()):
        if true is not None:
            np.testing.assert_allclose(off.depth[i], true, atol=0.0051)
            np.testing.assert_allclose(off.other_depth[i], approximate, atol=0.0051)
            np.testing.assert_allclose(off.error[i], error, atol=0.0051)


def test_table_3() -> None:
    contour, depth, difference, per_cent = np.array(TABLE_3).T
    off = departure(1.410, contour, 25.0)
    np.testing.assert_allclose(off.depth, 35.25, rtol=1e-12)
    np.testing.assert_allclose(off.other_depth, depth, atol=0.0051)  # half a unit: 36.675 prints as 36.68
    np.testing.assert_allclose(off.error, difference, atol=0.0051)
    # per cents come from differences that were rounded before: 1.43 / 35.25, not 1.425 / 35.25
    np.testing.assert_allclose(100.0 * off.relative, per_cent, atol=0.05 + 100.0 * 0.005 / 35.25)


def test_the_extremes_of_table_3_are_those_of_the_model() -> None:
    """The contours end at the corner and at the middle of the model."""
    assert pair_factor(*CORNER, 25.0, H_TABLE, N_TABLE) == pytest.approx(TABLE_3[0][0], abs=5e-4)  # three decimals
    middle = model_factor(B_TABLE / 2.0, 0.0, 25.0, H_TABLE, B_TABLE, N_TABLE)
    assert middle == pytest.approx(TABLE_3[-1][0], abs=5e-4)


def test_equation_14_is_13_with_its_substitutions() -> None:
    x, y = np.meshgrid(np.linspace(0.0, B_TABLE, 7), np.linspace(-1125.0, 1125.0, 9))
    by_distance = pair_factor(np.hypot(x, y), np.hypot(B_TABLE - x, y), x, B_TABLE - x, 25.0, H_TABLE, N_TABLE)
    np.testing.assert_array_equal(model_factor(x, y, 25.0, H_TABLE, B_TABLE, N_TABLE), by_distance)
    np.testing.assert_allclose(by_distance, by_distance[::-1, ::-1], rtol=1e-14)  # the model is symmetric
