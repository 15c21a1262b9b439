"""Columns of characters: the texts and numbers of their cells, to the last bit those of cell after cell."""

from __future__ import annotations

import random
import re

import numpy as np
import pytest

from musatpy.listings.audit.columns import Cells, sliced


def column(*cells):
    """Return cells as they stand in a table."""
    width = max(map(len, cells))
    (sliced_cells,) = sliced([cell.ljust(width) for cell in cells], ((0, width),))
    return sliced_cells


@pytest.mark.parametrize(
    ("cells", "decimals"),
    [
        ((" 1.25", "  .50", "-0.75", "     ", "12.00"), 2),
        (("-.5", " .5"), 1),
        (("123456789012.345",), 3),
        (("1234567890123.456",), None),  # more digits than are exact
        (("1.25 ", " .50 "), 2),
        (("1.25", "1.5 "), None),
        (("1.25", " 1.5"), None),
        (("1.25", " ** "), None),
        (("1.25", "- .5"), None),
        (("--.2", "1.25"), None),
        (("1-.2", "1.25"), None),
        (("1 .2", "1.25"), None),
        (("1.2 ", "1.25"), None),
        (("1.-2", "1.25"), None),
        (("   2", "1.25"), None),
        (("1.25", "1..5"), None),
        (("1.2l", "1.25"), None),
        (("12.", " 1."), None),
        (("1 2  .50",), None),
        (("   ", "   "), None),
        (("12", "34"), None),
    ],
)
def test_numbers_that_end_in_one_place(cells, decimals):
    characters, texts = column(*cells), Cells([cell.strip() for cell in cells])
    assert characters.decimals == decimals and texts.decimals is None
    assert characters == texts
    assert characters.is_blank.tolist() == texts.is_blank.tolist()
    for ours, plain in zip(characters.numbers, texts.numbers, strict=True):
        np.testing.assert_array_equal(ours, plain)


@pytest.mark.parametrize("seed", range(20))
def test_numbers_are_those_of_float_to_the_last_bit(seed):
    rng = random.Random(seed)
    decimals = rng.randrange(1, 8)
    cells = [f"{rng.choice((-1, 1)) * 10 ** rng.uniform(-4, 6):16.{decimals}f}" for _ in range(200)]
    cells = [rng.choice((cell, re.sub(" (-?)0[.]", r"  \1.", cell), " " * 16)) for cell in cells]
    numbers = column(*cells)
    values, halves = numbers.numbers
    expected = np.array([float(cell) if cell.strip() else np.nan for cell in cells])
    assert numbers.decimals == decimals
    assert values.tobytes() == np.where(np.isnan(expected), np.nan, expected).tobytes()  # signs of zeros, too
    assert set(halves[~numbers.is_blank]) <= {0.5 * 10.0**-decimals}


def test_rows_that_are_no_columns_of_characters():
    spans = ((0, 2), (4, 6))
    first, second = sliced(["ab  12", " c    "], spans)
    assert list(first) == ["ab", "c"] and second[:] == ["12", ""]
    assert [len(cells) for cells in sliced([], spans)] == [0, 0]
    for row in ("ab. 12", "ab  123", "a\u2022  12", "ab\t 12"):
        assert sliced(["ab  12", row], spans) is None
