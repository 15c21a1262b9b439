"""A sheet of panels with margins of fixed sizes: to find them by the texts would take as long as to draw all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.canvas import new_figure
from musatpy.plots.panel import add_panel

_SHADES = 128  # of a bar
_LINE = 0.19  # inches, of a line of the legend
_HEAD = 0.3  # of the title of a sheet
_LETTER, _TITLE = 0.068, 0.092  # of a letter of 8 points, and of the title


@dataclass(frozen=True, kw_only=True)
class Margins:
    """What is left around the panels of a sheet, and between them, inches."""

    left: float = 0.75  # room for numbers and the name of an axis
    right: float = 0.2
    above: float = 0.35  # for a title
    below: float = 0.55
    beside: float = 0.75  # between panels side by side
    between: float = 0.75  # between one panel and that below


@dataclass(frozen=True, kw_only=True, eq=False)
class Sheet:
    """A figure with its panels."""

    figure: Any
    panels: NDArray[Any]  # (down, across) axes


def new_sheet(
    sizes: tuple[Sequence[float], Sequence[float]],
    margins: Margins,
    *,
    title: str = "",
    legend: int = 0,
) -> Sheet:
    """Return a sheet for panels of these widths and heights (inches), with room for lines of a legend.

    Raises `MusatError` where matplotlib is missing.
    """
    widths, heights = (np.asarray(size, dtype=float) for size in sizes)
    width = margins.left + widths.sum() + margins.beside * (len(widths) - 1) + margins.right
    lines = wrap(title, int(width / _TITLE))
    head, foot = _HEAD * len(lines), _LINE * legend + 0.15 if legend else 0.0
    height = margins.below + heights.sum() + margins.between * (len(heights) - 1) + margins.above + head + foot
    figure = new_figure(width, height, layout="none")
    if title:
        figure.suptitle("\n".join(lines), fontsize=11, y=1.0 - 0.08 / height, va="top")
    panels = np.empty((len(heights), len(widths)), dtype=object)
    for row, column in np.ndindex(panels.shape):
        left = margins.left + widths[:column].sum() + margins.beside * column
        top = height - head - margins.above - heights[:row].sum() - margins.between * row
        place = [
            left / width,
            (top - heights[row]) / height,
            widths[column] / width,
            heights[row] / height,
        ]
        panels[row, column] = add_panel(figure, place)
    return Sheet(figure=figure, panels=panels)


def bar_beside(figure: Any, axes: Any, shade: Any, label: str) -> None:
    """Draw what shades mean right of a panel."""
    place, (width, _) = axes.get_position(), figure.get_size_inches()
    draw_bar(figure, [place.x1 + 0.15 / width, place.y0, 0.18 / width, place.height], shade, label)


def draw_bar(figure: Any, place: Sequence[float], shade: Any, label: str) -> None:
    """Draw what shades mean at a place of a figure."""
    bar = add_panel(figure, place)
    low, high = shade.get_clim()
    steps = np.linspace(low, high, _SHADES)[:, None]
    bar.imshow(
        steps, origin="lower", extent=(0.0, 1.0, low, high), aspect="auto", cmap=shade.get_cmap(), vmin=low,
        vmax=high, alpha=shade.get_alpha(),
    )  # fmt: skip
    bar.set_xticks([])
    bar.scales["y"].after = True
    bar.tick_params(labelsize=8)
    bar.set_ylabel(label)


def room_of(names: Sequence[str]) -> float:
    """Return the room (inches) of the longest of names, written in 8 points."""
    return 0.2 + _LETTER * max(map(len, names), default=0)


def legend_lines(number: int, columns: int) -> int:
    """Return how many lines a legend of so many entries has."""
    return -(-number // columns)


def legend_below(figure: Any, columns: int, handles: Sequence[Any], labels: Sequence[str]) -> Any:
    """Draw the legend of a sheet below its panels, and return it."""
    return figure.legend(handles, labels, loc="lower center", ncols=max(min(len(labels), columns), 1), fontsize=8)
