"""Axes of a map: equal in x and y, with their units, a scale bar and north; and the view of a block."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.canvas import new_figure
from musatpy.plots.enlarged import largest_of_cells, magnification, round_length
from musatpy.plots.painted import add_arrows, add_names
from musatpy.plots.panel import add_panel
from musatpy.plots.plane import Plane
from musatpy.plots.sheet import draw_bar

INK, GREY, LIGHT = "black", "0.45", "0.75"
DRY, WET, CONTROL = "#9a6700", "#00457c", "#b3001b"  # apart in grey too, and never without a marker of their own
SHADES = "cividis"  # alike to every eye, and in print
_LONG, _SHORT = 8.2, 3.6  # inches, of the sides of a map
_ROW = 0.19  # inches, of a line of the legend
_BORDER = 0.05  # of the extent
_KEY = 0.05  # of the extent, for a line of keys below the block
_BEYOND = 1.0  # extents of the block, within which points are in view
_NAMES = 40  # at most
MOST_ARROWS = 1000  # or ellipses of a map: more cannot be told apart
OF_CELLS = ", the largest of each cell"
_NOTHING = 1e-6  # m, of vectors that are rounding errors
_SHOWN = 0.02  # of the extent, at most: ellipses and arrows
_APART = 0.6  # of the distance between points, at most
_DOTS = (2.0, 6.0)  # points, of the smallest and largest marker


def view_of(core: FloatArray, others: FloatArray, keys: int = 0) -> tuple[FloatArray, BoolArray]:
    """Return the bounds (2, 2) of a picture, west south and east north, and which others (n,) lie in it.

    All of the core (m, 2) is in view, and of the others (n, 2) what lies within one extent of it: a point that went
    astray does not make a dot of the block. Below it is room for some lines of keys.
    """
    core = core[np.isfinite(core).all(axis=1)]
    low, high = core.min(axis=0), core.max(axis=0)
    reach = _BEYOND * max(float((high - low).max()), 1.0)
    seen = ((others >= low - reach) & (others <= high + reach)).all(axis=1)
    both = np.concatenate([core, others[seen]])
    low, high = both.min(axis=0), both.max(axis=0)
    extent = max(float((high - low).max()), 1.0)
    low, high = low - _BORDER * extent, high + _BORDER * extent
    low[1] -= keys * _KEY * extent
    lacking = np.maximum(_SHORT / _LONG * (high - low).max() - (high - low), 0.0)
    return np.array([low - 0.5 * lacking, high + 0.5 * lacking]), seen


def shown_size(bounds: FloatArray, number: int) -> float:
    """Return how large (m) most ellipses of a number of points in bounds are drawn: they do not hide each other."""
    sides = bounds[1] - bounds[0]
    return float(min(_SHOWN * sides.max(), _APART * np.sqrt(sides.prod() / max(number, 1))))


def dot_size(bounds: FloatArray, number: int) -> float:
    """Return the size (points) of the markers of a number of points."""
    sides = bounds[1] - bounds[0]
    apart = np.sqrt(sides.prod() / max(number, 1)) / sides.max() * _LONG * 72.0
    return float(np.clip(0.3 * apart, *_DOTS))


def new_map(bounds: FloatArray, plane: Plane, title: str) -> tuple[Any, Any]:
    """Return a figure and its axes for bounds (2, 2) m. Raises `MusatError` where matplotlib is missing."""
    figure = new_figure(1.0, 1.0)
    figure.set_layout_engine("none")
    axes = add_panel(figure, [0.0, 0.0, 1.0, 1.0])
    dress(axes, bounds, plane)
    axes.set_title(title, fontsize=11)
    return figure, axes


def dress(axes: Any, bounds: FloatArray, plane: Plane) -> None:
    """Give axes the bounds (2, 2) m, labels with units, a scale bar and north."""
    axes.set_xlim(*bounds[:, 0])
    axes.set_ylim(*bounds[:, 1])
    axes.set_xlabel(plane.labels[0], fontsize=9)
    axes.set_ylabel(plane.labels[1], fontsize=9)
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.tick_params(labelsize=8)
    axes.locator_params(nbins=6)
    arrow = {"arrowstyle": "-|>", "color": INK, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=(0.97, 0.98), xytext=(0.97, 0.90), xycoords="axes fraction", arrowprops=arrow)
    axes.text(0.97, 0.895, plane.north, transform=axes.transAxes, ha="center", va="top", fontsize=9)
    _draw_scale(axes, bounds)


def finish(figure: Any, axes: Any, *, shade: Any = None, label: str = "") -> Any:
    """Give a map its size, with the legend below, and beside it what its shades mean (`shade`); return the figure.

    Margins are of fixed sizes, so that maps of one extent lie on one another.
    """
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    scale = _LONG / max(east - west, north - south)
    width, height = (extent * scale for extent in (east - west, north - south))
    handles, labels = axes.get_legend_handles_labels()
    columns = min(3, max(len(labels), 1))
    legend = _ROW * -(-len(labels) // columns) + 0.15
    left, below, above, right = 0.8, 0.6 + legend, 0.4, 1.1 if shade is not None else 0.3
    whole = np.array([left + width + right, below + height + above])
    figure.set_size_inches(*whole)
    axes.set_position([left / whole[0], below / whole[1], width / whole[0], height / whole[1]])
    if labels:
        enlarge_signs(figure.legend(handles, labels, loc="lower center", ncols=columns, fontsize=8))
    if shade is not None:
        place = [(left + width + 0.15) / whole[0], below / whole[1], 0.18 / whole[0], height / whole[1]]
        draw_bar(figure, place, shade, label)
    return figure


def enlarge_signs(legend: Any) -> None:
    """Give the markers of a legend a size at which they can be told apart, whatever that of the map is."""
    for handle in legend.legend_handles:
        if hasattr(handle, "set_markersize"):
            handle.set_markersize(max(handle.get_markersize(), _DOTS[1] - 1.0))


def _draw_scale(axes: Any, bounds: FloatArray) -> None:
    """Draw a bar of a round length in the lower right corner."""
    width, height = (bounds[1] - bounds[0]).tolist()
    length = round_length(0.2 * width)
    right, below = bounds[1, 0] - 0.03 * width, bounds[0, 1] + 0.02 * height
    axes.plot([right - length, right], [below, below], "-", color=INK, linewidth=3, solid_capstyle="butt")
    text = f"{length:g} m" if length < 1000.0 else f"{length / 1000.0:g} km"
    axes.annotate(
        text, (right - 0.5 * length, below), textcoords="offset points", xytext=(0, 4), ha="center", fontsize=8
    )


def key_place(axes: Any, line: int) -> FloatArray:
    """Return the place (2,) of the sign of a line of keys, the lowest is 0, in the lower left corner."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    extent = max(east - west, north - south)
    return np.array([west + 0.045 * extent, south + (0.025 + 0.95 * _KEY * line) * extent])


