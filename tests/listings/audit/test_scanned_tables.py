"""Tabs, stars and mark-up of scanned tables: put right and reported, or noted; never lost in silence."""

from __future__ import annotations

import re

import pytest

from listings.audit.report_tables import statistics_of, table
from musatpy.listings.audit.checks import audit
from musatpy.listings.audit.reading import listing_of
from musatpy.listings.audit.structures import RepairKind

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
