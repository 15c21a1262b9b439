"""Numbers of listings, files of rules, and any input at all."""

import random
from decimal import Decimal

import pytest

from musatpy.fortran import parse_edit, write_number
from musatpy.listings import RulesError, compare_texts, parse_rules


def difference(a, b):
    """Return the one finding of two lines, where angles are read."""
    (one,) = compare_texts(f"x {a}\n", f"x {b}\n", parse_rules("[[rule]]\narcsec = 0\n")).findings
    return one


@pytest.mark.parametrize(
    ("a", "b", "size", "last_digits"),
    [
        ("1.50", "1.5003", "0.0003", "0.03"),
        ("+12", "13", "1", "1"),
        ("41.", "42.", "1", "1"),
        (".1D-05", ".2D-05", "1E-6", "1"),
        ("0.1234E+03", "123.5", "0.1", "1"),
        ("0.1234+105", "0.1236+105", "2E+101", "2"),
        ("(1.5),", "(1.7),", "0.2", "2"),
        ("1.234-5.678", "1.234-5.679", "-0.001", "-1"),
        ("1.5D+03-2.5D-03", "1.5D+03-2.5D-02", "-0.0225", "-22.5"),
        ("12.345-103", "12.345-104", "-1", "-1"),  # no exponent: two digits stand before the point
        ("12-13", "12-15", "-2", "-2"),
        ("18 20 21.71281", "18 20 21.71280", "-0.00001", "-1"),
        ("-0 30 45.2", "0 0 0.0", "1845.2", "18452"),
        ("359 59 59.9", "0 0 0.1", "0.2", "2"),  # no difference of a circle
        ("-64 55 .43702", "-64 55 .43703", "-0.00001", "-1"),
    ],
)
def test_a_number_is_the_decimal_that_stands_on_paper(a, b, size, last_digits):
    one = difference(a, b)
    assert (one.difference, one.last_digits) == (Decimal(size), Decimal(last_digits))


@pytest.mark.parametrize("word", ["RC8", "1053A", "MUSAT-IIA", "IIA.", "5e", "a1.5", "1.5x", "1E99999"])
def test_names_and_marks_are_words(word):
    assert difference(word, f"{word}y").kind == "text"


@pytest.mark.parametrize("text", ["18 60 1.0", "18 20 61.0", "18 -20 1.0", "18.5 20 1.0", "1 2 x", "18 20 21"])
def test_other_numbers_are_no_angle(text):
    assert difference(f"{text} 7", f"{text} 8").kind == "number"
    assert difference(f"7 {text}", f"8 {text}").kind == "number"


@pytest.mark.parametrize("descriptor", ["F12.4", "E14.6", "D15.7", "I6"])
def test_what_fortran_writes_is_read_as_it_stands(descriptor):
    rng, edit = random.Random(7), parse_edit(descriptor)
    for _ in range(100):
        value = rng.uniform(-1, 1) * 10 ** rng.randint(-3, 5)
        value = round(value) if edit.letter == "I" else value
        found = compare_texts(f"x {write_number(value, edit)}\n", f"x {value!r}\n")
        # half a unit of the last digit is how a decimal is rounded; binary numbers add their own error
        assert all(one.kind == "number" and abs(one.last_digits) <= 0.5000001 for one in found.findings)


@pytest.mark.parametrize(
    ("line", "key", "message"),
    [
        ("absolute = -1", "absolute", "zero or larger"),
        ("section = '('", "section", "no regular expression"),
        ("row = 3", "row", "is a text"),
        ("point = []", "point", "at least one"),
        ("column = 0", "column", "counted from 1"),
        ("page = [3, 2]", "page", "[first, last]"),
        ("only = 'C'", "only", "'C' is not one of A, B, either"),
        ("angle = 'degrees'", "angle", "goes with arcsec"),
    ],
)
def test_every_error_has_its_line_and_key(line, key, message):
    text = f"# rules\n[[rule]]\nsigmas = 1\n\n[[rule]]\nsigmas = 2\n{line}\n"
    with pytest.raises(RulesError) as caught:
        parse_rules(text, "my.toml")
    found = [problem for problem in caught.value.problems if problem.field == key]
    assert found and message in found[0].message
    assert (found[0].file, found[0].line, found[0].card) == ("my.toml", 7, "rule 2")


def test_all_errors_are_reported_at_once():
    with pytest.raises(RulesError, match="whole rows"):
        parse_rules("[[rule]]\ncolumn = 'x'\norder = 'any'\n")
    with pytest.raises(RulesError) as caught:
        parse_rules("[layout]\nwidth = 3\n[[rule]]\nskip = true\nabsolute = 1\n[[rule]]\nsection = 'x'\n[other]\n")
    places = [(one.line, one.field) for one in caught.value.problems]
    assert places == [(8, "other"), (2, "width"), (4, "skip"), (6, None)]


@pytest.mark.parametrize(
    ("text", "line"), [("[[rule]]\nskip = maybe\n", 2), ("a = 'x\n", 1), ("[[rule]]\nskip = true\n[[rule]\n", 3)]
)
def test_text_that_is_no_toml_is_refused_with_its_line(text, line):
    with pytest.raises(RulesError) as caught:
        parse_rules(text, "r.toml")
    assert caught.value.problems[0].line == line