def write_key(axes: Any, place: FloatArray, text: str) -> None:
    """Write what a sign at a place means."""
    axes.annotate(text, place, textcoords="offset points", xytext=(24, -3), fontsize=8)


def draw_arrows(
    axes: Any, places: FloatArray, vectors: FloatArray, shown: float, what: str, *, color: str = INK, line: int = 0
) -> None:
    """Draw vectors (n, 2) m at places (n, 2), most as long as `shown` (m), with their key; NaN is left out."""
    rows = np.flatnonzero(np.isfinite(vectors).all(axis=1) & np.isfinite(places).all(axis=1))
    length = np.linalg.norm(vectors[rows], axis=1)
    if not (length > _NOTHING).any():
        return
    some = largest_of_cells(places[rows], length, MOST_ARROWS)
    what += OF_CELLS if len(some) < len(rows) else ""
    rows, factor = rows[some], magnification(length[some], shown)
    unit = round_length(1.5 * shown / factor)
    place = key_place(axes, line)
    tails = np.concatenate([places[rows], [place - [0.5 * factor * unit, 0.0]]])
    arrows = factor * np.concatenate([vectors[rows], [[unit, 0.0]]])
    add_arrows(axes, tails, arrows, color=color, width=0.0025)
    write_key(axes, place, f"{what}, {factor:,g} times enlarged: {unit:g} m")


def draw_outlines(axes: Any, outlines: FloatArray) -> None:
    """Draw the footprints (n, 4, 2) of photos."""
    from matplotlib.collections import LineCollection

    known = outlines[np.isfinite(outlines).all(axis=(1, 2))]
    if len(known):
        rings = np.concatenate([known, known[:, :1]], axis=1)
        axes.add_collection(LineCollection(list(rings), colors=LIGHT, linewidths=0.6, zorder=0), autolim=False)
        axes.plot([], [], "-", color=LIGHT, label="footprints")


def name_places(axes: Any, xy: FloatArray, names: TextArray) -> None:
    """Write names beside places (n, 2); of many, every second, third, ... only."""
    known = np.flatnonzero(np.isfinite(xy).all(axis=1))
    step = -(-len(known) // _NAMES) or 1
    add_names(axes, xy[known[::step]], names[known[::step]])
