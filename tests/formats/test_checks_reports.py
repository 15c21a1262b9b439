"""Whole reports of bad decks against the expected ones, and decks that chance has spoilt."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from formats.deck_edits import FOLDER, GOOD, deck
from musatpy.errors import Problem
from musatpy.formats import musat

REPORTS = sorted(FOLDER.glob("*.txt"))


@pytest.mark.parametrize("report", REPORTS, ids=lambda report: report.stem)
def test_the_report_of_a_bad_deck(report, monkeypatch) -> None:
    monkeypatch.chdir(FOLDER)
    block, problems = musat.check_deck(f"{report.stem}.crd")
    assert block is None
    assert "".join(f"{problem.render()}\n" for problem in problems) == report.read_text(encoding="ascii")


def test_twenty_errors_at_once_are_all_reported() -> None:
    _, problems = musat.check_deck(FOLDER / "many_errors.crd")
    assert sum(problem.severity == "error" for problem in problems) > 20
    assert len({(problem.line, problem.columns) for problem in problems}) == len(problems)


def check_quietly(data: bytes) -> None:
    """Assert that a deck gives a block or problems that print, and no warning of numpy."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        block, problems = musat.check_deck(data)
    assert (block is None) == any(problem.severity == "error" for problem in problems)
    assert all(isinstance(problem, Problem) and problem.render() for problem in problems)


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(st.integers(0, len(deck()) - 1), st.binary(max_size=3)), min_size=1, max_size=20))
@pytest.mark.slow
def test_any_bytes_in_a_deck_give_problems_only(changes: list[tuple[int, bytes]]) -> None:
    data = deck()
    for place, new in changes:
        data = data[:place] + new + data[place + max(len(new), 1) :]
    check_quietly(data)


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 2**32 - 1))
@pytest.mark.slow
def test_any_values_in_a_deck_give_problems_only(seed: int) -> None:
    rng = np.random.default_rng(seed)
    family = musat.card_family()
    lines = list(GOOD)
    texts = ["", "*", "0", "-0", "-1", "1", "9" * 16, "1E30", "-1E30", "1E-30", "B", "841", "1101", "RC8"]
    for row in rng.choice(len(lines) - 1, 8, replace=False):
        fields = family.cards[lines[row][:3]].fields
        field = fields[rng.integers(len(fields))]
        width = field.last - field.first + 1
        text = rng.choice(texts)[:width]
        lines[row] = lines[row][: field.first - 1] + text.ljust(width) + lines[row][field.last :]
    check_quietly(deck(lines=lines))


@settings(max_examples=60, deadline=None)
@given(st.sets(st.integers(0, len(GOOD) - 1), max_size=len(GOOD)))
@example(set(range(len(GOOD))))
@example(set(range(1, len(GOOD))))
@pytest.mark.slow
def test_any_missing_cards_give_problems_only(missing: set[int]) -> None:
    check_quietly(deck(lines=[line for row, line in enumerate(GOOD) if row not in missing]))


@pytest.mark.parametrize("mnemonic", sorted({line[:3] for line in GOOD}))
def test_a_kind_of_card_alone_gives_problems_only(mnemonic: str) -> None:
    check_quietly(deck(lines=[line for line in GOOD if line[:3] == mnemonic]))
    check_quietly(deck(lines=[line for line in GOOD if line[:3] != mnemonic]))
