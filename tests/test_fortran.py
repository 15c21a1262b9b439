"""FORTRAN editing: the rules one by one, and every representable value written and read back."""

import math
from decimal import ROUND_HALF_EVEN, Decimal

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from musatpy.fortran import (
    EXACT_INTEGERS,
    Edit,
    FieldError,
    decimals_of,
    fit_number,
    parse_edit,
    read_number,
    write_number,
)


def same(value: float, expected: float) -> bool:
    """Equal with the sign of zero, NaN equal to itself."""
    if math.isnan(expected):
        return math.isnan(value)
    return value == expected and math.copysign(1, value) == math.copysign(1, expected)


# --- descriptors ---


@pytest.mark.parametrize(
    ("text", "letter", "width", "decimals"),
    [
        ("I3", "I", 3, 0),
        ("F12.6", "F", 12, 6),
        ("F5.0", "F", 5, 0),
        ("F4.3", "F", 4, 3),
        ("E16.9", "E", 16, 9),
        ("D6.1", "D", 6, 1),
        ("A68", "A", 68, 0),
    ],
)
def test_descriptors_are_parsed_and_spelt(text, letter, width, decimals):
    edit = parse_edit(text)
    assert edit == Edit(letter=letter, width=width, decimals=decimals)
    assert str(edit) == text
    assert edit.is_number == (letter in "IFED")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "F8",
        "I0",
        "I3.1",
        "A",
        "3X",
        "E6.2",
        "f8.3",
        "G8.3",
        "F8.3 ",
    ],
)
def test_what_is_no_descriptor_is_refused(text):
    with pytest.raises(FieldError):
        parse_edit(text)


# --- reading numbers ---


@pytest.mark.parametrize(
    ("edit", "field", "value"),
    [
        ("I4", "  12", 12.0),
        ("I4", "  +7", 7.0),
        ("I2", "-0", -0.0),
        ("I4", "12  ", 12.0),  # BLANK='NULL'
        ("F8.3", "    1500", 1.5),  # implied point
        ("F8.3", "1500    ", 1.5),
        ("F8.3", " 1.23456", 1.23456),  # the explicit point beats the implied one
        ("F8.3", "     5. ", 5.0),
        ("F8.3", "  -.281 ", -0.281),
        ("F8.3", "  -0.000", -0.0),
        ("F8.3", "  1.5E+3", 1500.0),
        ("F8.3", "   1.5D3", 1500.0),
        ("F8.3", "   1.5+3", 1500.0),
        ("F8.3", "   1.5-3", 0.0015),
        ("F8.3", "    15D3", 15.0),  # implied point, then the exponent
        ("F8.3", "   1.5e3", 1500.0),
        ("E12.4", "  0.1234+102", 0.1234e102),
        ("E12.4", "        1234", 0.1234),
        ("F20.6", "  4.9E-324          ", 5e-324),
    ],
)
def test_numbers_are_read(edit, field, value):
    assert same(read_number(field, parse_edit(edit)), value)


@pytest.mark.parametrize("edit", ["I8", "F8.3", "E8.1", "D8.1"])
@pytest.mark.parametrize(
    "field",
    [
        "1l.345  ", "1 2.5   ", "- 1.5   ", "1.5E    ", "1.5E+   ", "1.5 E3  ", "1.5E 3  ", "1..5    ", "1.5.    ",
        ".       ", "-       ", "+.      ", "E5      ", "+-1     ", "1,5     ", "nan     ", "inf     ", "0x10    ",
        "1_000   ", "1.5F3   ", "1.5E3.  ", "********", "12*     ", "\t1.5    ", "１２      ",
    ],
)  # fmt: skip
def test_junk_is_refused(edit, field):
    with pytest.raises(FieldError, match="is not"):
        read_number(field, parse_edit(edit))


@pytest.mark.parametrize("field", ["1.0", " 1.", "1E3", "1+3"])
def test_integers_have_neither_point_nor_exponent(field):
    with pytest.raises(FieldError):
        read_number(field, parse_edit("I4"))


def test_numbers_beyond_a_float_are_refused():
    with pytest.raises(FieldError, match="range of a float"):
        read_number("1.0E+309", parse_edit("F8.3"))
    with pytest.raises(FieldError, match=r"2\*\*53"):
        read_number(f"{EXACT_INTEGERS + 1:20d}", parse_edit("I20"))


