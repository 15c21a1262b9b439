"""The flag D of plate and control cards: dry for certain, whatever the water; through all that has flags."""

from pathlib import Path

import numpy as np
import pytest

from musatpy import BlockBuilder, adjust
from musatpy.errors import DeckError
from musatpy.formats import musat
from musatpy.model import Points
from musatpy.reports.listing import listing
from musatpy.reports.record import record

DECK = Path("fixtures/st_thomas/st_thomas.crd")
DRY = ("204", "220")


def flagged_deck() -> bytes:
    """Return St. Thomas with two points on land flagged D on all their plate cards."""
    lines = DECK.read_text().splitlines()
    for row, line in enumerate(lines):
        if line[:3] == "PLT" and line[13:21].strip() in DRY:
            assert line[61] == " "
            lines[row] = f"{line[:61]}D{line[62:]}"
    return "\n".join([*lines, ""]).encode()


def test_listing_and_record_show_it() -> None:
    solution = adjust(musat.read_deck(flagged_deck()))
    points = record(solution)["points"]
    assert [name for name, dry in zip(points["point"], points["dry"], strict=True) if dry] == sorted(DRY)
    text = listing(solution)
    head = next(line for line in text.splitlines() if line.startswith("Point") and "Dry" in line)
    at = head.index("Dry")
    rows = [line for line in text.splitlines() if line[:8].strip() in DRY and line[at : at + 1] == "D"]
    assert len(rows) == 2
    echo = [line for line in text.splitlines() if line[10:18].strip() in DRY and line.split()[-1] == "D"]
    images = sum(card[:3] == "PLT" and card[13:21].strip() in DRY for card in DECK.read_text().splitlines())
    assert len(echo) == 2 * images  # as given, and as adjusted


def test_it_changes_nothing_of_the_adjustment() -> None:
    plain, flagged = adjust(musat.read_deck(DECK)), adjust(musat.read_deck(flagged_deck()))
    np.testing.assert_array_equal(plain.points.position, flagged.points.position)


def test_a_block_cannot_have_both_flags() -> None:
    with pytest.raises(ValueError, match="submerged and dry"):
        Points(ids=np.array(["1"]), bathymetric=np.array([True]), dry=np.array([True]))
    builder = BlockBuilder()
    builder.add_images("1", ["A"], [[0.0, 0.0]], submerged=True)
    builder.add_images("2", ["A"], [[0.0, 0.0]], dry=True)
    messages = [problem.message for problem in builder.check()]
    assert messages.count("point A is flagged bathymetric and dry: one or the other") == 2
    with pytest.raises(DeckError):
        builder.build()
