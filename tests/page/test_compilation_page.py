"""The page of a compilation, against its record."""

from __future__ import annotations

import json

import numpy as np
import pytest

from musatpy.as11_runs import compile_deck
from musatpy.errors import RecordError
from musatpy.page.records import page_of_record
from page.pages import ROOT, read, written

DECK = ROOT / "fixtures" / "st_thomas_as11" / "st_thomas_as11.crd"


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """The record of the compilation of St. Thomas."""
    folder = tmp_path_factory.mktemp("compiled")
    result = compile_deck(written(folder), DECK, folder)
    (record,) = (path for path in result.files if path.suffix == ".json")
    return record


@pytest.fixture
def page(compiled, monkeypatch):
    monkeypatch.setattr("musatpy.page.compilation_page.PICTURES", ())
    return read(compiled)


@pytest.mark.slow
def test_models_points_and_bottom(page, compiled):
    record = json.loads(compiled.read_text())
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


def test_what_is_odd_makes_it_doubtful(compiled, tmp_path, monkeypatch):
    monkeypatch.setattr("musatpy.page.compilation_page.PICTURES", ())
    record = json.loads(compiled.read_text())
    record["job"]["caution"] = "THE RUN HAS NOT CONVERGED"
    for rows in [record["recovered"]] if isinstance(record["recovered"], list) else []:
        rows[0]["recovered"] = False
    record["points"]["position"][0], record["points"]["reason"][0] = [None] * 3, "its rays are parallel"
    page = read(written(tmp_path, json.dumps(record)))
    assert "DOUBTFUL" in page.text and "THE RUN HAS NOT CONVERGED" in page.text
    assert "model 2122: points read again are off by more than the limit" in page.text
    assert page.rows("Points Without Coordinates")[0]["Reason"] == "its rays are parallel"


def test_a_wrong_value_is_named(compiled, tmp_path):
    record = json.loads(compiled.read_text())
    record["points"]["datum_depth"][2] = "deep"
    with pytest.raises(RecordError, match=r"points.datum_depth\[2\]: expected a number"):
        page_of_record(written(tmp_path, json.dumps(record)))
