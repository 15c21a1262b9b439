"""The bottom along a line: apparent and corrected points, the water at each photo, and soundings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.figures import BAND, DRY, GREY, INK, WATER, WET, new_panels, write_beside
from musatpy.geometry.collinearity import wrapped
from musatpy.plots.maps import NORMAL, without_paths
from musatpy.plots.picture import NothingToShowError, Picture, counted, measure
from musatpy.plots.plane import MapPlane
from musatpy.plots.submerged_points import CORRECTIONS, PlottedPoints, submerged_points
from musatpy.records.tables import Tables, numbers, part, texts

_WANTED = 12  # submerged points of a profile, where there are as many
_SOUNDED = 40  # soundings, likewise: where there are more, the nearest
_NARROW, _WIDE = 0.005, 0.16  # of the length of a line: half a corridor, at least and at most
_BEND, _GAP = 60.0, 2.5  # degrees, and typical distances, at which a strip ends
_BESIDE_AXIS = 0.05  # of the length of a line: what counts where the line is chosen
_BESIDE = 1.0  # flying heights from the line, within which the water of photos is that of the line
_JOINED = 400  # points that are joined by lines, at most
_NEAR = 0.1  # of the length of a line: so near it are points that are joined


@dataclass(frozen=True, kw_only=True, eq=False)
class SoundedPlaces:
    """Soundings on the plane of a picture: places (n, 2) m, heights (n,) m, and their sigmas (n,), NaN for none."""

    places: FloatArray
    height: FloatArray
    sigma: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class ProfileLine:
    """Where a profile runs: vertices (v, 2) m on the plane."""

    name: str
    vertices: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthProfile:
    """What lies along a line, within half a corridor, in the order of the distance, m."""

    line: ProfileLine
    half: float
    distance: FloatArray  # (n,) of submerged points
    near: BoolArray  # (n,) those that are joined: within a tenth of the length of the line
    corrected: FloatArray  # (n,) heights
    apparent: FloatArray  # (n,)
    sigma: FloatArray  # (n,) of the corrected heights
    depth: FloatArray  # (n,)
    dry: FloatArray  # (d, 2) distance and height of other points
    water: FloatArray  # (w, 2) distance and height
    photos: TextArray  # (w,) whose water it is; empty: that of a point
    sounded: FloatArray  # (s, 3) distance, height, sigma
    beside: float  # half the corridor of the soundings


def along(vertices: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far along a line (v, 2) places (n, 2) lie, and how far from it, m; NaN and inf beyond its ends.

    Of the segments of the line the nearest counts.
    """
    distance, offset = np.full(len(places), np.nan), np.full(len(places), np.inf)
    begin = 0.0
    for start, end in pairwise(vertices):
        length = float(np.linalg.norm(end - start))
        axis = (end - start) / length
        s, across = (places - start) @ axis, np.abs((places - start) @ [-axis[1], axis[0]])
        nearer = (s >= 0.0) & (s <= length) & (across < offset)
        distance[nearer], offset[nearer] = begin + s[nearer], across[nearer]
        begin += length
    return distance, offset


def strips(stations: FloatArray) -> IntArray:
    """Return the number (n,) of the strip of each station (n, 2), in the order of the flight.

    A strip ends where the flight turns, and where the next station is far off.
    """
    strip = np.zeros(len(stations), dtype=np.int64)
    if len(stations) < 3:
        return strip
    step = np.diff(stations, axis=0)
    length = np.linalg.norm(step, axis=1)
    far = length > _GAP * np.median(length)
    heading = np.arctan2(step[:, 1], step[:, 0])
    for row in range(2, len(stations)):
        turn = abs(wrapped(heading[row - 1] - heading[row - 2]))
        turns = turn > np.radians(_BEND) and not far[row - 2] and strip[row - 2] == strip[row - 1]
        strip[row] = strip[row - 1] + int(far[row - 1] or turns)
    return strip


def half_corridor(offset: FloatArray, length: float, wanted: int = _WANTED) -> float:
    """Return half the width (m) of the narrowest corridor about a line that has points enough, by their offsets."""
    inside = np.sort(offset[np.isfinite(offset)])
    if not len(inside):
        return _WIDE * length
    needed = inside[min(wanted, len(inside)) - 1] * (1.0 + 1e-9)
    return float(np.clip(needed, _NARROW * length, _WIDE * length))


