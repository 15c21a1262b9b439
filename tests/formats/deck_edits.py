"""A small good deck, and edits of its cards: what the tests of bad decks are made of."""

from collections.abc import Callable
from dataclasses import replace as with_values
from functools import cache
from pathlib import Path

import numpy as np

from musatpy.formats import musat
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import Block, CoordinateSystem

FOLDER = Path(__file__).parents[2] / "fixtures" / "bad_decks"
GOOD = (FOLDER / "good.crd").read_text(encoding="ascii").splitlines()

Edit = Callable[[list[str]], list[str]]


def replace(line: int, old: str, new: str) -> Edit:
    """Return the edit that puts `new` in the place of `old`, of the same length, on a line (1-based)."""

    def edit(lines: list[str]) -> list[str]:
        assert lines[line - 1].count(old) == 1, (line, old)
        assert len(old) == len(new), (old, new)
        return [*lines[: line - 1], lines[line - 1].replace(old, new), *lines[line:]]

    return edit


def drop(*numbers: int) -> Edit:
    """Return the edit that takes lines (1-based) away."""
    return lambda lines: [text for number, text in enumerate(lines, 1) if number not in numbers]


def add(*cards: str) -> Edit:
    """Return the edit that puts cards before the last one; in the good deck, the first of them becomes line 49."""
    return lambda lines: [*lines[:-1], *(card.ljust(80) for card in cards), lines[-1]]


def deck(*edits: Edit, lines: list[str] | None = None) -> bytes:
    """Return the good deck, or another, after `edits`."""
    lines = list(GOOD if lines is None else lines)
    for edit in edits:
        lines = edit(lines)
    return "".join(f"{text}\n" for text in lines).encode("ascii")


@cache
def in_system(system: CoordinateSystem) -> Block:
    """Return the block of the good deck in another coordinate system (local: about the first photo's nadir)."""
    block = musat.read_deck(deck())
    if system is CoordinateSystem.GEOGRAPHIC:
        return block
    ellipsoid = Ellipsoid(block.ellipsoid.name)
    origin = np.array([*block.photos.position[0, :2], 0.0])

    def convert(position: np.ndarray) -> np.ndarray:
        whole = np.where(np.isnan(position), origin, position)
        xyz = ellipsoid.geocentric(whole)
        if system is CoordinateSystem.LOCAL:
            return (xyz - ellipsoid.geocentric(origin)) @ ellipsoid.frame(origin).T
        return xyz

    return with_values(
        block,
        options=with_values(block.options, system=system),
        ellipsoid=None if system is CoordinateSystem.LOCAL else block.ellipsoid,
        photos=with_values(block.photos, position=convert(block.photos.position)),
        control=with_values(block.control, position=convert(block.control.position)),
    )
