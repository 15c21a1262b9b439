"""Listings, our own and those of the report, are audited by their standard reports."""

import re

import numpy as np
import pytest

from listings.audit.report_tables import FIXTURES, statistics_of, table
from musatpy.campaign.baselines import load_baseline
from musatpy.listings.audit import audit, listing_of, read_listing

GOLDEN = load_baseline(FIXTURES)
STANDARD, MODIFIED = (FIXTURES / "cayman" / f"cayman_{name}.lst" for name in ("standard", "modified"))
CAYMAN = MODIFIED.read_text()


def audited(text):
    listing = listing_of(text, "x")
    assert listing.repairs == () and listing.unreadable == ()
    return audit(listing)


@pytest.mark.parametrize("deck", sorted(GOLDEN.entries))
def test_a_golden_listing_is_consistent(deck):
    listing = read_listing(GOLDEN.kept(deck)["lst"])
    if deck not in GOLDEN.runs:  # compilations have one analysis, and no plates
        names = [report.name for report in listing.reports]
        assert sum(name.endswith("analysis") for name in names) >= 3 and "plate residuals" in names
    assert listing.repairs == () and listing.unreadable == ()
    assert audit(listing) == []


def submerged(listing):
    return [report for report in listing.reports if report.name == "bathymetric points"]


def test_depths_of_some_decimetres_are_coordinates():
    """As FORTRAN prints them, without a digit before the point."""
    text = (FIXTURES / "waves" / "unknown.lst").read_text()
    shallow, count = re.subn(
        r"(?m)^( {15}Z)( +-\S+){3}$", r"\1" + "".join(f"{z:>18}" for z in ("-.4", "-.5", "-.6")), text
    )
    before, after = (listing_of(each, "x") for each in (text, shallow))
    assert count == sum(len(table.items) for table in submerged(before)) > 0
    assert after.unreadable == () and after.repairs == ()
    depths = [table.cells[point, "Z, refraction"].value for table in submerged(after) for point in table.items]
    assert depths == [-0.6] * count


@pytest.mark.parametrize(
    ("source", "row", "old", "new", "item"),
    [
        (MODIFIED, "RMS of Points Not Trig. - y", " .139", " .009", "frame 841"),
        (MODIFIED, "RMS of All Points - y", " .031", " .213", "frame 841"),
        (table(4), "RMS of All Points - y", " .033", "-.033", "frame 841"),  # roots are not negative
        (table(1), "Standard Dev", " 0  0    .144", "-0  0    .144", "Latitude"),
    ],
)
def test_a_number_that_contradicts_others_is_found_at_its_line(source, row, old, new, item):
    lines = source.read_text().splitlines()
    (at,) = (n for n, line in enumerate(lines) if line.startswith(row))
    assert lines[at].count(old) == 1
    lines[at] = lines[at].replace(old, new)
    known = {(one.item, one.message) for one in audit(read_listing(source))}
    findings = [one for one in audit(listing_of("\n".join(lines), "x")) if (one.item, one.message) not in known]
    assert item in {one.item for one in findings}
    if "-" in new:
        (found,) = findings
        assert found.line == at + 1 and " ".join(new.split()) in [suspect.found for suspect in found.suspects]


def test_an_error_in_the_second_run_is_found_at_its_line():
    spoiled = MODIFIED.read_text().replace("-0  0  4.113", "-0  0  4.173")
    found = audit(listing_of(STANDARD.read_text() + "\f" + spoiled, "x"))
    (alone,) = {one.line for one in audit(listing_of(spoiled, "x"))}
    assert {one.line for one in found} == {alone + STANDARD.read_text().count("\n")}


def test_sixty_seconds_are_no_angle():
    (finding,) = audited(CAYMAN.replace("0  2 24.135", "0  1 84.135"))
    assert finding.message == "no angle in degrees, minutes, seconds"


def test_a_point_that_is_nowhere_near_is_found():
    row = re.compile(r"^1044           Y .*$", re.MULTILINE).search(CAYMAN)[0]
    adjusted = row.split()[-1]
    (finding,) = audited(CAYMAN.replace(row, row.replace(adjusted, f"{float(adjusted) + 100:.1f}")))
    assert finding.item == "point 1044" and finding.suspects[0].item == "Y, refraction"


