"""Normalised residuals beside the normal distribution, kind by kind: histograms and quantiles."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.figures import DRY, INK, WET, new_panels
from musatpy.plots.maps import NORMAL
from musatpy.plots.picture import NothingToShowError, Picture, counted
from musatpy.records.tables import Tables, numbers, part, texts

LEAST = 3  # residuals of a kind
_SPAN = 4.5  # sigmas of a histogram; what is beyond counts in its last bars
_BARS = (9, 36)  # least and most
_DRAWN = 200  # quantiles at most, the ends all
_ENDS = 20
_FAR = 3.29  # 99.9 %
_WIDTH, _HEIGHT = 3.5, 1.7  # inches, of a panel


@dataclass(frozen=True, kw_only=True, eq=False)
class Residuals:
    """The normalised residuals (n,) of a kind of observations, growing."""

    kind: str
    values: FloatArray

    @property
    def deviation(self) -> float:
        """Their root mean square: 1 where the sigmas given are right."""
        return float(np.sqrt(np.mean(np.square(self.values))))

    def beyond(self, limit: float) -> float:
        """Return the share that is larger than a limit."""
        return float(np.mean(np.abs(self.values) > limit))


def normal_quantiles(number: int, rows: IntArray) -> FloatArray:
    """Return where rows (k,) of the values of a standard normal sample, growing, are expected: at (i - 1/2)/n."""
    normal = NormalDist()  # scipy's would have to be loaded, for this alone
    return np.array([normal.inv_cdf((row + 0.5) / number) for row in rows.tolist()])


def thinned(number: int) -> IntArray:
    """Return the rows of quantiles that are drawn: both ends, and evenly between."""
    if number <= _DRAWN:
        return np.arange(number)
    inner = np.linspace(_ENDS, number - 1 - _ENDS, _DRAWN - 2 * _ENDS).round().astype(int)
    return np.unique(np.concatenate([np.arange(_ENDS), inner, np.arange(number - _ENDS, number)]))


def residuals_by_kind(tables: Tables) -> list[Residuals]:
    """Return the residuals of each kind that has some. Raises `NothingToShowError` where none has."""
    observed = part(tables, "observations")
    kind, value = texts(observed, "kind"), numbers(observed, "standardised")
    known = np.isfinite(value)
    data = []
    for name in dict.fromkeys(kind.tolist()):
        values = value[known & (kind == name)]
        if len(values) >= LEAST:
            data.append(Residuals(kind=str(name).replace("_", " "), values=np.sort(values)))
    if not data:
        raise NothingToShowError("no kind of observation has three checked residuals")
    return data


def sentence(data: list[Residuals]) -> str:
    """Return what the histograms say."""
    parts = [
        f"{of_kind.kind}: {counted(len(of_kind.values), 'residual')}, root mean square {of_kind.deviation:.2f}, "
        f"{of_kind.beyond(NORMAL):.1%} beyond {NORMAL:g} (5 % expected), largest {np.abs(of_kind.values).max():.2f}"
        for of_kind in data
    ]
    return "Residuals over their own sigmas; " + "; ".join(parts) + "."


def figure(data: list[Residuals]) -> Any:
    """Return the figure of all kinds. Raises `MusatError` where matplotlib is missing."""
    title = "Normalised residuals beside the normal distribution"
    figure, panels = new_panels([_WIDTH] * 2, [_HEIGHT] * len(data), title, sharex="col")
    for (bars, dots), of_kind in zip(panels, data, strict=True):
        _draw_bars(bars, of_kind)
        _draw_quantiles(dots, of_kind)
    panels[-1, 0].set_xlabel("residual over its own sigma")
    panels[-1, 1].set_xlabel("expected of a normal distribution")
    return figure


def _draw_bars(axes: Any, of_kind: Residuals) -> None:
    bars = int(np.clip(np.sqrt(len(of_kind.values)), *_BARS))
    edges = np.linspace(-_SPAN, _SPAN, bars + 1)
    count, _ = np.histogram(np.clip(of_kind.values, -_SPAN, _SPAN), edges)
    axes.stairs(count, edges, fill=True, facecolor="0.8", edgecolor=INK, linewidth=0.5, label="residuals")
    x = np.linspace(-_SPAN, _SPAN, 121)
    curve = len(of_kind.values) * (edges[1] - edges[0]) * np.exp(-0.5 * np.square(x)) / np.sqrt(2.0 * np.pi)
    axes.plot(x, curve, "-", color=WET, linewidth=1.4, label="normal distribution")
    for limit in (-_FAR, _FAR):
        axes.axvline(limit, color=DRY, linestyle="--", label="99.9 %")
    axes.set_ylabel("residuals")
    axes.set_title(f"{of_kind.kind}: {len(of_kind.values):,}, RMS {of_kind.deviation:.2f}")
    axes.locator_params(axis="y", nbins=4, integer=True)


def _draw_quantiles(axes: Any, of_kind: Residuals) -> None:
    rows = thinned(len(of_kind.values))
    expected = normal_quantiles(len(of_kind.values), rows)
    ends = [expected[0] - 0.3, expected[-1] + 0.3]
    axes.plot(ends, ends, "-", color=WET, linewidth=1.4)
    axes.plot(expected, of_kind.values[rows], ".", color=INK, label="quantiles")
    for limit in (-_FAR, _FAR):
        axes.axhline(limit, color=DRY, linestyle="--")
    axes.set_ylabel("residual over sigma")
    axes.locator_params(nbins=6)


NORMALISED = Picture(
    name="normalised",
    title="Normalised residuals",
    needs=("observations",),
    numbers=residuals_by_kind,
    figure=figure,
    words=sentence,
)
