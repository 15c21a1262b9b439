"""Frame, ticks and numbers of axes as matplotlib has them, and signs that are drawn in one stroke."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from musatpy.canvas import small_png, svg
from musatpy.lettering import renderer_of
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


def pixels(figure):
    """Return which pixels of a figure are dark, rows from below."""
    figure.set_dpi(100)
    renderer = renderer_of(400.0, 300.0, 100)
    figure.draw(renderer)
    return np.asarray(renderer.buffer_rgba())[::-1, :, :3].sum(axis=2) < 300


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


def test_frame_and_ticks_are_where_matplotlib_draws_them():
    figure, axes = ours(xlim=(0.0, 10.0), ylim=(0.0, 4.0))
    other = Figure((4.0, 3.0))
    other.add_axes(PLACE).set(xlim=(0.0, 10.0), ylim=(0.0, 4.0))
    for one in (axes, other.axes[0]):
        one.tick_params(labelsize=8.0)
        one.set_xticks([0.0, 5.0, 10.0], ["", "", ""])
        one.set_yticks([0.0, 1.0, 4.0], ["", "", ""])
    drawn, wanted = pixels(figure), pixels(other)
    assert wanted.sum() > 900 and (drawn == wanted).all()


def test_names_of_axes_and_numbers_do_not_touch():
    figure, axes = ours(xlim=(0.0, 10.0), ylim=(0.0, 40000.0))
    axes.set_ylabel("height, m")
    dark = pixels(figure)[:, :79].any(axis=0)  # left of the frame
    edges = np.flatnonzero(np.diff(dark.astype(int)))
    assert dark[edges[0] + 1 :].sum() > 20 and np.diff(edges).max() >= 3  # a gap between name and numbers
    assert not dark[:2].any()


def test_grid_numbers_above_and_axes_that_are_off():
    figure, axes = ours(xlim=(0.0, 10.0), ylim=(0.0, 4.0))
    bare = pixels(figure).sum()
    axes.grid(alpha=1.0, linewidth=3.0, color="black")
    assert pixels(figure).sum() > bare + 500
    axes.grid(False)
    assert pixels(figure).sum() == bare
    axes.scales["y"].after = True
    assert pixels(figure)[:, 365:].any() and not pixels(figure)[80:250, :75].any()
    axes.set_axis_off()
    assert not pixels(figure).any()
    with pytest.raises(AttributeError):
        axes.set(no_such_property=1)


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
    bare = pixels(figure)
    add_arrows(
        axes, np.array([[5.0, 5.0], [5.0, 8.0]]), np.array([[2.0, 0.0], [99.0, 0.0]]), color="black", width=0.01
    )
    with_arrows = pixels(figure)
    new = with_arrows & ~bare
    rows, columns = np.nonzero(new)
    assert marks(figure) >= 2 and columns.max() <= 361 and columns.min() >= 219
    assert new[165, 221:270].all() and not new[165, 280:].any()  # from 5 to 7 of ten
    add_names(axes, np.array([[2.0, 2.0], [20.0, 2.0]]), np.array(["here", "NOT"]))
    rows, columns = np.nonzero(pixels(figure) & ~with_arrows)
    assert len(rows) and columns.max() < 260
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
