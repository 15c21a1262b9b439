"""Every check has a bad deck, which is reported exactly; any bytes and values give problems only."""

import re
import warnings
from functools import cache

import pytest

from formats import bad_antenna_cases, bad_system_cases, bad_wave_cases
from formats.bad_deck_cases import CASES as DECK_CASES
from formats.bad_deck_cases import GEOCENTRIC, LOCAL, Case
from formats.deck_edits import FOLDER, GOOD, add, deck
from formats.raw_deck_cases import RAW, RAW_CASES
from musatpy.errors import DeckError, Problem
from musatpy.formats import musat
from musatpy.formats.cards.deck import read_cards
from musatpy.formats.cards.spec import CardSpec
from musatpy.formats.checks import CHECKS
from musatpy.formats.checks.check import DeckCheck
from musatpy.formats.draft import Draft, draft_of
from musatpy.formats.job_tables import card_family

ENTERED = list(bad_system_cases.ENTERED.values())
ALL = [*DECK_CASES, *bad_system_cases.CASES, *bad_wave_cases.CASES, *bad_antenna_cases.CASES, *RAW_CASES, *ENTERED]


@cache
def draft(data: bytes) -> Draft:
    family = card_family()
    return draft_of(read_cards(data, family), family)


def _name(case: Case) -> str:
    return case[1][0].message


@pytest.mark.parametrize("case", ALL, ids=_name)
def test_a_bad_deck_is_reported_exactly(case: Case) -> None:
    data, expected = case
    block, problems = musat.check_deck(data)
    assert len(problems) == len(expected), [str(problem) for problem in problems]
    for problem, one in zip(problems, expected, strict=True):
        one.check(problem)
    if case in ENTERED:  # what only taking in shows
        return
    assert (block is None) == any(one.severity == "error" for one in expected)


def test_a_deck_with_errors_is_not_read() -> None:
    data, expected = DECK_CASES[0]
    with pytest.raises(DeckError) as caught:
        musat.read_deck(data)
    assert len(caught.value.problems) == len(expected)
    expected[0].check(caught.value.problems[0])


def problems_of(spec: CardSpec, *cards: str) -> dict[str, str]:
    """Return the problems of the last of some cards: what stands in the columns that they name, by message."""
    problems = musat.check_deck(deck(lines=[*cards, "END"]))[1]
    return {
        one.message: one.text[one.columns[0] - 1 : one.columns[1]].strip()
        for one in problems
        if one.line == len(cards) and one.card == spec.mnemonic and one.columns
    }


def cells(spec: CardSpec, name: str) -> list[str]:
    """Return what the sample of a card says of an attribute, by its fields."""
    fields = [one for one in spec.fields if re.fullmatch(rf"\w+\.{name}(\[\d\])?", one.target)]
    return [spec.sample[one.first - 1 : one.last].strip() for one in fields]


CARDS = card_family().cards.values()


@pytest.mark.parametrize("spec", [one for one in CARDS if one.once], ids=lambda spec: spec.mnemonic)
def test_what_a_card_gives_is_told_where_it_is_given_again(spec: CardSpec) -> None:
    found = problems_of(spec, spec.sample, spec.sample)
    for names, message in spec.once:
        values = [cell for name in names.split() for cell in cells(spec, name)]
        where = found[f"{message.format(*values)} on line 1"]
        assert where.split() == cells(spec, names.split()[-1])


@pytest.mark.parametrize("spec", [one for one in CARDS if one.two_ends], ids=lambda spec: spec.mnemonic)
def test_two_ends_of_one_name_are_told(spec: CardSpec) -> None:
    name, message = spec.two_ends
    first, second = cells(spec, name)
    assert problems_of(spec, spec.sample.replace(f" {second} ", f" {first} ", 1))[message].split() == [first, first]


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.find.__name__)
def test_every_check_has_a_case(check: DeckCheck) -> None:
    assert any(list(check(draft(data))) for data, _ in ALL)


@pytest.mark.parametrize(
    "lines",
    [GOOD, LOCAL, GEOCENTRIC, RAW, bad_system_cases.UTM, bad_system_cases.MATRICES],
    ids=["geographic", "local", "geocentric", "raw", "UTM", "matrices"],
)
def test_a_good_deck_has_no_problems(lines: list[str]) -> None:
    assert [one for one in musat.check_deck(deck(lines=lines))[1] if "carried and listed" not in one.message] == []


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
    assert "as if the focal length were 210 mm" in problem.message
    assert all("flagged as submerged" in one.message for one in others)  # tides and low control without a flag


REPORTS = sorted(FOLDER.glob("*.txt"))


@pytest.mark.parametrize("report", REPORTS, ids=lambda report: report.stem)
def test_the_report_of_a_bad_deck(report, monkeypatch) -> None:
    monkeypatch.chdir(FOLDER)
    block, problems = musat.check_deck(f"{report.stem}.crd")
    assert block is None
    assert "".join(f"{problem.render()}\n" for problem in problems) == report.read_text(encoding="ascii")


def check_quietly(data: bytes) -> None:
    """Assert that a deck gives a block or problems that print, and no warning of numpy."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        block, problems = musat.check_deck(data)
    assert (block is None) == any(problem.severity == "error" for problem in problems)
    assert all(isinstance(problem, Problem) and problem.render() for problem in problems)


@pytest.mark.parametrize("mnemonic", sorted({line[:3] for line in GOOD}))
def test_a_kind_of_card_alone_gives_problems_only(mnemonic: str) -> None:
    check_quietly(deck(lines=[line for line in GOOD if line[:3] == mnemonic]))
    check_quietly(deck(lines=[line for line in GOOD if line[:3] != mnemonic]))