def test_a_field_wider_than_its_descriptor_is_refused():
    with pytest.raises(FieldError, match="5 characters"):
        read_number("12345", parse_edit("I4"))


def test_a_blank_field_follows_its_rule():
    edit = parse_edit("F8.3")
    assert same(read_number(" " * 8, edit, blank="zero"), 0.0)
    assert math.isnan(read_number(" " * 8, edit, blank="missing"))
    with pytest.raises(FieldError, match="is not F8"):
        read_number(" " * 8, edit)


@pytest.mark.parametrize(
    ("edit", "field", "as_zeros", "as_nothing"),
    [
        ("I4", "12  ", 1200.0, 12.0),
        ("I4", "12", 1200.0, 12.0),  # a short record is filled with blanks
        ("F6.2", "12    ", 1200.0, 0.12),
        ("F6.2", "1.2   ", 1.2, 1.2),
        ("F6.2", "1.2E1 ", 1.2e10, 12.0),
        ("F6.2", "12E1  ", 0.12e100, 1.2),
    ],
)
def test_blanks_after_a_number_are_zeros_or_nothing(edit, field, as_zeros, as_nothing):
    # FORTRAN 66, and BLANK='ZERO' of FORTRAN 77; then BLANK='NULL'.
    assert read_number(field, parse_edit(edit), blank="zero") == as_zeros
    assert read_number(field, parse_edit(edit), blank="missing") == as_nothing
    assert read_number(field, parse_edit(edit), blank="error") == as_nothing


def test_asterisks_are_no_value_where_allowed():
    edit = parse_edit("F8.3")
    assert math.isnan(read_number("********", edit, asterisks=True))
    assert math.isnan(read_number("   *****", edit, asterisks=True))
    with pytest.raises(FieldError):
        read_number("****1***", edit, asterisks=True)


# --- writing numbers ---


@pytest.mark.parametrize(
    ("edit", "value", "field"),
    [
        ("I4", 12, "  12"),
        ("I4", -1234, "****"),
        ("I3", -0.0, " -0"),  # degrees carry the sign of their angle
        ("F8.3", 0.0, "   0.000"),
        ("F8.3", -0.0, "   0.000"),
        ("F8.3", -0.0004, "   0.000"),  # FORTRAN 77: no sign on what prints as zero
        ("F8.3", -0.0006, "  -0.001"),
        ("F8.3", 99999.9995, "********"),
        ("F8.3", math.inf, "********"),
        ("F8.3", math.nan, "        "),
        ("F4.3", 0.281, ".281"),  # no room for the zero
        ("F5.3", -0.281, "-.281"),
        ("F5.3", 0.281, "0.281"),
        ("F4.3", -0.281, "****"),
        ("F4.3", 0.9996, "****"),
        ("F4.0", 12, " 12."),
        ("F2.0", 0.0, "0."),
        ("F1.0", 0.0, "*"),
        ("F5.2", 0.125, " 0.12"),  # a tie, to even
        ("F5.2", 1.005, " 1.00"),  # the binary value is below the tie
        ("E12.4", -12.34, " -0.1234E+02"),
        ("E12.4", 0.0, "  0.0000E+00"),
        ("E12.4", 99999.9, "  0.1000E+06"),
        ("E12.4", 1e99, "  0.1000+100"),  # three digits of exponent drop the letter
        ("E12.4", 1e-100, "  0.1000E-99"),
        ("E12.4", 5e-324, "  0.4941-323"),
        ("E10.4", -12.34, "-.1234E+02"),
        ("E9.4", 12.34, ".1234E+02"),
        ("E9.4", -12.34, "*********"),
        ("D12.4", 12.34, "  0.1234D+02"),
        ("D12.4", 1e-200, "  0.1000-199"),
    ],
)
def test_numbers_are_written(edit, value, field):
    assert write_number(value, parse_edit(edit)) == field


def test_a_fraction_is_no_integer():
    with pytest.raises(FieldError, match="integer"):
        write_number(1.5, parse_edit("I4"))


