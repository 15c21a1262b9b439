"""The misprints of Tables 6-1 to 6-9 of ETL-0306, and no others: in the transcribed tables and in the scan."""

import csv
import re

import pytest

from listings.audit.report_tables import FIXTURES, inconsistencies, scan, table
from musatpy.listings.audit import audit, listing_of, read_listing
from musatpy.listings.audit.cells import RepairKind

# (table, item) of the contradictions that print alone shows, as the list of inconsistencies calls them, with what
# the audit says: report, item, cells one of which is wrong -> what they should be.
PRINTED = {
    ("6.3", "latitude RMS / SD"): (
        "ground point analysis, no refraction",
        "Latitude",
        {"RMS": "0 0 .075 to 0 0 .076", "standard deviation": "0 0 .037 to 0 0 .038"},
    ),
    ("6.5", "latitude mean"): ("station position analysis, refraction", "Latitude", {"mean": "-0 0 .010"}),
    ("6.6", "X-tilt mean"): ("station attitude analysis, refraction", "X-Tilt", {"mean": "-0 1 8.483"}),
    ("6.6", "heading mean"): (
        "station attitude analysis, refraction",
        "Heading",
        {"sum": "-0 0 .445 to -0 0 .435", "mean": "-0 0 .043"},
    ),
    # The list says -5952644.9 +- 0.3.
    ("6.9", "1056 predicted Y"): ("bathymetric points", "point 1056", {"Y, predicted": "about -5952645.0"}),
}
# What only the scan has wrong: kind of the repair, found, read.
SCANNED = {
    ("6.3", "latitude point id"): (RepairKind.SPLIT, "110 3", "1103"),
    ("6.3", "longitude point id"): (RepairKind.SPLIT, "121 5", "1215"),
    ("6.5", "longitude camera id"): (RepairKind.SPLIT, "84 4", "844"),
    ("6.7", "latitude point id"): (RepairKind.SPLIT, "121 10", "12110"),
}
GARBLED_TITLE = ("6.7", "title")  # a line of noise above a title that is whole
# What no listing can show.
OUT_OF_REACH = {
    ("6.9", "1043 refraction Y"): "a hypothesis from the heights: 7 m from the apparent position, as others are",
    ("6.9", "1050 refraction"): "a wrong orientation; its digits are right",
    ("6.9", "predicted column"): "a method: the points were moved along Z, and printed so",
    ("text", "'Tables 6-1 through 6-10'"): "prose",
    ("text", "'Frames 841 to 845 ... only frames which contained bathymetric points'"): "prose",
    ("text", "'improvement in the position analysis' (6.5 vs 6.1)"): "prose that reads the tables otherwise",
    ("text", "'slight improvement for the camera attitudes' (6.6 vs 6.2)"): "prose that reads the tables otherwise",
    ("text", "'slight improvement in Latitude' (6.7 vs 6.3)"): "prose that reads the tables otherwise",
    ("text", "'15 micrometre goal'"): "prose that reads the tables otherwise",
    ("3.3", "sea water index"): "not of section 6",
}


def said(findings):
    return [(one.table, one.item, {suspect.item: suspect.expected for suspect in one.suspects}) for one in findings]


def by_place(findings):
    return sorted(findings, key=str)


def test_every_known_inconsistency_is_covered_or_out_of_reach():
    known = {(row, item) for row, item in inconsistencies()}
    assert {*PRINTED, *SCANNED, GARBLED_TITLE, *OUT_OF_REACH} == known


@pytest.mark.parametrize("number", range(1, 10))
def test_a_transcribed_table_has_its_misprints_and_no_others(number):
    listing = read_listing(table(number))
    expected = [finding for (name, _), finding in PRINTED.items() if name == f"6.{number}"]
    assert listing.repairs == () and listing.unreadable == ()
    assert by_place(said(audit(listing))) == by_place(expected)


def test_all_tables_in_one_listing_have_the_same_misprints():
    text = "".join(table(number).read_text() + "\f" for number in range(1, 10))
    listing = listing_of(text, "report")
    assert [report.name.split()[-1] for report in listing.reports] == [
        *["analysis"] * 3, "residuals", *["analysis"] * 3, "residuals", "points"
    ]  # fmt: skip
    assert by_place(said(audit(listing))) == by_place(PRINTED.values())


