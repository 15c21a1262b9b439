"""Axes of a map: equal in x and y, with their units, a scale bar and north; and the view of a block."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.canvas import new_figure
from musatpy.plots.ellipses import round_length
from musatpy.plots.plane import Plane

INK, GREY, LIGHT = "black", "0.45", "0.8"
SHADES = "cividis"  # alike to every eye, and in print
_LONG, _SHORT = 8.2, 4.2  # inches, of the sides of a map
_ROW = 0.19  # inches, of a line of the legend
_BORDER = 0.06  # of the extent
_BEYOND = 1.0  # extents of the block, within which points are in view
_NAMES = 60  # at most


def view_of(core: FloatArray, others: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the bounds (2, 2) of a picture, west south and east north, and which others (n,) lie in it.

    All of the core (m, 2) is in view, and of the others (n, 2) what lies within one extent of it: a point that went
    astray does not make a dot of the block.
    """
    core = core[np.isfinite(core).all(axis=1)]
    low, high = core.min(axis=0), core.max(axis=0)
    reach = _BEYOND * max(float((high - low).max()), 1.0)
    seen = ((others >= low - reach) & (others <= high + reach)).all(axis=1)
    both = np.concatenate([core, others[seen]])
    low, high = both.min(axis=0), both.max(axis=0)
    border = _BORDER * max(float((high - low).max()), 1.0)
    return np.array([low - border, high + border]), seen


def new_map(bounds: FloatArray, plane: Plane, title: str) -> tuple[Any, Any]:
    """Return a figure and its axes for bounds (2, 2) m. Raises `MusatError` where matplotlib is missing."""
    figure = new_figure(1.0, 1.0)
    figure.set_layout_engine("none")
    axes = figure.add_subplot()
    dress(axes, bounds, plane)
    axes.set_title(title, fontsize=11)
    return figure, axes


def finish(figure: Any, axes: Any, *, shade: Any = None, label: str = "") -> Any:
    """Give a map its size, with the legend below, and beside it what its shades mean (`shade`); return the figure.

    Margins are of fixed sizes, so that maps of one extent lie on one another.
    """
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    scale = _LONG / max(east - west, north - south)
    width, height = (max(extent * scale, _SHORT) for extent in (east - west, north - south))
    handles, labels = axes.get_legend_handles_labels()
    columns = min(3, max(len(labels), 1))
    legend = _ROW * -(-len(labels) // columns) + 0.15
    left, below, above, right = 0.8, 0.6 + legend, 0.4, 1.1 if shade is not None else 0.3
    whole = np.array([left + width + right, below + height + above])
    figure.set_size_inches(*whole)
    axes.set_position([left / whole[0], below / whole[1], width / whole[0], height / whole[1]])
    if labels:
        figure.legend(handles, labels, loc="lower center", ncols=columns, fontsize=8)
    if shade is not None:
        bar = figure.add_axes(
            [(left + width + 0.15) / whole[0], below / whole[1], 0.18 / whole[0], height / whole[1]]
        )
        figure.colorbar(shade, cax=bar, label=label)
        bar.tick_params(labelsize=8)
    return figure


def dress(axes: Any, bounds: FloatArray, plane: Plane) -> None:
    """Give axes the bounds (2, 2) m, labels with units, a scale bar and north."""
    axes.set_aspect("equal")
    axes.set_xlim(*bounds[:, 0])
    axes.set_ylim(*bounds[:, 1])
    axes.set_xlabel(plane.labels[0])
    axes.set_ylabel(plane.labels[1])
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.tick_params(labelsize=8)
    axes.locator_params(nbins=6)
    _draw_scale(axes, bounds)
    axes.annotate(
        "", xy=(0.97, 0.98), xytext=(0.97, 0.90), xycoords="axes fraction", ha="center", va="center",
        arrowprops={"arrowstyle": "-|>", "color": INK, "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip
    axes.text(0.97, 0.895, plane.north, transform=axes.transAxes, ha="center", va="top", fontsize=10)


def _draw_scale(axes: Any, bounds: FloatArray) -> None:
    """Draw a bar of a round length in the lower right corner."""
    width, height = (bounds[1] - bounds[0]).tolist()
    length = round_length(0.25 * width)
    right, below = bounds[1, 0] - 0.03 * width, bounds[0, 1] + 0.03 * height
    axes.plot([right - length, right], [below, below], "-", color=INK, linewidth=3, solid_capstyle="butt")
    text = f"{length:g} m" if length < 1000.0 else f"{length / 1000.0:g} km"
    axes.annotate(
        text, (right - 0.5 * length, below), textcoords="offset points", xytext=(0, 4), ha="center", fontsize=8
    )


def name_places(axes: Any, xy: FloatArray, names: Any, **style: Any) -> None:
    """Write names beside places (n, 2); of many, every second, third, ... only."""
    known = np.flatnonzero(np.isfinite(xy).all(axis=1))
    step = -(-len(known) // _NAMES) or 1
    for row in known[::step].tolist():
        axes.annotate(
            str(names[row]), xy[row], textcoords="offset points", xytext=(4, 4), fontsize=7, annotation_clip=True,
            **style,
        )  # fmt: skip
