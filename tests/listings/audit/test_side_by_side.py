"""A legacy listing beside a newer run: the same statistic of the same id, from a listing or a record."""

import json

import pytest

from listings.audit.report_tables import FIXTURES, statistics_of, table
from musatpy.listings.audit import listing_of, read_listing, side_by_side
from musatpy.listings.audit.against import Key, StatisticPair, numbers_of, side_text
from musatpy.listings.audit.report import PrintedNumber
from musatpy.model import CoordinateSystem
from musatpy.reports.listing import listing as listing_text
from musatpy.reports.record import dumps, record
from record_rows import read_rows, with_columns
from sample_solutions import sample_solution

STANDARD, MODIFIED = (FIXTURES / "cayman" / f"cayman_{name}.lst" for name in ("standard", "modified"))


@pytest.mark.slow
@pytest.mark.parametrize("system", CoordinateSystem)
def test_a_listing_is_like_the_record_of_its_run(system, tmp_path):
    solution = sample_solution(system)
    path = saved(solution, tmp_path)
    listing = listing_of(listing_text(solution), "job.lst")
    found = side_by_side(listing, path)
    assert found.only_old == () and len(found.pairs) == len(statistics_of(listing))
    # Numbers of the record are full: each rounds to the printed one. Angles differ by whole circles at most.
    assert [pair.key for pair in found.pairs if not pair.alike] == []
    reports = {pair.key.report for pair in found.pairs}
    assert {"ground point analysis", "bathymetric points", "plate residuals"} <= reports


def saved(solution, tmp_path):
    (path := tmp_path / "job.json").write_text(dumps(record(solution)))
    return path


def test_what_is_changed_in_the_record_is_a_difference(tmp_path):
    path = saved(sample_solution(), tmp_path)
    changed = read_rows(path)
    changed["analyses"]["camera_station_attitude"][2]["mean"] += 2e-8  # 0.004 arc seconds, printed to .001
    changed["analyses"]["ground_point"][2]["maximum_id"] = "none"
    changed["analyses"]["check_point"][0]["size"] += 1
    changed["plate_statistics"]["frames"][1]["rms"][2][1] += 1e-3
    changed["bathymetric_points"][2]["predicted"][0] += 0.1
    path.write_text(json.dumps(with_columns(changed)))
    found = side_by_side(listing_of(listing_text(sample_solution()), "job.lst"), path)
    point, frame = changed["bathymetric_points"][2]["point"], changed["plate_statistics"]["frames"][1]["photo"]
    assert {(one.key.report, one.key.item, one.key.statistic) for one in found.pairs if not one.alike} == {
        ("station attitude analysis", "Heading", "mean"),
        ("ground point analysis", "Elevation", "maximum at"),
        ("check point analysis", "East", "size"),
        ("plate residuals", frame, "all, y"),
        ("bathymetric points", point, "X, predicted"),
    }


def test_a_whole_circle_is_no_difference():
    key = Key(report="x", refracted=None, item="1", statistic="Heading")
    old, new = (PrintedNumber(value, 0.0005, "", unit="arcsec") for value in (647999.9999, -648000.0))
    assert StatisticPair(key=key, old=old, new=new).alike


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


def test_a_report_that_does_not_say_its_run_is_of_the_only_one():
    text = table(5).read_text().replace("Modified MUSAT-IIA\nRefraction Correction Applied\n", "")
    assert len(side_by_side(listing_of(text, "x"), MODIFIED).pairs) == 3 * 7


@pytest.mark.slow
def test_what_two_runs_say_otherwise_is_not_compared(tmp_path):
    (both := tmp_path / "both.lst").write_text(STANDARD.read_text() + "\f" + MODIFIED.read_text())
    found = side_by_side(read_listing(MODIFIED), both)
    assert all(pair.alike for pair in found.pairs) and found.only_old == ()
    compared = {pair.key for pair in found.pairs}
    assert {key for key in compared if key.refracted} == {
        key for key in statistics_of(read_listing(MODIFIED)) if key.refracted
    }
    assert compared.isdisjoint(found.several) and "bathymetric points" in {key.report for key in found.several}
    assert set(found.several) == numbers_of(read_listing(both))[1]
