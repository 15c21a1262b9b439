"""Our own listings: consistent in every system of coordinates, and a spoiled number is found."""

from __future__ import annotations

import dataclasses
import re

import pytest

from listings.audit.report_tables import FIXTURES, statistics_of
from listings.audit.test_side_by_side import SPECS
from musatpy.campaign.baseline_index import load_baseline
from musatpy.listings.audit.checks import audit
from musatpy.listings.audit.cross_checks import Discrepancy
from musatpy.listings.audit.cross_checks import _largest as largest
from musatpy.listings.audit.reading import listing_of, read_listing
from musatpy.model import CoordinateSystem, Refraction
from musatpy.reports.listing import listing as listing_text
from musatpy.runs import run_deck
from sample_solutions import sample_solution

GOLDEN = load_baseline(FIXTURES)
CAYMAN = (FIXTURES / "cayman" / "cayman_modified.lst").read_text()


def audited(text):
    listing = listing_of(text, "x")
    assert listing.repairs == () and listing.unreadable == ()
    return audit(listing)


@pytest.mark.parametrize("deck", sorted(GOLDEN.entries))
def test_a_golden_listing_is_consistent(deck):
    listing = read_listing(GOLDEN.kept(deck)["lst"])
    if deck not in GOLDEN.runs:  # compilations have one analysis, and no plates
        assert len(listing.analyses) >= 3 and listing.plates
    assert listing.repairs == () and listing.unreadable == ()
    assert audit(listing) == []


@pytest.mark.parametrize("refraction", [Refraction.NONE, Refraction.WATPT])
@pytest.mark.parametrize("system", CoordinateSystem)
def test_listings_of_all_systems_are_consistent(system, refraction):
    assert audited(listing_text(sample_solution(system, refraction=refraction))) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["feet", "geocentric", "tilt"])
def test_listings_stated_in_other_systems_are_consistent(name):
    block = sample_solution().block
    given = None if name == "geocentric" else SPECS[name]  # its control has points without height
    block = dataclasses.replace(block, given_in=given, stated_in=SPECS[name])
    text = listing_text(dataclasses.replace(sample_solution(), block=block))
    assert listing_of(text, "x").stated
    assert audited(text) == []


def test_depths_of_some_decimetres_are_coordinates():
    """As FORTRAN prints them, without a digit before the point."""
    text = (FIXTURES / "waves" / "unknown.lst").read_text()
    shallow, count = re.subn(
        r"(?m)^( {15}Z)( +-\S+){3}$", r"\1" + "".join(f"{z:>18}" for z in ("-.4", "-.5", "-.6")), text
    )
    before, after = (listing_of(each, "x") for each in (text, shallow))
    assert count == sum(len(table.points) for table in before.submerged) > 0
    assert after.unreadable == () and after.repairs == ()
    depths = [point.xyz["refraction", "Z"].value for table in after.submerged for point in table.points]
    assert depths == [-0.6] * count


def test_carriage_control_changes_nothing():
    solution = sample_solution()
    plain, controlled = (
        listing_of(listing_text(solution, carriage_control=control), "x") for control in (False, True)
    )
    assert texts(plain) == texts(controlled) and len(texts(plain)) > 60
    assert audit(controlled) == []


def texts(listing):
    """Return the cells that can be compared, without their lines."""
    return {key: quantity.text for key, quantity in statistics_of(listing).items()}


def replaced(label, old, new, text=CAYMAN, after=""):
    """Return the listing with a cell of one row changed, in the same columns."""
    start = text.index(after)
    at = text.index(label, start)
    end = text.index("\n", at)
    row = text[at:end]
    assert row.count(old) == 1 and len(old) == len(new), row
    return text[:at] + row.replace(old, new) + text[end:]


@pytest.mark.parametrize(
    ("label", "old", "new", "item"),
    [
        ("Sum of Differences", "-0  0  4.113", "-0  0  4.173", "Longitude"),
        ("Mean Value of Differences", "    4.73", "    4.78", "Elevation"),
        ("RMS of Differences", "0  0   .137", "0  0   .131", "Latitude"),
        ("Standard Deviation from Mean", " .900", " .909", "Longitude"),
        ("Maximum Difference", "35.60", "35.80", "Elevation"),
        ("Sample Size", f"{10:16}{10:18}{10:18}", f"{10:16}{10:18}{11:18}", "Elevation"),
        ("Camera with Max. Difference", "845", "844", "Elevation"),
        ("Camera with Max. Difference", "845", "945", "Elevation"),
    ],
)
def test_a_spoiled_cell_of_an_analysis_is_found(label, old, new, item):
    findings = audited(replaced(label, old, new, after="Camera Station Position Analysis"))
    assert findings and all(item in one.item for one in findings)


@pytest.mark.parametrize(
    ("label", "old", "new", "frame"),
    [
        ("RMS of Trig. Points - y", " .004", " .009", "840"),
        ("RMS of Points Not Trig. - y", " .139", " .193", "841"),
        ("RMS of All Points - y", " .031", " .013", "841"),
    ],
)
def test_a_spoiled_plate_residual_is_found(label, old, new, frame):
    findings = audited(replaced(label, old, new))
    assert f"frame {frame}" in {one.item for one in findings}


