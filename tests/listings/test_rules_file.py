"""The rule file: what it can say, and every error with file, line and key."""

from __future__ import annotations

from decimal import Decimal

import pytest

from musatpy.listings import RulesError, load_rules, parse_rules


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
