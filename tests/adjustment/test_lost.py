"""Data so wrong that points fall behind their cameras: the run ends as not converged, never in an exception."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from musatpy import adjust, listing, read_deck
from musatpy.model import Refraction

DECK = Path(__file__).resolve().parents[2] / "fixtures" / "st_thomas" / "st_thomas.crd"


@pytest.fixture(scope="module")
def block():
    return read_deck(DECK)


def moved_control(block, row, degrees):
    position = block.control.position.copy()
    position[row] += [*np.radians(degrees), 0.0]
    return dataclasses.replace(block, control=dataclasses.replace(block.control, position=position))


def moved_station(block, row, degrees):
    position = block.photos.position.copy()
    position[row] += [*np.radians(degrees), 0.0]
    return dataclasses.replace(block, photos=dataclasses.replace(block.photos, position=position))


@pytest.mark.parametrize("refraction", [Refraction.WATPT, Refraction.RIGOROUS])
@pytest.mark.parametrize(
    "spoil",
    [
        pytest.param(lambda block: moved_control(block, 3, (1.0, 0.0)), id="control-degree-of-latitude"),
        pytest.param(lambda block: moved_control(block, 0, (0.0, -1.0)), id="control-degree-of-longitude"),
        pytest.param(lambda block: moved_station(block, 2, (1.0, 0.0)), id="station-degree-of-latitude"),
    ],
)
def test_a_hopeless_job_ends_as_not_converged(block, spoil, refraction):
    spoiled = spoil(block)
    solution = adjust(
        dataclasses.replace(spoiled, options=dataclasses.replace(block.options, refraction=refraction))
    )
    assert not solution.converged
    assert "still moves" in solution.reason
    assert "NOT CONVERGED" in listing(solution)


def test_points_behind_cameras_end_the_run(block):
    solution = adjust(moved_station(block, 2, (1.0, 0.0)))
    assert solution.reason.startswith("points stay behind their cameras")
    assert solution.passes == ()  # nothing is built on a lost triangulation
