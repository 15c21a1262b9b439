"""Photos across the page, three to a table: a photo more or less moves columns into other tables."""

from __future__ import annotations

import pytest

from musatpy.listings import compare_texts, parse_rules

PHOTOS = [f"{n}" for n in range(21, 29)]


def listing(photos, values=None, across=3, title="Plate Residuals"):
    """Return tables with the values of each photo, .021 and .121 of photo 21."""
    lines = []
    for first in range(0, len(photos), across):
        here = photos[first : first + across]
        rule = "=" * (12 + 8 * across)
        lines += ["", "", title, "(MM)", "", rule]
        lines += ["Frame       " + "".join(f"{photo:>8}" for photo in here), "-" * len(rule)]
        for n, label in enumerate(("RMS x", "RMS y")):
            texts = [(values or {}).get((label, photo), f".{n}{photo}") for photo in here]
            lines.append(f"{label:<12}" + "".join(f"{text:>8}" for text in texts))
        lines.append(rule)
    return "\n".join(lines) + "\n"


def compared(a, b, rules=""):
    return compare_texts(a, b, parse_rules(rules))


def shown(found):
    return [(one.kind, one.row, one.column, one.a, one.b) for one in found.findings]


@pytest.mark.parametrize("gone", PHOTOS)
def test_a_photo_less_is_one_finding(gone):
    rest = [photo for photo in PHOTOS if photo != gone]
    assert shown(compared(listing(PHOTOS), listing(rest))) == [("column", "(headings)", gone, "only in A", None)]
    assert shown(compared(listing(rest), listing(PHOTOS))) == [("column", "(headings)", gone, None, "only in B")]


@pytest.mark.parametrize("photo", PHOTOS[1:])
def test_columns_are_compared_in_whatever_table_they_stand(photo):
    a, b = listing(PHOTOS), listing(PHOTOS[1:], {("RMS y", photo): ".999"})
    first, *others = compared(a, b).findings
    assert (first.kind, first.column) == ("column", "21")
    (one,) = others
    assert (one.kind, one.row, one.column, one.a, one.b) == ("number", "RMS y", photo, f".1{photo}", ".999")
    lines = a.split("\n"), b.split("\n")
    assert f".1{photo}" in lines[0][one.place_a.line - 1]
    assert ".999" in lines[1][one.place_b.line - 1]


def test_other_widths_of_paper_are_no_difference_of_numbers():
    found = compared(listing(PHOTOS), listing(PHOTOS, across=8))
    assert found.same
    found = compared(listing(PHOTOS, across=8), listing(PHOTOS, {("RMS x", "28"): ".000"}))
    assert shown(found) == [("number", "RMS x", "28", ".028", ".000")]


def test_rules_know_the_photo_of_a_column_in_another_table():
    a, b = listing(PHOTOS), listing(PHOTOS[1:], {("RMS y", "24"): ".125"})
    known = "[[rule]]\ncolumn = '^21$'\nskip = true\n"
    assert not compared(a, b, known).same
    assert compared(a, b, f"{known}[[rule]]\nphoto = '24'\nlast_digits = 1\n").same
    assert not compared(a, b, f"{known}[[rule]]\nphoto = '23'\nlast_digits = 1\n").same


def test_tables_of_two_titles_keep_their_columns():
    a = listing(PHOTOS[:2]) + listing(PHOTOS[2:4], title="Other Residuals")
    b = listing(PHOTOS[:4]) + listing(PHOTOS[2:3], title="Other Residuals")
    assert shown(compared(a, b)) == [
        ("column", "(headings)", "23", None, "only in B"),
        ("section", "", "", None, "2 rows"),
        ("column", "(headings)", "24", "only in A", None),
    ]


def test_a_photo_that_a_title_has_twice_is_not_looked_for_elsewhere():
    a, b = listing(PHOTOS[:3]) + listing(PHOTOS[:3]), listing(PHOTOS[:2]) + listing(PHOTOS[:3])
    assert shown(compared(a, b)) == [("column", "(headings)", "23", "only in A", None)]
    assert shown(compared(b, a)) == [("column", "(headings)", "23", None, "only in B")]
