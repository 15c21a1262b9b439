"""Frame, ticks and numbers of axes as matplotlib has them, and signs that are drawn in one stroke."""

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from musatpy.canvas import small_png, svg
from musatpy.plots import panel
from musatpy.plots.gallery import marks
from musatpy.plots.painted import add_arrows, add_names, arrow_corners
from musatpy.plots.tables import SharedTables, worked_out_once

PLACE = [0.2, 0.25, 0.7, 0.6]


def ours(**given):
    figure = Figure((4.0, 3.0))
    axes = panel.add_panel(figure, PLACE)
    axes.set(**given)
    return figure, axes


@pytest.mark.parametrize("limits", [(-3.0, 11.0), (80123.0, 80999.0), (5.0, -5.0), (0.0, 1e-3)])
def test_ticks_are_those_of_matplotlib(limits):
    _, axes = ours(xlim=limits, ylim=limits)
    other = Figure((4.0, 3.0)).add_axes(PLACE)
    other.set(xlim=limits, ylim=limits)
    for one in (axes, other):
        one.tick_params(labelsize=10.0)
        one.ticklabel_format(useOffset=False, style="plain")
    places, labels = panel._ticks(axes, 0)
    low, high = sorted(limits)
    wanted = [tick for tick in other.get_xticks() if low <= tick <= high]
    np.testing.assert_allclose(places, other.transData.transform([(tick, limits[0]) for tick in wanted])[:, 0])
    assert labels == other.xaxis.get_major_formatter().format_ticks(wanted)


def test_the_panel_is_one_of_matplotlib_and_its_bytes_stay():
    figure, axes = ours(xlim=(0.0, 1.0))
    assert isinstance(axes, Axes)
    axes.set_title("A title")
    assert svg(figure, "a") == svg(figure, "a") and small_png(figure) == small_png(figure)
    assert ">A title<" in svg(figure, "a").decode()


def test_an_arrow_ends_where_its_vector_does():
    starts, ends = np.array([[10.0, 10.0], [0.0, 0.0]]), np.array([[110.0, 10.0], [0.0, 4.0]])
    corners = arrow_corners(starts, ends, 2.0)
    np.testing.assert_allclose(corners[:, 3], ends)
    np.testing.assert_allclose(0.5 * (corners[:, 0] + corners[:, 6]), starts)
    assert np.ptp(corners[0, :, 1]) == pytest.approx(6.0)  # its head is three times as wide as the shaft
    assert corners[0, 2, 0] == pytest.approx(100.0) and corners[0, 1, 0] == pytest.approx(101.0)
    assert np.ptp(corners[1, :, 0]) == pytest.approx(2.4)  # a short one is all head, and smaller
    assert np.isfinite(arrow_corners(starts, starts, 2.0)).all()


def test_arrows_and_names_are_drawn_on_the_axes_only():
    figure, axes = ours(xlim=(0.0, 10.0), ylim=(0.0, 10.0))
    add_arrows(
        axes, np.array([[5.0, 5.0], [5.0, 8.0]]), np.array([[2.0, 0.0], [99.0, 0.0]]), color="black", width=0.01
    )
    assert marks(figure) >= 2
    add_names(axes, np.array([[2.0, 2.0], [20.0, 2.0]]), np.array(["here", "NOT"]))
    text = svg(figure, "a").decode()
    assert ">here<" in text and "NOT" not in text


def test_tables_that_are_shared_are_worked_out_once():
    asked = []

    @worked_out_once
    def size(tables):
        asked.append(1)
        return len(tables)

    shared = SharedTables({"a": 1, "b": 2})
    assert [size(shared), size(shared), size(SharedTables({})), size({"a": 1}), size({"a": 1})] == [2, 2, 0, 1, 1]
    assert len(asked) == 4