def profile(
    tables: Tables,
    line: Callable[[MapPlane], ProfileLine] | None = None,
    soundings: Callable[[MapPlane], SoundedPlaces] | None = None,
    within: float | None = None,
) -> DepthProfile:
    """Return the profile along a line; of its own along the strip, or the points, with most of the bottom.

    `within` (m) is half the corridor about it; else it is as wide as it must be. Raises `NothingToShowError` where
    no submerged point lies there.
    """
    bottom = submerged_points(tables)
    known = np.flatnonzero(bottom.submerged & np.isfinite(bottom.shift).all(axis=1))
    best = line(bottom.plane) if line else _own_line(tables, bottom, bottom.places[known, :2])
    distance, offset = along(best.vertices, bottom.places[known, :2])
    half = half_corridor(offset, _length(best)) if within is None else within
    order = np.argsort(distance, kind="stable")
    order = order[offset[order] <= half]
    if not len(order):
        raise NothingToShowError(f"no submerged point lies within {half:.0f} m of {best.name}")
    rows = known[order]
    sounded, beside = np.empty((0, 3)), half
    if soundings:
        data = soundings(bottom.plane)
        if within is None:
            beside = min(half, half_corridor(along(best.vertices, data.places)[1], _length(best), _SOUNDED))
        sounded = _in_corridor(best, beside, data.places, np.column_stack([data.height, data.sigma]))
    water, photos = _water(tables, bottom, best, rows)
    dry = bottom.places[~bottom.submerged]
    return DepthProfile(
        line=best,
        half=half,
        distance=distance[order],
        near=offset[order] <= _NEAR * _length(best),
        corrected=bottom.places[rows, 2],
        apparent=bottom.apparent[rows, 2],
        sigma=bottom.sigma[rows],
        depth=bottom.depth[rows],
        dry=_in_corridor(best, half, dry[:, :2], dry[:, 2:]),
        water=water,
        photos=photos,
        sounded=sounded,
        beside=beside,
    )


def _length(line: ProfileLine) -> float:
    return float(np.linalg.norm(np.diff(line.vertices, axis=0), axis=1).sum())


def _in_corridor(line: ProfileLine, half: float, places: FloatArray, values: FloatArray) -> FloatArray:
    """Return distance and values (m, 1 + k) of what lies in the corridor, of places (n, 2), values (n, k)."""
    distance, offset = along(line.vertices, places)
    return np.column_stack([distance, values])[offset <= half]


def _own_line(tables: Tables, bottom: PlottedPoints, wet: FloatArray) -> ProfileLine:
    """Return the axis of the strip beside which most submerged points (m, 2) lie, or their own."""
    lines = [_axis("the longest axis of the submerged points", wet, wet)]
    photos = part(tables, "stations")
    stations = bottom.plane.places(numbers(photos, "position", 3))[:, :2]
    names, strip = texts(photos, "photo"), strips(stations)
    for number in np.unique(strip).tolist():
        rows = np.flatnonzero((strip == number) & np.isfinite(stations).all(axis=1))
        if len(rows) > 1:
            lines.append(_axis(f"strip {names[rows[0]]} to {names[rows[-1]]}", stations[rows], wet))
    near = [(along(one.vertices, wet)[1] <= _BESIDE_AXIS * _length(one)).sum() for one in lines]
    near[0] //= 2  # a strip is what a reader knows
    return lines[int(np.argmax(near))]


def _axis(name: str, places: FloatArray, wet: FloatArray) -> ProfileLine:
    """Return the line of best fit of places (n, 2), from the first to the last of the points (m, 2) beside it."""
    middle = np.median(places, axis=0)
    axis = np.linalg.svd(places - middle, full_matrices=False)[2][0] if len(places) > 1 else np.array([1.0, 0.0])
    axis = axis if axis @ (places[-1] - places[0]) >= 0.0 else -axis
    s, across = (wet - middle) @ axis, np.abs((wet - middle) @ [-axis[1], axis[0]])
    reach = float(np.ptp((places - middle) @ axis))
    beside = s[across <= max(0.5 * reach, across.min())]
    low, high = float(beside.min()) - 1.0, float(beside.max()) + 1.0
    return ProfileLine(name=name, vertices=np.array([middle + low * axis, middle + high * axis]))


