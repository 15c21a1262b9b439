"""Pictures of wave experiments: maps and histograms of the errors, and what they depend on."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.figures import image_of, new_figure, styled
from musatpy.sea.experiment import Histogram
from musatpy.sea.study import Trials, WaveStudy

_COORDINATES = ("X", "Y", "Z")
_BLUE, _RED, _GREY = "#1f5a8c", "#b5402a", "#666666"


def pictures(study: WaveStudy) -> dict[str, bytes]:
    """Return the pictures of a study as PNG files, by name."""
    files = {"map": error_maps(study), "histogram": histograms(study.histogram, study.spec.title)}
    if study.studies:
        files["dependence"] = dependence(study.studies, study.spec.title)
    return files


@styled
def error_maps(study: WaveStudy) -> bytes:
    """Return maps of the errors over the model, one per coordinate, contoured; cameras as triangles."""
    shape = study.spec.area.numbers
    points, error = study.errors.points.reshape(*shape, 3), study.errors.error.reshape(*shape, 3)
    figure = new_figure(11.0, 5.6, study.spec.title)
    for axis, plot in enumerate(np.atleast_1d(figure.subplots(1, 3, sharey=True))):
        reach = max(float(np.abs(error[..., axis]).max()), 1e-6)
        levels = np.linspace(-reach, reach, 17)
        filled = plot.contourf(points[..., 0], points[..., 1], error[..., axis], levels=levels, cmap="RdBu_r")
        largest = study.spread.point[axis]
        plot.plot(*study.errors.points[largest, :2], "kx")
        plot.plot(*np.array(study.spec.stereo.cameras)[:, :2].T, "k^", markersize=5, clip_on=False)
        plot.set_title(f"error in {_COORDINATES[axis]}: sigma {study.spread.sigma[axis]:.3f} m")
        plot.set_xlabel("x, m")
        plot.set_aspect("equal")
        figure.colorbar(filled, ax=plot, orientation="horizontal", format="%.2f", ticks=levels[::4], label="m")
    figure.axes[0].set_ylabel("y, m")
    return image_of(figure, "png")


@styled
def histograms(histogram: Histogram, title: str) -> bytes:
    """Return the histograms of the three coordinates side by side."""
    figure = new_figure(11.0, 3.6, title)
    for axis, plot in enumerate(figure.subplots(1, 3)):
        bars(plot, histogram.edges[axis], histogram.count[axis], _COORDINATES[axis])
    return image_of(figure, "png")


def bars(plot: Any, edges: FloatArray, count: IntArray, name: str) -> None:
    """Draw the histogram of errors in a coordinate."""
    plot.bar(edges[:-1], count, width=np.diff(edges), align="edge", color=_BLUE, edgecolor="white", linewidth=0.5)
    plot.axvline(0.0, color=_GREY, linewidth=0.8)
    plot.set_xlabel(f"error in {name}, m")
    plot.set_ylabel("points")


@styled
def dependence(studies: tuple[Trials, ...], title: str) -> bytes:
    """Return how standard error and maximum depend on what was varied, one panel each."""
    figure = new_figure(3.7 * max(2, len(studies)), 3.8, title)
    for plot, trials in zip(np.atleast_1d(figure.subplots(1, len(studies))), studies, strict=True):
        done = [trial for trial in trials.trials if trial.spread is not None]
        value = [trial.value for trial in done]
        for axis, (name, style) in enumerate(zip(_COORDINATES, ("-", "--", "-"), strict=True)):
            color = _RED if axis == 2 else _BLUE
            sigma = [trial.spread.sigma[axis] for trial in done if trial.spread]
            largest = [abs(trial.spread.largest[axis]) for trial in done if trial.spread]
            plot.plot(value, sigma, style, marker="o", markersize=3, color=color, label=f"sigma {name}")
            plot.plot(value, largest, style, color=color, alpha=0.35, label=f"maximum {name}")
        plot.set_xlabel(f"{trials.name.lower()}, {trials.unit}")
        plot.set_ylabel("error, m")
        plot.set_ylim(bottom=0.0)
    figure.axes[0].legend(fontsize="x-small")
    return image_of(figure, "png")
