"""Our own listings: consistent in every system of coordinates, and a spoiled number is found."""

from __future__ import annotations

import re

import pytest

from listings.audit.report_tables import FIXTURES, statistics_of
from musatpy.campaign.baseline_index import load_baseline
from musatpy.listings.audit.checks import audit
from musatpy.listings.audit.reading import listing_of, read_listing
from musatpy.model import CoordinateSystem, Refraction
from musatpy.reports.listing import listing as listing_text
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
        ("Maximum Difference", "35.60", "65.60", "Elevation"),
        ("Sample Size", f"{10:16}{10:18}{10:18}", f"{10:16}{10:18}{11:18}", "Elevation"),
        ("Camera with Max. Difference", "845", "945", "Elevation"),
    ],
)
def test_a_spoiled_cell_of_an_analysis_is_found(label, old, new, item):
    findings = audited(replaced(label, old, new, after="Camera Station Position Analysis"))
    assert findings and all(item in one.item for one in findings)


@pytest.mark.parametrize(
    ("label", "old", "new", "frame"),
    [
        ("RMS of Points Not Trig. - y", " .139", " .009", "841"),
        ("RMS of All Points - y", " .031", " .213", "841"),
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


def test_sixty_seconds_are_no_angle():
    (finding,) = audited(CAYMAN.replace("0  2 24.135", "0  1 84.135"))
    assert finding.message == "no angle in degrees, minutes, seconds"


def test_a_point_that_is_nowhere_near_is_found():
    row = re.compile(r"^1044           Y .*$", re.MULTILINE).search(CAYMAN)[0]
    adjusted = row.split()[-1]
    (finding,) = audited(CAYMAN.replace(row, row.replace(adjusted, f"{float(adjusted) + 100:.1f}")))
    assert finding.item == "point 1044" and finding.suspects[0].item == "Y, refraction"
