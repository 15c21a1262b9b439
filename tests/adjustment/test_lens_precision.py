"""What adjusted lenses are correlated with, and what they do to the plate: against differences and drawn lenses."""

from functools import lru_cache

import numpy as np
import pytest

import musatpy
from adjustment.test_lenses import SIDES, TRUE, displaced, drone, through_lens, unknowns
from altered import altered
from blocks import converged, simulation
from musatpy.model import GRID_PLACES, LENS_PARAMETERS, DistortionSide, Solution

NAMES = list(TRUE)


@lru_cache
def adjusted(side: DistortionSide) -> Solution:
    return converged(unknowns(through_lens(drone(4), side, TRUE), *NAMES))


@pytest.mark.parametrize("side", SIDES)
def test_the_grid_is_what_the_lens_does(side: DistortionSide) -> None:
    """Ideal places of the grid through the lens, by formulas of the tests: 1e-9 mm. Sigmas of 400 lenses: 12 %."""
    solution = adjusted(side)
    grid, parameters = solution.grid, solution.parameters
    assert grid is not None and parameters is not None and grid.count == GRID_PLACES**2
    assert (grid.camera == solution.block.cameras.ids[0]).all()
    xy = solution.block.plates.xy
    np.testing.assert_allclose(np.abs(grid.place).max(axis=0), np.abs(xy).max(axis=0), atol=0.1)
    ideal = grid.place - grid.distortion

    def measured(lens: np.ndarray) -> np.ndarray:
        return displaced(ideal, side, dict.fromkeys(LENS_PARAMETERS, 0.0) | dict(zip(NAMES, lens, strict=True)))

    assert parameters.parameter.tolist() == NAMES
    np.testing.assert_allclose(measured(parameters.value), grid.place, atol=1e-9)
    drawn = np.random.default_rng(3).multivariate_normal(parameters.value, parameters.covariance, 400)
    moved = np.array([measured(lens) for lens in drawn])
    np.testing.assert_allclose(moved.std(axis=0), grid.sigma, rtol=0.12, atol=1e-6)
    np.testing.assert_allclose(np.sqrt(np.diagonal(parameters.covariance)), parameters.spread)


def test_without_unknown_distortion_there_is_no_grid() -> None:
    assert converged(unknowns(drone(4), "F", "XP")).grid is None


SIGMA = {"F": 0.05, "K1": 2e-8}


def over_water(share: float, change: float = 0.0) -> Solution:
    """Level and index unknown; focal length, given with a change, and K1 with wide sigmas."""
    block = simulation(
        6,
        terrain={"level": 60.0, "relief": 40.0, "wavelength": 900.0},
        water={"index_sigma": 0.002, "tide_sigma": 0.3},
        shoal=[{"share": share, "depth": [10.0, 200.0]}],
        flight={"photos": 4, "strips": 2, "height": 1200.0, "reverse_alternate": True, "attitude_scatter": 4.0},
        points={"extra": [{"number": 30}]},
        control=[{"kind": "full", "number": 5, "sigma": 0.05, "error": 0.05}],
        stations={"position_error": 0.1, "attitude_error": 0.3, "position_sigma": 0.1},
        options={"program": "IIIA", "water_index": "ADJUST", "water_level": "ONE"},
    ).block
    block = unknowns(block, *SIGMA)
    value = np.array([block.cameras.focal_length[0] + change, 0.0])
    return converged(altered(block, lens_unknowns={"value": value, "sigma": np.array(list(SIGMA.values()))}))


def shown(solution: Solution) -> dict[str, float]:
    """Everything that parameters may be tied to, by its name, in metres, radians and millimetres."""
    parameters, water, stations = solution.parameters, solution.water, solution.stations
    assert parameters is not None and water is not None
    values = dict(zip(("F of camera CAM1", "K1 of camera CAM1"), parameters.value.tolist(), strict=True))
    values |= {"water level": float(water.correction[0]), "refractive index": water.index}
    radius = 6.37e6 * np.array([np.cos(np.radians(18.0)), 1.0])
    for photo, (north, east, up), turn in zip(
        solution.block.photos.ids.tolist(), stations.position.tolist(), stations.attitude.tolist(), strict=True
    ):
        places = {"east": east * radius[0], "north": north * radius[1], "up": up}
        places |= dict(zip(("X-tilt", "Y-tilt", "heading"), turn, strict=True))
        values |= {f"photo {photo} {name}": value for name, value in places.items()}
    return values | {"depth": float(np.nanmean(solution.bathymetric.depth))}


def sigmas(solution: Solution) -> dict[str, float]:
    """Their a priori sigmas after the adjustment; of the depth that of a single point."""
    parameters, water, ids = solution.parameters, solution.water, solution.block.photos.ids.tolist()
    assert parameters is not None and water is not None
    every = dict(zip(("F of camera CAM1", "K1 of camera CAM1"), parameters.spread.tolist(), strict=True))
    every |= {"water level": float(water.correction_sigma[0]), "refractive index": water.index_sigma}
    names = ("east", "north", "up", "X-tilt", "Y-tilt", "heading")
    of_stations = np.sqrt(np.einsum("nii->ni", solution.stations.covariance))
    for photo, row in zip(ids, of_stations.tolist(), strict=True):
        every |= {f"photo {photo} {name}": sigma for name, sigma in zip(names, row, strict=True)}
    every["depth"] = float(np.nanmean(solution.bathymetric.depth_sigma))
    return {name: sigma / solution.unit_sigma for name, sigma in every.items()}


@pytest.mark.slow
def test_correlations_are_those_of_differences() -> None:
    """An unknown follows the value given for F by its cofactor with F over the variance given: 1 %.

    The mean depth is that of one point, whose sigma is known, then of half of all points.
    """
    for share in (0.02, 0.5):
        solution, (more, less) = over_water(share), (shown(over_water(share, change)) for change in (0.01, -0.01))
        parameters, sigma = solution.parameters, sigmas(solution)
        assert parameters is not None and parameters.parameter[0] == "F"
        wet = int(solution.block.points.bathymetric.sum())
        assert (wet == 1) == (share == 0.02)
        tied = dict(zip(parameters.tied[0].tolist(), parameters.correlation[0].tolist(), strict=False))
        assert set(tied) > {"K1 of camera CAM1"} and {"water level", "refractive index"} & set(tied)
        if wet == 1:
            tied["depth"] = parameters.correlation[0, 4]
        for name, value in tied.items():
            cofactor = (more[name] - less[name]) / 0.02 * SIGMA["F"] ** 2
            expected = cofactor / (sigma[name] * sigma["F of camera CAM1"])
            assert value == pytest.approx(expected, rel=0.02, abs=0.002), name
        assert parameters.correlations[0, 1] == pytest.approx(tied["K1 of camera CAM1"])


def test_correlations_are_printed_and_recorded() -> None:
    solution = over_water(0.5)
    text = musatpy.listing(solution)
    assert "Correlations Of Parameters" in text and "Distortion Of Plates" in text
