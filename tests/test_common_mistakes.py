"""Mistakes that are common to a deck: the right class of causes is named first where anything can show it."""

from __future__ import annotations

import pytest

from drivers.common_mistakes import FAR, MISTAKES, outcome
from musatpy.model import Grade

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
