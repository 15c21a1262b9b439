"""Photos across the page, three to a table."""

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


@pytest.mark.parametrize("gone", PHOTOS[6:])
def test_a_photo_less_in_the_last_table_is_one_finding(gone):
    rest = [photo for photo in PHOTOS if photo != gone]
    assert shown(compared(listing(PHOTOS), listing(rest))) == [("column", "(headings)", gone, "only in A", None)]
    assert shown(compared(listing(rest), listing(PHOTOS))) == [("column", "(headings)", gone, None, "only in B")]


def test_photos_that_stand_in_another_table_are_found():
    found = compared(listing(PHOTOS), listing(PHOTOS[1:]))
    assert {one.kind for one in found.findings} == {"column"}
    assert {one.column for one in found.findings} == {"21", "24", "27"}


def test_a_mark_below_another_photo_is_found():
    a, b = (f"{listing(PHOTOS[:2])}Largest     {stars}\n" for stars in ("    ****", "            ****"))
    assert [(one.row, one.column) for one in compared(a, b).findings] == [("Largest", "21"), ("Largest", "22")]


def test_rules_know_the_photo_of_a_column():
    a, b = listing(PHOTOS), listing(PHOTOS, {("RMS y", "24"): ".125"})
    assert compared(a, b, "[[rule]]\nphoto = '24'\nlast_digits = 1\n").same
    assert not compared(a, b, "[[rule]]\nphoto = '23'\nlast_digits = 1\n").same
