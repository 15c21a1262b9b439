"""Our own listings, those of compilations and scanned tables are audited by their standard reports."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from listings.audit.report_tables import FIXTURES, statistics_of, table
from musatpy.campaign.baseline_index import load_baseline
from musatpy.cli.main import main as musat
from musatpy.listings.audit import audit, listing_of, read_listing
from musatpy.listings.audit.analyses import consistent, implied, sizes_implied
from musatpy.listings.audit.cells import RepairKind
from musatpy.model import CoordinateSystem, Refraction
from musatpy.reports.listing import listing as listing_text
from sample_solutions import sample_solution
from stage_readings import DECK

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
    assert count == sum(len(table.items) for table in before.submerged) > 0
    assert after.unreadable == () and after.repairs == ()
    depths = [table.cells[point, "Z, refraction"].value for table in after.submerged for point in table.items]
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


LISTING = DECK.with_suffix(".lst")


def by_command(path: Path) -> Result:
    return CliRunner().invoke(musat, ["audit", str(path)])


def test_the_listing_of_a_compilation_is_consistent_and_a_wrong_mean_is_not(tmp_path: Path) -> None:
    result = by_command(LISTING)
    assert result.exit_code == 0 and "1 analysis" in result.output and "Repairs" not in result.output
    text = LISTING.read_text()
    (row,) = [line for line in text.splitlines() if line.startswith("Mean Value of Differences")]
    changed = tmp_path / "changed.lst"
    changed.write_text(text.replace(row, row.replace("-.0300", "-.0330")))
    assert by_command(changed).exit_code == 1


K = RepairKind


def tabbed(text):
    """Return the text with tabs for the blanks before columns of eight, as an editor may leave it."""
    lines = []
    for line in text.split("\n"):
        stops = "\x00".join(line[n : n + 8] for n in range(0, len(line), 8))
        lines.append(re.sub(r" +(?=\x00)", "\t", stops).replace("\x00", ""))
    return "\n".join(lines)


@pytest.mark.parametrize("text", [table(4).read_text(), table(8).read_text()], ids=["6-4", "6-8"])
def test_tabs_for_blanks_change_nothing(text):
    assert tabbed(text).count("\t") > 20 and tabbed(text).expandtabs() == text
    listing = listing_of(tabbed(text), "x")
    assert listing.repairs == listing.unreadable == () and audit(listing) == []
    assert statistics_of(listing) == statistics_of(listing_of(text, "x"))


STARS = "Frame With Max. RMS All Pts."


@pytest.mark.parametrize(
    ("star", "repairs", "said"),
    [
        ("****,", [K.STRAY], []),
        ("'****", [K.STRAY], []),
        ("***", [], ["'***' in a row of stars"]),
        ("** **", [], ["'**' in a row of stars"]),
        ("**x*", [], ["'**x*' in a row of stars"]),
    ],
)
def test_a_torn_star_is_no_missing_star(star, repairs, said):
    text = table(4).read_text()
    at = text.index("****", text.index(STARS))
    assert text[at - 1 : at + 5] == " ****\n"
    start = min(at, at + 4 - len(star))
    listing = listing_of(text[:start] + star.rjust(4) + text[at + 4 :], "x")
    assert [one.kind for one in listing.repairs] == repairs
    assert [one.message for one in listing.unreadable] == said and audit(listing) == []


def test_mark_up_that_is_left_out_is_reported():
    text = table(1).read_text().replace("27.30\n", "27.30 <u> </u>\n")
    listing = listing_of(text, "x")
    assert [(one.kind, one.found) for one in listing.repairs] == [(K.STRAY, "<u>"), (K.STRAY, "</u>")]
    assert statistics_of(listing) == statistics_of(listing_of(table(1).read_text(), "x"))


NAMES = ("sum", "mean", "rms", "deviation", "maximum")


def sample_statistics(d):
    N, mean = len(d), d.mean()
    found = {"sum": d.sum(), "mean": mean, "rms": np.sqrt((d**2).mean()), "maximum": d[np.abs(d).argmax()]}
    if N > 1:
        found["deviation"] = np.sqrt(((d - mean) ** 2).sum() / (N - 1))
    return found


def printed(statistics, decimals):
    half = 0.5 * 10.0**-decimals
    rounded = {name: round(float(value), decimals) for name, value in statistics.items()}
    return {name: (value - half, value + half) for name, value in rounded.items()}


def samples():
    random = np.random.default_rng(6)
    for N in (1, 2, 3, 7, 10, 35, 500):
        for scale in (1e-3, 0.05, 1.0, 300.0):
            for offset in (0.0, 1.0, -5.0):
                yield scale * (random.standard_normal(N) + offset)
                yield scale * np.full(N, offset)  # all alike: every bound is reached


@pytest.mark.parametrize("decimals", [2, 3])
def test_no_real_sample_is_contradictory(decimals):
    for d in samples():
        truth = sample_statistics(d)
        cells = printed(truth, decimals)
        assert consistent(len(d), cells), d
        for name in cells:
            bounds = implied(len(d), name, cells)
            if bounds is not None:
                slack = 1e-9 * abs(truth[name]) + 1e-12  # rounding of the arithmetic
                assert bounds[0] - slack <= truth[name] <= bounds[1] + slack, (name, d)


def test_a_statistic_that_is_far_off_is_a_contradiction():
    d = np.random.default_rng(1).standard_normal(10) + 0.4
    cells = printed(sample_statistics(d), 3)
    for name, (low, high) in cells.items():
        for factor in (0.1, 10.0):
            middle = 0.5 * (low + high) * factor
            spoiled = cells | {name: (middle - 5e-4, middle + 5e-4)}
            assert not consistent(10, spoiled), (name, factor)


def test_the_maximum_is_bounded_on_both_sides():
    base = {"sum": (-0.01, 0.01), "rms": (0.99, 1.01)}
    assert not consistent(4, base | {"maximum": (0.9, 0.95)})  # below the RMS
    # Of four numbers with sum 0 and RMS 1 the largest is sqrt(3) at most, with the others at -1 / sqrt(3).
    assert consistent(4, base | {"maximum": (1.72, 1.74)})
    assert not consistent(4, base | {"maximum": (1.79, 1.81)})
    assert consistent(4, base | {"maximum": (-1.74, -1.72)})


def test_the_sign_of_the_maximum_matters():
    # Three of four at 1 and one at 1.2 or -1.2: sums of 4.2 and 1.8.
    cells = {"sum": (4.19, 4.21), "rms": (1.04, 1.06)}
    assert consistent(4, cells | {"maximum": (1.19, 1.21)})
    assert not consistent(4, cells | {"maximum": (-1.21, -1.19)})


def test_sizes_that_sum_and_mean_allow():
    assert list(sizes_implied({"sum": (9.99, 10.01), "mean": (0.999, 1.001)})) == [10]
    assert list(sizes_implied({"sum": (0.99, 1.01), "mean": (-0.001, 0.001)})) == []
    assert list(sizes_implied({"sum": (-10.01, -9.99), "mean": (0.999, 1.001)})) == []
