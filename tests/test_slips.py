"""No slip of one digit is quiet where a test fails or a well checked point moves; the wrong card is named."""

from __future__ import annotations

import pytest

from drivers.slips import DECKS, UNUSABLE, slips
from musatpy.model import Grade


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "count", "seed"),
    [("st_thomas", 4, 3), *(pytest.param(name, 25, 4, marks=pytest.mark.slow) for name in DECKS)],
)
def test_slips_of_one_digit(name: str, count: int, seed: int) -> None:
    runs = slips(DECKS[name], count, seed)
    for run in runs:
        if run.quiet:
            assert not run.moved and (run.notes or not run.beyond), run
    told = [run for run in runs if run.grade not in (Grade.ACCEPTED, UNUSABLE)]
    assert told and sum(run.named for run in told) >= 0.8 * len(told)
