"""Simulated waves, and decks of fixtures that are those of their specs."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import musatpy
from frozen import specs
from musatpy.errors import SpecError
from musatpy.formats import musat
from musatpy.formats.musat import deck_bytes, read_deck
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import Program, Waves
from musatpy.model.tables import empty
from musatpy.sea.theory import linear_wave
from musatpy.simulation import simulate, truth_json
from musatpy.simulation.raytrace import RayTraceError
from musatpy.simulation.simulation_spec import spec_from_table
from musatpy.units import DEGREE
from reference import compare

SWELL = {"id": "SW", "period": 10.0, "depth": 12.0, "height": 1.1, "azimuth": 60.0, "crest": 12.5}
STOKES = {"id": "ST", "shape": "STOK", "length": 40.0, "depth": 8.0, "height": 0.6, "azimuth": -20.0}


def spec(system: str, *waves: dict[str, Any], **tables: Any) -> Any:
    centre = {"centre": [5000.0, 7000.0]} if system == "LOCL" else {"centre": [19.3, -81.3]}
    table: dict[str, Any] = {
        "job": {"system": system, **centre},
        "flight": {"photos": 4, "height": 1500.0, "interval": 12.5, "attitude_scatter": 1.0},
        "terrain": {"level": 20.0, "relief": 15.0},
        "water": {"tides": [0.2, -0.1, 0.3, 0.0], "wave_origin": [40.0, -25.0]},
        "shoal": [{"share": 0.5, "depth": [2.0, 15.0]}],
        "points": {"per_site": 2},
        "measurement": {"sigma": 3.0, "noise": 0.0},
        "control": [{"kind": "full", "number": 8, "sigma": 0.05}],
        "options": {"program": "IIIA"},
        "wave": list(waves),
    }
    return spec_from_table({**table, **tables})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("system", "program"), [(system, program) for system in ("LOCL", "GEOG", "GEOC") for program in Program]
)
def test_the_adjustment_finds_the_truth_behind_a_simulated_deck(system: str, program: Program) -> None:
    made = simulate(spec(system, SWELL, STOKES, options={"program": program.value}))
    block = musat.read_deck(musat.deck_bytes(made.block))
    solution = musatpy.adjust(block)
    assert solution.converged, solution.reason
    wet = block.points.bathymetric & np.isfinite(solution.points.position).all(axis=1)
    assert wet.sum() > 5
    found = compare.enu_difference(block, solution.points.position[wet], made.truth.points.job[wet])
    assert np.abs(found).max() < 1e-3  # what the cards round: control to half a millimetre
    level = musatpy.adjust(replace(block, waves=empty(Waves), wave_origin=None))
    wrong = compare.enu_difference(block, level.points.position[wet], made.truth.points.job[wet])
    assert np.sqrt(np.mean(wrong[:, 2] ** 2)) > 0.1


def test_errors_and_sigmas_stand_on_the_cards_and_not_in_the_images() -> None:
    wrong = {"height_error": -0.2, "length_error": 3.0, "azimuth_error": 5.0, "crest_error": 4.0}
    sigmas = {"height_sigma": 0.3, "length_sigma": 4.0, "azimuth_sigma": 6.0, "crest_sigma": 5.0}
    right, made = (simulate(spec("LOCL", one)) for one in (SWELL, {**SWELL, **wrong, **sigmas}))
    assert right.block.photos.time.tolist() == [0.0, 12.5, 25.0, 37.5]
    assert right.block.wave_origin is not None and right.block.wave_origin.position == (5040.0, 6975.0, 0.0)
    assert right.block.waves.ids.tolist() == ["SW"] and right.block.waves.height.tolist() == [1.1]
    waves = musat.read_deck(musat.deck_bytes(made.block)).waves
    length = float(linear_wave(10.0, 12.0).length)
    assert waves.period[0] == 10.0 and waves.length[0] == pytest.approx(length + 3.0, abs=5.1e-4)  # last decimal
    assert (waves.height[0], waves.crest[0]) == pytest.approx((0.9, 16.5))
    assert (waves.azimuth[0], waves.azimuth_sigma[0]) == pytest.approx((65.0 * DEGREE, 6.0 * DEGREE))
    assert (waves.height_sigma[0], waves.length_sigma[0], waves.crest_sigma[0]) == (0.3, 4.0, 5.0)
    np.testing.assert_array_equal(made.block.plates.xy, right.block.plates.xy)
    assert np.isnan(right.block.waves.length[0]) and np.isnan(right.block.waves.height_sigma[0])


@pytest.mark.parametrize(
    ("waves", "tables", "message"),
    [
        ([{**SWELL, "height": 9.5}], {}, r"wave\[1\].height.* breaks from 9.04 m on"),
        ([{"id": "A", "height": 0.5}], {}, r"wave\[1\].period.* one of them is needed"),
        ([{**STOKES, "height": 3.6}], {}, "too high for second-order theory"),
        ([{**SWELL, "speed": 9.0, "length_error": 1.0}], {}, "length_error needs a length"),
        ([{**SWELL, "height_error": 9.0}], {}, r"wave\[1\].height.* breaks from 9.04 m on"),
        ([SWELL, SWELL], {}, "two waves have the same id"),
        ([SWELL], {"water": {"tilt": [5.0, 0.0]}}, "level water: no tilt"),
    ],
)
def test_waves_that_cannot_be_are_said(waves: list[dict[str, Any]], tables: dict[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        simulate(spec("LOCL", *waves, **tables))
    with pytest.raises(RayTraceError, match="no incidence point on the water surface"):
        simulate(spec_from_table(specs.spec(286)))  # waves deeper than a point: a step led to infinity


FIXTURES = Path(__file__).parents[2] / "fixtures"
DECKS = ["cayman/cayman_standard", "cayman/cayman_modified", "cayman/cayman_clean", "st_thomas/st_thomas"]

# ETL-0306 Table 6.9, third column (with refraction): geocentric metres, Clarke 1866
TABLE_6_9 = {
    "1047": (907450.4, -5951413.1, 2099644.8),
    "1056": (904464.7, -5952644.5, 2097466.9),
    "1042": (911413.8, -5950279.9, 2101164.7),
    "1043": (911400.0, -5949795.4, 2102555.2),
    "1044": (910101.4, -5949940.9, 2102656.6),
    "1046": (909453.9, -5951346.9, 2098992.1),
    "1049": (907745.3, -5950409.4, 2102374.6),
    "1050": (907880.4, -5950190.0, 2102950.1),
    "1051": (905940.3, -5950302.6, 2103418.7),
    "1052": (904874.1, -5950706.3, 2102745.1),
    "1053": (904826.4, -5950462.7, 2103488.2),
    "1057": (903378.3, -5950272.0, 2104636.3),
}


@pytest.mark.parametrize("name", DECKS)
def test_deck_and_truth_are_those_of_the_spec(name):
    simulation = simulate(FIXTURES / f"{name}.toml")
    assert deck_bytes(simulation.block) == (FIXTURES / f"{name}.crd").read_bytes()
    stored = (FIXTURES / f"{name}.truth.json").read_text(encoding="utf-8")
    assert without_version(truth_json(simulation)) == without_version(stored)


def without_version(truth):
    """The truth says which musatpy made it; a new release does not change the deck."""
    return [line for line in truth.split("\n") if not line.startswith('  "musatpy":')]


@pytest.mark.parametrize("name", ["cayman/cayman_standard", "cayman/cayman_clean"])
def test_bathymetric_points_of_table_6_9_stand_where_printed(name):
    truth = json.loads((FIXTURES / f"{name}.truth.json").read_text(encoding="utf-8"))["points"]
    block = read_deck(FIXTURES / f"{name}.crd")
    places = np.array([truth[point]["position"] for point in TABLE_6_9])
    xyz = Ellipsoid("clrk66").geocentric(places * [np.pi / 180.0, np.pi / 180.0, 1.0])
    # the deck's precision: 0.00001 arc second is 0.3 mm
    np.testing.assert_allclose(xyz, list(TABLE_6_9.values()), rtol=0, atol=3e-4)
    rows = np.isin(block.points.ids[block.plates.point], list(TABLE_6_9))
    assert set(block.photos.ids[block.plates.photo[rows]].tolist()) == {"841", "842", "843", "844"}
    assert np.all(places[:, 2] < np.nanmin(block.photos.tide))
