"""Pictures of estimated water surfaces: that they are pictures of what they are asked for, and always the same."""

from __future__ import annotations

import io

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib import image

import sea_fixtures
import sea_tables
from musatpy.sea.pictures.stereo import surface_picture
from musatpy.sea.stereo.estimate import fit_fourier, fit_grid
from studies.pictures import stereo_picture
from studies.stereo import Setup, run


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(image.imread(io.BytesIO(png), format="png"))


@pytest.mark.slow
def test_the_surface_is_drawn_with_what_is_rejected() -> None:
    points = sea_fixtures.simulation().surface_points
    points.position[17, 2] += 1.2
    for fit in (fit_fourier(points), fit_grid(points, curvature=0.003)):
        assert not fit.kept[17]
        first = surface_picture(fit, "SEA")
        assert first == surface_picture(fit, "SEA")
        drawn = pixels(first)
        red = (np.abs(drawn[..., :3] - [0xB5 / 255, 0x40 / 255, 0x2A / 255]) < 0.02).all(axis=-1)
        assert red.sum() > 5  # the cross of the point
        assert len(np.unique(drawn[..., :3].sum(axis=2))) > 100  # maps, not an empty sheet


@pytest.mark.slow
def test_the_picture_of_the_study_stands_in_docs() -> None:
    outcomes = [run(Setup(surface_points=count, bottom_points=20), (1,)) for count in (60, 120)]
    drawn = pixels(stereo_picture([("one", outcomes)] * len(sea_tables.SEAS)))
    kept = pixels(sea_tables.PICTURE.read_bytes())
    # another version of matplotlib sets letters elsewhere, but the sheet has its size
    assert kept.shape == drawn.shape and len(np.unique(kept[..., :3].sum(axis=2))) > 20
