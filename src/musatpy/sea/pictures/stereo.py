"""The picture of an estimated water surface with its points."""

from __future__ import annotations

import numpy as np

from musatpy.figures import image_of, new_figure, styled
from musatpy.sea.stereo.estimate import SurfaceFit
from musatpy.sea.stereo.fitted import height_sigma

_STEPS = 121  # of a map, the longer way
_RED = "#b5402a"


@styled
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
    figure = new_figure(11.0, 5.6, title)
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
    return image_of(figure, "png")
