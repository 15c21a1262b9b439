"""Words into cells: every declared repair, what is not repaired, and readings that are not taken."""

import pytest

from listings.audit.report_tables import table
from musatpy.listings.audit import audit, listing_of, read_listing
from musatpy.listings.audit.cells import RepairKind, read_cells
from musatpy.listings.audit.report import printed

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
        ("-001 .543", ("angle",), ("-0 01 .543",), [(K.JOINED, "-001 .543", "-0 01 .543")]),
        ("!103 1215 1104", ("id",) * 3, ("1103", "1215", "1104"), [(K.ONE, "!103", "1103")]),
        ("1103 1215 110|", ("id",) * 3, ("1103", "1215", "1101"), [(K.ONE, "110|", "1101")]),
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
        ("l0 10 10", ("count",) * 3, ("10", "10", "10"), [(K.ONE, "l0", "10")]),
        ("<u>,</u> 845 84 6 ==== 84 2", ("id",) * 3, ("845", "846", "842"), None),
        ("110 3 121 5 1104", ("id",) * 3, ("1103", "1215", "1104"), None),
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
        ("-122 2.182", ("angle",)),
        ("0 5.296", ("angle",)),  # degrees or minutes are lost
        ("001.543", ("angle",)),  # 0 0 1.543 or 0 01 .543
        ("0 01.543", ("angle",)),
        ("0  0    .247      0  01.543             66.72", ("angle", "angle", "number")),
        ("0  0    .035      0  0    .050              4.87", ("number",) * 3),  # 00.035 is not how numbers print
        ("!103", ("id",)),  # a ruling and 103, or 1103
        ("- 5950270.4", ("number",)),  # a minus, or a stray hyphen
        ("", ("count",)),
        ("S 0 .281", ("angle",)),
    ],
)
def test_what_cannot_be_read_is_not_guessed(text, kinds):
    assert reading(text, *kinds) is None


@pytest.mark.parametrize(
    ("text", "value", "half"),
    [("-0 0 .281", -0.281, 5e-4), ("-1 22 2.182", -4922.182, 5e-4), (".14", 0.14, 5e-3), ("7.5", 7.5, 0.05)],
)
def test_a_cell_is_a_number_with_its_rounding(text, value, half):
    cell = printed(text, 7)
    # Decimal fractions are not exact in binary: a few units of the last place.
    assert cell.value == pytest.approx(value, rel=1e-14) and cell.half == pytest.approx(half, rel=1e-14)


def test_a_row_that_cannot_be_read_is_a_problem_with_its_line():
    lines = table(1).read_text().splitlines()
    row = next(number for number, line in enumerate(lines) if line.startswith("RMS"))
    lines[row] = lines[row].replace(".830", "#??")
    listing = listing_of("\n".join(lines), "job.lst")
    (problem,) = listing.unreadable
    assert (problem.file, problem.line, problem.expected) == ("job.lst", row + 1, "the 3 cells of 'rms'")
    assert {what for _, what in listing.analyses[0].cells} == {
        *("size", "sum", "mean", "deviation", "maximum", "maximum at")
    }


@pytest.mark.parametrize(
    ("number", "label", "what"),
    [
        (1, "Standard Dev", "Standard Deviation from Mean"),
        (4, "RMS of All Points - x", "RMS of All Points x"),
        (4, "Frame With Max. RMS All", "Frame With Max RMS All Points"),
    ],
)
def test_a_row_without_a_legible_label_is_missed(number, label, what):
    text = table(number).read_text()
    spoiled = text.replace(label, "#" * len(label))
    assert spoiled != text
    (problem,) = listing_of(spoiled, "x").unreadable
    assert problem.message.startswith("no row '") and what in problem.message and problem.line == 1


def test_bytes_that_are_not_utf8_are_windows_1252(tmp_path):
    text = table(1).read_text().replace(" .830", " \u2022830")
    (path := tmp_path / "x.lst").write_bytes(text.encode("cp1252"))
    (repair,) = read_listing(path).repairs
    assert (repair.kind, repair.read) == (K.BULLET, ".830")


def test_stars_without_any_rms_and_a_frame_twice_are_problems():
    text = table(4).read_text()
    listing = listing_of(text.replace("\nRMS of", "\nXXX of"), "x")
    missing = [
        f"no row 'RMS of {name} {axis}'"
        for name in ("Trig Points", "Points Not Trig", "All Points")
        for axis in "xy"
    ]
    assert [one.message.removesuffix(" is legible below") for one in listing.unreadable] == missing
    assert audit(listing) == []
    (problem,) = listing_of(text.replace(" 839 ", " 838 ", 1), "x").unreadable
    assert problem.message == "a frame is there twice" and problem.line == 7


def test_a_star_below_no_frame_is_a_problem():
    text = table(4).read_text().replace("Frame With Max. RMS Trig. Pts.    ", "Frame With Max. RMS Trig. Pts. ****")
    assert ["below no frame" in one.message for one in listing_of(text, "x").unreadable] == [True]


@pytest.mark.parametrize("axis", "XYZ")
def test_three_rows_make_a_point(axis):
    lines = table(9).read_text().splitlines()
    at = next(number for number, line in enumerate(lines) if line.startswith("1042")) + "XYZ".index(axis) - 1
    del lines[at]
    listing = listing_of("\n".join(lines), "x")
    assert all(f"row of {axis} of a point is missing" in one.message for one in listing.unreadable[:1])
    assert len(listing.unreadable) >= 1 and listing.repairs == ()
    (found,) = listing.submerged
    names = read_listing(table(9)).submerged[0].items
    assert found.items == [name for name in names if name != "1042"]


@pytest.mark.parametrize(
    ("old", "new", "repairs"),
    [
        ("1042      Y", "] 1042    Y", [(K.BORDER, "]", "")]),
        ("1042      Y", "1 1042    Y", [(K.BORDER, "1", "")]),
        ("1042      Y", "1042      \u00a5", [(K.LABEL, "\u00a5", "Y")]),
        ("1042      Y", "1042     [Y", [(K.BORDER, "[", "")]),
        ("1042      Y", "1 042     Y", [(K.SPLIT, "1 042", "1042")]),
        ("1042      Y", "|1042     Y", [(K.STRAY, "|1042", "1042")]),
        ("1042      Y", "!042      Y", [(K.ONE, "!042", "1042")]),
    ],
)
def test_noise_beside_the_number_of_a_point_is_a_repair(old, new, repairs):
    text = table(9).read_text()
    assert old in text
    listing = listing_of(text.replace(old, new), "x")
    assert [(one.kind, one.found, one.read) for one in listing.repairs] == repairs
    assert listing.submerged[0].items[2] == "1042" and not listing.unreadable


def test_words_beside_a_coordinate_are_no_ruling():
    text = table(9).read_text().replace("        X                911407.6", "about   X                911407.6")
    (problem,) = listing_of(text, "x").unreadable
    assert problem.message == "'about' beside the X of a point"
