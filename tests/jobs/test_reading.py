"""Decks that are read to be edited: what they may lack, and what they may not."""

from __future__ import annotations

import pytest

from formats.deck_edits import GOOD, deck, replace
from musatpy.formats.musat import check_deck


def without(*mnemonics: str) -> bytes:
    return deck(lines=[line for line in GOOD if line[:3] not in mnemonics])


@pytest.mark.parametrize("mnemonics", [("CTG", "BAS", "EQL"), ("PLT", "EQL")], ids=["control", "measurements"])
def test_a_deck_may_lack_control_or_measurements(mnemonics: tuple[str, ...]) -> None:
    data = without(*mnemonics)
    assert check_deck(data)[0] is None
    block, problems = check_deck(data, for_run=False)
    assert block is not None
    assert all(problem.severity == "warning" for problem in problems)


@pytest.mark.parametrize(
    "data", [without("CAM"), without("ATT"), without("ELL"), deck(replace(6, "STA 841", "STA 842"))]
)
def test_a_deck_may_not_contradict_itself(data: bytes) -> None:
    assert check_deck(data, for_run=False)[0] is None


def test_what_is_needed_for_a_run_is_no_problem_of_editing() -> None:
    data = without("CTG", "BAS", "EQL")
    messages = [problem.message for problem in check_deck(data)[1]]
    assert any("datum needs" in message for message in messages)
    assert not any("datum needs" in problem.message for problem in check_deck(data, for_run=False)[1])
