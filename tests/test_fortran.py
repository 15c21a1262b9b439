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


@pytest.mark.parametrize(
    ("text", "letter", "width", "decimals"),
    [("I3", "I", 3, 0), ("F12.6", "F", 12, 6), ("F5.0", "F", 5, 0), ("D6.1", "D", 6, 1), ("A68", "A", 68, 0)],
)
def test_descriptors_are_parsed_and_spelt(text, letter, width, decimals):
    edit = parse_edit(text)
    assert edit == Edit(letter=letter, width=width, decimals=decimals)
    assert str(edit) == text
    assert edit.is_number == (letter in "IFED")


@pytest.mark.parametrize(
    "text", ["", "F8", "I0", "I3.1", "A", "3X", "E6.2", "f8.3", "G8.3", "F8.3 ", "A" + "9" * 60]
)
def test_what_is_no_descriptor_is_refused(text):
    with pytest.raises(FieldError):
        parse_edit(text)


@pytest.mark.parametrize(
    ("edit", "field", "value"),
    [
        ("I4", "  +7", 7.0),
        ("I2", "-0", -0.0),
        ("F8.3", "    1500", 1.5),  # implied point
        ("F8.3", " 1.23456", 1.23456),  # the explicit point beats the implied one
        ("F8.3", "     5. ", 5.0),
        ("F8.3", "  -0.000", -0.0),
        ("F8.3", "   1.5D3", 1500.0),
        ("F8.3", "   1.5-3", 0.0015),
        ("F8.3", "    15D3", 15.0),  # implied point, then the exponent
        ("F8.3", "   1.5e3", 1500.0),
        ("E12.4", "  0.1234+102", 0.1234e102),
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


@pytest.mark.parametrize(
    ("edit", "field", "message"),
    [
        ("I4", "1.0", "is not"),  # neither point nor exponent
        ("I4", "1E3", "is not"),
        ("F8.3", "1.0E+309", "range of a float"),
        ("I20", f"{EXACT_INTEGERS + 1:20d}", r"2\*\*53"),
        ("I4", "12345", "5 characters"),
        ("F8.3", " " * 8, "is not F8"),
    ],
)
def test_numbers_that_a_field_cannot_have_are_refused(edit, field, message):
    with pytest.raises(FieldError, match=message):
        read_number(field, parse_edit(edit))


@pytest.mark.parametrize(
    ("edit", "field", "as_zeros", "as_nothing"),
    [
        ("F8.3", " " * 8, 0.0, math.nan),
        ("I4", "12", 1200.0, 12.0),  # a short record is filled with blanks
        ("F6.2", "12    ", 1200.0, 0.12),
        ("F6.2", "1.2   ", 1.2, 1.2),
        ("F6.2", "1.2E1 ", 1.2e10, 12.0),
        ("F6.2", "12E1  ", 0.12e100, 1.2),
    ],
)
def test_blanks_after_a_number_are_zeros_or_nothing(edit, field, as_zeros, as_nothing):
    """FORTRAN 66, and BLANK='ZERO' of FORTRAN 77; then BLANK='NULL'."""
    assert same(read_number(field, parse_edit(edit), blank="zero"), as_zeros)
    assert same(read_number(field, parse_edit(edit), blank="missing"), as_nothing)


def test_asterisks_are_no_value_where_allowed():
    edit = parse_edit("F8.3")
    assert math.isnan(read_number("   *****", edit, asterisks=True))
    with pytest.raises(FieldError):
        read_number("****1***", edit, asterisks=True)


@pytest.mark.parametrize(
    ("edit", "value", "field"),
    [
        ("I4", -1234, "****"),
        ("I3", -0.0, " -0"),  # degrees carry the sign of their angle
        ("F8.3", -0.0004, "   0.000"),  # FORTRAN 77: no sign on what prints as zero
        ("F8.3", -0.0006, "  -0.001"),
        ("F8.3", 99999.9995, "********"),
        ("F8.3", math.inf, "********"),
        ("F8.3", math.nan, "        "),
        ("F5.3", -0.281, "-.281"),  # no room for the zero
        ("F5.3", 0.281, "0.281"),
        ("F4.3", -0.281, "****"),
        ("F4.0", 12, " 12."),
        ("F1.0", 0.0, "*"),
        ("F5.2", 0.125, " 0.12"),  # a tie, to even
        ("F5.2", 1.005, " 1.00"),  # the binary value is below the tie
        ("E12.4", -12.34, " -0.1234E+02"),
        ("E12.4", 0.0, "  0.0000E+00"),
        ("E12.4", 99999.9, "  0.1000E+06"),
        ("E12.4", 1e99, "  0.1000+100"),  # three digits of exponent drop the letter
        ("E12.4", 5e-324, "  0.4941-323"),
        ("E10.4", -12.34, "-.1234E+02"),
        ("E9.4", -12.34, "*********"),
        ("D12.4", 12.34, "  0.1234D+02"),
    ],
)
def test_numbers_are_written(edit, value, field):
    assert write_number(value, parse_edit(edit)) == field


@pytest.mark.parametrize(
    ("edit", "value", "field"),
    [
        ("F7.5", -12.345678, "-12.346"),
        ("F7.5", 999999.4, "999999."),
        ("F7.5", 99.99999, "100.000"),
        ("F4.3", -0.281, "-.28"),
        ("E9.4", 12.34, ".1234E+02"),
        ("I4", -12, " -12"),
        # too small for the decimals, and not written as zero
        ("F5.3", -0.0042, "-.004"),
        ("F7.5", -1e-7, "-.1E-06"),
        ("F12.7", 1.23456e-8, ".00000001235"),
        ("F12.7", 0.0, "   0.0000000"),
    ],
)
def test_numbers_that_do_not_fit_lose_decimals(edit, value, field):
    parsed = parse_edit(edit)
    assert fit_number(value, parsed) == field
    assert (read_number(field, parsed) == 0.0) == (value == 0.0)


@pytest.mark.parametrize(
    ("edit", "value"),
    [
        ("F5.3", 1e-8),
        ("F7.5", 1e7),
        ("E9.4", -12.34),
        ("I4", 12345),
        ("I4", 1.5),
        ("F7.5", math.inf),
        ("F2.1", -0.3),
    ],
)
def test_numbers_that_never_fit_are_refused(edit, value):
    with pytest.raises(FieldError, match=r"fits|integer"):
        fit_number(value, parse_edit(edit))


@pytest.mark.parametrize(
    ("edit", "value", "field"),
    [
        ("F6.2", 0.31924, ".31924"),
        ("F6.2", 0.500001, "  0.50"),  # what does not fit rounds to what the descriptor writes
        ("F6.2", 9.9999996, " 10.00"),
        ("F8.3", 10.0 + 2e-15, "  10.000"),  # what a change of unit leaves is no digit
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


@given(st.integers(0, 15), st.integers(1, 10), st.data())
def test_every_fixed_number_is_read_back(decimals, before, data):
    edit = Edit(letter="F", width=decimals + before, decimals=decimals)
    smallest = 10 ** (edit.width - 2) - 1 if edit.width > 1 else 0
    ticks = data.draw(st.integers(-smallest, 10 ** (edit.width - 1) - 1))  # units of the last decimal
    assume(abs(ticks) < 10**15)  # beyond, neighbouring texts can be the same float
    text = f"{Decimal(ticks).scaleb(-decimals):.{decimals}f}" + ("" if decimals else ".")
    field = write_number(float(text), edit)
    if "*" in field:  # only `0.` and `-0.x` need a character more than their digits
        assert abs(ticks) < 10**decimals and len(text) > edit.width
        return
    assert field.strip() in (text, text.replace("0.", ".", 1))
    assert read_number(field, edit) == float(text)


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
@given(
    st.from_regex(r"[+-]?([0-9]{1,12}(\.[0-9]{0,8})?|\.[0-9]{1,8})([ED][+-]?[0-9]{1,2})?", fullmatch=True),
    st.integers(0, 9),
    st.integers(0, 5),
)
def test_points_are_read_as_python_does_and_implied_ones_exactly(text, decimals, before):
    edit = Edit(letter="F", width=len(text) + before + decimals + 1, decimals=decimals)
    mantissa, _, exponent = text.replace("D", "E").partition("E")
    implied = 0 if "." in text else decimals
    expected = float(f"{mantissa}E{int(exponent or 0) - implied}")
    assert same(read_number(" " * before + text, edit), expected)


@pytest.mark.parametrize(
    ("value", "decimals"),
    [(30.0, 2), (0.25, 2), (0.04, 2), (0.004, 3), (-0.0125, 4), (1e-9, 9), (0.0, 2), (1e6, 2), (0.1 + 0.2, 2)],
)
def test_a_value_is_told_with_the_decimals_that_it_needs(value, decimals):
    assert decimals_of(value, 2) == decimals
    assert float(f"{value:.{decimals}f}") == pytest.approx(value, rel=1e-11)  # twelve digits
