"""Axes that draw frame, ticks and their numbers at once: the ticks of matplotlib are half the time of a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.plots.painted import OwnSet, font_of, lines, painted, polygons, write

_TICK, _PAD, _LABEL_PAD = 3.5, 3.5, 4.0  # points: length of a tick, from it to its number, from numbers to the name
_LINE, _NUMBER = 0.8, 8.0  # points: width of the frame, size of numbers
_GRID = "#b0b0b0"
_EDGE = 1e-9  # of the extent, within which a tick is still on the axes


@dataclass(kw_only=True)
class Scale:
    """How the ticks of an axis are drawn."""

    size: float = _NUMBER  # points
    turned: bool = False  # numbers run upwards
    named: bool = True  # ticks have numbers
    after: bool = False  # above, or at the right
    grid: dict[str, Any] = field(default_factory=dict)  # style of its lines; empty: none


def add_panel(figure: Any, place: Sequence[float]) -> Any:
    """Return axes on a figure, at left, below, width, height in shares of its size."""
    return figure.add_axes(_panel_class()(figure, place))


class _Ticks:
    """The methods of axes for their ticks, which `_draw_frame` draws."""

    xaxis: Any
    yaxis: Any
    scales: dict[str, Scale]

    def grid(self, visible: bool | None = None, which: str = "major", axis: str = "both", **style: Any) -> None:
        for name, scale in self.scales.items():
            if axis in (name, "both"):
                scale.grid = {"color": _GRID, **style} if visible or style else {}

    def tick_params(self, axis: str = "both", which: str = "major", **options: Any) -> None:
        if which == "minor":  # which earlier versions of matplotlib set as axes are made
            return
        for name, scale in self.scales.items():
            if axis in (name, "both"):
                scale.size = options.get("labelsize", scale.size)
        self.scales["x"].named = options.get("labelbottom", self.scales["x"].named)

    def set_xticks(self, ticks: Any, labels: Any = None, **style: Any) -> None:
        _set_ticks(self.xaxis, self.scales["x"], ticks, labels, **style)

    def set_yticks(self, ticks: Any, labels: Any = None, **style: Any) -> None:
        _set_ticks(self.yaxis, self.scales["y"], ticks, labels, **style)


def _set_ticks(
    axis: Any, scale: Scale, ticks: Any, labels: Any, *, rotation: float = 0.0, fontsize: float = _NUMBER
) -> None:
    from matplotlib.ticker import FixedFormatter, FixedLocator

    axis.set_major_locator(FixedLocator(ticks))
    if labels is not None:
        axis.set_major_formatter(FixedFormatter([str(label) for label in labels]))
    scale.turned, scale.size = rotation == 90.0, fontsize


@cache
def _axis_classes() -> tuple[Any, Any]:
    """Return the classes of axes along x and y that make no ticks, and are not drawn."""
    from matplotlib.artist import Artist
    from matplotlib.axis import XAxis, YAxis

    class BareX(OwnSet, XAxis):
        def set_clip_path(self, path: Any, transform: Any = None) -> None:
            Artist.set_clip_path(self, path, transform)

    class BareY(OwnSet, YAxis):
        def set_clip_path(self, path: Any, transform: Any = None) -> None:
            Artist.set_clip_path(self, path, transform)

    return BareX, BareY


@cache
def _panel_class() -> Any:
    """Return the class of axes: matplotlib is imported where a picture is drawn."""
    from matplotlib.axes import Axes

    base: Any = Axes  # of which other versions of matplotlib tell mypy other things

    class Panel(OwnSet, _Ticks, base):  # type: ignore[misc]
        def __init__(self, *arguments: Any, **options: Any) -> None:
            self.scales = {"x": Scale(), "y": Scale()}
            super().__init__(*arguments, **options)
            self.xaxis.set_visible(False)
            self.yaxis.set_visible(False)
            self.add_artist(painted(lambda renderer: _draw_grid(self, renderer), 0.9))
            self.add_artist(painted(lambda renderer: _draw_frame(self, renderer), 2.6))

        def _gen_axes_spines(self, *_: Any) -> dict[str, Any]:
            return {}

        def _init_axis(self) -> None:
            x, y = _axis_classes()
            self.xaxis, self.yaxis = x(self, clear=False), y(self, clear=False)

        def set_title(self, label: str, **options: Any) -> Any:
            return super().set_title(label, **{"y": 1.0, **options})

    return Panel


def _ticks(axes: Any, number: int) -> tuple[FloatArray, list[str]]:
    """Return where the ticks of an axis in view are, pixels along it, and their numbers."""
    axis = (axes.xaxis, axes.yaxis)[number]
    places = np.asarray(axis.get_majorticklocs(), dtype=float)
    labels = axis.get_major_formatter().format_ticks(places)
    low, high = sorted(axis.get_view_interval())
    border = _EDGE * (high - low)
    inside = np.flatnonzero((places >= low - border) & (places <= high + border))
    along = np.full((len(inside), 2), np.array([axes.get_xlim()[0], axes.get_ylim()[0]]))
    along[:, number] = places[inside]
    return axes.transData.transform(along)[:, number], [labels[row] for row in inside.tolist()]


def _draw_grid(axes: Any, renderer: Any) -> None:
    box = axes.bbox
    for number, name in enumerate("xy"):
        if style := axes.scales[name].grid:
            starts = np.repeat(_ticks(axes, number)[0][:, None], 2, axis=1)
            ends = starts.copy()
            starts[:, 1 - number], ends[:, 1 - number] = (box.y0, box.y1) if number == 0 else (box.x0, box.x1)
            lines(renderer, starts, ends, **style)


def _draw_frame(axes: Any, renderer: Any) -> None:
    """Draw the frame of axes, their ticks with numbers, and the names of both."""
    if not axes.axison:
        return
    box = axes.bbox
    if axes.get_frame_on():
        corners = np.array([[[box.x0, box.y0], [box.x1, box.y0], [box.x1, box.y1], [box.x0, box.y1]]])
        polygons(renderer, corners, line=("black",), width=_LINE)
    for number, name in enumerate("xy"):
        _draw_scale(axes, renderer, number, axes.scales[name])


def _draw_scale(axes: Any, renderer: Any, number: int, scale: Scale) -> None:
    """Draw the ticks of an axis with their numbers, and its name."""
    box, point, figure = axes.bbox, renderer.points_to_pixels(1.0), axes.get_figure()
    at, labels = _ticks(axes, number)
    sign = 1.0 if scale.after else -1.0
    edge = ((box.y0, box.y1), (box.x0, box.x1))[number][int(scale.after)]
    starts = np.full((len(at), 2), edge)
    starts[:, number] = at
    ends = starts.copy()
    ends[:, 1 - number] += sign * _TICK * point
    lines(renderer, starts, ends, linewidth=_LINE)
    across, up = _alignment(number, scale)
    place, room = edge + sign * (_TICK + _PAD) * point, 0.0
    for along, label in zip(at.tolist(), labels if scale.named else (), strict=False):
        if label:
            where = (place, along) if number else (along, place)
            write(renderer, figure, label, where, scale.size, across, up, scale.turned)
            room = max(room, _room_of(renderer, label, scale, number))
    label = (axes.xaxis, axes.yaxis)[number].label
    if label.get_text():
        place += sign * (room + _LABEL_PAD * point)
        middle = (0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1))[number]
        where = (place, middle) if number else (middle, place)
        up = "bottom" if sign * (0.5 - number) > 0.0 or (number and sign < 0.0) else "top"
        write(renderer, figure, label.get_text(), where, label.get_fontsize(), "center", up, bool(number))


def _alignment(number: int, scale: Scale) -> tuple[str, str]:
    """Return where along and across a number of an axis its place is."""
    if number:
        return ("left" if scale.after else "right"), "center"
    if scale.turned:
        return ("left" if scale.after else "right"), "center"
    return "center", ("bottom" if scale.after else "top")


def _room_of(renderer: Any, label: str, scale: Scale, number: int) -> float:
    """Return how far a number reaches from its axis, pixels."""
    if bool(number) == scale.turned:
        return float(renderer.points_to_pixels(scale.size))
    return float(renderer.get_text_width_height_descent(label, font_of(scale.size), False)[0])
