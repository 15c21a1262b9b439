"""Words into cells: every declared repair, what is not repaired, and readings that are not taken."""

import pytest

from listings.audit.report_tables import statistics_of, table
from musatpy.listings.audit import listing_of, read_listing
from musatpy.listings.audit.cells import RepairKind, read_cells

K = RepairKind


def reading(text, *kinds, places=None):
    return read_cells(text, kinds, places)


@pytest.mark.parametrize(
    ("text", "kinds", "cells", "repairs"),
    [
        ("-0 0 .281 104.71", ("angle", "number"), ("-0 0 .281", "104.71"), []),
        ("-0 0 \u2022281", ("angle",), ("-0 0 .281",), [(K.BULLET, "\u2022281", ".281")]),
        ("0 O 5.296", ("angle",), ("0 0 5.296",), [(K.ZERO, "O", "0")]),
        ("0 0 5.2l6", ("angle",), ("0 0 5.216",), [(K.ONE, "5.2l6", "5.216")]),
        ("!103 1215 1104", ("id",) * 3, ("1103", "1215", "1104"), [(K.ONE, "!103", "1103")]),
        ("|103 215 104", ("id",) * 3, ("103", "215", "104"), [(K.STRAY, "|103", "103")]),
        ("00 .081", ("angle",), ("0 0 .081",), [(K.JOINED, "00 .081", "0 0 .081")]),
        ("-00.454", ("angle",), ("-0 0 .454",), [(K.JOINED, "-00.454", "-0 0 .454")]),
        (
            "-1 \u00b722 2.182",
            ("angle",),
            ("-1 22 2.182",),
            [(K.BULLET, "\u00b722", ".22"), (K.STRAY, ".22", "22")],
        ),
        ("-5952644 .9", ("number",), ("-5952644.9",), [(K.SPLIT, "-5952644 .9", "-5952644.9")]),
        ("903378-8", ("number",), ("903378.8",), [(K.HYPHEN, "903378-8", "903378.8")]),
        ("10 1 0 10", ("count",) * 3, ("10", "10", "10"), [(K.SPLIT, "1 0", "10")]),
        ("<u>,</u> 845 84 6 ==== 84 2", ("id",) * 3, ("845", "846", "842"), None),
        ("10.47 ] ", ("number",), ("10.47",), [(K.BORDER, "]", "")]),
        ("10.47 __", ("number",), ("10.47",), [(K.STRAY, "__", "")]),
        ("A12 P-7", ("id", "id"), ("A12", "P-7"), []),
    ],
)
def test_a_row_is_read_with_the_repairs_that_it_takes(text, kinds, cells, repairs):
    found = reading(text, *kinds)
    assert found.texts == cells
    if repairs is not None:
        assert [(one.kind, one.found, one.read) for one in found.repairs(1)] == repairs


def test_a_lost_point_is_put_where_the_column_has_it():
    found = reading("66", "number", places=[2])
    assert found.texts == (".66",)
    assert [one.kind for one in found.repairs(1)] == [K.POINT]
    assert reading("66", "number") is None and reading("6600", "number", places=[2]) is None
    # A hyphen for the point, or a minus before a lost one; a digit that is no number.
    assert reading("-66", "number", places=[2]) is None and reading("6", "number", places=[1]) is None


@pytest.mark.parametrize(
    ("text", "kinds"),
    [
        ("10 10", ("count",) * 3),  # one is missing
        ("10 10 10 10", ("count",) * 3),  # one too many, not at the edge of a ruling
        ("1\u00a30.4", ("number",)),  # no declared repair
        ("12 34 56", ("id", "id")),  # 1234 56 or 12 3456
        ("12 30.847", ("angle",)),  # minutes whose degrees are lost, or 1 degree 2
        ("0 5.296", ("angle",)),  # degrees or minutes are lost
        ("001.543", ("angle",)),  # 0 0 1.543 or 0 01 .543
        ("0  0    .247      0  01.543             66.72", ("angle", "angle", "number")),
        ("0  0    .035      0  0    .050              4.87", ("number",) * 3),  # 00.035 is not how numbers print
        ("!103", ("id",)),  # a ruling and 103, or 1103
        ("- 5950270.4", ("number",)),  # a minus, or a stray hyphen
        ("S 0 .281", ("angle",)),
    ],
)
def test_what_cannot_be_read_is_not_guessed(text, kinds):
    assert reading(text, *kinds) is None


def test_bytes_that_are_not_utf8_are_windows_1252(tmp_path):
    text = table(1).read_text().replace(" .830", " \u2022830")
    (path := tmp_path / "x.lst").write_bytes(text.encode("cp1252"))
    (repair,) = read_listing(path).repairs
    assert (repair.kind, repair.read) == (K.BULLET, ".830")


@pytest.mark.parametrize(
    ("old", "new", "repairs"),
    [
        ("1042      Y", "] 1042    Y", [(K.BORDER, "]", "")]),
        ("1042      Y", "1042      \u00a5", [(K.LABEL, "\u00a5", "Y")]),
        ("1042      Y", "1042     [Y", [(K.BORDER, "[", "")]),
        ("1042      Y", "|1042     Y", [(K.STRAY, "|1042", "1042")]),
        ("1042      Y", "!042      Y", [(K.ONE, "!042", "1042")]),
    ],
)
def test_noise_beside_the_number_of_a_point_is_a_repair(old, new, repairs):
    text = table(9).read_text()
    assert old in text
    listing = listing_of(text.replace(old, new), "x")
    assert [(one.kind, one.found, one.read) for one in listing.repairs] == repairs
    assert listing.reports[-1].items[2] == "1042" and not listing.unreadable


@pytest.mark.parametrize(
    ("number", "old", "new", "message", "line"),
    [
        (1, ".830", "#??", "is not the 3 cells of 'rms'", 12),
        (1, "Standard Dev", "Standxrd Dev", "no row 'Standard Deviation from Mean' is legible below", 1),
        (1, "Camera Station Pos", "C4mera Station Pos", "a report without a legible title", 9),
        (4, "\nFrame   ", "\nFr#me   ", "no row 'Frame' is legible below", 1),
        (4, " 839 ", " 838 ", "a frame is there twice", 7),
        (4, "\nRMS of", "\nXXX of", "no row 'RMS of Trig Points x' is legible below", 1),
        (7, "Latitude ", "Lat ", "no row 'Latitude, Longitude, Elevation or X, Y, Z or East, North, Up (M)'", 1),
        (9, "        X                911407.6", "about   X                911407.6", "'about' beside the X", 15),
        (9, "1042      Y  ", "???       Y  ", "a point with no legible number: '???'", 16),
        (9, "1042      Y              -5950277.0        -5950277.4        -5950279.9\n", "", "the row of Y of", 16),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_reported_with_its_line_and_not_guessed(number, old, new, message, line):
    """One case for each message; all else is as it was."""
    text = table(number).read_text()
    if number == 7:  # the other line that tells the columns
        text = text.replace("(Degrees, Minutes, Seconds)", "")
    assert old in text
    listing = listing_of(text.replace(old, new), "job.lst")
    assert (listing.unreadable[0].file, listing.unreadable[0].line) == ("job.lst", line)
    assert message in listing.unreadable[0].headline() and listing.repairs == ()
    assert statistics_of(listing).items() <= statistics_of(read_listing(table(number))).items()
