"""Letters by Pillow stand where matplotlib would have put them."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.figure import Figure

from musatpy.lettering import renderer_of

_DPI = 110


def ink(renderer, **text):
    """Return the first and last rows and columns of the dark pixels of a figure with one text, and its darkness."""
    figure = Figure((3.0, 2.0), dpi=_DPI)
    figure.text(0.5, 0.5, **text)
    figure.draw(renderer)
    grey = 255 - np.asarray(renderer.buffer_rgba())[..., 0].astype(int)
    rows, columns = np.nonzero(grey > 100)
    return np.array([rows.min(), rows.max(), columns.min(), columns.max()]), grey.sum()


@pytest.mark.parametrize("rotation", [0, 90])
@pytest.mark.parametrize(
    "place", [{"ha": "left", "va": "bottom"}, {"ha": "right", "va": "center"}, {"ha": "center"}]
)
@pytest.mark.parametrize("text", ["Plan, m", "−12.5", "18°20.403'N (gjpq)"])
def test_texts_stand_as_matplotlib_has_them(rotation, place, text):
    given = {"s": text, "fontsize": 9, "rotation": rotation, **place}
    edges, darkness = ink(renderer_of(330.0, 220.0, _DPI), **given)
    wanted, other = ink(RendererAgg(330, 220, _DPI), **given)
    assert np.abs(edges - wanted).max() <= 2 and darkness == pytest.approx(other, rel=0.2)


@pytest.mark.parametrize(
    "given", [{"s": "$10^{-3}$"}, {"s": "bold", "weight": "bold"}, {"s": "aslant", "rotation": 30}]
)
def test_other_texts_are_drawn_by_matplotlib(given):
    (edges, darkness), (wanted, other) = (
        ink(renderer_of(330.0, 220.0, _DPI), **given),
        ink(RendererAgg(330, 220, _DPI), **given),
    )
    assert (edges == wanted).all() and darkness == other


def test_a_name_of_strange_letters_is_drawn():
    ink(renderer_of(330.0, 220.0, _DPI), s="foto Ж 写")
