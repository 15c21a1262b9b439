"""Pictures of the sea: errors by waves, an interpolation of errors, and an estimated surface of the water."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.figures import BLUE, FORM, GREY, INK, RED, ImageForm, add_bar, file_of, new_panels, styled

if TYPE_CHECKING:
    from musatpy.sea.experiment import Histogram, Trials, WaveStudy
    from musatpy.sea.interpolation.interpolate import Interpolation
    from musatpy.sea.stereo.estimate import SurfaceFit

_COORDINATES = ("X", "Y", "Z")
_LONG, _LEAST = 4.0, 2.4  # inches, of the sides of a map
_GRID = 121  # places along the longer side of a map


def _sides(places: FloatArray) -> FloatArray:
    """Return width and height (inches) of a map of places (n, 2 or more), not too narrow for its title."""
    extent = np.ptp(places[:, :2], axis=0)
    return np.maximum(_LONG * extent / max(float(extent.max()), 1e-9), _LEAST)


# --- wave experiments ---


def pictures(study: WaveStudy, form: ImageForm = FORM) -> dict[str, bytes]:
    """Return the pictures of a study, by name and suffix."""
    title = study.spec.title
    files = {"map": error_maps(study, form), "histogram": histograms(study.histogram, title, form)}
    if study.studies:
        files["dependence"] = dependence(study.studies, title, form)
    return {f"{name}.{suffix}": image for name, (suffix, image) in files.items()}


@styled
def error_maps(study: WaveStudy, form: ImageForm) -> tuple[str, bytes]:
    """Return maps of the errors over the model, one per coordinate, contoured; cameras as triangles."""
    shape = study.spec.area.numbers
    points, error = study.errors.points.reshape(*shape, 3), study.errors.error.reshape(*shape, 3)
    cameras = np.array(study.spec.stereo.cameras)
    wide, tall = _sides(study.errors.points)
    figure, (plots,) = new_panels([wide] * 3, [tall], study.spec.title, sharey=True)
    for axis, plot in enumerate(plots):
        reach = max(float(np.abs(error[..., axis]).max()), 1e-6)
        levels = np.linspace(-reach, reach, 17)
        filled = plot.contourf(points[..., 0], points[..., 1], error[..., axis], levels=levels, cmap="RdBu_r")
        largest = study.errors.points[study.spread.point[axis], :2]
        plot.plot(*largest, "x", color=INK, markersize=7, label="largest error")
        plot.plot(*cameras[:, :2].T, "^", color=INK, markersize=5, clip_on=False, label="cameras")
        plot.set(title=f"error in {_COORDINATES[axis]}: sigma {study.spread.sigma[axis]:.3f} m", xlabel="x, m")
        plot.set_aspect("equal")
        add_bar(plot, filled, "m", format="{x:z.2g}", ticks=levels[::4])
    plots[0].set_ylabel("y, m")
    return file_of(figure, form)


@styled
def histograms(histogram: Histogram, title: str, form: ImageForm) -> tuple[str, bytes]:
    """Return the histograms of the three coordinates side by side."""
    figure, (plots,) = new_panels([3.0] * 3, [2.5], title)
    for axis, plot in enumerate(plots):
        bars(plot, histogram.edges[axis], histogram.count[axis], _COORDINATES[axis])
    return file_of(figure, form)


def bars(plot: Any, edges: FloatArray, count: IntArray, name: str) -> None:
    """Draw the histogram of errors in a coordinate."""
    plot.bar(edges[:-1], count, width=np.diff(edges), align="edge", color=BLUE, edgecolor="white", linewidth=0.5)
    plot.axvline(0.0, color=INK, linewidth=0.8)
    plot.set(xlabel=f"error in {name}, m", ylabel="points")
    plot.locator_params(axis="x", nbins=7)


@styled
def dependence(studies: Sequence[Trials], title: str, form: ImageForm) -> tuple[str, bytes]:
    """Return how standard error and maximum depend on what was varied, one panel each."""
    figure, (plots,) = new_panels([3.2] * len(studies), [3.0], title)
    signs = (("s", BLUE), ("v", BLUE), ("o", RED))
    for plot, trials in zip(plots, studies, strict=True):
        done = [(trial.value, trial.spread) for trial in trials.trials if trial.spread is not None]
        value = [value for value, _ in done]
        for axis, (name, (marker, color)) in enumerate(zip(_COORDINATES, signs, strict=True)):
            sigma = [spread.sigma[axis] for _, spread in done]
            largest = [abs(spread.largest[axis]) for _, spread in done]
            plot.plot(value, sigma, "-", marker=marker, color=color, label=f"sigma {name}")
            plot.plot(value, largest, ":", marker=marker, color=color, label=f"maximum {name}")
        plot.set(xlabel=f"{trials.name.lower()}, {trials.unit}", ylabel="error, m")
        plot.set_ylim(bottom=0.0)
    return file_of(figure, form)


# --- interpolation ---


@styled
def interpolation_picture(interpolation: Interpolation, title: str) -> tuple[str, bytes]:
    """Return a map of the predicted errors with the control points, one of their sigmas, and the covariances."""
    place, used = interpolation.observed.place, interpolation.used
    wide, tall = _sides(place)
    title = f"Errors of heights, interpolated between control points\n{title}"
    figure, ((left, middle, right),) = new_panels([wide] * 3, [tall], title)
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
    reach = max(float(np.abs(interpolation.observed.value[used]).max()), 1e-6)
    _draw_map(left, (x, y, value), "predicted error, m", cmap="RdBu_r", vmin=-reach, vmax=reach)
    _draw_map(middle, (x, y, sigma), "sigma of corrected heights, m", cmap="viridis", vmin=0.0)
    for plot in (left, middle):
        plot.plot(*place[used].T, ".", color=INK, label="control")
        if not used.all():
            plot.plot(*place[~used].T, "x", color=RED, markersize=7, label="outlier")
    _draw_covariances(right, interpolation)
    return file_of(figure)


def _draw_map(plot: Any, grid: tuple[FloatArray, ...], title: str, **scale: Any) -> None:
    """Draw values (ny, nx) at x, y of a grid, with a bar."""
    drawn = plot.pcolormesh(*grid, shading="nearest", **scale)
    plot.set(title=title, xlabel="x, m", ylabel="y, m", aspect="equal")
    add_bar(plot, drawn, "")


def _draw_covariances(plot: Any, interpolation: Interpolation) -> None:
    covariance, table = interpolation.best.estimate.covariance, interpolation.empirical
    distance = np.linspace(0.0, float(table.distance[-1]), 200)
    azimuth = np.arange(180) * np.pi / 180.0
    lag = distance[:, None, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    fitted = covariance.signal * covariance.correlation(lag).mean(axis=1)
    plot.axhline(0.0, color=GREY, linewidth=0.8)
    plot.plot(distance, fitted, color=RED, label=f"{interpolation.best.family}, mean of all directions")
    plot.plot(table.distance, table.covariance, "o", color=BLUE, label="covariance of the control points")
    plot.set(title="covariance, m2", xlabel="distance, m")


# --- surface of the water ---


@styled
def surface_picture(fit: SurfaceFit, title: str, form: ImageForm) -> tuple[str, bytes]:
    """Return maps of the height and of its sigma where the surface is known; rejected points as crosses."""
    from musatpy.sea.stereo.surface_points import height_sigma

    fitted, points = fit.fitted, fit.points.position
    place = points[:, :2] - fitted.origin
    low, extent = place.min(axis=0), np.ptp(place, axis=0)
    counts = np.maximum(2, np.rint(_GRID * extent / extent.max()).astype(int))
    x, y = (low[i] + extent[i] * np.linspace(0.0, 1.0, counts[i]) for i in (0, 1))
    xy = np.stack(np.meshgrid(x, y), axis=-1)
    known = fitted.covers(xy)
    height = np.where(known, fitted.surface.relief(xy).height, np.nan)
    sigma = np.where(known, height_sigma(fitted, xy), np.nan)
    wide, tall = _sides(place)
    figure, ((left, right),) = new_panels([wide] * 2, [tall], title)
    grid = x + fitted.origin[0], y + fitted.origin[1]
    _draw_map(left, (*grid, height), "height of the water, m", cmap="viridis")
    _draw_map(right, (*grid, sigma), "its sigma, m", cmap="magma")
    for plot in (left, right):
        plot.plot(*points[fit.kept, :2].T, ".", color=GREY, markersize=1.5, label="points")
        if not fit.kept.all():
            plot.plot(*points[~fit.kept, :2].T, "x", color=RED, markersize=6, label="rejected")
    return file_of(figure, form)
