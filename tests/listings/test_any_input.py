"""Whatever two files hold, they are compared or refused: no other error, and the same answer both ways round."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest

from musatpy.errors import ProblemsError
from musatpy.listings import compare_bytes, compare_texts, parse_rules
from musatpy.listings.machine import json_text, junit_text
from musatpy.listings.render import render

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
