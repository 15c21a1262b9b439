"""Output editing of whole columns, against the editing of single fields and the printed tables."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from musatpy.fortran import FieldError, parse_edit, write_number
from musatpy.reports import table
from musatpy.reports.characters import strings
from musatpy.reports.editing import MANY, characters, edited, field_width, prints_as_zero
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


NUMBERS = st.floats(allow_nan=True, allow_infinity=True) | st.floats(-1e4, 1e4) | st.integers(-(10**6), 10**6)
SHORT = st.integers(-(10**7), 10**7).map(lambda number: number / 2**7)  # decimals that are ties
TIES = st.integers(-(10**6), 10**6).map(lambda number: (number + 0.5) / 1000.0)  # but for the last bit


@given(
    st.lists(NUMBERS.map(float) | SHORT | TIES, min_size=1, max_size=30),
    st.sampled_from(
        ["F8.2", "F10.4", "F12.3", "F6.3", "F5.2", "F4.0", "F20.15", "E11.3", "S14.3", "S11.3", "S9.2"]
    ),
)
def test_columns_are_edited_as_their_values_are(values, edit):
    column = np.array(values * MANY)
    if edit.startswith("S"):
        column = column * ARC_SECOND
    alone = [edited(edit, [value])[0] for value in column[: len(values)].tolist()]
    assert edited(edit, column) == alone * MANY
    assert strings(characters(edit, column[: len(values)])) == alone


@given(st.lists(st.integers(-(10**7), 10**7), min_size=1, max_size=30), st.integers(1, 9))
def test_columns_of_whole_numbers_are_edited_as_their_values_are(values, width):
    alone = [edited(f"I{width}", [value])[0] for value in values]
    assert edited(f"I{width}", np.array(values * MANY)) == alone * MANY


@given(st.lists(st.text(st.characters(exclude_characters="\0"), max_size=12), min_size=1, max_size=30))
def test_columns_of_texts_are_edited_as_their_values_are(values):
    alone = [edited("A8", [value])[0] for value in values]
    assert edited("A8", np.array(values * MANY)) == edited("A8", values * MANY) == alone * MANY


def test_a_table_of_many_rows_is_that_of_its_rows(monkeypatch):
    """Columns that are wider than their fields, and more rows than are edited at a time."""
    monkeypatch.setattr(table, "_ROWS", 30)
    count = np.arange(100)
    columns = (
        table.Column("A long heading", "A4", lambda rows: [f"p{row}" for row in rows.tolist()]),
        table.Column("Count", "I3", lambda rows: rows),
        table.Column("Number\nm", "F12.4", lambda rows: rows / 7.0 - 3.0),
        table.Column("Some", "A4", lambda rows: np.where(rows % 3 == 0, "B", "")),
    )
    whole = table.Table(columns)
    assert whole.lines(count) == [line for row in count for line in whole.lines(count[row : row + 1])]


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
