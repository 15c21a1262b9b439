"""Tokens of listings, files of rules, and any input at all."""

import json
import random
from decimal import Decimal
from pathlib import Path

import pytest

from musatpy.errors import ProblemsError
from musatpy.fortran import parse_edit, write_number
from musatpy.listings import RulesError, compare_bytes, compare_texts, load_rules, parse_rules
from musatpy.listings.output import json_text, junit_text, render
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
        ("tolerance = 1", "tolerance", "is not a key of a rule"),
        ("absolute = -1", "absolute", "zero or larger"),
        ("absolute = 'x'", "absolute", "zero or larger"),
        ("relative = nan", "relative", "zero or larger"),
        ("last_digits = true", "last_digits", "zero or larger"),
        ("section = '('", "section", "no regular expression"),
        ("row = 3", "row", "is a text"),
        ("point = []", "point", "at least one"),
        ("column = 0", "column", "counted from 1"),
        ("page = [3, 2]", "page", "[first, last]"),
        ("page = 0", "page", "[first, last]"),
        ("at = [1, 2, 3]", "at", "[first, last]"),
        ("skip = false", "skip", "is true"),
        ("order = 'random'", "order", "is 'any'"),
        ("only = 'C'", "only", "'A', 'B' or 'either'"),
        ("angle = 'degrees'", "angle", "goes with arcsec"),
        ("angle = 'turns'", "angle", "is 'dms'"),
        ("name = ''", "name", "is a text"),
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
    with pytest.raises(RulesError) as caught:
        parse_rules("[layout]\nwidth = 3\n[[rule]]\nskip = true\nabsolute = 1\n[[rule]]\nsection = 'x'\n[other]\n")
    assert [(one.line, one.field) for one in caught.value.problems] == [
        (8, "other"),
        (2, "width"),
        (4, "skip"),
        (6, None),
    ]


@pytest.mark.parametrize(
    ("text", "line"), [("[[rule]]\nskip = maybe\n", 2), ("a = 'x\n", 1), ("[[rule]]\nskip = true\n[[rule]\n", 3)]
)
def test_text_that_is_no_toml_is_refused_with_its_line(text, line):
    with pytest.raises(RulesError) as caught:
        parse_rules(text, "r.toml")
    assert caught.value.problems[0].line == line


def test_bytes_that_are_no_text_are_refused():
    with pytest.raises(RulesError, match="UTF-8"):
        parse_rules(b"name = '\xff'")


@pytest.mark.parametrize("text", ["rule = 3", "[rule]\nskip = true\n", "layout = 3"])
def test_tables_of_another_kind_are_refused(text):
    with pytest.raises(RulesError):
        parse_rules(text)


def test_rows_and_columns_do_not_go_together():
    with pytest.raises(RulesError, match="whole rows"):
        parse_rules("[[rule]]\ncolumn = 'x'\norder = 'any'\n")


FIXTURES = Path(__file__).parents[2] / "fixtures"
TEXT = (FIXTURES / "st_thomas" / "st_thomas.lst").read_text(encoding="utf-8")
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
    rng = random.Random(2)
    for _ in range(12):
        start = rng.randrange(len(TEXT))
        damaged = TEXT[:start] + any_text(rng) + TEXT[start + rng.randint(0, 500) :]
        shown(compare_texts(TEXT, damaged, parse_rules(RULES)))


def test_any_listing_can_be_held_against_a_record():
    record = {
        "points": [{"point": "1", "position": [1e300, None, "x"], "sigma": 3, "bathymetric": 0}], "solution": 3,
        "stations": {"x": 1}, "analyses": {"ground_point": [{"size": 3}]}, "plates": [3, {"photo": {}}],
        "cameras": None, "bathymetric_points": [{"predicted": []}], "control": [[]],
        "equal_elevations": [{"points": 3}],
    }  # fmt: skip
    rng = random.Random(3)
    titles = [
        "Adjusted Ground Points", "Solution Summary", "Ground Point Analysis", "Size Of The Job", "Input: Cameras",
        "Bathymetric Points", "Input: Plate Measurements", "Input: Control", "Equal Elevation Points",
        "Plate Residuals",
    ]  # fmt: skip
    for _ in range(100):
        head = "Point        Latitude      Elevation\n              D  M  S              m\n"
        head += "-----  -------------  -------------\n"
        text = f"{rng.choice(titles)}\n\n{head}1      {any_text(rng)}\nSample Size 3 {any_text(rng)}"
        try:
            shown(compare_texts(text, json.dumps(record), parse_rules(RULES), ("a.lst", "b.json")))
        except ProblemsError as error:
            assert "no section" in str(error)


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
