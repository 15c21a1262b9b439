"""Lenses over the water: errors against sigmas, with level and index unknown too; what is not determined."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import musatpy
from adjustment.test_lenses import unknowns
from altered import altered
from blocks import converged, simulation
from musatpy.errors import AdjustmentError
from musatpy.model import Grade, Solution
from musatpy.simulation import Simulation
from musatpy.statistics import metric_differences

LEVEL, INDEX, FOCAL = 0.3, 0.002, 0.05  # sigmas of what is given: m, none, mm
DRAWS = 50


def over_deep_water(seed: int) -> Simulation:
    """A camera over water 0.1 to 0.5 flying heights deep; level, index and focal length are given wrongly."""
    rng = np.random.default_rng(seed)
    return simulation(
        seed,
        terrain={"level": 40.0, "relief": 30.0, "wavelength": 500.0},
        water={
            "level_error": float(rng.normal() * LEVEL),
            "tide_sigma": LEVEL,
            "index_error": float(np.round(rng.normal() * INDEX, 6)),
            "index_sigma": INDEX,
        },
        shoal=[{"share": 0.6, "depth": [60.0, 300.0]}],
        flight={
            "photos": 3,
            "strips": 2,
            "height": 600.0,
            "reverse_alternate": True,
            "attitude_scatter": 3.0,
        },
        points={"extra": [{"number": 12}]},
        control=[{"kind": "full", "number": 4, "sigma": 0.05, "error": 0.05}],
        stations={"position_error": 0.1, "attitude_error": 0.3, "position_sigma": 0.1},
        lens={"parameter": [{"name": "F", "change": 0.03, "sigma": FOCAL}]},
        options={"program": "IIIA", "water_level": "ONE", "water_index": "ADJUST"},
    )


def errors_over_sigmas(simulated: Simulation, solution: Solution) -> dict[str, Any]:
    """Errors over a priori sigmas after the adjustment of every unknown, by what it is."""
    truth, water, parameters = simulated.truth, solution.water, solution.parameters
    assert water is not None and parameters is not None
    block, unit = solution.block, solution.unit_sigma
    of_stations, of_points = (
        np.sqrt(np.einsum("nii->ni", table.covariance)) / unit for table in (solution.stations, solution.points)
    )
    places = metric_differences(block, truth.stations.job, solution.stations.position)
    turns = solution.stations.attitude - truth.attitude
    points = metric_differences(block, truth.points.job, solution.points.position) / of_points
    wet = truth.bathymetric
    ratios = {
        "F": (parameters.value - [truth.parameters[0].value]) / (parameters.spread / unit),
        "level": (water.correction + truth.tide_error[0]) / (water.correction_sigma / unit),
        "index": np.array([(water.index - truth.index) / (water.index_sigma / unit)]),
        "turn": ((turns + np.pi) % (2.0 * np.pi) - np.pi) / of_stations[:, 3:],
    }
    for axis, name in enumerate(("east", "north", "up")):
        ratios |= {f"station {name}": places[:, axis] / of_stations[:, axis]}
        ratios |= {f"{kind} {name}": points[rows, axis] for kind, rows in (("dry", ~wet), ("wet", wet))}
    return ratios


def drawn(draws: int, first: int = 0) -> tuple[Mapping[str, float], float]:
    """RMS of errors over sigmas by kinds of unknowns, and how often sigma0 lies within its 95 % limits."""
    squares: dict[str, list[float]] = {}
    passed = 0
    for seed in range(first, first + draws):
        simulated = over_deep_water(seed)
        solution = converged(simulated.block)
        for name, ratio in errors_over_sigmas(simulated, solution).items():
            squares.setdefault(name, []).append(float(np.mean(np.square(ratio))))
        low, high = chi2.ppf([0.025, 0.975], solution.degrees_of_freedom)
        passed += bool(low < solution.sum_of_squares < high)
    return {name: float(np.sqrt(np.mean(values))) for name, values in squares.items()}, passed / draws


@pytest.mark.slow
def test_errors_over_deep_water_are_as_large_as_their_sigmas() -> None:
    """Fifty draws: RMS within three of its sigmas, .30, for what a draw has one of, and .13 for the others.

    A thousand draws gave .958 (focal length) to 1.019 (wet heights), and 947 that passed the test of sigma0.
    """
    ratios, passed = drawn(DRAWS)
    for name, ratio in ratios.items():
        assert ratio == pytest.approx(1.0, abs=0.30 if name in ("F", "level", "index") else 0.13), name
    assert 0.86 < passed < 0.99


FOCAL_LENGTH = {"parameter": [{"name": "F", "change": 0.05}]}
STATIONS = {"position_sigma": 0.1, "position_error": 0.1, "attitude_error": 0.1}
FLAT: dict[str, Any] = {
    "terrain": {"relief": 0.0},
    "points": {"extra": [{"number": 30}]},
    "control": [{"kind": "full", "number": 6, "sigma": 0.05}],
    "stations": {"position_error": 2.0, "attitude_error": 0.1},
    "lens": FOCAL_LENGTH,
    "options": {"program": "IIIA"},
}


def test_all_wet_with_level_and_focal_length_free() -> None:
    """They do the same to images: doubtful, no sigma, and their correlation is named."""
    solution = converged(
        simulation(
            3,
            terrain={"relief": 0.0},
            water={},
            shoal=[{"share": 1.0, "depth": [5.0, 60.0]}],
            flight={"photos": 4, "height": 600.0},
            points={"extra": [{"number": 30}]},
            stations=STATIONS,
            lens=FOCAL_LENGTH,
            options={"program": "IIIA", "water_level": "ONE"},
        ).block
    )
    verdict, parameters = musatpy.verdict(solution), solution.parameters
    assert verdict.grade is Grade.DOUBTFUL and parameters is not None and np.isnan(parameters.sigma).all()
    text = "F of camera CAM1 (correlation -0.998 with water level; a sigma of 0.6 mm would do): not determined"
    assert text in " ".join(reason.text for reason in verdict.reasons)
    listing = musatpy.listing(solution)
    (row,) = [line for line in listing.splitlines() if line.startswith("CAM1      F ") and "not determined" in line]
    assert len(row.split(" not")[0].split()) == 7  # without sigma and test; inflation and effect say why


@pytest.mark.slow
def test_one_flat_strip_with_focal_length_free() -> None:
    """A little tilt tells it from the heights of stations only by chance: doubtful, and no number for its sigma."""
    solution = converged(
        simulation(3, **FLAT, flight={"photos": 5, "height": 1000.0, "attitude_scatter": 1.0}).block
    )
    reasons = " ".join(reason.text for reason in musatpy.verdict(solution).reasons)
    assert musatpy.verdict(solution).grade is Grade.DOUBTFUL and solution.parameters is not None
    assert "F of camera CAM1 (correlation 1.000 with photo" in reasons and np.isnan(solution.parameters.sigma).all()


@pytest.mark.parametrize("strips", [1, 3])
def test_no_tilt_over_flat_ground_names_the_focal_length(strips: int) -> None:
    """Nothing tells it from the flying height: no answer, and the parameter with what would help."""
    block = simulation(3, **FLAT, flight={"photos": 5, "strips": strips, "height": 1000.0}).block
    with pytest.raises(AdjustmentError, match=r"not determined.*hold F of camera CAM1, or give it a sigma"):
        converged(block)
    held = converged(unknowns(block, "F", sigma=0.1))
    assert held.parameters is not None and held.parameters.verdicts[0].startswith("only by its prior")


@pytest.mark.slow
def test_cameras_of_groups_of_photos_have_lenses_of_their_own() -> None:
    """Two CAM cards for one camera, each with a CAL card: two focal lengths, each from its own photos."""
    simulated = simulation(
        5, **{**FLAT, "terrain": {"relief": 40.0}, "stations": STATIONS, "lens": {}},
        flight={"photos": 4, "strips": 2, "height": 1000.0, "attitude_scatter": 3.0},
    )  # fmt: skip
    block = simulated.block
    cameras = {name: np.repeat(getattr(block.cameras, name), 2, axis=0) for name in vars(block.cameras)}
    cameras["ids"] = np.array(["ONE", "TWO"])
    second = np.arange(block.photos.count) >= 4
    stretched = np.where(second[block.plates.photo], 1.0 + 0.2 / 152.0, 1.0)[:, None]  # 0.2 mm longer
    block = altered(
        block, cameras=cameras, photos={"camera": second.astype(int)}, plates={"xy": block.plates.xy * stretched}
    )
    block = replace(block, lens_unknowns=replace(unknowns(block, "F", "F").lens_unknowns, camera=np.array([0, 1])))
    parameters = converged(block).parameters
    assert parameters is not None and parameters.owner.tolist() == ["ONE", "TWO"]
    np.testing.assert_array_less(np.abs(parameters.value - [152.0, 152.2]) / parameters.sigma, 3.5)
    assert (parameters.sigma < 0.05).all()
