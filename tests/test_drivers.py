"""Decks and inputs that are wrong: by chance, by a slip of the punch, by mistakes common to a deck."""

from pathlib import Path

import pytest

from drivers.common_mistakes import FAR, MISTAKES, outcome
from drivers.fuzz_inputs import fuzz
from drivers.mutated_decks import absurdities, decks, run
from drivers.slips import DECKS, UNUSABLE, slips
from musatpy.model import Grade

_SLOW = [pytest.param(*part, marks=pytest.mark.slow) for part in ((2, 29), (32, 33))]


@pytest.mark.parametrize(("first", "count"), [(0, 2), *_SLOW])
def test_a_deck_that_is_wrong_by_chance(first: int, count: int, tmp_path: Path) -> None:
    for seed in range(first, first + count):
        one = run(seed, tmp_path)
        assert not one.faults, one


def test_absurd_answers_are_seen() -> None:
    station = {"photo": "1", "position": [0.0, 0.0, -10.0], "attitude": [0.0] * 3, "covariance": [[1e-4] * 6] * 6}
    point = {"point": "A", "status": "triangulated", "position": [0.0, 0.0, 5.0], "covariance": [[1e-4] * 3] * 3}
    far = point | {"point": "B", "position": [1e6, 0.0, 5.0], "covariance": [[1e9] * 3] * 3}
    record = {
        "options": {"system": "LOCL"},
        "stations": [station],
        "points": [point, far],
        "plates": [{"photo": "1", "point": name, "triangulated": True} for name in "AB"],
    }
    faults = " ".join(absurdities(record))
    for text in ("stations under ground", "point B is", "point A is behind photo 1", "point B has a sigma of"):
        assert text in faults
    assert len(decks()) >= 18


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(7, 10))
def test_spoilt_inputs_end_in_an_answer_or_a_message(seed: int) -> None:
    tally = fuzz(50, seed, tell=lambda text: None)
    assert tally.failures == []
    assert tally.statuses[0] > 5 and tally.statuses[1] > 5  # some are harmless, some are not


@pytest.mark.slow
@pytest.mark.parametrize("name", DECKS)
def test_slips_of_one_digit(name: str) -> None:
    every = slips(DECKS[name], 14, 4)
    for one in every:
        if one.quiet:
            assert not one.moved and (one.notes or not one.beyond), one
    told = [one for one in every if one.grade not in (Grade.ACCEPTED, UNUSABLE)]
    assert told and sum(one.named for one in told) >= 0.8 * len(told)


_NAMED = {mistake.name: mistake for mistake in MISTAKES}


@pytest.mark.slow
@pytest.mark.parametrize("block", ["three", "watpt", "iiia"])
def test_a_block_without_mistakes_is_accepted_and_right(block: str) -> None:
    run = outcome(block, 1, _NAMED["nothing"])
    assert run.grade == Grade.ACCEPTED
    assert run.moved < FAR
    assert not run.causes


@pytest.mark.slow
@pytest.mark.parametrize(
    ("block", "mistake"),
    [
        ("three", "heights in feet"),
        ("three", "control in feet"),
        ("iiia", "focal 2 %"),
        ("iiia", "focal a tenth"),  # trials that lead nowhere leave effort for the one that fits
        ("watpt", "flags, all"),
        ("three", "x mirrored"),
        ("three", "control in km"),
        ("watpt", "plates in cm"),
    ],
)
def test_the_right_class_of_causes_is_named_first(block: str, mistake: str) -> None:
    run = outcome(block, 1, _NAMED[mistake])
    assert run.grade != Grade.ACCEPTED
    assert run.named, run.causes
