"""The fixtures, run: listings byte for byte, the contract's criterion, and the truth behind the simulation."""

import json
import os
import subprocess
import sys
from functools import cache

import numpy as np
import pytest

from blocks import FIXTURES
from campaign.batches import near
from musatpy import adjust, read_deck
from musatpy.campaign.baseline_checks import check, check_text
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import ControlKind, Refraction, Solution
from musatpy.statistics import Statistics
from musatpy.units import DEGREE, MICROMETRE


@cache
def solution_of(name: str) -> Solution:
    return adjust(read_deck(FIXTURES / name))


def test_listings_are_the_golden_ones(tmp_path):
    """To take over what has changed for good reasons: musat baseline accept fixtures."""
    with near():
        found = check(FIXTURES, work=tmp_path)
    assert len(found.decks) == 10
    assert {one.state for one in found.decks} == {"identical"}, check_text(found, listed=3)


@pytest.mark.parametrize("core", ["Prescott", "Haswell"])
@pytest.mark.slow
def test_listing_does_not_depend_on_the_arithmetic_of_the_machine(core, tmp_path):
    """OpenBLAS takes other kernels, which round otherwise in the last digits (other libraries ignore the name)."""
    deck = FIXTURES / "st_thomas" / "st_thomas.crd"
    main = "from musatpy.cli.main import main; main()"
    command = [sys.executable, "-c", main, "run", "-q", str(deck), "-o", str(tmp_path)]
    subprocess.run(command, check=True, env={**os.environ, "OPENBLAS_CORETYPE": core}, timeout=120)
    assert (tmp_path / "st_thomas.lst").read_bytes() == deck.with_suffix(".lst").read_bytes()


def test_the_contract_is_met_in_the_modified_run_of_the_clean_strip():
    """ETL-0306, page 41: plate residuals of 15 um RMS or better, at least half of the image points submerged."""
    solution = solution_of("cayman/cayman_clean.crd")
    block, statistics = solution.block, Statistics(solution)
    assert solution.converged
    assert block.options.refraction is Refraction.WATPT
    assert len(block.photos.ids) == 10
    assert len(block.points.ids) == 98
    assert 2 * np.count_nonzero(block.points.bathymetric) >= 98
    assert 2 * np.count_nonzero(block.points.bathymetric[block.plates.point]) >= len(block.plates.photo)
    assert (statistics.plates.total_rms / MICROMETRE <= 15.0)[[0, 2]].all()
    assert (statistics.plates.rms[:, 2] / MICROMETRE <= 15.0).all()


@pytest.mark.parametrize("name", ["cayman_standard", "cayman_modified", "cayman_clean"])
def test_the_strip_is_that_of_the_report(name):
    block = solution_of(f"cayman/{name}.crd").block
    assert block.photos.ids.tolist() == [str(photo) for photo in range(837, 847)]
    assert block.ellipsoid.name == "clrk66"
    assert len(block.points.ids) == 98
    kinds = block.control.kind[block.control.kind != ControlKind.CHECK]
    assert np.count_nonzero(kinds == ControlKind.HORIZONTAL) == 7
    assert np.count_nonzero(kinds == ControlKind.VERTICAL) == 35
    assert block.options.plate_sigma == 10 * MICROMETRE


@pytest.mark.parametrize("name", ["st_thomas/st_thomas", "cayman/cayman_clean"])
def test_the_truth_is_found_within_its_sigmas(name):
    stations, points = errors_in_sigmas(name)
    # 18 to 294 errors that hang together, so their RMS is not 1 but near it; a sigma wrong by half, or a correction
    # left out (the sea points of the next test), lies outside.
    assert 0.6 < rms(stations) < 1.5
    assert 0.6 < rms(points) < 1.5


def test_without_refraction_the_sea_would_be_too_shallow():
    solution, true = solution_of("cayman/cayman_clean.crd"), truth("cayman/cayman_clean")
    sea = solution.bathymetric
    ids = solution.block.points.ids[sea.point]
    depth = sea.water_level - [true["points"][point]["position"][2] for point in ids]
    # 1/n = .746 below the camera, less away from it; the noise of one depth is .1 of it, the median is sought
    assert 0.65 < np.median(sea.apparent_depth / depth) < 0.75
    assert rms(sea.apparent_depth - depth) > 2 * rms(sea.depth - depth)


def truth(name: str) -> dict:
    return json.loads((FIXTURES / name).with_suffix(".truth.json").read_text())


def errors_in_sigmas(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return adjusted minus true over sigma, of stations (n, 6) and of points that have a position (k, 3)."""
    solution, true = solution_of(f"{name}.crd"), truth(name)
    statistics, earth = Statistics(solution), Ellipsoid("clrk66")
    block = solution.block
    photos = [true["stations"][photo] for photo in block.photos.ids]
    points = [true["points"][point] for point in block.points.ids]
    angles = np.array([photo["attitude"] for photo in photos]) * DEGREE - solution.stations.attitude
    turned = np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi
    stations = np.concatenate([metres(earth, photos, solution.stations.position), -turned], axis=1)
    ground = metres(earth, points, solution.points.position) / statistics.point_sigmas
    return stations / statistics.station_sigmas, ground[np.isfinite(ground).all(axis=1)]


def metres(earth: Ellipsoid, true: list[dict], position: np.ndarray) -> np.ndarray:
    """Return east, north, up (n, 3) m from true places of the truth file to geographic positions (n, 3)."""
    places = np.array([one["position"] for one in true]) * [DEGREE, DEGREE, 1.0]
    shift = earth.geocentric(position) - earth.geocentric(places)
    return np.einsum("nij,nj->ni", earth.frame(places), shift)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
