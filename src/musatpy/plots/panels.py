"""Maps of the points of a block side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.canvas import new_figure
from musatpy.plots.footprints import outlines
from musatpy.plots.mapping import INK, SHADES, dot_size, draw_outlines, dress, view_of
from musatpy.plots.plane import Plane, plane_of
from musatpy.plots.tables import Tables, numbers, part

MAPS_NEED = {
    "options": ("system",),
    "stations": ("photo", "camera", "position", "attitude"),
    "cameras": ("camera", "focal_length", "principal_point", "format_size"),
    "points": ("position",),
}
_MARKERS = ("o", "s", "D", "^", "v", "P", "X")  # of classes
_PANEL, _LOW = 5.0, 2.6  # inches, of the long side of a map, and of its height at least


@dataclass(frozen=True, kw_only=True, eq=False)
class PointMap:
    """The points of a block on its plane, m, with what is drawn under them."""

    plane: Plane
    stations: FloatArray  # (k, 2)
    outlines: FloatArray  # (k, 4, 2)
    places: FloatArray  # (n, 2)
    seen: BoolArray  # (n,) in view
    bounds: FloatArray  # (2, 2)


def point_map(tables: Tables, positions: FloatArray | None = None) -> PointMap:
    """Return the map of points (n, 3), those of the record where none are given.

    Raises `NothingToShowError` without stations.
    """
    plane = plane_of(tables)
    if positions is None:
        positions = numbers(part(tables, "points"), "position", 3)
    places = plane.places(positions)
    stations = plane.places(numbers(part(tables, "stations"), "position", 3))[:, :2]
    heights = places[np.isfinite(places).all(axis=1), 2]
    ground = float(np.median(heights)) if len(heights) else 0.0
    around = outlines(tables, plane, ground)
    bounds, seen = view_of(np.concatenate([stations, around.reshape(-1, 2)]), places[:, :2])
    return PointMap(plane=plane, stations=stations, outlines=around, places=places[:, :2], seen=seen, bounds=bounds)


def new_panels(block: PointMap, titles: list[str]) -> tuple[Any, list[Any]]:
    """Return a figure with the maps of a block side by side. Raises `MusatError` where matplotlib is missing."""
    width, height = (block.bounds[1] - block.bounds[0]).tolist()
    scale = _PANEL / max(width, height)
    across = min(len(titles), 2)
    down = -(-len(titles) // across)
    figure = new_figure((width * scale + 0.7) * across + 0.3, max(height * scale + 0.7, _LOW) * down + 1.0)
    panels = [figure.add_subplot(down, across, place) for place in range(1, len(titles) + 1)]
    for axes, title in zip(panels, titles, strict=True):
        axes.set_aspect("equal")
        dress(axes, block.bounds, block.plane)
        axes.set_title(title, fontsize=10)
    return figure, panels


def draw_block(axes: Any, block: PointMap) -> None:
    """Draw footprints and stations of a block."""
    draw_outlines(axes, block.outlines)
    axes.plot(*block.stations.T, "+", color=INK, markersize=4, label="stations")


def draw_grades(axes: Any, block: PointMap, grade: IntArray, classes: Sequence[str], used: Sequence[int]) -> None:
    """Draw points by classes (n,), -1 of none, each with a shade and a marker; all that are used are named."""
    from matplotlib import colormaps

    size = dot_size(block.bounds, int(block.seen.sum()))
    for number in used:
        rows = block.seen & (grade == number)
        shade = colormaps[SHADES](number / max(len(classes) - 1, 1))
        marker = _MARKERS[number % len(_MARKERS)]
        axes.plot(
            *block.places[rows].T, marker, color=shade, markersize=size, markeredgewidth=0, label=classes[number]
        )


def finish_panels(figure: Any, panels: list[Any], title: str) -> Any:
    """Give a figure of maps its title and one legend, and return it."""
    named: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    figure.suptitle(title, fontsize=11)
    figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=min(len(named), 5), fontsize=8)
    return figure