@pytest.mark.parametrize(
    ("stars", "message"),
    [
        (f"{'****':>41}", "frame 840 is starred, the largest RMS is that of 841"),
        (f"{'****':>50}     ****", "2 frames are starred: 841, 842"),
        ("", "no frame is starred, though 841 has an RMS"),
    ],
)
def test_a_star_at_another_frame_a_second_one_and_a_missing_one_are_found(stars, message):
    label = "Frame With Max. RMS All Points"
    row = f"{label}{'****':>53}"
    assert row in CAYMAN
    (finding,) = audited(CAYMAN.replace(row, label + stars))
    assert finding.message == message


@pytest.mark.parametrize(
    ("row", "old", "new", "table"),
    [
        # seconds of an adjusted station, of an adjusted control point; a residual; its star; a depth
        (r"^839       RC8 .*$", "43.83300", "43.88300", "station position"),
        (r"^1103            triangulated.*$", "19 19 53", "19 19 58", "ground point"),
        (r"^841       1301         87.2070    -37.2550 .*$", "-139.37", "-193.37", "plate residuals"),
        (r"^841       1301         87.2070    -37.2550       1.94.*$", "*", " ", "residuals of plate"),
        (r"^1042           2       17.3        5.600 .*$", "5.974", "6.574", "bathymetric points"),
        (r"^1042           2       17.3        5.600 .*$", "-.508", "-.518", "depths of bathymetric points"),
    ],
)
def test_a_spoiled_cell_of_a_table_is_found(row, old, new, table):
    tail = CAYMAN.index("\nAdjusted Exposure Stations: Positions") if "RC8" in row else 0
    match = re.compile(row, re.MULTILINE).search(CAYMAN, tail)
    spoiled = CAYMAN[: match.start()] + match[0].replace(old, new, 1) + CAYMAN[match.end() :]
    assert spoiled != CAYMAN
    findings = audited(spoiled)
    assert findings and any(one.table.startswith(table) for one in findings)


def test_an_illegible_cell_of_a_table_is_reported_and_no_contradiction():
    spoiled = CAYMAN.replace("43.83300", "43.8E300")
    listing = listing_of(spoiled, "x")
    (problem,) = listing.unreadable
    assert problem.line == CAYMAN[: CAYMAN.index("43.83300")].count("\n") + 1
    assert problem.found == "19 21 43.8E300" and listing.repairs == () and audit(listing) == []


def test_sixty_seconds_are_no_angle():
    (finding,) = audited(CAYMAN.replace("0  2 24.135", "0  1 84.135"))
    assert finding.message == "no angle in degrees, minutes, seconds"


def test_a_point_that_is_nowhere_near_is_found():
    row = re.compile(r"^1044           Y .*$", re.MULTILINE).search(CAYMAN)[0]
    adjusted = row.split()[-1]
    (finding,) = audited(CAYMAN.replace(row, row.replace(adjusted, f"{float(adjusted) + 100:.1f}")))
    assert finding.item == "point 1044" and finding.suspects[0].item == "Y, refraction"


def test_a_submerged_point_without_a_position_is_no_contradiction(tmp_path):
    deck = (FIXTURES / "cayman" / "cayman_modified.crd").read_text().splitlines()
    rows = [row[:72] for row in deck if not row.startswith("PLT 841      1042 ")]
    (tmp_path / "job.crd").write_text("\n".join(rows))
    listing = read_listing(run_deck(tmp_path / "job.crd", out_dir=tmp_path).listing)
    assert listing.undetermined == ("1042",) and listing.unreadable == ()
    assert audit(listing) == []


@pytest.mark.parametrize(
    ("row", "old"),
    [
        (r"^841       1301         87.2070    -37.2550       1.94.*$", "-139.37"),  # a residual, um
        (r"^1103            triangulated.*$", "-81 27  8.83428"),  # an adjusted coordinate
    ],
)
def test_a_number_that_has_overflown_leaves_its_statistics_open(row, old):
    match = re.compile(row, re.MULTILINE).search(CAYMAN)
    assert match[0].count(old) == 1
    text = CAYMAN[: match.start()] + match[0].replace(old, "*" * len(old)) + CAYMAN[match.end() :]
    assert audited(text) == []


def test_predicted_points_are_held_against_their_depths_where_the_listing_has_these():
    row = re.compile(r"^1044           Y .*$", re.MULTILINE).search(CAYMAN)[0]
    predicted = row.split()[3]
    wrong = row.replace(f"{predicted}  ", f"{float(predicted) + 500:.1f}  ", 1)
    (finding,) = audited(CAYMAN.replace(row, wrong))
    assert finding.item == "point 1044" and "by the depths" in finding.message


def test_of_several_differences_that_may_be_the_largest_any_may_be():
    """By chance .018 and -.018 are printed, and the maximum is of either sign."""

    def sample(*values):
        return {str(number): Discrepancy(value=value, half=5e-4) for number, value in enumerate(values)}

    assert largest(sample(0.018, -0.018, 0.001)) == [0.018, -0.018]
    assert largest(sample(0.018, -0.0172)) == [0.018, -0.0172]
    assert largest(sample(0.018, -0.016)) == [0.018]


def test_pages_with_the_answer_and_the_index_are_no_run():
    solution = sample_solution()
    text = listing_text(solution)
    twice = listing_of(f"{text}\f{listing_text(solution, brief=True)}", "x")
    assert len(twice.runs) == 2 and twice.unreadable == ()
    assert [len(run.plates) for run in twice.runs] == [1, 0] and audit(twice) == []
    assert twice.runs[0].tables == listing_of(text, "x").tables
