"""Options, headings, rules and stars under noise: put right and reported, or noted; never lost in silence."""

from __future__ import annotations

import re

import pytest

from listings.audit.report_tables import FIXTURES, statistics_of, table
from musatpy.listings.audit.checks import audit
from musatpy.listings.audit.headings import AUDITED, Title, audited_tables
from musatpy.listings.audit.reading import listing_of
from musatpy.listings.audit.structures import RepairKind

OWN = (FIXTURES / "st_thomas" / "st_thomas.lst").read_text()
STATISTICS = statistics_of(listing_of(OWN, "x"))
K = RepairKind


def after(title):
    return OWN.index("\n", OWN.index(f"\n{title}\n") + 1)


def spoiled(title, old, new):
    """Return the listing with the first such text below a title changed, and its line."""
    at = OWN.index(old, after(title))
    return OWN[:at] + new + OWN[at + len(old) :], OWN[:at].count("\n") + 1


def seen(text):
    listing = listing_of(text, "x")
    return [(one.line, one.kind) for one in listing.repairs], [one.message for one in listing.unreadable]


@pytest.mark.parametrize(
    ("title", "old", "new", "kinds"),
    [
        ("Size Of The Job", "Photos .", "Ph0tos .", [K.ZERO]),
        ("Size Of The Job", ". 48", ". 4 8", [K.SPLIT]),
        ("Size Of The Job", "... 48", ".\u2022. 48", []),
        ("Options", "Initial values", "lnitial values", [K.ONE]),
        ("Options", "GIVEN", "G1VEN", [K.ONE]),
        ("Options", "GEOG", "GE0G", [K.ZERO]),
        ("Solution Summary", " .936128", " \u2022936l28", [K.BULLET, K.ONE]),
        ("Solution Summary", "Degrees of freedom", "Degrees 0f freed0m", [K.ZERO]),
        ("Adjusted Ground Points", "Longitude", "L0ngitude", [K.ZERO]),
        ("Depths Of Bathymetric Points", "Depth, no refr.", "Depth. n0 refr.", [K.ZERO]),
        ("Plate Residuals Of The Job", "\nall ", "\na11 ", [K.ONE]),
    ],
)
def test_noise_in_what_the_audit_uses_is_put_right(title, old, new, kinds):
    text, line = spoiled(title, old, new)
    listing = listing_of(text, "x")
    assert [one.kind for one in listing.repairs] == kinds and listing.unreadable == ()
    assert {one.line for one in listing.repairs} <= {line + old.startswith("\n")}
    assert statistics_of(listing) == STATISTICS and audit(listing) == []


@pytest.mark.parametrize(
    ("title", "old", "new", "said"),
    [
        ("Size Of The Job", ". 48", ". 4B", "'4B' is no value of 'Plate measurements'"),
        ("Size Of The Job", "Photos .", "Phxtxs .", "no row 'Photos' is legible below"),
        ("Options", "GIVEN", "GxVEN", "'GxVEN  station and attitude cards' is no value of 'Initial values'"),
        ("Options", "Coordinate system", "Cxxrdinate system", "no row 'Coordinate system' is legible below"),
        ("Adjusted Ground Points", "Longitude", "Lxngitude", "without a legible heading: 'Lxngitude'"),
        ("Plate Residuals Of The Job", "\nall ", "\nxxx ", "no row 'all' is legible below"),
    ],
)
def test_what_the_audit_needs_is_noted_where_it_is_not_legible(title, old, new, said):
    _, unreadable = seen(spoiled(title, old, new)[0])
    assert [said in one for one in unreadable] == [True]


@pytest.mark.parametrize("title", [title for title in audited_tables() if f"\n{title}\n" in OWN])
def test_a_table_whose_rule_is_torn_is_noted(title):
    rule = re.compile(r"^-+(?:  -+)+$", re.MULTILINE).search(OWN, after(title))
    torn = rule[0][:2] + "." + rule[0][3:]
    _, unreadable = seen(OWN[: rule.start()] + torn + OWN[rule.end() :])
    assert f"the rule of dashes below the headings of '{title}' is not legible" in unreadable


def test_titles_that_the_audit_uses_are_stated_by_reports():
    assert [table.title for table in AUDITED] == list(Title)
    assert sorted(table.title for table in audited_tables().values()) == sorted(Title)


def test_two_cells_without_a_heading_are_no_split_number():
    heading = "Kind      Photo, point "
    assert heading in OWN
    repairs, _ = seen(OWN.replace(heading, "Kind      Pxxxx, pxxxx "))
    assert repairs == []


def tabbed(text):
    """Return the text with tabs for the blanks before columns of eight, as an editor may leave it."""
    lines = []
    for line in text.split("\n"):
        stops = "\x00".join(line[n : n + 8] for n in range(0, len(line), 8))
        lines.append(re.sub(r" +(?=\x00)", "\t", stops).replace("\x00", ""))
    return "\n".join(lines)


@pytest.mark.parametrize("text", [OWN, table(4).read_text(), table(8).read_text()], ids=["own", "6-4", "6-8"])
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
