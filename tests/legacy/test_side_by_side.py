"""A legacy listing beside a newer run: the same statistic of the same id, from a listing or a record."""

from __future__ import annotations

import dataclasses
import json

import pytest

from legacy.report_tables import FIXTURES, table
from musatpy.errors import MusatError
from musatpy.legacy.against import side_by_side
from musatpy.legacy.listing_numbers import statistics_of
from musatpy.legacy.read import listing_of, read_listing
from musatpy.legacy.record_numbers import statistics_of_record
from musatpy.legacy.report import side_text
from musatpy.model import CoordinateSystem, SystemSpec
from musatpy.reports.listing import listing as listing_text
from musatpy.reports.record import dumps, record
from musatpy.units import AngleUnit
from sample_solutions import sample_solution

MODIFIED = FIXTURES / "cayman" / "cayman_modified.lst"


def test_a_listing_is_like_itself():
    found = side_by_side(read_listing(MODIFIED), MODIFIED)
    assert len(found.pairs) > 500 and found.only_old == found.only_new == ()
    assert all(pair.alike and not pair.difference for pair in found.pairs)


@pytest.mark.parametrize("system", CoordinateSystem)
def test_a_listing_is_like_the_record_of_its_run(system, tmp_path):
    solution = sample_solution(system)
    (path := tmp_path / "job.json").write_text(dumps(record(solution)))
    listing = listing_of(listing_text(solution), "job.lst")
    found = side_by_side(listing, path)
    assert found.only_old == () and len(found.pairs) == len(statistics_of(listing))
    # Numbers of the record are full: each rounds to the printed one. Angles differ by whole circles at most.
    assert [pair.key for pair in found.pairs if not pair.alike] == []
    reports = {key.report for key in statistics_of_record(json.loads(path.read_text()))}
    assert {"adjusted points", "adjusted stations", "bathymetric points", "plate residuals"} <= reports


def test_tables_in_another_system_are_not_compared(tmp_path):
    solution = sample_solution()
    block = dataclasses.replace(solution.block, stated_in=SystemSpec(unit=AngleUnit.DEGREES))
    solution = dataclasses.replace(solution, block=block)
    (path := tmp_path / "job.json").write_text(dumps(record(solution)))
    found = side_by_side(listing_of(listing_text(solution), "job.lst"), path)
    assert all(pair.alike for pair in found.pairs)
    assert {"adjusted points", "adjusted stations"} <= {key.report for key in found.only_new}


def test_legacy_tables_beside_a_new_run():
    found = side_by_side(read_listing(table(5)), MODIFIED)
    pairs = {(pair.key.item, pair.key.statistic): pair for pair in found.pairs}
    assert len(pairs) == 3 * 7
    rms = pairs["Elevation", "rms"]
    assert (rms.old.text, rms.new.text, rms.alike) == ("25.00", "19.08", False)
    assert rms.difference == pytest.approx(-5.92, abs=1e-9)  # of two printed numbers
    assert pairs["Elevation", "size"].alike and not pairs["Elevation", "maximum at"].alike
    assert found.only_old == ()
    text = side_text(found, 30)
    assert ["Elevation", "rms", "25.00", "19.08", "-5.92", "m", "*"] in [line.split() for line in text.splitlines()]


def test_a_run_is_compared_with_its_own_kind():
    with pytest.raises(MusatError, match="no statistic that is in"):
        side_by_side(read_listing(table(1)), MODIFIED)


def test_a_report_that_does_not_say_its_run_is_of_the_only_one():
    text = table(5).read_text().replace("Modified MUSAT-IIA\nRefraction Correction Applied\n", "")
    found = side_by_side(listing_of(text, "x"), MODIFIED)
    assert len(found.pairs) == 3 * 7


def test_columns_and_pages_do_not_matter():
    lines = MODIFIED.read_text().replace("\f", "").splitlines()
    moved = "\n".join(["   " + line if "Differences" in line else line for line in lines if "PAGE" not in line])
    found = side_by_side(listing_of(moved, "moved"), MODIFIED)
    assert found.only_old == found.only_new == () and all(pair.alike for pair in found.pairs)


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"options": {}}', '{"options": {"refraction": "NONE"}}'])
def test_json_that_is_no_record_is_refused(content, tmp_path):
    (path := tmp_path / "new.json").write_text(content)
    with pytest.raises(MusatError, match="is no record of a run"):
        side_by_side(read_listing(MODIFIED), path)