@pytest.mark.parametrize(
    ("edit", "value", "field"),
    [
        ("F7.5", 0.012345678, "0.01235"),
        ("F7.5", 12.345678, "12.3457"),
        ("F7.5", -12.345678, "-12.346"),
        ("F7.5", 999999.4, "999999."),
        ("F7.5", 99.99999, "100.000"),
        ("F4.3", -0.281, "-.28"),
        ("E9.4", 12.34, ".1234E+02"),
        ("I4", -12, " -12"),
    ],
)
def test_numbers_that_do_not_fit_lose_decimals(edit, value, field):
    assert fit_number(value, parse_edit(edit)) == field


@pytest.mark.parametrize(
    ("edit", "value", "field"),
    [
        ("F5.3", 0.00042, ".0004"),
        ("F5.3", -0.0042, "-.004"),
        ("F7.5", 1e-7, ".10E-06"),
        ("F7.5", -1e-7, "-.1E-06"),
        ("F12.7", 1.23456e-8, ".00000001235"),
        ("F9.8", -2.38788e-8, "-.239E-07"),
        ("F12.7", 0.0, "0.0000000"),
    ],
)
def test_numbers_too_small_for_their_decimals_are_not_written_as_zero(edit, value, field):
    parsed = parse_edit(edit)
    assert fit_number(value, parsed) == field.rjust(parsed.width)
    assert (read_number(field.rjust(parsed.width), parsed) == 0.0) == (value == 0.0)


@pytest.mark.parametrize(
    ("edit", "value"),
    [("F5.3", 1e-8), ("F7.5", 1e7), ("E9.4", -12.34), ("I4", 12345), ("F7.5", math.inf), ("F2.1", -0.3)],
)
def test_numbers_that_never_fit_are_refused(edit, value):
    with pytest.raises(FieldError, match="fits"):
        fit_number(value, parse_edit(edit))


@pytest.mark.parametrize(
    ("edit", "value", "field"),
    [
        ("F6.2", 0.31924, ".31924"),
        ("F6.2", 0.5, "  0.50"),
        ("F6.2", 0.500001, "  0.50"),  # what does not fit rounds to what the descriptor writes
        ("F6.2", 12.3456789, "12.346"),
        ("F6.2", 9.9999996, " 10.00"),
        ("F8.3", 10.0 + 2e-15, "  10.000"),  # what a change of unit leaves is no digit
        ("F8.3", 1.2345e-5, ".0000123"),
        ("F7.2", 0.0, "   0.00"),
        ("F6.2", 1.23e-7, ".1E-06"),
    ],
)
def test_numbers_with_all_digits_that_fit(edit, value, field):
    assert fit_number(value, parse_edit(edit), all_digits=True) == field


@given(width=st.integers(4, 12), decimals=st.integers(0, 3), value=st.floats(1e-9, 1e3))
def test_all_digits_are_never_farther_off(width, decimals, value):
    """What is read back is the value to its last digit that fits, and at least as near as by the descriptor."""
    edit = Edit(letter="F", width=width, decimals=decimals)
    try:
        few = read_number(fit_number(value, edit), edit)
    except FieldError:
        return
    read = read_number(fit_number(value, edit, all_digits=True), edit)
    places = width - 1 - (len(str(int(value))) if value >= 1.0 else 0)
    last = 10.0 ** -max(places, 0)
    assert abs(read - value) <= min(max(0.5 * last, 1e-11 * value) * (1.0 + 1e-9), abs(few - value)) or value < last


# --- every representable value ---


@given(width=st.integers(1, 17), data=st.data())
def test_every_integer_is_read_back(width, data):
    edit = Edit(letter="I", width=width)
    largest = min(10**width - 1, EXACT_INTEGERS)
    number = data.draw(st.integers(-min(10 ** (width - 1) - 1, EXACT_INTEGERS), largest))
    field = write_number(float(number), edit)
    assert field == f"{number:{width}d}"
    assert read_number(field, edit) == number


@st.composite
def fixed_fields(draw):
    """A descriptor Fw.d and a number that it can hold, as an integer of units of the last decimal."""
    decimals = draw(st.integers(0, 15))
    width = decimals + draw(st.integers(1, 10))
    largest = 10 ** (width - 1) - 1
    smallest = 10 ** (width - 2) - 1 if width > 1 else 0
    return Edit(letter="F", width=width, decimals=decimals), draw(st.integers(-smallest, largest))


