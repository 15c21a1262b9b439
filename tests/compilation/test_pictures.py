"""The picture of a bottom: as high as its map, with the bar beside that whole."""

import pytest

from musatpy.compilation.pictures import height_of


@pytest.mark.parametrize(("north", "height"), [(5000.0, 6.0), (1000.0, 5.4), (500.0, 3.3)])
def test_a_figure_is_as_high_as_the_highest_of_its_maps(north: float, height: float) -> None:
    from matplotlib.figure import Figure

    maps = Figure().subplots(1, 2)
    for axes, length in zip(maps, (north, 0.5 * north), strict=True):
        axes.set(xlim=(0.0, 1000.0), ylim=(0.0, length))
    assert height_of(list(maps)) == pytest.approx(height, abs=0.01)
