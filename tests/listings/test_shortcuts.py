"""What is quick for nearly all numbers of records finds what the way through tokens and rules finds."""

from __future__ import annotations

import json
import math
import random
from decimal import ROUND_HALF_EVEN, Decimal, localcontext

import pytest

from musatpy.listings import compare_texts, mixed, parse_rules, recorded
from musatpy.listings.judge import EXACTLY
from musatpy.listings.tokens import Token, parse
from musatpy.units import dms_from_radians

RECORDS, MIXED = ("a.json", "b.json"), ("a.lst", "b.json")
# A rule of the name that findings have without one: it lets nothing pass, but every value is looked at.
EXACT = "[[rule]]\nname = 'exact'\nexact = true\n"
ALL_FIELDS = "[[rule]]\nname = 'exact'\ncolumn = 999\nexact = true\n"
NUMBERS = (
    "0", "-0", "0.0", "-0.0", "0e5", "1", "1.0", "1e0", "1E-7", "0.0000001", "1e99999", "1e9999", "NaN",
    "-Infinity", "12345678901234567890", "1.2345678901234567890123", "-3.25",
)  # fmt: skip
OTHERS = ('"1"', '"NaN"', '"null"', "null", "true", "false", '""', '"a b"', "[]", "{}", "[1, [2, 3]]", '{"z": 1}')


def any_value(chance, numbers=NUMBERS, others=OTHERS):
    if chance.random() < 0.7:
        return chance.choice(numbers)
    if chance.random() < 0.5:
        return chance.choice(others)
    return f"[{', '.join(chance.choice(numbers + others) for _ in range(chance.randrange(1, 4)))}]"


def any_row(chance, number):
    keys = ["position", "x", "y.z", "sigma"][: chance.randrange(1, 5)]
    if chance.random() < 0.2:
        chance.shuffle(keys)
    fields = [f'"{key}": {any_value(chance)}' for key in keys]
    return f'{{"id": "{number}", {", ".join(fields)}}}'


def any_record(chance):
    system = chance.choice(["GEOG", "LOCL"])
    rows = ",".join(any_row(chance, number) for number in range(8))
    return f'{{"options": {{"system": "{system}"}}, "points": [{rows}]}}'


def same(one, other):
    """Tell whether two differences are one, sigmas that are no numbers included."""
    return repr((one.findings, one.sections)) == repr((other.findings, other.sections))


@pytest.mark.parametrize("rules", [EXACT, ALL_FIELDS])
def test_records_differ_alike_whether_a_rule_looks_at_their_fields(rules):
    chance = random.Random(1)
    kinds = set()
    for _ in range(300):
        a, b = any_record(chance), any_record(chance)
        quick = compare_texts(a, b, names=RECORDS)
        assert same(quick, compare_texts(a, b, parse_rules(rules), RECORDS))
        kinds |= {(one.kind, one.sigmas is None) for one in quick.findings}
    assert {("number", True), ("number", False), ("text", True)} <= kinds


@pytest.mark.parametrize("values", [["NaN", "1"], ["1", "NaN"], ["1e99999", "1"]])
def test_a_rule_is_known_to_be_of_use_whichever_row_shows_it(values):
    text = f'{{"points": [{", ".join(f"""{{"id": "{n}", "x": {one}}}""" for n, one in enumerate(values))}]}}'
    (rule,) = compare_texts(text, text, parse_rules("[[rule]]\nabsolute = 1\ncolumn = 'x'\n"), RECORDS).rules
    assert rule.matched and rule.applied


@pytest.mark.parametrize(
    ("rows", "labels"),
    [
        ([{"photos": ["1", "2"]}, {"photos": ["1", "3"]}], ["photos 1 2", "photos 1 3"]),
        ([{"photo": "1", "point": "7"}, {"photo": "2", "point": "7"}], ["photo 1", "photo 2"]),
        ([{"photo": "1", "point": "7"}, {"photo": "1", "point": "8"}], ["photo 1 point 7", "photo 1 point 8"]),
        ([{"group": None, "x": 1}, {"group": "a", "x": 1}], ["group None", "group a"]),
        ([{"y": 1}, {"y": 1}], ["row 1", "row 2"]),
    ],
)
def test_rows_are_called_by_the_fields_that_tell_them_apart(rows, labels):
    changed = [{**row, "value": 2} for row in rows]
    texts = [json.dumps({"table": table}) for table in ([{**row, "value": 1} for row in rows], changed)]
    assert [one.row for one in compare_texts(*texts, names=RECORDS).findings] == labels


