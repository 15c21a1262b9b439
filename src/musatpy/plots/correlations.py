"""How the unknowns of photos and of all photos hang together: correlations of stations, water and camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.figures import INK, add_bar, name_ticks, new_panels, shades
from musatpy.plots.picture import NothingToShowError, Picture, counted
from musatpy.records.tables import Tables, numbers, part, texts

_ELEMENTS = ("east", "north", "up", "X-tilt", "Y-tilt", "heading")
_MOST = 16  # unknowns of all photos that are drawn
_HIGH = 0.95  # from which two unknowns can hardly be told apart
_CELL, _LEAST = 0.5, 3.2  # inches, of a correlation and of all


@dataclass(frozen=True, kw_only=True, eq=False)
class Correlations:
    """Correlations (k, k) of the elements of a station, those of one photo, and of k - 6 unknowns of all photos."""

    names: tuple[str, ...]
    value: FloatArray
    photo: str  # whose station hangs together most with the others
    inflated: TextArray  # (u,) unknowns of all photos
    inflation: FloatArray  # (u,) variance inflation factors

    @property
    def strongest(self) -> tuple[int, int]:
        """Row and column of the largest."""
        size = np.tril(np.abs(np.nan_to_num(self.value)), -1)  # once each: both halves may differ by rounding
        row, column = np.unravel_index(int(size.argmax()), size.shape)
        return int(row), int(column)


def correlated(covariance: FloatArray) -> FloatArray:
    """Return the correlations (..., k, k) of covariances (..., k, k); NaN with what has no variance."""
    variance = np.einsum("...ii->...i", covariance)
    sigma = np.sqrt(np.where(variance > 0.0, variance, np.nan))
    return covariance / (sigma[..., :, None] * sigma[..., None, :])


def joined(stations: FloatArray, water: FloatArray, shared: FloatArray) -> FloatArray:
    """Return covariances (n, 6 + q, 6 + q) of stations (n, 6, 6) with water (q, q) by what they share (q, n, 6)."""
    cross = np.moveaxis(shared, 0, 1)
    low = np.broadcast_to(water, (len(stations), *water.shape))
    return np.concatenate(
        [np.concatenate([stations, np.swapaxes(cross, 1, 2)], 2), np.concatenate([cross, low], 2)], axis=1
    )


def correlations(tables: Tables) -> Correlations:
    """Return the correlations. Raises `NothingToShowError` where no station has a covariance."""
    stations, water = part(tables, "stations"), part(tables, "water_precision")
    covariance = numbers(stations, "covariance", 6, 6)
    names = texts(water, "quantity")[:_MOST]
    q, n = len(names), len(covariance)
    known = np.isfinite(covariance).all(axis=(1, 2))
    if not known.any():
        raise NothingToShowError("no station has a covariance")
    if q:
        of_water = numbers(water, "covariance", len(texts(water, "quantity")))[:q, :q]
        covariance = joined(covariance, of_water, numbers(water, "stations", n * 6)[:q].reshape(q, n, 6))
    value = correlated(covariance)
    between = value[:, :6, 6:] if q else value - np.eye(6)
    size = np.where(known, np.nan_to_num(np.abs(between)).reshape(n, -1).max(axis=1), -1.0)
    photo = int(size.argmax())
    unknowns = part(tables, "dependence.globals")
    return Correlations(
        names=(*_ELEMENTS, *names.tolist()),
        value=value[photo],
        photo=str(texts(stations, "photo")[photo]),
        inflated=texts(unknowns, "unknown")[:_MOST],
        inflation=numbers(unknowns, "inflation")[:_MOST],
    )


def sentence(data: Correlations) -> str:
    """Return what the correlations say."""
    row, column = data.strongest
    upper = np.abs(data.value[np.triu_indices(len(data.names), 1)])
    text = (
        f"Of the unknowns of photo {data.photo}"
        f"{' with the water' if len(data.names) > 6 else ''}, {data.names[column]} and {data.names[row]} are "
        f"correlated most: {data.value[row, column]:+.3f}; "
        f"{counted(int((upper >= _HIGH).sum()), 'pair')} of {_HIGH:g} and more"
    )
    if len(data.inflation):
        worst = int(np.nanargmax(data.inflation))
        text += f"; largest variance inflation of the water {data.inflation[worst]:.3g} ({data.inflated[worst]})"
    return text + "."


def figure(data: Correlations) -> Any:
    """Return the figure of correlations. Raises `MusatError` where matplotlib is missing."""
    number, bars = len(data.names), len(data.inflated)
    side = max(_CELL * number, _LEAST)
    figure, ((axes, *beside),) = new_panels([side, 3.0][: 1 + bool(bars)], [side], "Correlations")
    drawn = axes.imshow(np.abs(data.value), cmap=shades(), vmin=0.0, vmax=1.0)
    for (row, column), value in np.ndenumerate(data.value):
        if np.isfinite(value) and row > column:
            axes.text(column, row, f"{value:+z.2f}", ha="center", va="center", fontsize=7, color="white")
    name_ticks(axes, np.arange(number), data.names)
    axes.set_yticks(range(number), data.names)
    axes.set_title(f"unknowns of photo {data.photo}")
    add_bar(axes, drawn, "size of the correlation")
    for panel in beside:
        drawn = panel.barh(data.inflated, data.inflation, color="0.7", edgecolor=INK, height=0.5)
        panel.bar_label(drawn, [f"{value:.3g}" for value in data.inflation.tolist()], padding=3)
        panel.set_ylim(max(bars, 4) - 0.5, -0.5)
        panel.set_xscale("log")
        panel.minorticks_off()
        panel.set_xlim(1.0, 3.0 * max(float(np.nanmax(data.inflation)), 4.0))
        panel.set_xlabel("variance inflation factor")
        panel.set_title("unknowns of all photos")
    return figure


CORRELATIONS = Picture(
    name="correlations",
    title="Correlations",
    needs=("stations", "water_precision"),
    numbers=correlations,
    figure=figure,
    words=sentence,
)
