"""Two records: their tables, fields, units and sigmas."""

import json
import math
from decimal import Decimal

import pytest

from listings.runs import ST_THOMAS, edited, moved, run_of
from musatpy.listings import CannotCompareError, compare_texts, parse_rules
from record_rows import with_rows

RECORDS = ("a.json", "b.json")


@pytest.fixture
def text():
    return run_of(ST_THOMAS).record


def compared(a, b, rules=""):
    return compare_texts(a, b, parse_rules(rules), RECORDS)


def test_a_record_is_itself_however_it_is_laid_out(text):
    content = json.loads(text)
    for other in (text, json.dumps(content), json.dumps(content, indent=3), json.dumps(with_rows(content))):
        assert compared(text, other).same


def test_the_last_bit_of_a_number_is_found(text):
    def change(content):
        station = content["stations"][1]
        station["attitude"][2] = math.nextafter(station["attitude"][2], 9)

    (one,) = compared(text, edited(text, change)).findings
    assert (one.section, one.row, one.column, one.unit) == ("stations", "photo 22", "attitude[2]", "rad")
    assert one.difference == Decimal(one.b) - Decimal(one.a) > 0


def test_differences_are_in_sigmas(text):
    sigma = with_rows(json.loads(text))["points"][2]["sigma"][2]
    other = moved(text, ("points", 2, "position", 2), 2.0 * sigma)
    (one,) = compared(text, other).findings
    # what the addition rounds is far below a billionth of a sigma of decimetres
    assert one.sigmas == pytest.approx(2.0, abs=1e-9)
    for limit in (1.999, 2.001):
        assert compared(text, other, f"[[rule]]\nsection = 'points'\nsigmas = {limit}\n").same == (limit > 2.0)


@pytest.mark.parametrize("axis", [0, 1])
def test_latitude_and_longitude_have_limits_of_arc_but_no_sigmas(text, axis):
    other = moved(text, ("points", 2, "position", axis), 1e-8)  # 0.00206 arc seconds
    (one,) = compared(text, other).findings
    assert (one.unit, one.sigmas) == ("rad", None)
    for limit in (0.0020, 0.0021):
        rule = f"[[rule]]\ncolumn = 'position'\nsigmas = 9\narcsec = {limit}\nangle = 'radians'\n"
        assert compared(text, other, rule).same == (limit > 0.00206)


@pytest.mark.parametrize(
    ("path", "unit"),
    [
        (("points", 2, "position", 1), "rad"),
        (("points", 2, "position", 2), "m"),
        (("points", 2, "covariance", 0, 1), "m2"),
        (("analyses", "ground_point", 0, "rms"), "rad"),
        (("analyses", "ground_point", 2, "rms"), "m"),
        (("solution", "sigma0"), ""),
    ],
)
def test_units_are_those_that_the_reports_state(text, path, unit):
    (one,) = compared(text, moved(text, path, 1.0)).findings
    assert one.unit == unit


def test_rules_speak_of_records(text):
    def change(content):
        content["stations"][1]["attitude"][0] += 1e-8  # 0.00206 arc seconds
        content["points"][3]["position"][2] += 0.001

    other = edited(text, change)
    arc = "[[rule]]\nphoto = '22'\ncolumn = 'attitude'\narcsec = 0.0021\nangle = 'radians'\n"
    assert [one.section for one in compared(text, other, arc).findings] == ["points"]
    assert len(compared(text, other, arc.replace("0.0021", "0.0020")).findings) == 2
    both = arc + "[[rule]]\npoint = '204'\nabsolute = 0.0011\n[[rule]]\nsection = 'nowhere'\nskip = true\n"
    found = compared(text, other, both)
    assert found.same and found.unused_rules == ("rule 3",)


def test_rows_of_a_table_find_each_other_by_their_ids(text):
    def change(content):
        del content["points"][5]
        content["points"].append(content["points"].pop(0))
        content["plates"].insert(7, {**content["plates"][7], "point": "NEW"})

    found = compared(text, edited(text, change))
    assert [(one.kind, one.row) for one in found.findings] == [
        ("order", "point 102"),
        ("only in A", "point 206"),
        ("only in B", "photo 21 point NEW"),
    ]
    rules = "[[rule]]\nsection = 'points'\norder = 'any'\nonly = 'A'\n[[rule]]\nsection = 'plates'\nonly = 'B'\n"
    assert compared(text, edited(text, change), rules).same


@pytest.mark.parametrize(
    ("a", "b", "kinds"),
    [
        ('{"x": -0.0}', '{"x": 0}', []),
        ('{"x": null}', '{"x": "null"}', ["text"]),
        ('{"x": NaN}', '{"x": NaN}', []),
        ('{"x": [1, 2]}', '{"x": [1, 2, 3]}', ["text"]),
        ('{"x": 1}', '{"y": 1}', ["text", "text"]),
        ('{"x": {"y": [1, {"z": 2}]}}', '{"x": {"y": [1, {"z": 3}]}}', ["number"]),
        ('[{"a": 1}, {"a": 2}]', '[{"a": 1}, {"a": 2.5}]', ["number"]),
        ('{"x": []}', '{"x": [{"id": 1}]}', ["section"]),
        ('{"x": 123456789012345678}', '{"x": 123456789012345679}', ["number"]),
    ],
)
def test_any_json_can_be_compared(a, b, kinds):
    assert [one.kind for one in compared(a, b).findings] == kinds


@pytest.mark.parametrize("bad", ['{"x": 1', "not json", "[" * 100_000])
def test_what_is_no_json_cannot_be_compared(bad):
    with pytest.raises(CannotCompareError) as caught:
        compared('{"x": 1}', bad)
    assert caught.value.problems[0].file == "b.json"


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


def test_records_of_two_schemas_are_refused(text):
    assert compared(text, text.replace('"schema_version": "3.0"', '"schema_version": "3.9"')).counts["text"] == 1
    with pytest.raises(CannotCompareError, match=r"schema 3\.0, and b\.json of 1\.3; run the older deck again"):
        compared(text, text.replace('"schema_version": "3.0"', '"schema_version": "1.3"'))
    with pytest.raises(CannotCompareError, match=r"schema 1\.3"):
        compare_texts(text.replace('"3.0"', '"1.3"', 1), "X\n\ny 1\n", names=("a.json", "b.lst"))
