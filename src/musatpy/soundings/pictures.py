"""Compiled beside sounded depths as a picture: against each other, by frequency, and on the map (extra `plots`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.figures import BLUE, GREY, INK, RED, add_bar, new_panels, styled
from musatpy.soundings.differences import DepthDifferences, regression

_SIDE = 4.2  # inches, of each of three panels
_LEAST_BINS, _MOST_BINS = 8, 60
_DOTS = 24.0  # points squared, of a marker
_SHADES = "PuOr"  # two sides of a pale zero, alike to every eye
_MOST = 98.0  # percentile of the sizes of differences that have shades of their own


@styled
def difference_figure(differences: DepthDifferences, xy: FloatArray, title: str) -> Any:
    """Return the figure of differences at places xy (k, 2) m, to be laid out; blunders are crosses.

    Raises `MusatError` where matplotlib is missing.
    """
    figure, ((against, by_size, on_map),) = new_panels([_SIDE] * 3, [_SIDE], title)
    blunders = differences.blunders
    _draw_depths(against, differences, blunders)
    _draw_histogram(by_size, differences, blunders)
    _draw_map(on_map, differences.difference, xy, blunders)
    return figure


def _draw_depths(axes: Any, differences: DepthDifferences, blunders: BoolArray) -> None:
    """Draw compiled over sounded depths, with the line on which both are equal, and the regression."""
    sounded, compiled = differences.sounded, differences.compiled
    axes.plot(sounded[~blunders], compiled[~blunders], ".", color=GREY, label="soundings")
    if blunders.any():
        axes.plot(sounded[blunders], compiled[blunders], "x", color=INK, markersize=7, label="blunders")
    ends = np.array([min(sounded.min(), compiled.min()), max(sounded.max(), compiled.max())])
    axes.plot(ends, ends, "-", color=INK, linewidth=0.8, label="1:1")
    if line := regression(differences):
        label = f"{line.a:+z.3f} m {line.b:+z.4f} x depth"
        axes.plot(ends, ends + line.a + line.b * ends, "--", color=BLUE, linewidth=1.6, label=label)
    axes.set(aspect="equal", xlabel="sounded depth, m", ylabel="compiled depth, m")


def _draw_histogram(axes: Any, differences: DepthDifferences, blunders: BoolArray) -> None:
    """Draw the frequency of differences without blunders, with their median."""
    good = differences.difference[~blunders]
    bins = int(np.clip(np.sqrt(len(good)), _LEAST_BINS, _MOST_BINS))
    axes.hist(good, bins=bins, color="0.75", edgecolor=INK, linewidth=0.5)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    middle = float(np.median(good))
    axes.axvline(middle, color=RED, linestyle="--", linewidth=1.6, label=f"median {middle:z.3f} m")
    axes.set_xlabel(f"compiled less sounded, m ({np.count_nonzero(blunders)} blunders left out)")
    axes.set_ylabel("soundings")


def _draw_map(axes: Any, difference: FloatArray, xy: FloatArray, blunders: BoolArray) -> None:
    """Draw differences in their places; triangles point up where the compiled bottom is shoaler, else down."""
    most = max(float(np.percentile(np.abs(difference[~blunders]), _MOST)), 1e-9)
    for deeper, marker, label in ((False, "^", "compiled shoaler"), (True, "v", "compiled deeper")):
        rows = ~blunders & ((difference > 0.0) == deeper)
        shade = axes.scatter(
            *xy[rows].T, c=difference[rows], marker=marker, s=_DOTS, cmap=_SHADES, vmin=-most, vmax=most,
            edgecolors=GREY, linewidths=0.5,
        )  # fmt: skip
        axes.plot([], [], marker, color=GREY, markersize=5, label=label)  # the legend has no shade
    if blunders.any():
        axes.plot(*xy[blunders].T, "x", color=INK, markersize=7, label="blunders")
    add_bar(axes, shade, "compiled less sounded, m", extend="both")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="east, m", ylabel="north, m")
