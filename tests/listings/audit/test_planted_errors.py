"""Errors planted in our own listings: the audit finds these, and nothing else."""

from __future__ import annotations

import re
from functools import cache

import pytest

from listings.audit.report_tables import FIXTURES
from musatpy.listings.audit.checks import audit
from musatpy.listings.audit.reading import listing_of

TEXT = (FIXTURES / "st_thomas" / "st_thomas.lst").read_text()
UTM = (FIXTURES / "st_thomas_utm" / "st_thomas_utm.lst").read_text()


def after(text, title):
    """Return where the rows below a title begin."""
    return text.index("\n", text.index(f"\n{title}\n") + 1)


def changed(text, title, row, change):
    """Return the text with the first row of a pattern below a title changed, and its line."""
    match = re.compile(row, re.MULTILINE).search(text, after(text, title))
    line = text[: match.start()].count("\n") + 1
    return text[: match.start()] + change(match[0]) + text[match.end() :], line


@cache
def told(text):
    listing = listing_of(text, "x")
    assert listing.repairs == () and listing.unreadable == ()
    return [(one.table, one.item, one.message) for one in audit(listing)]


def without(row):
    return ""


def twice(row):
    return row + row


POSITIONS, ATTITUDES = "Adjusted Exposure Stations: Positions", "Adjusted Exposure Stations: Attitudes"
RESIDUALS = "Residuals Of Plate Measurements: Adjusted Minus Measured"


@pytest.mark.parametrize(
    ("title", "row", "change", "items"),
    [
        (ATTITUDES, r"^22 .*\n", without, {("adjusted exposure stations: attitudes", "photo 22")}),
        ("Adjusted Ground Points", r"^204 .*\n", twice, {("adjusted ground points", "point 204")}),
        ("Adjusted Ground Points", r"^204 .*\n", without, {("residuals of plate measurements", "point 204")}),
        (RESIDUALS, r"^21        204 .*\n", twice, {("residuals of plate measurements", "photo 21, point 204")}),
        (RESIDUALS, r"^21        204 .*\n", without, {("residuals of plate measurements", "plate measurements")}),
        ("Depths Of Bathymetric Points", r"^206 .*\n", without, {("depths of bathymetric points", "point 206")}),
        ("Size Of The Job", r"^Photos .*", lambda row: row[:-1] + "4", {("size of the job", "photos")}),
        (
            "Size Of The Job",
            r"^Plate measurements .*",
            lambda row: row[:-1] + "9",
            {("residuals of plate measurements", "plate measurements")},
        ),
        (
            "Plate Residuals Of The Job",
            r"^all .*",
            lambda row: row[:-1] + "9",
            {("plate residuals of the job", "all points")},
        ),
        (
            "Plate Residuals Of The Job",
            r"^triangulated  .*",
            lambda row: row.replace(" 48 ", " 47 "),
            {("plate residuals of the job", "triangulated points")},
        ),
    ],
)
@pytest.mark.parametrize("text", [TEXT, UTM], ids=["geographic", "stated"])
def test_rows_that_are_missing_or_twice_and_wrong_counts(text, title, row, change, items):
    spoiled, _ = changed(text, title, row, change)
    assert spoiled != text and told(text) == []
    found = told(spoiled)
    assert items <= {(table, item) for table, item, _ in found}
    wanted = " ".join(item for _, item in items).split()[-1]
    # What else is said is of the same row: its RMS, the counts of its table.
    assert all(wanted in " ".join(one) or re.search(r"RMS|have|them|number of", one[2]) for one in found)


@pytest.mark.parametrize(
    ("label", "change"),
    [
        ("Mean Value of Differences", 0.4),
        ("Standard Deviation from Mean", 0.4),
        ("Sum of Differences", 5.0),
        ("RMS of Differences", 5.0),
    ],
)
@pytest.mark.parametrize("text", [TEXT, UTM], ids=["geographic", "stated"])
def test_a_changed_statistic_of_a_stated_job_too(text, label, change):
    def moved(row):
        last = row.split()[-1]
        other = f"{float(last) + change:.2f}"
        return row[: -len(last)] + other

    spoiled, _ = changed(text, "Camera Station Position Analysis", rf"^{label}.*", moved)
    found = told(spoiled)
    assert any("contradict" in said for *_, said in found) and {item for _, item, _ in found} == {"Elevation"}


def test_a_listing_that_ends_too_early_is_not_whole():
    cut = TEXT[: TEXT.index("\nAdjusted Ground Points")]
    problems = [problem.message for problem in listing_of(cut, "x").unreadable]
    assert any("'Adjusted Ground Points' is missing" in one for one in problems)
    short = TEXT[: after(TEXT, RESIDUALS) + 900]
    found = audit(listing_of(short, "x"))
    assert ("residuals of plate measurements", "plate measurements") in {(one.table, one.item) for one in found}
