"""The picture of an interpolation: the predicted errors, their sigmas, the covariances."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.figures import image_of, new_figure, styled
from musatpy.sea.interpolation.interpolate import Interpolation

_BLUE, _RED, _GREY = "#1f5a8c", "#b5402a", "#666666"
_GRID = 81  # places along the longer side of a map


@styled
def interpolation_picture(interpolation: Interpolation) -> bytes:
    """Return a map of the predicted errors with the control points, one of their sigmas, and the covariances."""
    figure = new_figure(12.0, 4.4)
    left, middle, right = figure.subplots(1, 3)
    place = interpolation.observed.place
    low, high = place.min(axis=0), place.max(axis=0)
    step = max(float((high - low).max()), 1e-9) / (_GRID - 1)
    x, y = (np.arange(low[axis], high[axis] + step, step) for axis in range(2))
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    predicted = interpolation.uncertain.predict(grid.reshape(-1, 2))
    near = predicted.distance <= interpolation.reach
    value, sigma = (
        np.where(near, values, np.nan).reshape(grid.shape[:2])
        for values in (predicted.value, interpolation.sigma(predicted))
    )
    reach = max(float(np.abs(interpolation.observed.value[interpolation.used]).max()), 1e-6)
    _map(figure, left, (x, y), value, ("RdBu_r", -reach, reach), "predicted error, m")
    _map(figure, middle, (x, y), sigma, ("viridis", 0.0, None), "sigma of corrected heights, m")
    for plot in (left, middle):
        plot.plot(*place[interpolation.used].T, "k.", markersize=4, label="control")
        if not interpolation.used.all():
            plot.plot(*place[~interpolation.used].T, "rx", markersize=7, label="outlier")
    figure.legend(*left.get_legend_handles_labels(), loc="upper left", fontsize="x-small")
    _covariances(right, interpolation)
    return image_of(figure, "png")


def _map(figure: Any, plot: Any, axes: Any, value: Any, scale: tuple[str, float, float | None], name: str) -> None:
    cmap, low, high = scale
    drawn = plot.pcolormesh(*axes, np.ma.masked_invalid(value), cmap=cmap, vmin=low, vmax=high, shading="nearest")
    plot.set_aspect("equal")
    plot.set_xlabel("x, m")
    plot.set_ylabel("y, m")
    plot.set_title(name)
    figure.colorbar(drawn, ax=plot)


def _covariances(plot: Any, interpolation: Interpolation) -> None:
    covariance, table = interpolation.best.estimate.covariance, interpolation.empirical
    distance = np.linspace(0.0, float(table.distance[-1]), 200)
    azimuth = np.arange(180) * np.pi / 180.0
    lag = distance[:, None, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    fitted = covariance.signal * covariance.correlation(lag).mean(axis=1)
    plot.axhline(0.0, color=_GREY, linewidth=0.8)
    plot.plot(distance, fitted, color=_RED, label=f"{interpolation.best.family}, mean of all directions")
    plot.plot(table.distance, table.covariance, "o", color=_BLUE, markersize=4, label="of the control points")
    plot.set_xlabel("distance, m")
    plot.set_title("covariance, m2")
    plot.legend(fontsize="x-small")
