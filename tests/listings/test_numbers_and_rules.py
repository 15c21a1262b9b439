"""Numbers of listings, files of rules, and any input at all."""

import json
import random
from decimal import Decimal
from pathlib import Path

import pytest

from musatpy.errors import ProblemsError
from musatpy.fortran import parse_edit, write_number
from musatpy.listings import RulesError, compare_bytes, compare_texts, load_rules, parse_rules
from musatpy.listings.output import json_text, junit_text, render

LISTING = Path(__file__).parents[2] / "fixtures" / "st_thomas" / "st_thomas.lst"


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


def test_a_rule_file_is_read(tmp_path):
    path = tmp_path / "rules.toml"
    path.write_text(
        """
[layout]
section = '^TABLE \\d'
header = ['^RUN ', '^DATE ']
carriage_control = true

[[rule]]
name = "sigmas"
section = "Adjusted"
column = "Sigma"
last_digits = 1

[[rule]]
page = [2, 3]
point = ["101", 102]
at = [10, 20]
absolute = 0.001
relative = 1e-6
"""
    )
    rules = load_rules(path)
    assert [rule.name for rule in rules.rules] == ["sigmas", "rule 2"]
    assert rules.rules[1].absolute == Decimal("0.001")
    assert rules.rules[1].pages == (2, 3)
    assert rules.rules[1].point.fullmatch("102") and not rules.rules[1].point.fullmatch("1021")
    assert rules.layout.carriage_control is True
    assert len(rules.layout.header) == 2


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


RULES = (
    "[[rule]]\nabsolute = 0.1\nrelative = 1e-3\nlast_digits = 2\n[[rule]]\narcsec = 1\n"
    "[[rule]]\ncolumn = 3\narcsec = 1\nangle = 'radians'\n[[rule]]\nat = [3, 30]\nsigmas = 1\n"
    "[[rule]]\nphoto = '.*'\npoint = '1.*'\nskip = true\n[[rule]]\nrow = 'a'\norder = 'any'\nonly = 'A'\n"
)
PIECES = [
    "1.5", "-0", "0", "-0 30 45.2", "****", "*", "1.5-2.5", "1E9999", "-1.5D-300", ".12-105", "9" * 60, "---- ----",
    "Photo  Point", "====", "PAGE 3", "(continued)", "Title Of This", "\f", "\n", "\n\n\n", "  ", "\t", "x=3", "é",
    "1,2", "1 +", "0 0 0.0", "\r", "{", "99 59 59.99999", "+.5E+0005", "D  M  S", "NaN", "inf", "\x0b", "\u2028",
    "Latitude",
]  # fmt: skip


def any_text(rng):
    return "".join(rng.choice(PIECES) + rng.choice([" ", "  ", "\n", ""]) for _ in range(rng.randint(1, 60)))


def shown(found):
    """Return what was found, after every way of printing it was tried."""
    render(found)
    json.loads(json_text(found))
    junit_text(found)
    return found


@pytest.mark.parametrize("rules", ["", RULES])
@pytest.mark.slow
def test_any_two_texts_can_be_compared(rules):
    rng, loaded = random.Random(1), parse_rules(rules)
    for _ in range(150):
        a, b = f"x{any_text(rng)}", f"x{any_text(rng)}"
        assert shown(compare_texts(a, a, loaded)).same, a
        there, back = shown(compare_texts(a, b, loaded)), compare_texts(b, a, loaded)
        if not rules:
            assert there.same == back.same, (a, b)


@pytest.mark.slow
def test_any_damage_to_a_listing_can_be_compared():
    rng, whole = random.Random(2), LISTING.read_text(encoding="utf-8")
    for _ in range(12):
        start = rng.randrange(len(whole))
        damaged = whole[:start] + any_text(rng) + whole[start + rng.randint(0, 500) :]
        shown(compare_texts(whole, damaged, parse_rules(RULES)))


def any_json(rng, depth=0):
    kind = rng.randrange(8 if depth < 3 else 5)
    if kind < 5:
        return [None, True, rng.uniform(-1, 1), "x", rng.randint(-9, 9)][kind]
    if kind == 5:
        return [any_json(rng, depth + 1) for _ in range(rng.randint(0, 3))]
    names = rng.sample(["id", "point", "photo", "position", "position_sigma", "sigma", "options", "rows"], 3)
    return {name: any_json(rng, depth + 1) for name in names}


@pytest.mark.parametrize("rules", ["", RULES])
@pytest.mark.slow
def test_any_two_json_texts_can_be_compared(rules):
    rng, loaded, names = random.Random(4), parse_rules(rules), ("a.json", "b.json")
    for _ in range(400):
        a, b = any_json(rng), any_json(rng)
        assert shown(compare_texts(json.dumps(a), json.dumps(a), loaded, names)).same
        found = shown(compare_texts(json.dumps(a), json.dumps(b), loaded, names))
        if not rules:
            assert found.same == (a == b and json.dumps(a) == json.dumps(b)) or found.same == (a == b), (a, b)


def test_any_bytes_are_compared_or_refused():
    rng = random.Random(5)
    for _ in range(100):
        data = rng.randbytes(rng.randint(0, 60)).replace(b"\0", b"" if rng.random() < 0.9 else b"\0")
        for names in (("a", "b"), ("a.json", "b.json"), ("a.lst", "b.json")):
            try:
                assert shown(compare_bytes(data, data, names=names)).same
            except ProblemsError as error:
                assert error.problems
