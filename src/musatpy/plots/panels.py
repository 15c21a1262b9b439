"""Maps of the points of a block side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.plots.bottom_points import as_run, is_compilation
from musatpy.plots.footprints import ground_of, outlines
from musatpy.plots.mapping import INK, SHADES, dot_size, draw_outlines, dress, enlarge_signs, view_of
from musatpy.plots.plane import Plane, plane_of
from musatpy.plots.sheet import Margins, Sheet, legend_below, legend_lines, new_sheet
from musatpy.plots.tables import Tables, numbers, part, worked_out_once

MAPS_NEED = {
    "options": ("system",),
    "stations": ("photo", "camera", "position", "attitude"),
    "cameras": ("camera", "focal_length", "principal_point", "format_size"),
    "points": ("position",),
}
_MARKERS = ("o", "s", "D", "^", "v", "P", "X")  # of classes
_STATIONS = 200  # that are drawn in a panel with their footprints, at most: more would hide the points
_PANEL = 5.0  # inches, of the long side of a map
_COLUMNS = 5  # of the legend
NAMED = 2  # what is drawn under points: footprints and stations


@dataclass(frozen=True, kw_only=True, eq=False)
class PointMap:
    """The points of a block on its plane, m, with what is drawn under them."""

    plane: Plane
    stations: FloatArray  # (k, 2)
    outlines: FloatArray  # (k, 4, 2)
    places: FloatArray  # (n, 2)
    seen: BoolArray  # (n,) in view
    bounds: FloatArray  # (2, 2)


@worked_out_once
def point_map(tables: Tables) -> PointMap:
    """Return the map of the points of a run or a compilation, of the latter without photos.

    Raises `NothingToShowError` where the system of the job is not known.
    """
    position = numbers(part(tables, "points"), "position", 3)
    if is_compilation(tables):
        plane = plane_of(as_run(tables))
        stations, around = np.empty((0, 2)), np.empty((0, 4, 2))
    else:
        plane = plane_of(tables)
        stations = plane.places(numbers(part(tables, "stations"), "position", 3))[:, :2]
        around = outlines(tables, plane, ground_of(plane.places(position)))
    places = plane.places(position)[:, :2]
    core = np.concatenate([stations, around.reshape(-1, 2)]) if len(stations) else places
    bounds, seen = view_of(core, places)
    return PointMap(plane=plane, stations=stations, outlines=around, places=places, seen=seen, bounds=bounds)


def new_panels(block: PointMap, titles: list[str], title: str, named: int) -> tuple[Sheet, list[Any]]:
    """Return a sheet with the maps of a block side by side, and room for a legend of so many names.

    Raises `MusatError` where matplotlib is missing.
    """
    width, height = (block.bounds[1] - block.bounds[0]).tolist()
    scale = _PANEL / max(width, height)
    across = min(len(titles), 2)
    down = -(-len(titles) // across)
    sizes = [width * scale] * across, [height * scale] * down
    sheet = new_sheet(sizes, Margins(), title=title, legend=legend_lines(named, _COLUMNS))
    panels = sheet.panels.ravel()[: len(titles)].tolist()
    for axes in sheet.panels.ravel()[len(titles) :]:
        axes.remove()
    for axes, title in zip(panels, titles, strict=True):
        dress(axes, block.bounds, block.plane)
        axes.set_title(title, fontsize=10)
    return sheet, panels


def draw_block(axes: Any, block: PointMap) -> None:
    """Draw footprints and stations of a block, where these are not too many."""
    if len(block.stations) <= _STATIONS:
        draw_outlines(axes, block.outlines)
        axes.plot(*block.stations.T, "+", color=INK, markersize=4, label="stations")


def draw_grades(axes: Any, block: PointMap, grade: IntArray, classes: Sequence[str], used: Sequence[int]) -> None:
    """Draw points by classes (n,), -1 of none, each with a shade and a marker; all that are used are named."""
    from matplotlib import colormaps

    size = dot_size(block.bounds, int(block.seen.sum()))
    low, high = min(used, default=0), max(used, default=0)
    for number in used:
        rows = block.seen & (grade == number)
        shade = colormaps[SHADES]((number - low) / max(high - low, 1))
        marker = _MARKERS[number % len(_MARKERS)]
        axes.plot(
            *block.places[rows].T, marker, color=shade, markersize=size, markeredgewidth=0, label=classes[number]
        )


def finish_panels(sheet: Sheet, panels: list[Any]) -> Any:
    """Give a sheet of maps one legend, and return its figure."""
    named: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    enlarge_signs(legend_below(sheet.figure, _COLUMNS, list(named.values()), list(named)))
    return sheet.figure
