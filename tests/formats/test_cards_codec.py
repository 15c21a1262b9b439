"""The column codec against its definition, the codec of `FieldSpec`, on plain and on nasty values."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from musatpy.formats.cards.codec import FEW, decode_column, empty_column, encode_cards, strays
from musatpy.formats.cards.spec import CardSpec, FieldSpec
from musatpy.fortran import FieldError, fit_number, parse_edit, write_number

NUMBERS = (
    "I1", "I3", "I8", "I9", "I15", "I16", "F1.0", "F4.0", "F4.3", "F7.5", "F9.5", "F8.7", "F9.8", "F12.6", "F13.4",
    "F14.4", "F15.9", "F16.2", "F17.1", "F20.8", "E16.9", "D12.4",
)  # fmt: skip
TEXTS = ("A1", "A2", "A4", "A7", "A8", "A9", "A16", "A68")


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

plain_numbers = st.floats(-1e10, 1e10) | st.integers(-(10**9), 10**9).map(float) | st.floats(-1.0, 1.0)
junk = st.text(st.sampled_from(" 0123456789+-.ED*"), min_size=20, max_size=20)
any_text = st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=20, max_size=20)


@st.composite
def number_fields(draw):
    """A field of numbers, and texts for it: written under its descriptor, shifted, repaired or plain junk."""
    edit = parse_edit(draw(st.sampled_from(NUMBERS)))
    blank = draw(st.sampled_from(["error", "missing", "zero"]))
    field = make_field(str(edit), draw(st.sampled_from([4, 5, 72 - edit.width + 1])), blank=blank, asterisks=True)
    texts = []
    for value in draw(st.lists(plain_numbers, max_size=8)):
        try:
            text = fit_number(float(round(value)) if edit.letter == "I" else value, edit)
        except FieldError:
            text = "*" * edit.width
        left = draw(st.integers(0, 3))
        texts += [text, (text + "   ")[left:][: edit.width].ljust(edit.width)]
    texts += [text[: edit.width] for text in draw(st.lists(junk | any_text, max_size=8))]
    return field, [*texts, " " * edit.width, "*" * edit.width]


@pytest.mark.slow
@given(number_fields())
def test_columns_of_numbers_equal_their_fields(drawn):
    check_decoding(*drawn)


@pytest.mark.slow
@given(st.sampled_from(TEXTS), st.sampled_from(["error", "missing"]), st.booleans(), st.data())
def test_columns_of_texts_equal_their_fields(edit, blank, restricted, data):
    width = parse_edit(edit).width
    letters = st.sampled_from("AB ") if restricted else st.characters(min_codepoint=32, max_codepoint=126)
    texts = data.draw(st.lists(st.text(letters, max_size=width), min_size=1, max_size=8))
    places = data.draw(st.sampled_from([str.ljust, str.rjust, str.center]))
    allowed = ("A", "B") if restricted else ()
    first = data.draw(st.sampled_from([4, 72 - width + 1]))
    check_decoding(
        make_field(edit, first, blank=blank, allowed=allowed), [places(text, width) for text in [*texts, ""]]
    )


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
def test_columns_of_spoilt_numbers_equal_their_fields(edit):
    parsed = parse_edit(edit)
    rng = np.random.default_rng(66)
    values = 10.0 ** rng.uniform(-parsed.decimals, parsed.width, 600) * rng.choice([-1, 1], 600)
    written = [write_number(round(value) if parsed.letter == "I" else value, parsed) for value in values.tolist()]
    full = ["".join(digits) for digits in rng.choice(list("0123456789"), (60, parsed.width))]
    texts = [text for text in written if "*" not in text] + full
    point = parsed.width - parsed.decimals - 1
    pointed = [text[:point] + "." + text[point + 1 :] for text in full]
    blank = [" " * parsed.width] * 60
    for letters in (" 0159+-.ED*x", " -", "."):
        texts += spoilt([*texts, *pointed, *blank], letters, rng)[:: 2 if letters == "." else 1]
    check_decoding(make_field(edit, blank="missing", asterisks=True), [*texts, *pointed])


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


near_ties = st.builds(
    lambda ticks, decimals, ulps: float(np.nextafter((ticks + 0.5) / 10**decimals, ulps * math.inf)),
    st.integers(-(10**9), 10**9),
    st.integers(0, 8),
    st.sampled_from([-1, 1]),
)
exact_ties = st.builds(
    lambda odd, power: (2 * odd + 1) / 2.0**power, st.integers(-(10**6), 10**6), st.integers(1, 9)
)
any_number = st.floats() | plain_numbers | near_ties | exact_ties | st.sampled_from([0.0, -0.0, 1e15, -1e15, 0.5])


@pytest.mark.slow
@pytest.mark.parametrize("edit", [edit for edit in NUMBERS if edit[0] == "F"])
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
    check_encoding(make_field(edit), np.concatenate([near, -near]))


@pytest.mark.slow
@given(
    st.sampled_from(NUMBERS),
    st.sampled_from(["error", "missing", "zero"]),
    st.lists(any_number, min_size=1, max_size=20),
)
def test_numbers_are_written_as_their_fields_are(edit, blank, values):
    check_encoding(make_field(edit, blank=blank), np.array(values))


@pytest.mark.slow
@given(st.sampled_from(("I1", "I3", "I8", "I15", "I16")), st.lists(st.integers(-(10**16), 10**16), min_size=1))
def test_integers_are_written_as_their_fields_are(edit, values):
    numbers = np.array(values, dtype=float)
    check_encoding(make_field(edit), np.concatenate([numbers, numbers % 1000, -(numbers % 100), [-0.0]]))


@pytest.mark.slow
@given(
    st.sampled_from(TEXTS),
    st.sampled_from(["error", "missing"]),
    st.booleans(),
    st.lists(st.text(st.sampled_from("AB é\t~"), max_size=9), min_size=1, max_size=9),
)
def test_texts_are_written_as_their_fields_are(edit, blank, restricted, values):
    allowed = ("A", "B") if restricted else ()
    check_encoding(make_field(edit, blank=blank, allowed=allowed), np.array(values, dtype=np.str_))


def test_columns_to_write_have_one_length():
    card = make_card(make_field("I3"))
    with pytest.raises(ValueError, match="TST: wants columns"):
        encode_cards(card, {"value": np.zeros(3)}, 2, 1)
    with pytest.raises(ValueError, match="TST: wants columns"):
        encode_cards(card, {}, 2, 1)
