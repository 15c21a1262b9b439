"""Decks that are wrong by chance end in a message or a verdict, and in no answer that cannot be one."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.mutated_decks import absurdities, decks, run

_SLOW = [pytest.param(first, 48, marks=pytest.mark.slow) for first in range(12, 300, 48)]


@pytest.mark.parametrize(("first", "count"), [(0, 12), *_SLOW])
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
