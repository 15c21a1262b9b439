"""Pictures of wave experiments: that they are pictures, of what they are asked for, and always the same."""

from __future__ import annotations

import io

import numpy as np
import pytest

import okamoto_tables

pytest.importorskip("matplotlib")

from matplotlib import image

from musatpy.sea.experiment import histogram
from musatpy.sea.pictures.waves import error_maps
from musatpy.sea.spec import spec_from_table
from musatpy.sea.study import study
from studies.pictures import height_histogram


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(image.imread(io.BytesIO(png), format="png"))


@pytest.fixture(scope="module")
def figures() -> dict[str, bytes]:
    return okamoto_tables.pictures()


@pytest.mark.slow
def test_the_figures_of_the_paper_are_drawn_and_stand_in_docs(figures: dict[str, bytes]) -> None:
    assert sorted(figures) == ["okamoto_figure7", "okamoto_figure8", "okamoto_figure9"]
    for name, figure in figures.items():
        drawn = pixels(figure)
        assert min(drawn.shape[:2]) > 300
        assert len(np.unique(drawn[..., :3].sum(axis=2))) > 20  # not an empty sheet
        # another version of matplotlib sets letters elsewhere, but the sheet has its size
        kept = pixels((okamoto_tables.PICTURES / f"{name}.png").read_bytes())
        assert kept.shape == drawn.shape


def test_a_picture_is_the_same_every_time(figures: dict[str, bytes]) -> None:
    assert okamoto_tables.pictures() == figures


def test_a_histogram_has_as_much_ink_as_points() -> None:
    """Bars fill the part of the plot that the counts give: full for a flat histogram."""

    def blue(error: np.ndarray) -> int:
        drawn = pixels(height_histogram(histogram(error), "T"))
        return int((np.abs(drawn[..., :3] - [0x1F / 255, 0x5A / 255, 0x8C / 255]) < 0.01).all(axis=-1).sum())

    flat = np.repeat(np.linspace(-1.0, 1.0, 2001)[:, None], 3, axis=1)
    peaked = flat**9
    assert blue(flat) > 3 * blue(peaked) > 0


def test_maps_show_both_signs() -> None:
    spec = spec_from_table(
        {
            "stereo": {"cameras": [[0.0, 0.0, 490.0], [264.0, 0.0, 490.0]]},
            "water": {"depth": 10.0},
            "wave": [{"period": 10.0, "deep_height": 1.0}],
            "area": {"first": [0.0, -300.0], "spacing": [30.0, 60.0], "numbers": [9, 11]},
        }
    )
    drawn = pixels(error_maps(study(spec)))[:, :, :3]
    red, blue = drawn[..., 0] - drawn[..., 2] > 0.3, drawn[..., 2] - drawn[..., 0] > 0.3
    assert red.mean() > 0.01 and blue.mean() > 0.01
