"""Pictures of estimated water surfaces: the surface with its points, and what it is worth below the water."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from musatpy.plots.canvas import new_figure, png
from musatpy.seasurface.estimate import SurfaceFit
from musatpy.seasurface.fitted import height_sigma
from musatpy.seasurface.study import Outcome

_STEPS = 121  # of a map, the longer way
_BLUE, _RED, _GREEN, _GREY = "#1f5a8c", "#b5402a", "#3a7d44", "#666666"
_STYLES = (("level", "taken for level", _GREY), ("fourier", "waves", _BLUE), ("grid", "grid", _GREEN))


def surface_picture(fit: SurfaceFit, title: str) -> bytes:
    """Return maps of the height and of its sigma where the surface is known; rejected points as crosses."""
    fitted = fit.fitted
    place = fit.points.position[:, :2] - fitted.origin
    low, extent = place.min(axis=0), np.ptp(place, axis=0)
    counts = np.maximum(2, np.rint(_STEPS * extent / extent.max()).astype(int))
    x, y = (low[i] + extent[i] * np.linspace(0.0, 1.0, counts[i]) for i in (0, 1))
    xy = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    known = fitted.covers(xy)
    height = np.where(known, fitted.surface.relief(xy).height, np.nan)
    sigma = np.where(known, height_sigma(fitted, xy), np.nan)
    figure = new_figure(11.0, 5.6)
    figure.suptitle(title)
    maps = ((height, "height of the water, m", "viridis"), (sigma, "its sigma, m", "magma"))
    for plot, (values, name, colours) in zip(figure.subplots(1, 2, sharey=True), maps, strict=True):
        X, Y = (grid + shift for grid, shift in zip(np.moveaxis(xy, -1, 0), fitted.origin, strict=True))
        drawn = plot.pcolormesh(X, Y, values, cmap=colours, shading="nearest")
        points = fit.points.position
        plot.plot(*points[fit.kept, :2].T, ".", color="white", markersize=1.5, alpha=0.6, label="points")
        if not fit.kept.all():
            plot.plot(*points[~fit.kept, :2].T, "x", color=_RED, markersize=6, label="rejected")
        plot.set_title(name)
        plot.set_xlabel("X, m")
        plot.set_aspect("equal")
        figure.colorbar(drawn, ax=plot)
    figure.axes[0].set_ylabel("Y, m")
    names = figure.axes[0].get_legend_handles_labels()
    figure.legend(*names, loc="upper left", fontsize="small", markerscale=2.0, facecolor="lightgrey")
    return png(figure)


def study_picture(families: Sequence[tuple[str, Sequence[Outcome]]]) -> bytes:
    """Return what is left of the wave error in height, over the spacing of surface points, one panel per sea."""
    figure = new_figure(4.2 * len(families), 4.0)
    for plot, (name, outcomes) in zip(np.atleast_1d(figure.subplots(1, len(families))), families, strict=True):
        _panel(plot, name, outcomes)
    figure.axes[0].set_ylabel("error in height due to the waves, m RMS")
    figure.axes[0].legend(fontsize="small")
    return png(figure)


def _panel(plot: Any, name: str, outcomes: Sequence[Outcome]) -> None:
    spacing = [one.spacing for one in outcomes]
    shortest = float(2.0 * np.pi / np.linalg.norm(outcomes[0].setup.waves.vector, axis=1).max())
    for method, label, colour in _STYLES:
        left = [one.wave[method][2] for one in outcomes]
        plot.plot(spacing, left, marker="o", markersize=3, color=colour, label=label)
    for part, text in ((2.0, "L/2"), (4.0, "L/4")):
        plot.axvline(shortest / part, color=_RED, linewidth=0.8, linestyle=":")
        plot.annotate(text, (shortest / part, 1.0), xycoords=("data", "axes fraction"), va="bottom", color=_RED)
    plot.set_yscale("log")
    plot.set_xlabel("mean spacing of surface points, m")
    plot.set_title(name, pad=18.0)
