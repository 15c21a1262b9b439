"""Stations against their observed positions: what GNSS said, and what the block says of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.figures import BAND, INK, WET, name_ticks, new_panels
from musatpy.plots.maps import NORMAL, add_arrows, dress, name_places, view_of
from musatpy.plots.picture import NothingToShowError, Picture, counted, measure, rms
from musatpy.plots.plane import Plane, plane_of, turned
from musatpy.records.tables import Tables, numbers, part, texts

_AXES = ("east", "north", "up")
_LOCAL = ("X", "Y", "Z")
_WIDE, _LOW = 7.0, 0.9  # inches: width of all, height of the panel of a component


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
    bounds, _ = view_of(data.places, data.places, keys=True)
    width, height = (bounds[1] - bounds[0]).tolist()
    tall = _WIDE * height / max(width, height)
    figure, panels = new_panels([_WIDE], [tall, _LOW, _LOW, _LOW], "Stations, adjusted minus observed")
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
        panel.set_ylabel(f"{name}, m")
        panel.set_xticks([])
    name_ticks(panel, place, data.photos)
    panel.set_xlabel("photo")
    return figure


GNSS = Picture(
    name="gnss",
    title="Stations against observed positions",
    needs=("options", "stations"),
    numbers=observed_stations,
    figure=figure,
    words=sentence,
)