def _water(
    tables: Tables, bottom: PlottedPoints, line: ProfileLine, rows: IntArray
) -> tuple[FloatArray, TextArray]:
    """Return where along a line the water of photos stands, or that of points where there are no photos."""
    tide, stations = numbers(part(tables, "adjusted_water"), "tide"), part(tables, "stations")
    if not len(tide) or len(tide) != len(numbers(stations, "position", 3)):
        distance = along(line.vertices, bottom.places[rows, :2])[0]
        return np.column_stack([distance, bottom.water[rows]]), np.full(len(rows), "")
    position = numbers(stations, "position", 3)
    distance, offset = along(line.vertices, bottom.plane.places(position)[:, :2])
    height = bottom.plane.heights(position, tide)
    flown = bottom.plane.places(position)[:, 2] - height
    offset = np.where(np.isfinite(flown), offset / flown, np.inf)
    near = offset <= min(_BESIDE, offset.min() + 0.25)
    if not near.any():  # a line beside all stations: their water all the same
        return np.array([[0.0, np.nanmean(height)], [_length(line), np.nanmean(height)]]), np.full(2, "")
    return np.column_stack([distance, height])[near], texts(stations, "photo")[near]


def sentence(data: DepthProfile) -> str:
    """Return what the profile says."""
    fall = data.apparent - data.corrected
    text = (
        f"Along {data.line.name}: {counted(len(data.distance), 'submerged point')} within "
        f"{measure(data.half, 'm')} of the line, depths {measure(np.nanmin(data.depth), 'm')} to "
        f"{measure(np.nanmax(data.depth), 'm')}, refraction lowers them by {measure(float(np.median(fall)), 'm')} "
        f"in the median"
    )
    if np.isfinite(data.sigma).any():
        text += f"; {NORMAL:g} sigma of a height is typically {measure(NORMAL * np.nanmedian(data.sigma), 'm')}"
    if len(data.sounded):
        text += f"; {counted(len(data.sounded), 'sounding')} within {measure(data.beside, 'm')}"
    return text + "."


def figure(data: DepthProfile) -> Any:
    """Return the figure of a profile. Raises `MusatError` where matplotlib is missing."""
    title = f"Profile along {data.line.name}, points within {measure(data.half, 'm')}"
    figure, ((axes,),) = new_panels([8.5], [3.6], title)
    axes.set_ylim(*_heights(data))
    rows = data.near & (len(data.distance) <= _JOINED)
    band = NORMAL * np.nan_to_num(data.sigma)
    low, high = data.corrected - band, data.corrected + band
    axes.fill_between(data.distance[rows], low[rows], high[rows], **BAND)
    axes.errorbar(
        data.distance, data.corrected, band, fmt="none", ecolor=WET, elinewidth=0.8, label=f"{NORMAL:g} sigma"
    )
    for height, marker, style, shade, label in (
        (data.apparent, "^", "--", GREY, "apparent: straight rays"),
        (data.corrected, "o", "-", WET, "corrected"),
    ):
        axes.plot(data.distance[rows], height[rows], style, color=shade)
        axes.plot(data.distance, height, marker, color=shade, label=label)
    dry = data.dry[(data.dry[:, 1:] > axes.get_ylim()[0]).ravel() & (data.dry[:, 1:] < axes.get_ylim()[1]).ravel()]
    if len(dry):
        axes.plot(*dry.T, "s", color=DRY, label="dry points")
    _draw_water(axes, data)
    if len(data.sounded):
        label = f"soundings within {measure(data.beside, 'm')}"
        axes.plot(*data.sounded[:, :2].T, "+", color=INK, markersize=5, label=label, zorder=4)
    axes.set(xlabel="distance along the line, m", ylabel="height, m")
    axes.grid()
    return figure


def _heights(data: DepthProfile) -> tuple[float, float]:
    """Return from which height to which the bottom fills the picture: land that is higher is cut off."""
    lowest = data.corrected - NORMAL * np.nan_to_num(data.sigma)
    shown = np.concatenate([data.corrected, lowest, data.apparent, data.water[:, 1], data.sounded[:, 1]])
    low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
    border = 0.15 * max(high - low, 0.1)
    return low - border, high + 2.0 * border


def _draw_water(axes: Any, data: DepthProfile) -> None:
    order = np.argsort(data.water[:, 0], kind="stable")
    label = "water, at each photo" if (data.photos != "").any() else "water"
    axes.plot(*data.water[order].T, "-", color=WATER, linewidth=1.2, label=label)
    if len(data.water) <= 30:
        write_beside(axes, data.water, without_paths(data.photos), (0, 5), ha="center")


def profile_picture(
    line: Callable[[MapPlane], ProfileLine] | None = None,
    soundings: Callable[[MapPlane], SoundedPlaces] | None = None,
    within: float | None = None,
) -> Picture[DepthProfile]:
    """Return the picture of the profile along a line, with soundings."""
    return Picture(
        "profile",
        "Depth profile",
        CORRECTIONS.needs,
        partial(profile, line=line, soundings=soundings, within=within),
        figure,
        sentence,
    )


PROFILE = profile_picture()
