"""Listings as a whole: pages, several runs, missing lines, and noise of a scanner."""

import pytest

from listings.audit.report_tables import FIXTURES, statistics_of, table
from musatpy.listings.audit import audit, listing_of, read_listing, side_by_side
from musatpy.listings.audit.against import numbers_of

STANDARD, MODIFIED = (FIXTURES / "cayman" / f"cayman_{name}.lst" for name in ("standard", "modified"))


def test_an_error_in_the_second_run_is_found_at_its_line():
    spoiled = MODIFIED.read_text().replace("-0  0  4.113", "-0  0  4.173")
    found = audit(listing_of(STANDARD.read_text() + "\f" + spoiled, "x"))
    (alone,) = {one.line for one in audit(listing_of(spoiled, "x"))}
    assert {one.line for one in found} == {alone + STANDARD.read_text().count("\n")}


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


@pytest.mark.parametrize("source", [MODIFIED, table(4)])
def test_line_ends_tabs_and_a_byte_order_mark_change_nothing(source, tmp_path):
    text = source.read_text().replace("        ", "\t" if source == table(4) else "        ")
    (path := tmp_path / "x.lst").write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode() + b"\f")
    found, plain = read_listing(path), read_listing(source)
    assert found.repairs == found.unreadable == () and statistics_of(found) == statistics_of(plain)


@pytest.mark.parametrize(
    ("number", "row", "old", "item", "found"),
    [
        (1, "Standard Dev", " 0  0    .144", "Latitude", "-0 0 .144"),
        (4, "RMS of All Points - y", " .033", "frame 841", "-.033"),
    ],
)
def test_a_negative_root_is_found(number, row, old, item, found):
    lines = table(number).read_text().splitlines()
    (at,) = (n for n, line in enumerate(lines) if line.startswith(row))
    assert lines[at].count(old) == 1
    lines[at] = lines[at].replace(old, "-" + old.lstrip())
    known = {(one.item, one.message) for one in audit(read_listing(table(number)))}
    findings = [one for one in audit(listing_of("\n".join(lines), "x")) if (one.item, one.message) not in known]
    assert [(one.item, one.line) for one in findings] == [(item, at + 1)]
    assert found in [suspect.found for suspect in findings[0].suspects]


OWN = (FIXTURES / "st_thomas_utm" / "st_thomas_utm.lst").read_text()


# Kind of noise -> where it falls, what it makes of the text there, and the repair that it takes.
# Rows of the standard reports.
def test_ids_with_letters_that_look_like_digits_are_no_noise():
    text = OWN.replace("ROCK", "I0l ")
    listing = listing_of(text, "x")
    assert listing.repairs == () and listing.unreadable == ()
    assert any(report.name == "bathymetric points" and "I0l" in report.items for report in listing.reports)
