"""Decks for the tests of editing: fixtures, and what two blocks have in common."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from musatpy import model
from musatpy.errors import DeckError
from musatpy.formats.musat import check_deck, deck_bytes, read_deck
from musatpy.jobs.agreement import Part
from musatpy.jobs.merge import Merged, MergeOptions, merged

FIXTURES = Path(__file__).parents[2] / "fixtures"


def cayman() -> model.Block:
    return read_deck(FIXTURES / "cayman" / "cayman_modified.crd")


def st_thomas() -> model.Block:
    return read_deck(FIXTURES / "st_thomas" / "st_thomas.crd")


def rich() -> model.Block:
    """St. Thomas with something in every table."""
    block = st_thomas()
    ids = block.points.ids.tolist()
    ends = np.array([[ids.index(a), ids.index(b)] for a, b in (("101", "102"), ("104", "103"))])
    return replace(
        block,
        distortion=model.Distortion(camera=[0, 0], kind=["RADL", "DCEN"], values=[[1e-8, 2e-12, np.nan]] * 2),
        fiducials=model.Fiducials(camera=[0], ids=["1"], xy=[[-106.0, -106.0]], sigma=[[0.002, np.nan]]),
        fiducial_measurements=model.FiducialMeasurements(
            photo=[0, 1, 2], ids=["1"] * 3, xy=[[-106.0, -106.01]] * 3, sigma=np.full((3, 2), np.nan)
        ),
        photos=replace(
            block.photos,
            position_sigma=np.array([[0.5, 0.5, 0.8], [np.nan, np.nan, 0.8], [np.nan] * 3]),
            tide_sigma=np.array([0.05, np.nan, 0.05]),
            tide_group=np.array(["A", "A", "B"]),
            tide_day=np.array(["1", "1", "2"]),
        ),
        air_bases=model.AirBases(photo=[[0, 1], [2, 1]], length=[1440.0, 1390.0], sigma=[0.5, 0.5]),
        distances=model.Distances(point=ends, length=[2700.0, 1600.0], sigma=[0.05, 0.05]),
        height_differences=model.HeightDifferences(point=ends, difference=[35.4, -13.2], sigma=[0.02, 0.02]),
    )


def reread(block: model.Block) -> model.Block:
    """Return a block as its deck gives it."""
    again, problems = check_deck(deck_bytes(block), for_run=False)
    assert again is not None, [problem.headline() for problem in problems]
    return again


def cards(block: model.Block) -> Counter[str]:
    """Return the cards of a block, whatever their order, without sequence numbers."""
    return Counter(line[:72] for line in deck_bytes(block).decode("ascii").splitlines())


def photos(block: model.Block, *ids: str) -> np.ndarray:
    return np.isin(block.photos.ids, ids)


def merge(*blocks: model.Block, **options: object) -> Merged:
    parts = [Part(name=f"{letter}.crd", block=block) for letter, block in zip("abc", blocks, strict=False)]
    return merged(parts, MergeOptions(**options))


def complaints(*blocks: model.Block, **options: object) -> list[str]:
    with pytest.raises(DeckError) as error:
        merge(*blocks, **options)
    return [problem.message for problem in error.value.problems]
