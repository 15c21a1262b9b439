"""The pictures of the studies, in docs: Okamoto's tables, collocation, waves from stereo, waves as unknowns."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from musatpy.figures import file_of, new_panels, styled
from musatpy.sea.experiment import Histogram
from musatpy.sea.pictures import bars
from studies import collocation, stereo
from studies.crossing import Crossing
from studies.unknown_waves import Cell, Summary

_BLUE, _RED, _GREEN, _GREY = "#1f5a8c", "#b5402a", "#3a7d44", "#666666"
_STYLES = (("level", "taken for level", _GREY), ("fourier", "waves", _BLUE), ("grid", "grid", _GREEN))
_HEIGHT = 1
_LINES = (
    ("level", "water taken for level", "#b5402a", "--"),
    ("unknown", "waves unknown", "#1f5a8c", "-"),
    ("known", "waves known", "#666666", ":"),
)
_AXES = {"period": "period, s", "noise": "noise of the images, um", "guess": "sigmas of the guess, times"}


@styled
def unknown_waves(results: Sequence[tuple[Cell, Summary]]) -> bytes:
    """Return the RMS errors in height of check points under water, one panel for each thing that was varied."""
    names = list(dict.fromkeys(cell.varied for cell, _ in results))
    columns = min(4, len(names))
    figure, panels = new_panels([2.6] * columns, [2.4] * -(-len(names) // columns))
    for panel in panels.ravel()[len(names) :]:
        panel.remove()
    for panel, name in zip(panels.ravel(), names, strict=False):
        found = [(cell.value, summary) for cell, summary in results if cell.varied == name]
        values = [value for value, _ in found]
        for attribute, label, color, style in _LINES:
            rms = [getattr(summary, attribute)[_HEIGHT] for _, summary in found]
            panel.plot(values, rms, style, marker="o", markersize=3, color=color, label=label)
        control = name.startswith("control")
        panel.set_title(name.removeprefix("control, ") if control else f"{name} varied", fontsize="medium")
        panel.set_xlabel("control points in water" if control else _AXES[name])
        panel.set_ylim(bottom=0.0)
    panels[0, 0].set_ylabel("RMS error in height, m")
    return file_of(figure)[1]


@styled
def collocation_picture(
    rows: Sequence[
        tuple[str, Sequence[collocation.Outcome], Sequence[collocation.Outcome], Sequence[collocation.Outcome]]
    ],
) -> bytes:
    """Return what part of the errors goes, a row of panels for each sea: by spacing, period and noise.

    A row is the name of the sea with the outcomes where number, period and noise of the control points vary.
    """
    figure, plots = new_panels([3.4] * 3, [2.8] * len(rows), sharey=True)
    for row, (name, number, period, noise) in zip(plots, rows, strict=True):
        _removed(row[0], [2.0 * one.spacing / one.wave_length for one in number], number)
        row[0].axvline(1.0, color=_GREY, linewidth=0.8)
        row[0].set_xlabel("spacing of control, half wave lengths")
        _removed(row[1], [one.case.period for one in period], period)
        row[1].set_xlabel("period, s")
        _removed(row[2], [one.case.noise for one in noise], noise)
        row[2].set_xlabel("noise of control, m")
        row[0].set_ylabel(f"{name}: part of the RMS removed")
    plots[0, 0].set_ylim(-0.1, 1.05)
    return file_of(figure)[1]


def _removed(plot: Any, at: Sequence[float], outcomes: Sequence[collocation.Outcome]) -> None:
    plot.axhline(0.0, color=_GREY, linewidth=0.8)
    plot.plot(at, [one.removed for one in outcomes], "o-", color=_RED, markersize=4, label="best function")
    gaussian = [one.removed_by_gaussian for one in outcomes]
    plot.plot(at, gaussian, "s--", color=_BLUE, markersize=4, label="Gaussian alone")
    theory = [one.removed_by_theory for one in outcomes]
    plot.plot(at, theory, ":", color="black", label="theory, J0 known")


@styled
def stereo_picture(families: Sequence[tuple[str, Sequence[stereo.Outcome]]]) -> bytes:
    """Return what is left of the wave error in height, over the spacing of surface points, one panel per sea."""
    figure, (plots,) = new_panels([3.5] * len(families), [3.0])
    for plot, (name, outcomes) in zip(plots, families, strict=True):
        _panel(plot, name, outcomes)
    plots[0].set_ylabel("error in height due to the waves, m RMS")
    return file_of(figure)[1]


def _panel(plot: Any, name: str, outcomes: Sequence[stereo.Outcome]) -> None:
    spacing = [one.spacing for one in outcomes]
    shortest = float(2.0 * np.pi / np.linalg.norm(outcomes[0].setup.waves.vector, axis=1).max())
    for method, label, colour in _STYLES:
        left = [one.wave[method][2] for one in outcomes]
        plot.plot(spacing, left, marker="o", markersize=3, color=colour, label=label)
    for part, text in ((2.0, "L/2"), (4.0, "L/4")):
        plot.axvline(shortest / part, color=_RED, linewidth=0.8, linestyle=":")
        plot.annotate(text, (shortest / part, 0.94), xycoords=("data", "axes fraction"), color=_RED)
    plot.set_yscale("log")
    plot.set_xlabel("mean spacing of surface points, m")
    plot.set_title(name)


@styled
def height_histogram(histogram: Histogram, title: str) -> bytes:
    """Return the histogram of the errors in height alone, as Figures 8 and 9 of Okamoto (1982)."""
    figure, ((plot,),) = new_panels([5.2], [3.2], title)
    bars(plot, histogram.edges[2], histogram.count[2], "Z")
    return file_of(figure)[1]


@styled
def refraction_picture(crossing: Crossing, title: str) -> bytes:
    """Return the section through a wave with all rays from one point, as Figure 7 of Okamoto (1982)."""
    figure, ((plot,),) = new_panels([4.2], [5.4], title)
    plot.fill_between(crossing.along, crossing.height, crossing.ground[1], color="#d7e8f4")
    plot.plot(crossing.along, crossing.height, color=_BLUE)
    for i, ((x, z), above) in enumerate(zip(crossing.place, crossing.above, strict=True)):
        kind = (
            "least path: the principal one" if i == 0 else "minimum" if crossing.minimum[i] else "saddle or maximum"
        )
        plot.plot(
            [crossing.ground[0], x, above[0]],
            [crossing.ground[1], z, above[1]],
            "-" if crossing.minimum[i] else ":",
            color=_RED if i == 0 else _GREY,
            linewidth=1.6 if i == 0 else 0.9,
            label=kind,
        )
    plot.plot(*crossing.ground, "ko")
    plot.set_aspect("equal")
    plot.set_xlabel("along the wave, m")
    plot.set_ylabel("height, m")
    return file_of(figure)[1]
