"""Real data with independent printed answers, through `adjust` and the reference.

Every tolerance is half a unit of the last printed digit.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adjustment import case_decks
from blocks import converged
from musatpy.adjustment import adjust
from musatpy.model import Block, PointStatus
from reference import dense_bundle
from reference.compare import beside

STRASBOURG = {"S1": "S1_fixed", "S2": "S2_weighted", "S4": "S4_smart"}
DECIMALS = {"S1": (4, 5), "S2": (6, 5), "S4": (5, 4)}  # of sigma0, and of the root of the sum of squares


Answer = SimpleNamespace | dense_bundle.Result  # what they share
Run = Callable[[Block], Answer]


def from_python(block: Block) -> SimpleNamespace:
    """Return a solution and its stations as the reference has them."""
    solution = converged(block)
    names = ("sigma0", "sum_of_squares", "degrees_of_freedom", "observations", "unknowns")
    stations = {name: getattr(solution.stations, name) for name in ("position", "attitude", "covariance")}
    of_all = {name: getattr(solution, name) for name in names}
    return SimpleNamespace(**of_all, **stations, residual=solution.plates.residual)


def from_reference(block: Block) -> dense_bundle.Result:
    """Return what the reference has, from a start some metres off."""
    start = beside(adjust(block))
    rng = np.random.default_rng(1)
    away = {name: getattr(start, name) + rng.normal(0.0, 2.0, (1, 3)) for name in ("position", "points")}
    return dense_bundle.solve(block, replace(start, **away), refraction=False)


WAYS = (from_python, from_reference)


@pytest.fixture(params=WAYS)
def run(request: pytest.FixtureRequest) -> Run:
    """Both ways to an answer."""
    way: Run = request.param
    return way


def close(value: Any, printed: Any, decimals: int) -> bool:
    """Whether values round to what is printed; the last factor is for a value at the very edge."""
    return bool(np.all(np.abs(np.subtract(value, printed)) <= 0.5 * 10.0**-decimals * (1.0 + 1e-9)))


@pytest.mark.parametrize(
    ("variant", "run"),
    [
        *product(("S1", "S2"), WAYS),
        ("S4", from_python),
        pytest.param("S4", from_reference, marks=pytest.mark.slow),
    ],
    indirect=["run"],
)
def test_strasbourg(variant: str, run: Run) -> None:
    case = case_decks.load_case("sxb")
    answer = run(case_decks.strasbourg(case, variant))
    expected = case["expected"][STRASBOURG[variant]]
    of_sigma0, of_root = DECIMALS[variant]
    assert close(answer.sigma0, expected["sigma0_px"], of_sigma0)
    assert close(np.sqrt(answer.sum_of_squares), expected["sqrt_vtpv"], of_root)
    assert answer.degrees_of_freedom == expected["dof"]
    assert sum(answer.observations.values()) == expected["obs"]
    assert sum(answer.unknowns.values()) == expected["params"]
    if "photo1" in expected:
        assert_first_photo(answer, expected["photo1"])


def assert_first_photo(answer: Answer, photo: dict[str, Any]) -> None:
    """Hold the first station against what DBAT printed; its sigmas have three digits, and sigma0 in them."""
    sigma = np.sqrt(np.diag(answer.covariance[0]))
    assert close(np.degrees(answer.attitude[0]), photo["opk_deg"], 6)
    for value, printed, decimals in zip(sigma[:3], photo["sd_XYZ"], (3, 2, 3), strict=True):
        assert close(value, printed, decimals)
    if "XYZ" in photo:  # printed for S1, as are the sigmas of the angles
        assert close(answer.position[0], photo["XYZ"], 4)
        for value, printed, decimals in zip(np.degrees(sigma[3:]), photo["sd_deg"], (4, 4, 5), strict=True):
            assert close(value, printed, decimals)


def test_strasbourg_largest_residual(run: Run) -> None:
    case = case_decks.load_case("sxb")
    block = case_decks.strasbourg(case, "S2")
    length = np.hypot(*run(block).residual.T) / case_decks.PIXEL
    worst = int(length.argmax())
    assert close(length[worst], 2.172, 3)
    assert close(np.sqrt(np.mean(length**2)), 1.089, 3)
    names = block.points.ids[block.plates.point[worst]], block.photos.ids[block.plates.photo[worst]]
    assert names == ("410", case["image_names"]["4"])


def test_strasbourg_smart_points_go_through_the_conditions() -> None:
    """The smart points have no control: S4 is a test of coplanarity and scale restraint."""
    block = case_decks.strasbourg(case_decks.load_case("sxb"), "S4")
    loose = np.setdiff1d(block.plates.point, block.control.point)
    rays = np.bincount(block.plates.point)[loose]
    assert len(loose) == 365
    assert (rays >= 3).sum() > 100
    solution = adjust(block)
    assert (solution.points.status[loose] == PointStatus.TRIANGULATED).all()
    assert solution.observations["plate coordinates, pass points"] == 2 * rays.sum()


def test_mikhail_resection(run: Run) -> None:
    case = case_decks.load_case("resections")["mikhail"]
    answer = run(case_decks.resection(case))
    assert close(answer.attitude[0], case["expected_omega_phi_kappa_rad"], 9)
    assert close(answer.position[0], case["expected_XYZ"], 5)
    assert close(answer.sum_of_squares, case["sum_of_squared_residuals_mm2"], 9)


def test_dewitt_resection(run: Run) -> None:
    case = case_decks.load_case("resections")["dewitt"]
    answer = run(case_decks.resection(case))
    assert close(np.degrees(answer.attitude[0]), case["expected_omega_phi_kappa_deg"], 4)
    assert close(answer.position[0], case["expected_XYZ"], 4)
    assert close(answer.residual, [case["residuals_mm"][row[0]] for row in case["points_id_x_y_X_Y_Z"]], 4)
    assert close(answer.sigma0, 0.002823, 6)  # what the program prints has the wrong degrees of freedom