@pytest.mark.parametrize("source", [MODIFIED, table(4)])
def test_line_ends_tabs_and_a_byte_order_mark_change_nothing(source, tmp_path):
    text = source.read_text().replace("        ", "\t" if source == table(4) else "        ")
    (path := tmp_path / "x.lst").write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode() + b"\f")
    found, plain = read_listing(path), read_listing(source)
    assert found.repairs == found.unreadable == () and statistics_of(found) == statistics_of(plain)


def test_ids_with_letters_that_look_like_digits_are_no_noise():
    text = (FIXTURES / "st_thomas_utm" / "st_thomas_utm.lst").read_text().replace("ROCK", "I0l ")
    listing = listing_of(text, "x")
    assert listing.repairs == () and listing.unreadable == ()
    assert any(report.name == "bathymetric points" and "I0l" in report.items for report in listing.reports)


LABELS = {
    "sum": "Sum of Differences", "mean": "Mean Value of Differences", "rms": "RMS of Differences",
    "standard deviation": "Standard Deviation from Mean", "maximum": "Maximum Difference",
}  # fmt: skip


def statistics(d):
    N, mean = len(d), d.mean()
    found = {"sum": d.sum(), "mean": mean, "rms": np.sqrt((d**2).mean()), "maximum": d[np.abs(d).argmax()]}
    if N > 1:
        found["standard deviation"] = np.sqrt(((d - mean) ** 2).sum() / (N - 1))
    return found


def misprints(N, cells, decimals=3):
    """Return what the audit finds in an analysis of three columns that say the same, in the first of them."""
    rows = {"Sample Size": str(N)} | {LABELS[name]: f"{value:.{decimals}f}" for name, value in cells.items()}
    rows["Point with Max. Difference"] = "7"
    lines = [f"{label:<36}" + f"{text:>18}" * 3 for label, text in rows.items()]
    listing = listing_of("\n".join(["Ground Point Analysis", "", "X (M)   Y (M)   Z (M)", *lines]), "x")
    return [one for one in audit(listing) if one.item == "X"]


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
        assert misprints(len(d), statistics(d), decimals) == [], d


def test_a_statistic_that_is_far_off_is_found_and_what_it_should_be():
    d = np.random.default_rng(1).standard_normal(10) + 0.4
    truth = statistics(d)
    for name in truth:
        for factor in (0.1, 10.0):
            (found,) = misprints(10, truth | {name: truth[name] * factor})
            suspects = {one.item.lower(): one.expected for one in found.suspects}
            ends = [float(end) for end in suspects[name].split(" to ") if end]
            # ends of ranges are rounded to a thousandth
            assert not ends or ends[0] - 6e-4 <= truth[name] <= ends[-1] + 6e-4
    (found,) = misprints(11, truth)
    assert ("sample size", "10") in [(one.item, one.expected) for one in found.suspects]


@pytest.mark.parametrize(
    ("cells", "is_possible"),
    [
        ({"sum": 0.0, "rms": 1.0, "maximum": 0.93}, False),  # below the RMS
        # of four numbers with sum 0 and RMS 1 the largest is sqrt(3) at most, with the others at -1 / sqrt(3)
        ({"sum": 0.0, "rms": 1.0, "maximum": 1.73}, True),
        ({"sum": 0.0, "rms": 1.0, "maximum": 1.80}, False),
        ({"sum": 0.0, "rms": 1.0, "maximum": -1.73}, True),
        # three of four at 1 and one at 1.2 or -1.2: sums of 4.2 and 1.8
        ({"sum": 4.2, "rms": 1.05, "maximum": 1.2}, True),
        ({"sum": 4.2, "rms": 1.05, "maximum": -1.2}, False),
    ],
)
def test_the_maximum_is_bounded_on_both_sides_and_has_a_sign(cells, is_possible):
    assert (misprints(4, cells, decimals=2) == []) is is_possible
