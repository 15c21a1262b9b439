"""Pictures of exposures: the water at each, observed positions, and how the unknowns hang together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, TextArray, rms
from musatpy.figures import BAND, GREY, INK, LETTER, WET, add_bar, name_rows, name_ticks, new_panels, shades
from musatpy.plots.maps import NORMAL, add_arrows, dress, name_places, view_of, without_paths
from musatpy.plots.picture import NothingToShowError, Picture, counted, measure
from musatpy.plots.plane import MapPlane, plane_of, turned
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


def _tide_sentence(data: Tides) -> str:
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


def _tide_figure(data: Tides) -> Any:
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


TIDES = Picture("tides", "Water at the exposures", ("stations",), tides, _tide_figure, _tide_sentence)


# --- observed positions ---


_AXES = ("east", "north", "up")
_LOCAL = ("X", "Y", "Z")
_WIDE, _LOW = 7.0, 0.9  # inches: width of all, height of the panel of a component


@dataclass(frozen=True, kw_only=True, eq=False)
class ObservedStations:
    """n stations whose positions were observed."""

    plane: MapPlane
    photos: TextArray  # (n,)
    places: FloatArray  # (n, 2) m
    difference: FloatArray  # (n, 3) m, adjusted minus observed, east, north, up
    sigma: FloatArray  # (n, 3) m, of the observed positions; NaN of a component that was not
    turns: FloatArray  # (n,) rad of the plane

    @property
    def names(self) -> tuple[str, str, str]:
        """Of the components."""
        return _LOCAL if self.plane.north == "Y" else _AXES


def observed_stations(tables: Tables) -> ObservedStations:
    """Return the observed stations. Raises `NothingToShowError` where there are none."""
    stations = part(tables, "stations")
    sigma = numbers(stations, "given_position_sigma", 3)
    rows = np.isfinite(sigma).any(axis=1)
    if not rows.any():
        raise NothingToShowError("no position of a station was observed")
    plane = plane_of(tables)
    position, given = numbers(stations, "position", 3), numbers(stations, "given_position", 3)
    places, turns = plane.places(position), plane.turns(position)
    difference = places - plane.places(given)
    difference[:, :2] = turned(difference[:, :2], -turns)
    return ObservedStations(
        plane=plane,
        photos=texts(stations, "photo")[rows],
        places=places[rows, :2],
        difference=np.where(np.isfinite(sigma), difference, np.nan)[rows],
        sigma=sigma[rows],
        turns=turns[rows],
    )


def _station_sentence(data: ObservedStations) -> str:
    """Return what the differences say."""
    spread = ", ".join(
        f"{name} {measure(rms(data.difference[:, axis]), 'm')}" for axis, name in enumerate(data.names)
    )
    test = np.abs(data.difference) / np.where(data.sigma > 0.0, data.sigma, np.nan)
    text = (
        f"Adjusted minus observed positions of {counted(len(data.photos), 'station')}, root mean squares: {spread}"
    )
    if np.isfinite(test).any():
        row, axis = np.unravel_index(np.nanargmax(test), test.shape)
        text += f"; the largest in sigmas is {test[row, axis]:.1f} (photo {data.photos[row]}, {data.names[axis]}: "
        text += f"{measure(data.difference[row, axis], 'm')})"
    return text + "."


def _station_figure(data: ObservedStations) -> Any:
    """Return the figure of stations. Raises `MusatError` where matplotlib is missing."""
    bounds, _ = view_of(data.places, data.places, keys=True)
    width, height = (bounds[1] - bounds[0]).tolist()
    tall = _WIDE * height / max(width, height)
    figure, panels = new_panels([_WIDE], [tall, _LOW, _LOW, _LOW], "Stations, adjusted minus observed", below=0.45)
    axes, *components = panels[:, 0]
    dress(axes, bounds, data.plane)
    axes.plot(*data.places.T, "o", color=INK, markerfacecolor="white", label="stations")
    name_places(axes, data.places, data.photos)
    add_arrows(axes, data.places, turned(data.difference[:, :2], data.turns), "difference in plan", color=WET)
    place = np.arange(len(data.photos))
    for axis, (panel, name) in enumerate(zip(components, data.names, strict=True)):
        band = NORMAL * data.sigma[:, axis]
        panel.fill_between(place, -band, band, step="mid", label=f"{NORMAL:g} sigma of the observed", **BAND)
        panel.axhline(0.0, color=INK, linewidth=0.6)
        panel.plot(place, data.difference[:, axis], "o", color=WET, label="difference")
        panel.set(ylabel=f"{name}, m", xticks=[])
    name_ticks(panel, place, without_paths(data.photos))
    panel.set_xlabel("photo")
    return figure


GNSS = Picture(
    "gnss",
    "Stations against observed positions",
    ("options", "stations"),
    observed_stations,
    _station_figure,
    _station_sentence,
)


# --- correlations ---


_TILTS = ("X-tilt", "Y-tilt", "heading")
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
        names=(*(_LOCAL if tables["options"]["system"] == "LOCL" else _AXES), *_TILTS, *names.tolist()),
        value=value[photo],
        photo=str(texts(stations, "photo")[photo]),
        inflated=texts(unknowns, "unknown")[:_MOST],
        inflation=numbers(unknowns, "inflation")[:_MOST],
    )


def _correlation_sentence(data: Correlations) -> str:
    """Return what the correlations say."""
    row, column = data.strongest
    upper = np.abs(data.value[np.triu_indices(len(data.names), 1)])
    text = (
        f"Of the unknowns of photo {data.photo}"
        f"{' with the water' if len(data.names) > 6 else ''}, {data.names[column]} and {data.names[row]} are "
        f"correlated most: {data.value[row, column]:+z.3f}; "
        f"{counted(int((upper >= _HIGH).sum()), 'pair')} of {_HIGH:g} and more"
    )
    if len(data.inflation):
        worst = int(np.nanargmax(data.inflation))
        text += f"; largest variance inflation of the water {data.inflation[worst]:.3g} ({data.inflated[worst]})"
    return text + "."


def _correlation_figure(data: Correlations) -> Any:
    """Return the figure of correlations. Raises `MusatError` where matplotlib is missing."""
    number, bars = len(data.names), len(data.inflated)
    side = max(_CELL * number, _LEAST)
    room = 1.2 + LETTER * max((len(name) for name in data.inflated.tolist()), default=0)
    figure, ((axes, *beside),) = new_panels([side, 3.0][: 1 + bool(bars)], [side], "Correlations", room)
    drawn = axes.imshow(np.abs(data.value), cmap=shades(), vmin=0.0, vmax=1.0)
    for (row, column), value in np.ndenumerate(data.value):
        if np.isfinite(value) and row > column:
            axes.text(column, row, f"{value:+z.2f}", ha="center", va="center", fontsize=7, color="white")
    name_ticks(axes, np.arange(number), data.names)
    name_rows(axes, data.names)
    axes.set_title(f"unknowns of photo {data.photo}")
    add_bar(axes, drawn, "size of the correlation")
    for panel in beside:
        drawn = panel.barh(data.inflated, data.inflation, color="0.7", edgecolor=INK, height=0.5)
        panel.bar_label(drawn, [f"{value:.3g}" for value in data.inflation.tolist()], padding=3)
        panel.set(ylim=(max(bars, 4) - 0.5, -0.5), xscale="log")
        panel.minorticks_off()
        panel.set(xlim=(1.0, 3.0 * max(float(np.nanmax(data.inflation)), 4.0)), xlabel="variance inflation factor")
        panel.set_title("unknowns of all photos")
    return figure


CORRELATIONS = Picture(
    "correlations",
    "Correlations",
    ("options", "stations", "water_precision"),
    correlations,
    _correlation_figure,
    _correlation_sentence,
)
