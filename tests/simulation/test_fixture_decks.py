"""The decks of fixtures/ are what their specs say, byte for byte, and hold what their README says."""

import json
from pathlib import Path

import numpy as np
import pytest

from musatpy.formats.musat import deck_bytes, read_deck
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import ControlKind
from musatpy.simulation import simulate, truth_json

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
def test_cayman_is_the_strip_of_the_report(name):
    block = read_deck(FIXTURES / f"{name}.crd")
    assert block.photos.ids.tolist() == [str(frame) for frame in range(837, 847)]
    assert block.ellipsoid.name == "clrk66"
    assert len(block.points.ids) == 98
    kinds = np.bincount(block.control.kind, minlength=3)
    assert kinds[ControlKind.HORIZONTAL] == 7 and kinds[ControlKind.VERTICAL] == 35
    control = block.points.ids[block.control.point]
    assert {"1103", "1104", "1109", "1210", "1215", "1053"} <= set(control.tolist())
    assert block.options.plate_sigma == 0.010


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


def test_cayman_runs_differ_in_the_option_card_only():
    standard = (FIXTURES / "cayman/cayman_standard.crd").read_text(encoding="ascii").splitlines()
    modified = (FIXTURES / "cayman/cayman_modified.crd").read_text(encoding="ascii").splitlines()
    different = [(a, b) for a, b in zip(standard, modified, strict=True) if a != b]
    assert len(different) == 1
    assert different[0][0].startswith("OPT IIA  GEOG NONE") and different[0][1].startswith("OPT IIA  GEOG WATPT")


def test_cayman_has_as_many_kept_out_measurements_per_frame_as_the_report():
    block = read_deck(FIXTURES / "cayman/cayman_standard.crd")
    kept = block.photos.ids[block.plates.photo[~block.plates.triangulated]]
    assert {frame: kept.tolist().count(frame) for frame in sorted(set(kept))} == {
        "841": 1,
        "842": 2,
        "843": 3,
        "844": 3,
    }


def test_clean_variant_is_half_under_water():
    block = read_deck(FIXTURES / "cayman/cayman_clean.crd")
    assert 2 * block.points.bathymetric.sum() >= 98


def test_st_thomas_is_small_and_has_a_point_that_dries():
    block = read_deck(FIXTURES / "st_thomas/st_thomas.crd")
    truth = json.loads((FIXTURES / "st_thomas/st_thomas.truth.json").read_text(encoding="utf-8"))
    assert len(block.photos.ids) == 3 and len(block.points.ids) <= 25
    assert len(set(block.photos.tide.tolist())) == 3
    assert 0.3 < block.points.bathymetric.mean() < 0.4
    assert truth["dry"] == [["23", "ROCK"]]
