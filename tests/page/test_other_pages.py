"""Pages of compilations and of comparisons with soundings."""

import csv
import json
import re

import numpy as np
import pytest

from musatpy.errors import MusatError, RecordError
from musatpy.page.composition import page_of_record
from page.pages import SOUNDINGS, compiled_text, read, sounded_text, written


@pytest.fixture(autouse=True)
def _without_pictures(monkeypatch):
    monkeypatch.setattr("musatpy.page.composition.pictures", lambda *_: ())


@pytest.mark.slow
def test_models_points_and_bottom(tmp_path):
    page, record = read(written(tmp_path, compiled_text())), json.loads(compiled_text())
    assert "ACCEPTED" in page.text and "Points with coordinates257 of 257" in page.text
    rows = page.rows("Model Set-Up")
    assert [row["Model"] for row in rows] == ["2122", "2223"]
    analysis = page.rows("Comparison With The Run: In Numbers")
    difference = np.array(record["against_run"]["difference"])
    for axis, row in enumerate(analysis):
        assert float(row["RMS of Differences"]) == pytest.approx(
            np.sqrt(np.mean(difference[:, axis] ** 2)), abs=5.1e-3
        )
    assert len(page.rows("Profile Compilation")) == 3 and len(page.rows("Contours")) == 12
    assert "200 of 257 rows" in page.text
    assert {link.removeprefix("#") for link in page.links} <= set(page.ids)


@pytest.mark.slow
def test_what_is_odd_makes_it_doubtful(tmp_path):
    record = json.loads(compiled_text())
    reason = {"concern": "control", "text": "model 2122 is not recovered", "section": "Points Read Again"}
    record["verdict"] |= {"grade": "DOUBTFUL", "reasons": [{"grade": "DOUBTFUL", **reason}]}
    record["points"]["position"][0], record["points"]["reason"][0] = [None] * 3, "its rays are parallel"
    page = read(written(tmp_path, json.dumps(record)))
    assert "DOUBTFUL: to be looked at" in page.text and "model 2122 is not recovered" in page.text
    assert page.rows("Points Without Coordinates")[0]["Reason"] == "its rays are parallel"


@pytest.mark.slow
def test_a_wrong_value_is_named(tmp_path):
    record = json.loads(compiled_text())
    record["points"]["datum_depth"][2] = "deep"
    with pytest.raises(RecordError, match=r"points.datum_depth\[2\]: expected a number"):
        page_of_record(written(tmp_path, json.dumps(record)))


@pytest.fixture
def record():
    """The record of soundings beside the compilation of St. Thomas."""
    return json.loads(sounded_text())


def page_of(record, folder):
    return read(written(folder, json.dumps(record)))


def test_samples_orders_and_differences(record, tmp_path):
    page, table = page_of(record, tmp_path), record["differences"]
    difference, blunder = np.array(table["difference"]), np.array(table["blunder"])
    assert f"Soundings that meet the bottom{len(difference)} of 200" in page.text
    rows = {row["Sample"]: row for row in page.rows("Comparison With Soundings: Compiled Less Sounded Depths")}
    for name, values in (("all", difference), ("without blunders", difference[~blunder])):
        assert float(rows[name]["RMS m"]) == pytest.approx(np.sqrt(np.mean(values**2)), abs=5.1e-4)
        assert float(rows[name]["Median m"]) == pytest.approx(np.median(values), abs=5.1e-4)
    assert {"2 to 5 m", "5 to 10 m", "10 to 20 m"} <= set(rows)
    orders = page.rows("Orders Of S-44 Met By The Differences")
    assert [row["95 %"] for row in orders] == ["NO", "NO", "NO", "met"]
    assert "COMPARED: 95 % of the differences are within S-44 2" in page.text
    listed = page.rows("Differences")
    sizes = np.abs([float(row["Difference m"]) for row in listed])
    assert (np.diff(sizes) <= 0.0).all() and sizes[0] == pytest.approx(np.abs(difference).max(), abs=5.1e-4)
    assert sum(row["Blunder"] == "*" for row in listed) == blunder.sum()
    assert len(page.rows("Soundings That Do Not Meet The Bottom")) == len(record["left_out"]["sounding"])
    assert {link.removeprefix("#") for link in page.links} <= set(page.ids)


def test_feet_make_it_doubtful(record, tmp_path):
    table = record["differences"]
    sounded = [3.28084 * depth for depth in table["compiled"]]
    other = {**record, "differences": {**table, "sounded": sounded}}
    page = page_of(other, tmp_path)
    assert "DOUBTFUL" in page.text and re.search(r"they look like .*feet", page.text)


def test_the_map_has_the_soundings_in_their_places(record):
    """Distances on the map are those of the file, by the radii of the ellipsoid, to a thousandth."""
    with SOUNDINGS.open() as file:
        rows = {row["name"]: row for row in csv.DictReader(file)}
    table = record["differences"]
    first, last = table["sounding"][0], table["sounding"][-1]
    (lat1, lon1), (lat2, lon2) = ((float(rows[name]["lat"]), float(rows[name]["lon"])) for name in (first, last))
    phi = np.radians(0.5 * (lat1 + lat2))
    a, e2 = 6378206.4, 0.006768658
    w = 1.0 - e2 * np.sin(phi) ** 2
    north = np.radians(lat2 - lat1) * a * (1.0 - e2) / w**1.5
    east = np.radians(lon2 - lon1) * a / np.sqrt(w) * np.cos(phi)
    moved = np.subtract(table["place"][-1], table["place"][0])
    np.testing.assert_allclose(moved, [east, north], rtol=2e-3, atol=0.5)


def test_a_comparison_without_soundings_has_nothing_to_show(record, tmp_path):
    nothing = {**record, "differences": {name: [] for name in record["differences"]}}
    with pytest.raises(MusatError, match="no sounding meets the bottom"):
        page_of_record(written(tmp_path, json.dumps(nothing)))
