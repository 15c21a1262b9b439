"""One bad deck for each cross check: the whole report, and nothing else."""

from __future__ import annotations

from functools import cache

import pytest

from formats import bad_system_cases, bad_wave_cases
from formats.bad_deck_cases import CASES as DECK_CASES
from formats.bad_deck_cases import GEOCENTRIC, LOCAL, Case
from formats.deck_edits import FOLDER, GOOD, add, deck
from formats.raw_deck_cases import RAW, RAW_CASES
from musatpy.errors import DeckError
from musatpy.formats import musat
from musatpy.formats.cards.deck import read_cards
from musatpy.formats.checks import CHECKS, Check
from musatpy.formats.draft import Draft, draft_of

ALL = [*DECK_CASES, *bad_system_cases.CASES, *bad_wave_cases.CASES, *RAW_CASES]


@cache
def draft(data: bytes) -> Draft:
    family = musat.card_family()
    return draft_of(read_cards(data, family), family)


def _name(case: Case) -> str:
    return case[1][0].message


@pytest.mark.parametrize("case", ALL, ids=_name)
def test_a_bad_deck_is_reported_exactly(case: Case) -> None:
    data, expected = case
    block, problems = musat.check_deck(data)
    assert len(problems) == len(expected)
    for problem, one in zip(problems, expected, strict=True):
        one.check(problem)
    assert (block is None) == any(one.severity == "error" for one in expected)
    if block is None:
        with pytest.raises(DeckError) as caught:
            musat.read_deck(data)
        assert caught.value.problems == problems


@pytest.mark.parametrize("name", list(bad_system_cases.ENTERED))
def test_what_taking_in_shows_is_reported_at_its_card(name: str) -> None:
    data, expected = bad_system_cases.ENTERED[name]
    _, problems = musat.check_deck(data)
    assert len(problems) == len(expected), [str(problem) for problem in problems]
    for problem, one in zip(problems, expected, strict=True):
        one.check(problem)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_every_check_has_a_case(check: Check) -> None:
    assert any(list(check(draft(data))) for data, _ in ALL)


@pytest.mark.parametrize("lines", [GOOD, LOCAL, GEOCENTRIC, RAW], ids=["geographic", "local", "geocentric", "raw"])
def test_a_good_deck_has_no_problems(lines: list[str]) -> None:
    assert [problem for check in CHECKS for problem in check(draft(deck(lines=lines)))] == []


@pytest.mark.parametrize("lines", [bad_system_cases.UTM, bad_system_cases.MATRICES], ids=["UTM", "matrices"])
def test_a_good_deck_in_a_system_has_no_problems(lines: list[str]) -> None:
    assert musat.check_deck(deck(lines=lines))[1] == ()


def test_a_photo_that_is_wholly_observed_needs_no_other_datum() -> None:
    station, attitude = f"{GOOD[5][:57]}1.0001.0001.000", f"{GOOD[8][:57]} 60.0 60.0 60.0"
    kept = [
        line
        for line in GOOD
        if line[:7] in ("TID 841", "PLT 841") or line[:3] in ("OPT", "ELL", "WTR", "CAM", "END")
    ]
    block, problems = musat.check_deck(deck(add(station, attitude, GOOD[42]), lines=kept))
    assert block is not None
    assert {problem.message.partition(" has ")[2] for problem in problems} == {
        "a single ray and no known component: it cannot be used"
    }
    block, problems = musat.check_deck(deck(add(GOOD[5], attitude, GOOD[42]), lines=kept))
    assert block is None
    found = "photo 841 has 1 usable ray (8 measured) and 3 of its six parameters observed"
    assert any(found in problem.message for problem in problems)


def test_control_through_water_shows_no_other_camera() -> None:
    """It stands 0.78 times as wide on the photo as by straight rays: 1.28 times nearer, by refraction."""
    deck_of_control = FOLDER.parent / "verdict/focal_length_through_water.crd"
    assert musat.check_deck(deck_of_control)[1] == ()
    dry = (
        deck_of_control.read_bytes().replace(b"                B  ", b"                   ").replace(b"FXB", b"FX ")
    )
    problem, *others = sorted(musat.check_deck(dry)[1], key=lambda one: "submerged" in one.message)
    assert "as with a focal length of 210 mm" in problem.message
    assert all("flagged as submerged" in one.message for one in others)  # tides and low control without a flag
