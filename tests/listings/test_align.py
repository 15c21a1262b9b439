"""Rows that find each other: a shortcut for what two listings begin and end with changes nothing."""

from __future__ import annotations

import random

import pytest

from musatpy.listings import align as module
from musatpy.listings.align import Alignment, align


def changed(rng: random.Random, names: list[str]) -> list[str]:
    """Return names with some taken out, put in, renamed or moved."""
    found = list(names)
    for _ in range(rng.randrange(4)):
        place = rng.randrange(len(found) + 1)
        match rng.choice("+-=~"):
            case "+":
                found.insert(place, rng.choice([f"new{place}", "", *names]))
            case "-" if len(found) > 1:
                found.pop(place - 1)
            case "=" if found:
                found[place - 1] = f"other{place}"
            case "~" if found:
                found.insert(rng.randrange(len(found)), found.pop(place - 1))
    return found


def aligned(a: list[str], b: list[str], rng: random.Random, *, strict: bool) -> Alignment:
    texts = tuple([f"{name} {rng.randrange(3)} {rng.randrange(3)}" for name in side] for side in (a, b))
    return align((a, b), (texts[0], texts[1]), lambda side, row: texts[side][row].split()[1], strict=strict)


@pytest.mark.parametrize("strict", [True, False])
@pytest.mark.parametrize("repeated", [False, True])
def test_same_ends_are_what_the_whole_search_finds(strict, repeated, monkeypatch):
    rng = random.Random(4)
    shortened = 0
    for seed in range(600):
        names = [f"{n % 4 if repeated else n}" for n in range(rng.randrange(1, 14))]
        other = changed(rng, names)
        quick = aligned(names, other, random.Random(seed), strict=strict)
        shortened += module._same_ends((names, other)) not in {(0, 0), (len(names), 0)}
        with monkeypatch.context() as patch:
            patch.setattr(module, "_same_ends", lambda ids: (0, 0))
            assert aligned(names, other, random.Random(seed), strict=strict) == quick
    assert shortened > 0 if repeated else shortened > 100
