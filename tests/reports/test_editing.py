"""Output editing of whole columns, against the editing of single fields and the printed tables."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from musatpy.fortran import FieldError, parse_edit, write_number
from musatpy.reports.editing import edited, field_width, prints_as_zero
from musatpy.units import ARC_SECOND

NAN = math.nan


@given(st.floats(allow_nan=True, allow_infinity=True), st.integers(3, 20), st.integers(0, 8))
def test_fixed_is_fortran_without_the_zero_before_the_point(value, width, decimals):
    if width < decimals + 2:
        return
    plain = write_number(value, parse_edit(f"F{width}.{decimals}"))
    words = plain.split()
    if words and words[0].lstrip("-").startswith("0.") and decimals:
        plain = words[0].replace("0.", ".", 1).rjust(width)
    assert edited(f"F{width}.{decimals}", [value]) == [plain]


@pytest.mark.parametrize(
    ("edit", "value", "text"),
    [
        ("F8.2", -0.66, "    -.66"),  # Table 6-7
        ("F8.2", 0.14, "     .14"),  # Table 6-3
        ("F8.2", 10.04, "   10.04"),
        ("F8.2", -0.004, "     .00"),
        ("F8.2", 0.996, "    1.00"),
        ("F6.2", 1000.0, "******"),
        ("F6.2", -100.0, "******"),
        ("F6.2", NAN, "      "),
        ("F6.2", math.inf, "******"),
        ("I4", 12, "  12"),
        ("I4", -12345, "****"),
        ("E10.3", 0.00015, "  .150E-03"),
        ("E10.3", 0.0, "  .000E+00"),
        ("A4", "AB", "AB  "),
        ("A4", "ABCDEF", "ABCD"),
        ("S14.3", -0.281 * ARC_SECOND, "  -0  0   .281"),  # Table 6-1
        ("S14.3", -4922.182 * ARC_SECOND, "  -1 22  2.182"),  # Table 6-2
        ("S14.3", 0.0, "   0  0   .000"),
        ("S14.3", -0.0004 * ARC_SECOND, "   0  0   .000"),  # no sign on what rounds to zero
        ("S14.3", -0.0006 * ARC_SECOND, "  -0  0   .001"),
        ("S14.3", 59.9996 * ARC_SECOND, "   0  1   .000"),  # the carry goes through
        ("S14.3", -3599.9999 * ARC_SECOND, "  -1  0   .000"),
        ("S14.3", math.pi, " 180  0   .000"),
        ("S14.3", NAN, " " * 14),
        ("S14.3", 1e9, "*" * 14),
        ("S14.3", math.inf, "*" * 14),
    ],
)
def test_one_field(edit, value, text):
    assert edited(edit, [value]) == [text]
    assert field_width(edit) == len(text)


@pytest.mark.parametrize("edit", ["", "Q8", "F8", "S14", "F2.5"])
def test_what_is_no_descriptor(edit):
    with pytest.raises(FieldError):
        edited(edit, [1.0])


@pytest.mark.parametrize(
    ("edit", "value", "zero"),
    [
        ("F8.3", 0.0004, True),
        ("F8.3", -0.0006, False),
        ("F6.3", 1e9, False),  # asterisks are no zero
        ("S14.3", 1e-12, True),
        ("S14.3", ARC_SECOND, False),
        ("F8.3", 100.0, False),
    ],
)
def test_prints_as_zero(edit, value, zero):
    assert prints_as_zero(edit, value) is zero
