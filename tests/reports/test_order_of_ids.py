"""Rows in the order of the identifiers (OP2): whatever the order of the cards, the same listing and record."""

from __future__ import annotations

import dataclasses
import random
from pathlib import Path

import numpy as np
import pytest

from musatpy import read_deck
from musatpy.formats.musat import deck_bytes
from musatpy.model import Order
from musatpy.model.block import in_order_of_ids, natural_order
from musatpy.runs import run_deck
from sample_solutions import sample_solution

FIXTURES = Path(__file__).parents[2] / "fixtures"
# A station's cards and the members of a group may stand anywhere; titles are read in their order.
KEPT = ("TTL", "END")


def ordered(deck):
    """The cards of a fixture, its rows in the order of the identifiers."""
    block = read_deck(FIXTURES / deck)
    options = dataclasses.replace(block.options, order=Order.IDS)
    return deck_bytes(dataclasses.replace(block, options=options)).decode().splitlines()


def shuffled(cards, seed):
    """The cards in another order: titles first, the end last."""
    rest = [card[:72] for card in cards if not card.startswith(KEPT)]
    random.Random(seed).shuffle(rest)
    first, last = ([card for card in cards if card.startswith(kind)] for kind in KEPT)
    return [*first, *rest, *last]


def files(tmp_path, cards):
    (tmp_path / "job.crd").write_text("\n".join(cards) + "\n")
    result = run_deck(tmp_path / "job.crd")
    assert result.solution is not None, result.problems
    return result.listing.read_bytes(), result.record.read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    "deck",
    [
        "st_thomas/st_thomas.crd",
        "st_thomas_raw/st_thomas_raw.crd",
        pytest.param("cayman/cayman_modified.crd", marks=pytest.mark.slow),
        pytest.param("st_thomas_utm/st_thomas_utm.crd", marks=pytest.mark.slow),
        pytest.param("waves/strip.crd", marks=pytest.mark.slow),
        pytest.param("waves/unknown.crd", marks=pytest.mark.slow),
    ],
)
def test_shuffled_cards_give_the_same_bytes(deck, tmp_path):
    cards = ordered(deck)
    first = files(tmp_path, cards)
    for seed in (1, 2):
        assert files(tmp_path, shuffled(cards, seed)) == first


def test_ids_are_ordered_by_their_numbers():
    ids = ["10", "2", "P10", "P9", "A", "02", "P9B1", ""]
    assert [ids[row] for row in natural_order(ids)] == ["", "02", "2", "10", "A", "P9", "P9B1", "P10"]


def test_rows_keep_what_they_say():
    """Links are numbered anew with their rows; nothing else of a row changes."""
    block = sample_solution().block
    rows = in_order_of_ids(block)

    def said(of, name, links):
        table = getattr(of, name)
        columns = [of_ids(of, table, link) for link in links]
        others = [one.name for one in dataclasses.fields(table) if one.name not in links]
        values = [getattr(table, other).tolist() for other in others]
        return sorted(map(repr, zip(*columns, *values, strict=True)))

    def of_ids(of, table, link):
        return getattr(of, f"{link}s").ids[getattr(table, link)].tolist()

    for name, links in (
        ("photos", ["camera"]),
        ("points", []),
        ("plates", ["photo", "point"]),
        ("control", ["point"]),
        ("air_bases", ["photo"]),
        ("distances", ["point"]),
        ("height_differences", ["point"]),
        ("fiducial_measurements", ["photo"]),
        ("fiducials", ["camera"]),
        ("distortion", ["camera"]),
        ("waves", []),
    ):
        assert said(rows, name, links) == said(block, name, links), name
    groups, given = rows.equal_elevations, block.equal_elevations
    assert sorted(zip(groups.ids[groups.group], rows.points.ids[groups.point], strict=True)) == sorted(
        zip(given.ids[given.group], block.points.ids[given.point], strict=True)
    )
    assert dict(zip(groups.ids, groups.sigma, strict=True)) == dict(zip(given.ids, given.sigma, strict=True))
    assert rows.points.ids.tolist() == sorted(block.points.ids.tolist(), key=lambda name: (len(name), name))
    keys = list(zip(rows.plates.photo.tolist(), rows.plates.point.tolist(), strict=True))
    assert keys == sorted(keys) and keys != list(
        zip(block.plates.photo.tolist(), block.plates.point.tolist(), strict=True)
    )
    np.testing.assert_array_equal(in_order_of_ids(rows).plates.xy, rows.plates.xy)
