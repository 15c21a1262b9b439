"""Stations against their observed positions: what GNSS said, and what the block says of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.plots.enlarged import NORMAL, turned
from musatpy.plots.mapping import INK, WET, draw_arrows, dress, name_places, shown_size, view_of
from musatpy.plots.picture import Picture
from musatpy.plots.plane import Plane, plane_of
from musatpy.plots.sheet import Margins, legend_below, new_sheet
from musatpy.plots.tables import NothingToShowError, Tables, numbers, part, texts
from musatpy.plots.wording import counted, measure, rms

_AXES = ("east", "north", "up")
_LOCAL = ("X", "Y", "Z")
_MAP, _WIDE, _LOW = 6.0, 8.0, 0.95  # inches: of the map, and of the panels of components
_TICKS = 40  # photos that are named, at most


@dataclass(frozen=True, kw_only=True, eq=False)
class ObservedStations:
    """n stations whose positions were observed."""

    plane: Plane
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


def sentence(data: ObservedStations) -> str:
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


def figure(data: ObservedStations) -> Any:
    """Return the figure of stations. Raises `MusatError` where matplotlib is missing."""
    bounds, _ = view_of(data.places, data.places, keys=1)
    width, height = (bounds[1] - bounds[0]).tolist()
    tall = max(_MAP * height / max(width, height), 3.0)
    sizes = [_WIDE], [tall, _LOW, _LOW, _LOW]
    margins = Margins(below=1.0, between=0.5)
    sheet = new_sheet(sizes, margins, title="Stations, adjusted minus observed", legend=1)
    axes, *components = sheet.panels[:, 0].tolist()
    axes.set_aspect("equal")
    dress(axes, bounds, data.plane)
    axes.plot(*data.places.T, "o", color=INK, markerfacecolor="white", markersize=4)
    name_places(axes, data.places, data.photos)
    shown = 2.0 * shown_size(bounds, len(data.photos))
    draw_arrows(axes, data.places, turned(data.difference[:, :2], data.turns), shown, "in plan", color=WET)
    for axis, (panel, name) in enumerate(zip(components, data.names, strict=True)):
        if axis:
            panel.sharex(components[0])
        _draw_component(panel, data, axis)
        panel.tick_params(labelbottom=panel is components[-1])
        panel.set_ylabel(f"{name}, m", fontsize=9)
    step = -(-len(data.photos) // _TICKS)
    number = np.arange(1.0, len(data.photos) + 1.0)
    panel.set_xticks(number[::step], data.photos[::step].tolist(), rotation=90, fontsize=7)
    panel.set_xlabel("photo")
    legend_below(sheet.figure, 2, *panel.get_legend_handles_labels())
    return sheet.figure


def _draw_component(axes: Any, data: ObservedStations, axis: int) -> None:
    number = np.arange(1.0, len(data.photos) + 1.0)
    band = NORMAL * data.sigma[:, axis]
    axes.fill_between(
        number, -band, band, step="mid", color="0.85", linewidth=0, label=f"{NORMAL:g} sigma of the observed"
    )
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.plot(number, data.difference[:, axis], ".", color=WET, markersize=4, label="difference")
    axes.tick_params(labelsize=8)


GNSS = Picture(
    name="gnss",
    title="Stations against observed positions",
    needs={
        "options": ("system",),
        "stations": ("photo", "position", "given_position", "given_position_sigma"),
    },
    numbers=observed_stations,
    figure=figure,
    words=sentence,
)
