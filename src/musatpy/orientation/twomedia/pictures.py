"""Pictures of an orientation through water and of its study: correlations, basins, precision, errors of a strip."""

from __future__ import annotations

from itertools import cycle
from typing import Any

import numpy as np

from musatpy import figures
from musatpy.arrays import FloatArray, TextArray
from musatpy.orientation.twomedia.oriented import LIMIT, Oriented
from musatpy.orientation.twomedia.rays import PLANE_SYMBOLS, SYMBOLS, WATER, paper_partials
from musatpy.orientation.twomedia.study import NOWHERE, SOLUTION, Basins, LevelPrecision

_OUTCOMES = (
    ("this solution", figures.BLUE, "o"),
    ("another solution", figures.RED, "x"),
    ("no solution", figures.GREY, "."),
)
_LINES = 0.4  # inches, of more than one of ticks and labels
_STRONG = 0.95  # correlation from which its number is printed


@figures.styled
def correlation_picture(
    oriented: Oriented, title: str = "", form: figures.ImageForm = figures.FORM
) -> tuple[str, bytes]:
    """Return the matrix of the correlations of all unknowns, under the symbols of Okamoto and Mori."""
    J = paper_partials(oriented.at)
    covariance = J @ oriented.covariance @ J.T
    photos = oriented.method.photos
    number = [""] if photos == 1 else [f" {photo + 1}" for photo in range(photos)]
    symbols = np.array([f"{symbol}{photo}" for photo in number for symbol in SYMBOLS] + list(PLANE_SYMBOLS))
    unknown = np.diagonal(covariance) > 0.0
    sigma = np.sqrt(np.diagonal(covariance)[unknown])
    matrix = covariance[np.ix_(unknown, unknown)] / np.outer(sigma, sigma)
    size, what = 0.5 + 0.42 * len(matrix), f"{oriented.method.name}: correlations (numbers from {_STRONG:g})"
    figure, ((plot,),) = figures.new_panels([size], [size], f"{what}\n{title}")
    drawn = plot.imshow(matrix, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    for row, column in np.argwhere((np.abs(matrix) >= _STRONG) & ~np.eye(len(matrix), dtype=bool)):
        label = f"{matrix[row, column]:z.3f}".replace("0.", ".")
        plot.text(column, row, label, ha="center", va="center", color="white", fontsize=7)
    figures.name_ticks(plot, np.arange(len(matrix)), symbols[unknown])
    figures.name_rows(plot, symbols[unknown])
    figures.add_bar(plot, drawn, "")
    return figures.file_of(figure, form)


@figures.styled
def basins_picture(basins: Basins, title: str = "", form: figures.ImageForm = figures.FORM) -> tuple[str, bytes]:
    """Return the shares of the starts that lead to the solution, elsewhere and nowhere, and where they lie."""
    figure, ((left, right),) = figures.new_panels([4.2] * 2, [2.8], title)
    places, shares = np.arange(len(basins.levels)), 100.0 * basins.shares
    below = np.cumsum(shares, axis=1) - shares
    for case, (label, colour, _) in enumerate(_OUTCOMES):
        if shares[:, case].any():
            left.bar(places, shares[:, case], bottom=below[:, case], color=colour, label=label)
    left.set_xticks(places, [f"{5.0 * level:g}°\n{0.1 * level:g} H\n{0.05 * level:g}" for level in basins.levels])
    left.set_xlabel(
        "errors of the start (one sigma): angles, lengths, slopes\nH: height of the cameras over the water"
    )
    left.set_ylabel("starts, %")
    figures.add_room(figure, below=_LINES)
    _starts(right, basins)
    return figures.file_of(figure, form)


def _starts(plot: Any, basins: Basins) -> None:
    """Draw the starts by the errors of angles and lengths, root mean squares of those that are unknown."""
    unknown = (basins.errors != 0.0).any(axis=(0, 1))
    angles = np.resize([True] * 3 + [False] * 3, len(unknown) - WATER)
    lengths = np.append(~angles, [False, False, True, False])
    angles = np.append(angles, [False] * WATER)
    size = [np.sqrt(np.mean(np.square(basins.errors[..., part & unknown]), axis=-1)) for part in (angles, lengths)]
    cases = (basins.outcomes == SOLUTION, basins.outcomes > SOLUTION, basins.outcomes == NOWHERE)
    for case, (_, colour, marker) in zip(cases, _OUTCOMES, strict=True):
        plot.plot(np.degrees(size[0][case]), size[1][case], marker, color=colour, markersize=4)
    plot.set(xlabel="RMS error of the angles of the start, degrees", ylabel="RMS error of stations and level / H")
    plot.set_xlim(left=0.0)
    plot.set_ylim(bottom=0.0)


@figures.styled
def precision_picture(
    precision: LevelPrecision, title: str = "", limit: float = LIMIT, form: figures.ImageForm = figures.FORM
) -> tuple[str, bytes]:
    """Return the sigma of the level over the depth, a line for each share of dry points.

    Under the dashed line it is less than `limit` of the mean depth: there the water is determined.
    """
    figure, ((plot,),) = figures.new_panels([5.6], [4.0], title)
    for share, marker, sigma in zip(precision.shares, cycle("os^Dv"), precision.sigma.T, strict=False):
        plot.loglog(precision.depths, sigma, f"{marker}-", color=figures.BLUE, label=f"{100 * share:.0f} % dry")
    label = f"{100 * limit:g} % of the depth"
    plot.loglog(precision.depths, limit * precision.depths, "--", color=figures.GREY, label=label)
    plot.loglog(precision.depth, precision.at_hand, "*", markersize=10, color=figures.RED, label="as measured")
    plot.set_xlabel("mean depth / height of the cameras over the water")
    plot.set_ylabel("sigma of the level / height of the cameras over the water")
    plot.grid(which="both")
    return figures.file_of(figure, form)


@figures.styled
def strip_picture(
    photos: TextArray,
    sigma: FloatArray,
    differences: FloatArray,
    title: str = "",
    form: figures.ImageForm = figures.FORM,
) -> tuple[str, bytes]:
    """Return the sigmas (m, 3) of stations along a strip, with what its first values differ (m, 3) from these."""
    figure, panels = figures.new_panels([9.0], [1.2] * 3, title, sharex=True)
    place = np.arange(len(photos))
    for axis, (plot, name) in enumerate(zip(panels[:, 0], "XYZ", strict=True)):
        plot.fill_between(place, -sigma[:, axis], sigma[:, axis], label="one sigma", **figures.BAND)
        plot.plot(
            place, differences[:, axis], color=figures.RED, marker=".", linewidth=1.0, label="triplets less IIIA"
        )
        plot.axhline(0.0, color=figures.INK, linewidth=0.5)
        plot.set_ylabel(f"{name}, m")
    figures.name_ticks(plot, place, photos)
    plot.set_xlabel("photo")
    return figures.file_of(figure, form)
