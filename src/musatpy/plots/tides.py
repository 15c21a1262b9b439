"""The height of the water at each exposure: as given and as adjusted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.figures import BAND, GREY, INK, WET, name_ticks, new_panels
from musatpy.plots.maps import NORMAL
from musatpy.plots.picture import NothingToShowError, Picture, counted, measure
from musatpy.records.tables import Tables, numbers, part, texts

_BARS = 60  # exposures with error bars, at most; of more there is a band


@dataclass(frozen=True, kw_only=True, eq=False)
class Tides:
    """Heights of the water (n,) m at exposures, NaN where none is known."""

    photos: TextArray
    at: FloatArray  # (n,) s where `timed`, else the number of the exposure
    timed: bool
    given: FloatArray
    sigma: FloatArray  # of the given ones; NaN: without error, or none
    adjusted: FloatArray
    groups: TextArray  # (n,) whose corrections are common; empty: of none

    @property
    def correction(self) -> FloatArray:
        """(n,) m, adjusted minus given."""
        return self.adjusted - self.given


def tides(tables: Tables) -> Tides:
    """Return the tides of a run. Raises `NothingToShowError` where it has no water, or none of them is known."""
    stations, water = part(tables, "stations"), part(tables, "adjusted_water")
    given = numbers(stations, "tide")
    adjusted = numbers(water, "tide")
    if len(adjusted) != len(given):
        adjusted = np.full(len(given), np.nan)
    if not np.isfinite([given, adjusted]).any():
        raise NothingToShowError("no height of the water is known")
    time = numbers(stations, "time")
    timed = bool(len(time) == len(given) and np.isfinite(time).all() and np.ptp(time) > 0.0)
    groups, days = texts(stations, "tide_group"), texts(stations, "tide_day")
    return Tides(
        photos=texts(stations, "photo"),
        at=time if timed else np.arange(1.0, len(given) + 1.0),
        timed=timed,
        given=given,
        sigma=numbers(stations, "tide_sigma"),
        adjusted=adjusted,
        groups=np.where(groups != "", groups, days),
    )


def sentence(data: Tides) -> str:
    """Return what the tides say."""
    level = np.where(np.isfinite(data.adjusted), data.adjusted, data.given)
    text = (
        f"The water stands at {measure(np.nanmin(level), 'm')} to {measure(np.nanmax(level), 'm')} at "
        f"{counted(len(data.photos), 'exposure')}"
    )
    moved = np.abs(data.correction)
    if np.isfinite(moved).any() and np.nanmax(moved) > 0.0:
        worst = int(np.nanargmax(moved))
        text += f"; the adjustment moved it by {measure(data.correction[worst], 'm')} at most (photo "
        text += f"{data.photos[worst]})"
        if data.sigma[worst] > 0.0:
            text += f", {moved[worst] / data.sigma[worst]:.1f} of its sigma"
    else:
        text += "; the adjustment kept the heights given"
    return text + "."


def figure(data: Tides) -> Any:
    """Return the figure of tides. Raises `MusatError` where matplotlib is missing."""
    figure, ((axes,),) = new_panels([7.2], [2.8], "Water at the exposures")
    _draw_given(axes, data)
    if np.nanmax(np.abs(data.correction), initial=0.0) > 0.0 or not np.isfinite(data.given).any():
        axes.plot(data.at, data.adjusted, "x", color=WET, markersize=6, label="adjusted")
    _draw_groups(axes, data)
    if data.timed:
        axes.set_xlabel("time of the exposure, s")
    else:
        name_ticks(axes, data.at, data.photos)
        axes.set_xlabel("photo")
    axes.set_ylabel("height of the water, m")
    axes.grid()
    return figure


def _draw_given(axes: Any, data: Tides) -> None:
    half = np.where(data.sigma > 0.0, NORMAL * data.sigma, 0.0)
    label = f"given, with {NORMAL:g} sigma" if half.any() else "given"
    style: dict[str, Any] = {"color": GREY, "markerfacecolor": "none", "markersize": 5, "label": label}
    if half.any() and len(data.at) <= _BARS:
        axes.errorbar(data.at, data.given, half, fmt="o", linewidth=0.8, capsize=2, **style)
        return
    if half.any():
        order = np.argsort(data.at, kind="stable")
        axes.fill_between(data.at[order], (data.given - half)[order], (data.given + half)[order], **BAND)
    axes.plot(data.at, data.given, "o", **style)


def _draw_groups(axes: Any, data: Tides) -> None:
    """Draw a line where a group of common corrections begins, and its name."""
    if data.timed or len(set(data.groups.tolist())) < 2:
        return
    begins = np.flatnonzero(np.append(True, data.groups[1:] != data.groups[:-1]))
    for row in begins.tolist():
        axes.axvline(data.at[row] - 0.5, color=INK, linestyle=":", linewidth=0.7)
        place = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "fontsize": 7}
        axes.annotate(str(data.groups[row]), (data.at[row] - 0.5, 1.0), (3, -9), **place)


TIDES = Picture(
    name="tides",
    title="Water at the exposures",
    needs=("stations",),
    numbers=tides,
    figure=figure,
    words=sentence,
)
