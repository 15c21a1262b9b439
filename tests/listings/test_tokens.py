"""Numbers as they are printed: exponents, run-together fields, asterisks, angles."""

from __future__ import annotations

import random
from decimal import Decimal

import pytest

from musatpy.fortran import parse_edit, write_number
from musatpy.listings.tokens import angle_of, parse, tokens_of, with_angles


@pytest.mark.parametrize(
    ("text", "value", "step"),
    [
        ("1.50", "1.50", -2),
        ("-.05", "-0.05", -2),
        ("+12", "12", 0),
        ("41.", "41", 0),
        (".1D-05", "1E-6", -6),
        ("0.1234E+03", "123.4", -1),
        ("1.5d2", "150", 1),
        (".1234-105", "1.234E-106", -109),
        ("0.1234+105", "1.234E+104", 101),
    ],
)
def test_a_number_and_its_last_digit(text, value, step):
    (token,) = parse(text)
    assert (token.kind, token.value, token.step) == ("number", Decimal(value), step)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("1.234-5.678", ["1.234", "-5.678"]),
        ("-1.234-5.678-.5", ["-1.234", "-5.678", "-.5"]),
        ("1.5D+03-2.5D-03", ["1.5D+03", "-2.5D-03"]),
        ("12.345-103", ["12.345", "-103"]),  # no exponent: two digits stand before the point
        ("1.5******2.5", ["1.5", "******", "2.5"]),
        ("12-13", ["12", "-13"]),
    ],
)
def test_numbers_that_run_together_are_parted(text, parts):
    assert [token.text for token in parse(text)] == parts
    assert all(token.kind != "word" for token in parse(text))


@pytest.mark.parametrize(
    "word", ["RC8", "1053A", "MUSAT-IIA", "IIA.", "*", "5e", "a1.5", "1.5x", "..........", "1E99999"]
)
def test_names_and_marks_are_words(word):
    assert [token.kind for token in parse(word)] == ["word"]


def test_punctuation_is_parted_from_numbers():
    tokens = [placed.token for placed in tokens_of("Sigma0 is .8763, by (1.5) x=2")]
    assert " ".join(token.text for token in tokens) == "Sigma0 is .8763 , by ( 1.5 ) x = 2"
    assert [token.text for token in tokens if token.kind == "number"] == [".8763", "1.5", "2"]


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("18 20 21.71281", "66021.71281"),
        ("-0 30 45.2", "-1845.2"),
        ("0 30 45.2", "1845.2"),
        ("-64 55 .43702", "-233700.43702"),
        ("359 59 59.9", "1295999.9"),
    ],
)
def test_degrees_carry_the_sign_of_an_angle(text, seconds):
    (angle,) = with_angles(tokens_of(text))
    assert (angle.token.kind, angle.token.value, angle.token.text) == ("angle", Decimal(seconds), text)


@pytest.mark.parametrize(
    "text", ["18 60 1.0", "18 20 61.0", "18 -20 1.0", "18 20", "18.5 20 1.0", "1 2 x", "18 20 21"]
)
def test_other_numbers_are_no_angle(text):
    assert all(one.token.kind != "angle" for one in with_angles(tokens_of(text)))


def test_seconds_without_a_point_are_an_angle_where_a_column_says_so():
    assert angle_of([one.token for one in tokens_of("-0 0 7")]).value == -7


@pytest.mark.parametrize("descriptor", ["F12.4", "E14.6", "D15.7", "I6"])
def test_what_fortran_writes_is_read_as_it_stands(descriptor):
    rng, edit = random.Random(7), parse_edit(descriptor)
    for _ in range(300):
        value = rng.uniform(-1, 1) * 10 ** rng.randint(-3, 5)
        value = round(value) if edit.letter == "I" else value
        text = write_number(value, edit).strip()
        (token,) = parse(text)
        assert token.kind == "number"
        assert float(token.value) == float(text.replace("D", "E"))
        # half a unit of the last digit is how a decimal is rounded; binary numbers add their own error
        assert abs(float(token.value) - value) <= 0.5000001 * 10.0**token.step


def test_any_text_is_kept_whole():
    rng = random.Random(11)
    for _ in range(2000):
        line = "".join(rng.choice("0123456789.+-*EDx ,()=") for _ in range(25))
        tokens = tokens_of(line)
        assert "".join(one.token.text for one in tokens) == line.replace(" ", "")
        assert all(line[one.start : one.end] == one.token.text for one in tokens)
