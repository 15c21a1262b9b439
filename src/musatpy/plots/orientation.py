"""The picture of waves as unknowns: errors in height by control, period, noise and guess."""

from __future__ import annotations

from collections.abc import Sequence

from musatpy.plots.canvas import new_figure, png
from musatpy.swellstudy.orientation import Cell, Summary

_HEIGHT = 1
_LINES = (
    ("level", "water taken for level", "#b5402a", "--"),
    ("unknown", "waves unknown", "#1f5a8c", "-"),
    ("known", "waves known", "#666666", ":"),
)
_AXES = {"period": "period, s", "noise": "noise of the images, um", "guess": "sigmas of the guess, times"}


def unknown_waves(results: Sequence[tuple[Cell, Summary]]) -> bytes:
    """Return the RMS errors in height of check points under water, one panel for each thing that was varied."""
    names = list(dict.fromkeys(cell.varied for cell, _ in results))
    columns = min(4, len(names))
    figure = new_figure(3.3 * columns, 3.3 * -(-len(names) // columns))
    panels = figure.subplots(-(-len(names) // columns), columns, squeeze=False).reshape(-1)
    for panel in panels[len(names) :]:
        panel.set_axis_off()
    for panel, name in zip(panels[: len(names)], names, strict=True):
        found = [(cell.value, summary) for cell, summary in results if cell.varied == name]
        values = [value for value, _ in found]
        for attribute, label, color, style in _LINES:
            rms = [getattr(summary, attribute)[_HEIGHT] for _, summary in found]
            panel.plot(values, rms, style, marker="o", markersize=3, color=color, label=label)
        control = name.startswith("control")
        panel.set_title(name.removeprefix("control, ") if control else f"{name} varied", fontsize="medium")
        panel.set_xlabel("control points in water" if control else _AXES[name])
        panel.set_ylim(bottom=0.0)
    panels[0].set_ylabel("RMS error in height, m")
    panels[0].legend(fontsize="x-small")
    return png(figure)
