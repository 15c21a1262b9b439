"""Numbers as a page writes them."""

from __future__ import annotations

import math

import pytest

from musatpy.page.cells import angle_text, cell_text, number_text
from musatpy.units import DEGREE


@pytest.mark.parametrize(
    ("edit", "value", "text"),
    [
        ("F9.3", 0.1234, "0.123"),
        ("F9.3", -0.1234, "-0.123"),
        ("F9.3", -0.0004, "0.000"),
        ("F9.3", 123456789.1234, "123456789.123"),  # no asterisks: a page has room
        ("F9.3", None, ""),
        ("F9.3", math.nan, ""),
        ("F9.3", 4.2e15, "4.200e+15"),
        ("I6", 7, "7"),
        ("I6", 7.0, "7"),
        ("E17.9", 1.5e-9, "1.500000000e-09"),
        ("A8", "<b>", "<b>"),
        ("A8", ["21", "102"], "21 102"),
        ("S16.5", -0.5 * DEGREE, "-0° 30′ 00.00000″"),
        ("S14.3", 18.2 * DEGREE, "18° 12′ 00.000″"),
    ],
)
def test_values_of_cells(edit, value, text):
    assert cell_text(edit, value) == text


def test_angles_carry_and_have_no_sign_at_zero():
    assert angle_text(math.radians(1.0) - 1e-12, 3) == "1° 00′ 00.000″"
    assert angle_text(-1e-12, 3) == "0° 00′ 00.000″"
    assert number_text(-0.0, 1) == "0.0"
