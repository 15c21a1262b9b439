"""The depth factor against the printed numbers of Groeneveld Meijer (1964), and its limits."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from musatpy.refraction.apparent import departure, model_factor, pair_factor

TABLE_1 = Path(__file__).parents[2] / "fixtures" / "groeneveld_meijer" / "table1.csv"
HEIGHT, BASE, INDEX = 2500.0, 1126.0, 1.35  # feet
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
        found = pair_factor(*place, DEPTHS, HEIGHT, INDEX)
        for depth, value in zip(DEPTHS.tolist(), found.tolist(), strict=True):
            if abs(value - row[f"F_ha{depth:g}"]) > PRINTED:
                wrong[(place[0], place[1], depth)] = value
    assert set(wrong) == set(MISPRINTS)
    for place, value in wrong.items():
        assert value == pytest.approx(MISPRINTS[place], abs=PRINTED)


def test_table_2() -> None:
    factor = pair_factor(*CORNER, DEPTHS, HEIGHT, INDEX)
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
    assert pair_factor(*CORNER, 25.0, HEIGHT, INDEX) == pytest.approx(TABLE_3[0][0], abs=5e-4)  # three decimals
    middle = model_factor(BASE / 2.0, 0.0, 25.0, HEIGHT, BASE, INDEX)
    assert middle == pytest.approx(TABLE_3[-1][0], abs=5e-4)


@pytest.mark.parametrize(("index", "printed"), [(1.33402, 1.4466), (1.34158, 1.4564)])
def test_fresh_and_salt_water(index: float, printed: float) -> None:
    """The most unfavourable place at 25 feet, with the indices of Table 4; four decimals."""
    assert pair_factor(*CORNER, 25.0, HEIGHT, index) == pytest.approx(printed, abs=5e-5)


def test_equation_14_is_13_with_its_substitutions() -> None:
    x, y = np.meshgrid(np.linspace(0.0, BASE, 7), np.linspace(-1125.0, 1125.0, 9))
    by_distance = pair_factor(np.hypot(x, y), np.hypot(BASE - x, y), x, BASE - x, 25.0, HEIGHT, INDEX)
    np.testing.assert_array_equal(model_factor(x, y, 25.0, HEIGHT, BASE, INDEX), by_distance)
    np.testing.assert_allclose(by_distance, by_distance[::-1, ::-1], rtol=1e-14)  # the model is symmetric


def test_limits() -> None:
    """No refraction is no factor; at a small angle the factor is the index."""
    assert model_factor(300.0, 400.0, 25.0, HEIGHT, BASE, 1.0) == pytest.approx(1.0, abs=1e-15)
    # the angle is 1e-4: its square over two is what is left
    assert model_factor(0.1, 0.0, 0.0, 1e3, 0.2, 1.34) == pytest.approx(1.34, rel=1e-8)
    assert (model_factor(np.linspace(0.0, BASE, 5), 200.0, 25.0, HEIGHT, BASE, 1.34) > 1.34).all()
