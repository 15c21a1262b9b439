"""Pictures of interpolations: that they show what they are given, and that the one of docs stands there."""

from __future__ import annotations

import io

import numpy as np
import pytest

import collocation_tables

pytest.importorskip("matplotlib")

from matplotlib import image

from musatpy.sea.interpolation.correlation import Family
from musatpy.sea.interpolation.interpolate import Options, interpolate
from musatpy.sea.interpolation.prediction import Observed
from musatpy.sea.pictures.interpolation import interpolation_picture
from studies.collocation import Case, SeaState, outcome
from studies.pictures import collocation_picture


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(image.imread(io.BytesIO(png), format="png"))[..., :3]


@pytest.mark.slow
def test_a_map_shows_both_signs_and_leaves_out_what_is_out_of_reach() -> None:
    place = np.random.default_rng(1).uniform(0.0, 300.0, (40, 2))
    value = 0.3 * np.sin(place[:, 0] / 50.0)
    data = Observed(place=place, value=value, sigma=np.zeros(40))
    whole, near = (
        pixels(interpolation_picture(interpolate(data, Options(families=(Family.GAUSSIAN,), reach=reach))))
        for reach in (300.0, 20.0)
    )

    def coloured(drawn: np.ndarray) -> tuple[float, float]:
        third = drawn[:, : drawn.shape[1] // 3]
        difference = third[..., 0] - third[..., 2]
        return float((difference > 0.3).mean()), float((difference < -0.3).mean())

    assert min(coloured(whole)) > 0.02
    assert sum(coloured(near)) < 0.8 * sum(coloured(whole))


@pytest.mark.slow
def test_the_picture_of_the_study_stands_in_docs() -> None:
    outcomes = [outcome(Case(number=number), (Family.NONE, Family.SWELL)) for number in (12, 25)]
    rows = [(str(state), outcomes, outcomes, outcomes) for state in SeaState]
    drawn = pixels(collocation_picture(rows))
    assert len(np.unique(drawn.sum(axis=2))) > 20  # not an empty sheet
    assert np.array_equal(drawn, pixels(collocation_picture(rows)))
    # another version of matplotlib sets letters elsewhere, but the sheet has its size
    assert pixels(collocation_tables.PICTURE.read_bytes()).shape == drawn.shape