def test_the_scan_has_the_same_misprints():
    listing = read_listing(scan())
    assert listing.unreadable == ()
    assert by_place(said(audit(listing))) == by_place(PRINTED.values())


def test_broken_ids_of_the_scan_are_repaired_and_noise_above_a_title_does_not_hide_it():
    path = scan()
    listing = read_listing(path)
    assert set(SCANNED.values()) <= {(one.kind, one.found, one.read) for one in listing.repairs}
    lines = path.read_text(encoding="utf-8").splitlines()
    title = next(one.line for one in listing.reports if one.title == "ground point analysis, refraction")
    assert any("The shall be a start" in line for line in lines[title - 3 : title])


def test_the_scan_says_what_the_transcribed_tables_say():
    scanned = numbers(read_listing(scan()))
    printed = {}
    for number in range(1, 10):
        printed |= numbers(read_listing(table(number)))
    assert scanned.keys() == printed.keys() and len(printed) == 6 * 21 + 2 * 60 + 12 * 9
    # The scan lost minus and point of two cells, and broke an id: the first column of Table 6-7.
    lost = {
        ("ground point analysis, refraction", "Elevation", "sum"): (".66", "-.66"),
        ("ground point analysis, refraction", "Elevation", "mean"): (".02", "-.02"),
        ("ground point analysis, refraction", "Latitude", "maximum at"): ("12110", "1210"),
    }
    assert {key: (scanned[key], printed[key]) for key in printed if scanned[key] != printed[key]} == lost


def numbers(listing):
    """Return every cell of the standard reports by what it is."""
    return {(report.title, *key): cell.text for report in listing.reports for key, cell in report.cells.items()}


# --- the fixtures hold the printed numbers ---

STATISTICS = {"sum_of_differences": "sum", "mean_of_differences": "mean", "rms_of_differences": "rms"}
STATISTICS |= {"std_dev_from_mean": "deviation", "maximum_difference": "maximum", "id_with_max": "maximum at"}
COMPONENTS = {"latitude": "Latitude", "longitude": "Longitude", "elev_m": "Elevation"}
COMPONENTS |= {"x_tilt": "X-Tilt", "y_tilt": "Y-Tilt", "heading": "Heading"}


def rows_of(name):
    with open(FIXTURES / "etl0306" / name, newline="") as file:
        return list(csv.DictReader(file))


def test_transcribed_analyses_are_those_of_the_report():
    rows = rows_of("analyses.csv")
    assert len(rows) == 6 * 18
    for row in rows:
        (analysis,) = (listing := read_listing(table(int(row["table"][-1])))).reports
        found = numbers(listing)
        component = COMPONENTS[row["component"]]
        text = found[analysis.title, component, STATISTICS[row["statistic"]]]
        # `-0 08` of the listing stands as `-0 8` there.
        assert re.sub(r" 0(\d)", r" \1", text) == re.sub(r" 0(\d)", r" \1", row["printed"]), row
        assert found[analysis.title, component, "size"] == row["size"]


def test_transcribed_plate_residuals_are_those_of_the_report():
    rows = rows_of("plate_residuals.csv")
    assert len(rows) == 20
    for row in rows:
        (plates,) = read_listing(table(int(row["table"][-1]))).reports
        for group in ("trig", "nontrig", "all"):
            for axis in "xy":
                assert plates.cells[row["frame"], f"{group}, {axis}"].value == float(row[f"rms_{group}_{axis}"])


def test_transcribed_bathymetric_points_are_those_of_the_report():
    (submerged,) = read_listing(table(9)).reports
    names = {"none": "no_refraction", "predicted": "predicted", "refraction": "refraction"}
    rows = rows_of("bathymetric.csv")
    assert submerged.items == [row["point"] for row in rows]
    for row in rows:
        assert f"\n{row['point']}{row['note']} " in table(9).read_text()
        for column, name in names.items():
            for axis in "XYZ":
                assert submerged.cells[row["point"], f"{axis}, {column}"].text == row[f"{axis}_{name}"]