HEAD = """
Residuals Of Plate Measurements: Adjusted Minus Measured

                             x           y   Resid. x   Resid. y   Sigma x   Sigma y
Photo     Point             mm          mm         um         um        um        um
--------  --------  ----------  ----------  ---------  ---------  --------  --------
"""
FORMS = (
    "{:.4f}", "{:.2f}", "{:+.3f}", "{:.0f}", "{:.1f}", "{:.3E}", "{:.2e}", "{:.0f}.", "-0", "-0.00", ".5", "****",
    "", "nan", "1.5-2.5", "x",
)  # fmt: skip
VALUES = ("0", "-0.0", "1e-9", "0.5", "12.34565", "-0.00025", "2.5", "null", "1e30", "NaN", '"1"', "1e400")


def any_listing(chance):
    """Return a listing and a record, whose numbers are more or less the same."""
    lines, rows = HEAD.split("\n")[:-1], []
    for n in range(12):
        values = [chance.choice([*VALUES, f"{chance.gauss(0, 5):.9f}"]) for _ in range(6)]
        cells = []
        for value, scale in zip(values, (1, 1, 1e-3, 1e-3, 1e-3, 1e-3), strict=True):
            number = float(value) / scale if value.strip("-").replace(".", "").replace("e", "").isdigit() else 0.0
            form = chance.choice(FORMS)
            cells.append(form.format(number + chance.choice([0.0, 0.0, 0.01, 1e-9])))
        widths = (10, 10, 9, 9, 8, 8)
        fields = [cell.rjust(width)[:width] for cell, width in zip(cells, widths, strict=True)]
        lines.append(f"{n:<8}  {7:<8}  " + "  ".join(fields).rstrip())
        x, y, rx, ry, sx, sy = values
        rows.append(
            f'{{"photo": "{n}", "point": "7", "xy": [{x}, {y}], "residual": [{rx}, {ry}], "sigma": [{sx}, {sy}]}}'
        )
    return "\n".join(lines), f'{{"plates": [{", ".join(rows)}]}}'


@pytest.mark.parametrize(
    "rules",
    [
        "",
        pytest.param(EXACT, marks=pytest.mark.slow),
        "[[rule]]\nlast_digits = 1\n[[rule]]\ncolumn = 'Resid. x'\nabsolute = 0.02\n",
        pytest.param(ALL_FIELDS, marks=pytest.mark.slow),
    ],
)
def test_plain_numbers_of_a_listing_differ_as_their_tokens_do(monkeypatch, rules):
    chance = random.Random(2)
    pairs = [any_listing(chance) for _ in range(60)]
    quick = [compare_texts(*pair, parse_rules(rules), MIXED) for pair in pairs]
    back = [compare_texts(b, a, parse_rules(rules), ("a.json", "b.lst")) for a, b in pairs]
    monkeypatch.setattr(mixed._Pair, "plain_number", lambda *_: False)
    for pair, found, turned in zip(pairs, quick, back, strict=True):
        plain = compare_texts(*pair, parse_rules(rules), MIXED)
        assert same(found, plain) and found.rules == plain.rules
        assert same(turned, compare_texts(*pair[::-1], parse_rules(rules), ("a.json", "b.lst")))
    kinds = {one.kind for found in quick for one in found.findings}
    assert {"number", "text", "overflow"} <= kinds


def test_a_number_is_rounded_as_decimals_are():
    chance = random.Random(3)
    with localcontext(EXACTLY):
        for _ in range(2000):
            value = chance.choice([chance.uniform(-1e6, 1e6), chance.gauss(0, 1e-5), round(chance.gauss(0, 9)) / 8])
            step = -chance.randrange(8)
            token = Token("number", "1", Decimal(1), step)
            found = recorded.token_of(value, token, "mm")
            assert found.value == Decimal(value).quantize(Decimal(1).scaleb(step), ROUND_HALF_EVEN)
            assert parse(found.text)[0].value == Decimal(value).quantize(
                Decimal(1).scaleb(step - 4), ROUND_HALF_EVEN
            )


def test_an_angle_is_rounded_as_it_is_printed():
    chance = random.Random(4)
    for _ in range(2000):
        decimals = chance.randrange(7)
        value = chance.choice([1.0, -1.0]) * math.radians(chance.randrange(3600 * 360) / 3600 - 1e-12)
        degrees, minutes, seconds = (float(one) for one in dms_from_radians(value, decimals))
        size = 3600 * int(abs(degrees)) + 60 * int(minutes) + Decimal(f"{seconds:.{decimals}f}")
        token = Token("angle", "", Decimal(0), -decimals)
        with localcontext(EXACTLY):
            found = recorded.token_of(value, token, "")
        assert found.value == (size if value > 0.0 else -size)
