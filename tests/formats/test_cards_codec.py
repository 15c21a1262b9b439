"""The column codec against its definition, the codec of `FieldSpec`, on plain and on nasty values."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from musatpy.formats.cards.codec import FEW, decode_column, empty_column, encode_cards, strays
from musatpy.formats.cards.spec import CardSpec, FieldSpec
from musatpy.fortran import FieldError, parse_edit, write_number

NUMBERS = (
    "I1", "I3", "I8", "I9", "I15", "I16", "F1.0", "F4.0", "F4.3", "F7.5", "F9.5", "F8.7", "F9.8", "F12.6", "F13.4",
    "F14.4", "F15.9", "F16.2", "F17.1", "F20.8", "E16.9", "D12.4",
)  # fmt: skip
TEXTS = ("A1", "A2", "A4", "A7", "A8", "A9", "A16", "A68")
ALLOWED = {True: ("A", "B"), False: ()}


def make_field(edit: str, first: int = 5, **keys) -> FieldSpec:
    parsed = parse_edit(edit)
    return FieldSpec(name="value", columns=(first, first + parsed.width - 1), edit=parsed, **keys)


def make_card(*fields: FieldSpec) -> CardSpec:
    return CardSpec(
        mnemonic="TST", title="Test", doc="", order=1, repeat="many", required=False, sample="", fields=fields
    )


def make_cards(field: FieldSpec, texts: list[str], around: str = "9") -> np.ndarray:
    """Card images (k, 80) with `texts` in the columns of `field`, and `around` in all others."""
    width = field.edit.width
    assert all(len(text) == width for text in texts)
    lines = [around * (field.first - 1) + text + around * (80 - field.last) for text in texts]
    return np.frombuffer("".join(lines).encode("ascii"), dtype=np.uint8).reshape(-1, 80)


def bits(values) -> list[int | str]:
    """What makes two columns identical: texts, or the bits of floats, all NaN alike."""
    array = np.asarray(values)
    if array.dtype.kind == "U":
        return array.tolist()
    return np.where(np.isnan(array), np.nan, array).view(np.int64).tolist()


def check_decoding(field: FieldSpec, texts: list[str]) -> None:
    """Compare the column of `texts` with what `FieldSpec.decode` makes of each of them.

    So often that they are not few: those are read by the definition itself.
    """
    texts = texts * (FEW // len(texts) + 1)
    nothing = math.nan if field.edit.is_number else ""
    expected, refused = [], []
    for row, text in enumerate(texts):
        try:
            expected.append(field.decode(text))
        except FieldError:
            expected.append(nothing)
            refused.append(row)
    column = empty_column(field, len(texts))
    bad = decode_column(field, make_cards(field, texts), column)
    assert bits(column) == bits(np.array(expected, dtype=column.dtype))
    assert [row for row, _ in bad] == refused


# --- reading ---


@pytest.mark.slow
@given(st.sampled_from(TEXTS), st.sampled_from(["error", "missing"]), st.booleans(), st.data())
def test_columns_of_texts_equal_their_fields(edit, blank, restricted, data):
    width = parse_edit(edit).width
    letters = st.sampled_from("AB ") if restricted else st.characters(min_codepoint=32, max_codepoint=126)
    texts = data.draw(st.lists(st.text(letters, max_size=width), min_size=1, max_size=8))
    places = data.draw(st.sampled_from([str.ljust, str.rjust, str.center]))
    field = make_field(
        edit, data.draw(st.sampled_from([4, 72 - width + 1])), blank=blank, allowed=ALLOWED[restricted]
    )
    check_decoding(field, [places(text, width) for text in [*texts, ""]])


def spoilt(texts: list[str], letters: str, rng) -> list[str]:
    """The texts with one to three of their characters replaced."""
    result = []
    for text in texts:
        characters = list(text)
        for place in rng.integers(0, len(text), rng.integers(1, 4)):
            characters[place] = letters[rng.integers(len(letters))]
        result.append("".join(characters))
    return result


@pytest.mark.slow
@pytest.mark.parametrize("edit", NUMBERS)
def test_columns_of_numbers_equal_their_fields(edit):
    """Written under their descriptor, shifted, without a point, spoilt, blank, or plain junk."""
    parsed, rng = parse_edit(edit), np.random.default_rng(66)
    width = parsed.width
    values = 10.0 ** rng.uniform(-parsed.decimals, width, 200) * rng.choice([-1, 1], 200)
    written = [write_number(round(value) if parsed.letter == "I" else value, parsed) for value in values.tolist()]
    texts = [text for text in written if "*" not in text]
    texts += [text[1:].ljust(width) for text in texts[:60]]
    texts += ["".join(digits) for digits in rng.choice(list("0123456789"), (60, width))]
    point = width - parsed.decimals - 1
    pointed = [text[:point] + "." + text[point + 1 :] for text in texts[-60:]]
    junk = ["".join(letters) for letters in rng.choice(list(" 0123456789+-.ED*"), (60, width))]
    for letters in (" 0159+-.ED*x", " -", "."):
        texts += spoilt([*texts, *pointed, *[" " * width] * 60], letters, rng)[:: 2 if letters == "." else 1]
    for blank, first in (("missing", 5), ("error", 4), ("zero", 72 - width + 1)):
        field = make_field(edit, first, blank=blank, asterisks=blank != "zero")
        check_decoding(field, [*texts, *pointed, *junk, " " * width, "*" * width])


def test_the_sign_of_zero_is_kept():
    for edit, texts in {"I3": [" -0", "  0", "-00"], "F7.5": ["-.00000", "0.00000", "-0.0000"]}.items():
        field = make_field(edit)
        column = empty_column(field, 3)
        assert decode_column(field, make_cards(field, texts), column) == []
        assert np.signbit(column).tolist() == [True, False, True]


def test_columns_of_no_field():
    card = make_card(make_field("I3", 6), make_field("A8", 60))
    inside = {4, 5, *range(9, 60), *range(68, 73)}
    for column in range(1, 81):
        image = np.full((2, 80), ord(" "), dtype=np.uint8)
        image[1, column - 1] = ord("x")
        assert list(strays(card, image)) == [(1, column, "x")] * (column in inside)


# --- writing ---


def check_encoding(field: FieldSpec, values: np.ndarray) -> None:
    """Compare the cards of a column with what `FieldSpec.encode` makes of each value.

    So often that they are not few: those are written by the definition itself.
    """
    values = np.tile(values, FEW // len(values) + 1)
    expected, refused = [], []
    for row, value in enumerate(values):
        try:
            expected.append(field.encode(value.item()))
        except FieldError:
            expected.append(" " * field.edit.width)
            refused.append(row + 7)
    block, bad = encode_cards(make_card(field), {"value": values}, len(values), 7)
    lines = block.decode("ascii").split("\n")
    assert lines.pop() == ""
    assert [line[field.first - 1 : field.last] for line in lines] == expected
    assert [line[72:] for line in lines] == [f"{row + 7:08d}" for row in range(len(values))]
    assert all(len(line) == 80 and line.startswith("TST") for line in lines)
    outside = [line[3 : field.first - 1] + line[field.last : 72] for line in lines]
    assert not "".join(outside).strip()
    assert [int(re.findall(r"\d+", problem.message)[0]) for problem in bad] == refused


@pytest.mark.slow
@pytest.mark.parametrize("edit", NUMBERS)
def test_columns_near_ties_and_powers_are_written_as_their_fields_are(edit):
    parsed = parse_edit(edit)
    rng = np.random.default_rng(88)
    scale = 10.0**parsed.decimals
    ticks = np.floor(10.0 ** rng.uniform(0, parsed.width, 300))
    ties = (ticks + 0.5) / scale
    powers = 10.0 ** np.arange(-parsed.decimals - 1, parsed.width)
    exact = ticks / 2.0 ** rng.integers(1, 12, len(ticks))
    values = np.concatenate([ties, ticks / scale, exact, powers, powers - 0.5 / scale, powers / 2])
    near = np.concatenate([values, np.nextafter(values, np.inf), np.nextafter(values, -np.inf)])
    check_encoding(make_field(edit), np.concatenate([near, -near, [-0.0]]))


@pytest.mark.slow
@given(
    st.sampled_from(NUMBERS),
    st.sampled_from(["error", "missing", "zero"]),
    st.lists(st.floats() | st.integers(-(10**16), 10**16).map(float) | st.floats(-1.0, 1.0), min_size=1),
)
def test_numbers_are_written_as_their_fields_are(edit, blank, values):
    check_encoding(make_field(edit, blank=blank), np.array(values))


@pytest.mark.slow
@given(
    st.sampled_from(TEXTS),
    st.sampled_from(["error", "missing"]),
    st.booleans(),
    st.lists(st.text(st.sampled_from("AB é\t~"), max_size=9), min_size=1, max_size=9),
)
def test_texts_are_written_as_their_fields_are(edit, blank, restricted, values):
    field = make_field(edit, blank=blank, allowed=ALLOWED[restricted])
    check_encoding(field, np.array(values, dtype=np.str_))


def test_columns_to_write_have_one_length():
    card = make_card(make_field("I3"))
    for columns in ({"value": np.zeros(3)}, {}):
        with pytest.raises(ValueError, match="TST: wants columns"):
            encode_cards(card, columns, 2, 1)