@given(fixed_fields())
def test_every_fixed_number_is_read_back(drawn):
    edit, ticks = drawn
    assume(abs(ticks) < 10**15)  # beyond, neighbouring texts can be the same float
    text = f"{Decimal(ticks).scaleb(-edit.decimals):.{edit.decimals}f}" + ("" if edit.decimals else ".")
    value = float(text)
    field = write_number(value, edit)
    if "*" in field:  # only `0.` and `-0.x` need a character more than their digits
        assert abs(ticks) < 10**edit.decimals and len(text) > edit.width
        return
    assert field.strip() in (text, text.replace("0.", ".", 1))
    assert read_number(field, edit) == value


@given(st.integers(1, 17), st.sampled_from("ED"), st.floats(allow_nan=False, allow_infinity=False))
@example(9, "E", 9.999999999999999e22)
@example(17, "D", 1.7976931348623157e308)
@example(17, "E", 5e-324)
def test_every_float_under_e_and_d(decimals, letter, value):
    edit = Edit(letter=letter, width=decimals + 7, decimals=decimals)
    field = write_number(value, edit)
    assert len(field) == edit.width
    # Python's own rounding to as many digits is the reference.
    rounded = float(f"{value:.{decimals - 1}e}")
    if math.isinf(rounded):
        with pytest.raises(FieldError, match="range"):
            read_number(field, edit)
        return
    assert read_number(field, edit) == rounded
    assert write_number(rounded, edit) == field
    if decimals == 17:  # enough digits for any float
        assert rounded == value


@given(st.floats(-1e9, 1e9), st.integers(0, 9))
def test_fixed_rounding_is_that_of_the_exact_binary_value(value, decimals):
    edit = Edit(letter="F", width=25, decimals=decimals)
    exact = Decimal(value).quantize(Decimal(1).scaleb(-decimals), rounding=ROUND_HALF_EVEN)
    expected = f"{abs(exact) if exact == 0 else exact:.{decimals}f}" + ("" if decimals else ".")
    assert write_number(value, edit).strip() == expected


@pytest.mark.slow
@given(st.from_regex(r"[+-]?([0-9]{1,12}\.[0-9]{0,8}|\.[0-9]{1,8})([ED][+-]?[0-9]{1,2})?", fullmatch=True))
def test_explicit_points_are_read_as_python_does(text):
    edit = Edit(letter="F", width=len(text), decimals=0)
    assert same(read_number(text, edit), float(text.replace("D", "E")))


@pytest.mark.slow
@given(st.from_regex(r"[+-]?[0-9]{1,12}", fullmatch=True), st.integers(0, 9), st.integers(0, 5))
def test_implied_points_are_read_exactly(text, decimals, before):
    edit = Edit(letter="F", width=len(text) + before + decimals + 1, decimals=decimals)
    field = " " * before + text
    assert same(read_number(field, edit), float(f"{text}E-{decimals}"))


@given(st.text(st.sampled_from("0123456789+-.ED *"), min_size=6, max_size=6))
def test_any_field_reads_or_is_refused(field):
    for descriptor in ("I6", "F6.2", "E6.1"):
        try:
            value = read_number(field, parse_edit(descriptor), blank="missing", asterisks=True)
        except FieldError as error:
            assert error.found == field
        else:
            assert math.isfinite(value) or not field.strip(" *")


@pytest.mark.parametrize(
    ("value", "decimals"),
    [(30.0, 2), (0.25, 2), (0.04, 2), (0.004, 3), (-0.0125, 4), (1e-9, 9), (0.0, 2), (1e6, 2), (0.1 + 0.2, 2)],
)
def test_a_value_is_told_with_the_decimals_that_it_needs(value, decimals):
    assert decimals_of(value, 2) == decimals
    assert float(f"{value:.{decimals}f}") == pytest.approx(value, rel=1e-11)  # twelve digits


def test_no_descriptor_is_wider_than_any_line() -> None:
    with pytest.raises(FieldError, match="less than 10000 columns"):
        parse_edit("A" + "9" * 60)
