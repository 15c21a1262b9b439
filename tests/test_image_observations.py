"""Observations of images: in files with the plates, for who reads a record in one table."""

from __future__ import annotations

import copy
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from musatpy import adjust, read_deck
from musatpy.errors import RecordError
from musatpy.image_observations import FIELDS, are_apart, with_images
from musatpy.json_files import read_record
from musatpy.listings import compare_texts, parse_rules
from musatpy.reports.record import dumps, record, record_of
from musatpy.statistics import Statistics

FIXTURES = Path(__file__).parents[1] / "fixtures"
DECKS = ("st_thomas/st_thomas.crd", "cayman/cayman_modified.crd")  # the latter with plates that took no part
NEEDS = {"observations": (), "plates": ()}
BY_DIGITS = parse_rules("[[rule]]\nrelative = 1e-9\nabsolute = 1e-15\n")
NAMES = ("a.json", "b.json")


@cache
def solution(deck):
    return adjust(read_deck(FIXTURES / deck))


@cache
def written(deck=DECKS[0]):
    return dumps(record(solution(deck)))


def as_numbers(column):
    return np.array(column, dtype=float)


@pytest.mark.parametrize("deck", DECKS)
def test_what_is_read_of_a_file_is_what_the_solution_has(tmp_path, deck):
    path = tmp_path / "run.json"
    path.write_text(written(deck))
    assert are_apart(json.loads(written(deck)))
    found, whole = read_record(path, NEEDS), record_of(Statistics(solution(deck)), NEEDS.keys())
    assert found["plates"] == json.loads(json.dumps(whole["plates"]))
    given, back = whole["observations"], found["observations"]
    assert list(back) == list(given)
    for name in ("kind", "of", "component", "residual", "sigma"):
        assert back[name] == given[name]
    for name in (*FIELDS, "test", "estimated_error"):
        np.testing.assert_allclose(as_numbers(back[name]), as_numbers(given[name]), rtol=1e-9, atol=0.0)


def test_a_file_says_an_image_once():
    content = json.loads(written())
    assert "plate" not in content["observations"]["kind"]
    taken = content["plates"]["triangulated"]
    assert [pair != [None, None] for pair in content["plates"]["redundancy"]] == taken


def test_a_record_that_has_them_in_one_table_says_the_same(tmp_path):
    content = with_images(json.loads(written()))
    assert not are_apart(content)
    one_table = dumps(content)
    for pair in ((one_table, written()), (written(), one_table)):
        assert compare_texts(*pair, BY_DIGITS, NAMES).same
    path = tmp_path / "earlier.json"
    path.write_text(one_table)
    assert read_record(path, NEEDS) == {name: content[name] for name in NEEDS}


def test_a_difference_is_found_where_one_record_has_them_in_one_table():
    content = with_images(json.loads(written()))
    content["observations"]["redundancy"][3] += 0.01
    (one,) = compare_texts(dumps(content), written(), BY_DIGITS, NAMES).findings
    assert (one.section, one.column) == ("observations", "redundancy")


def broken(change):
    content = copy.deepcopy(json.loads(written()))
    change(content)
    return dumps(content)


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (lambda content: content["plates"].pop("effect"), "plates.effect"),
        (lambda content: content["plates"].update(standardised=[1.0] * len(content["plates"]["photo"])), "plates"),
        (lambda content: content["plates"].update(redundancy=content["plates"]["redundancy"][:-1]), "plates"),
        (lambda content: content["solution"].update(unit_sigma="large"), "solution.unit_sigma"),
    ],
)
def test_tables_that_are_wrong_are_told(tmp_path, change, where):
    path = tmp_path / "run.json"
    path.write_text(broken(change))
    with pytest.raises(RecordError, match=where):
        read_record(path, NEEDS)


def test_tables_that_are_wrong_are_held_against_another_record_as_they_are():
    found = compare_texts(
        dumps(with_images(json.loads(written()))),
        broken(lambda content: content["plates"].pop("effect")),
        BY_DIGITS,
        NAMES,
    )
    assert not found.same
