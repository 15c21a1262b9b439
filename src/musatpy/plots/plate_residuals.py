"""Residuals of plate coordinates, photo by photo."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.plots.enlarged import magnification, round_length
from musatpy.plots.footprints import frames
from musatpy.plots.mapping import DRY, INK, LIGHT, WET
from musatpy.plots.painted import add_arrows
from musatpy.plots.picture import Picture
from musatpy.plots.sheet import Margins, legend_below, new_sheet
from musatpy.plots.tables import NothingToShowError, Tables, flags, numbers, part, rows_of, texts, worked_out_once
from musatpy.plots.wording import counted, measure, rms
from musatpy.units import MICROMETRE

_SHOWN = 0.1  # of the width of a photo: what most residuals are drawn as
_PANELS, _COLUMNS = 20, 4  # photos, and how many of them side by side
_PANEL, _WIDE = 2.1, 5.5  # inches, of a photo, and of all at least
_BESIDE, _NAME = 0.14, 0.1  # of a format: between photos, and for the name of one
_MARGINS = Margins(above=0.1)
NEEDS = {
    "plates": ("photo", "point", "xy", "sigma", "residual", "triangulated"),
    "stations": ("photo", "camera"),
    "points": ("point", "bathymetric"),
    "cameras": ("camera", "focal_length", "principal_point", "format_size"),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateResiduals:
    """m images with a residual, on n photos."""

    photos: TextArray  # (n,)
    camera: IntArray  # (n,) row of `cameras`
    cameras: TextArray  # (c,)
    corners: FloatArray  # (n, 4, 2) mm of the formats, from the principal point
    photo: IntArray  # (m,) row of `photos`
    xy: FloatArray  # (m, 2) mm from the principal point
    residual: FloatArray  # (m, 2) um
    sigma: FloatArray  # (m, 2) um, a priori
    submerged: BoolArray  # (m,)
    used: BoolArray  # (m,) took part in the solution

    @cached_property
    def rms(self) -> FloatArray:
        """(n,) um, of the coordinates of each photo, NaN of one without residuals."""
        count = np.bincount(self.photo, minlength=len(self.photos))
        squares = np.bincount(self.photo, np.square(self.residual).sum(axis=1), len(self.photos))
        return np.sqrt(squares / np.where(count, 2.0 * count, np.nan))


@worked_out_once
def plate_residuals(tables: Tables) -> PlateResiduals:
    """Return the residuals of plates. Raises `NothingToShowError` where there are none."""
    plates, stations, points = part(tables, "plates"), part(tables, "stations"), part(tables, "points")
    cameras, photos = part(tables, "cameras"), texts(stations, "photo")
    residual = numbers(plates, "residual", 2) / MICROMETRE
    photo = rows_of(photos, texts(plates, "photo"))
    point = rows_of(texts(points, "point"), texts(plates, "point"))
    known = np.isfinite(residual).all(axis=1) & (photo >= 0) & (point >= 0)
    if not known.any():
        raise NothingToShowError("no plate coordinate has a residual")
    corners, _ = frames(tables)
    camera = rows_of(texts(cameras, "camera"), texts(stations, "camera"))
    centre = numbers(cameras, "principal_point", 2)[camera]
    wet = flags(points, "bathymetric")[point]
    return PlateResiduals(
        photos=photos,
        camera=camera,
        cameras=texts(cameras, "camera"),
        corners=corners,
        photo=photo[known],
        xy=(numbers(plates, "xy", 2) - centre[photo])[known],
        residual=residual[known],
        sigma=numbers(plates, "sigma", 2)[known] / MICROMETRE,
        submerged=wet[known],
        used=flags(plates, "triangulated")[known],
    )


def worst_photos(rms_of_photos: FloatArray, number: int) -> IntArray:
    """Return the rows of the photos with the largest root mean squares, in their own order; NaN is none."""
    order = np.argsort(-np.nan_to_num(rms_of_photos, nan=-1.0), kind="stable")[:number]
    return np.sort(order[np.isfinite(rms_of_photos[order])])


def _of_photos(plates: PlateResiduals) -> str:
    every, wet = plates.residual, plates.submerged
    shown, worst = worst_photos(plates.rms, _PANELS), int(np.nanargmax(plates.rms))
    of = "" if len(shown) == len(plates.photos) else f" of the {len(plates.photos):,}, those with the largest"
    parts = [
        f"{name} {measure(rms(every[rows]), 'um')}" for name, rows in (("dry", ~wet), ("wet", wet)) if rows.any()
    ]
    size = np.linalg.norm(every, axis=1)
    return (
        f"Residuals of {counted(len(shown), 'photo')}{of}: root mean square {' and '.join(parts)}; the largest of "
        f"a photo is {measure(plates.rms[worst], 'um')} (photo {plates.photos[worst]}), the longest vector "
        f"{measure(size.max(), 'um')} (photo {plates.photos[plates.photo[size.argmax()]]})."
    )


def _draw_photos(plates: PlateResiduals) -> Any:
    shown = worst_photos(plates.rms, _PANELS)
    columns = min(_COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    low, high = plates.corners[shown].min(axis=(0, 1)), plates.corners[shown].max(axis=(0, 1))
    pitch = (high - low) * [1.0 + _BESIDE, 1.0 + _BESIDE] + [0.0, _NAME * (high - low).max()]
    scale = max(_PANEL, _WIDE / columns) / float(pitch[0])
    inside = np.isin(plates.photo, shown)
    factor = (
        magnification(np.linalg.norm(plates.residual[inside], axis=1), _SHOWN * float((high - low).max())) or 1.0
    )
    title = f"Plate residuals, adjusted minus measured; {enlarged_text(factor)}"
    sheet = new_sheet(([columns * pitch[0] * scale], [rows * pitch[1] * scale]), _MARGINS, title=title, legend=1)
    axes = sheet.panels[0, 0]
    place = np.arange(len(shown))
    middle = np.column_stack([place % columns, -(place // columns)]) * pitch
    _set_axes(axes, middle, pitch, low, high)
    tile = np.full(len(plates.photos), -1)
    tile[shown] = place
    _draw_residuals(axes, plates, np.where(inside, tile[plates.photo], -1), middle, factor)
    axes.add_collection(_frames(plates.corners[shown] + middle[:, None, :]), autolim=False)
    for number, photo in enumerate(shown.tolist()):
        text = f"{plates.photos[photo]}: RMS {measure(plates.rms[photo], 'um')}"
        at = middle[number] + [0.5 * (low[0] + high[0]), high[1] + 0.5 * _BESIDE * (high[1] - low[1])]
        axes.text(*at, text, fontsize=8, ha="center", va="bottom")
    signs = _signs(plates)
    legend_below(sheet.figure, len(signs), signs, [sign.get_label() for sign in signs])
    return sheet.figure


def enlarged_text(factor: float) -> str:
    """Return what arrows of um over axes of mm mean, `factor` mm for 1 um."""
    return f"arrows {1000.0 * factor:,g} times enlarged: 10 mm of the photo are {10.0 / factor:g} um"


def _set_axes(axes: Any, middle: FloatArray, pitch: FloatArray, low: FloatArray, high: FloatArray) -> None:
    """Give axes of tiles about principal points (n, 2) the numbers of plate coordinates, below and at the left."""
    border = 0.5 * _BESIDE * (high - low)
    axes.set_xlim(middle[:, 0].min() + low[0] - border[0], middle[:, 0].max() + low[0] - border[0] + pitch[0])
    axes.set_ylim(middle[:, 1].min() + low[1] - border[1], middle[:, 1].max() + low[1] - border[1] + pitch[1])
    step = round_length(0.45 * float((high - low).min()))
    for axis, setter in ((0, axes.set_xticks), (1, axes.set_yticks)):
        marks = step * np.arange(np.ceil(low[axis] / step), np.floor(high[axis] / step) + 1.0)
        tiles = np.unique(middle[:, axis])
        setter((tiles[:, None] + marks).ravel(), [f"{mark:zg}" for mark in marks] * len(tiles), fontsize=7)
    axes.set_xlabel("x, mm", fontsize=8)
    axes.set_ylabel("y, mm", fontsize=8)
    axes.set_frame_on(False)


def _frames(corners: FloatArray) -> Any:
    """Return formats with corners (n, 4, 2) as lines."""
    from matplotlib.collections import LineCollection

    return LineCollection(list(np.concatenate([corners, corners[:, :1]], axis=1)), colors=LIGHT, linewidths=0.8)


def _draw_residuals(axes: Any, plates: PlateResiduals, tile: IntArray, middle: FloatArray, factor: float) -> None:
    """Draw images and residuals on the tiles (m,) of their photos, -1 of none, about principal points (n, 2).

    An arrow that would leave the tile ends at its border, without a head.
    """
    for wet, used, marker, fill in _KINDS:
        rows = (tile >= 0) & (plates.submerged == wet) & (plates.used == used)
        if not rows.any():
            continue
        shade = WET if wet else DRY
        at, arrow = plates.xy[rows] + middle[tile[rows]], factor * plates.residual[rows]
        corners = plates.corners[plates.photo[rows]]
        share = inside_share(plates.xy[rows], arrow, corners.min(axis=1), corners.max(axis=1))
        axes.plot(*at.T, marker, color=shade, markerfacecolor=shade if fill else "none", markersize=3.5)
        whole = share >= 1.0
        add_arrows(axes, at[whole], arrow[whole], color=shade, width=0.0015)
        ends = at + share[:, None] * arrow
        axes.plot(*np.stack([at[~whole], ends[~whole]], axis=1).transpose(2, 1, 0), "-", color=shade, linewidth=1.0)


def inside_share(xy: FloatArray, arrow: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return which share (m,) of arrows (m, 2) at xy (m, 2) lies on formats low to high (m, 2) or their border."""
    border = 0.5 * _BESIDE * (high - low)
    room = np.where(arrow > 0.0, high + border - xy, xy - low + border)
    with np.errstate(divide="ignore"):
        share = np.maximum(room, 0.0) / np.abs(arrow)
    return np.minimum(share.min(axis=1), 1.0)


_KINDS = ((False, True, ".", True), (True, True, "x", True), (False, False, "o", False), (True, False, "D", False))


def _sign(**style: Any) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], linestyle="none", color=style.pop("color", INK), **style)


def _signs(plates: PlateResiduals) -> list[Any]:
    """Return what the markers mean of which there are some."""
    signs = []
    for wet, used, marker, fill in _KINDS:
        if ((plates.submerged == wet) & (plates.used == used)).any():
            shade, label = WET if wet else DRY, f"{'submerged' if wet else 'dry'}{'' if used else ', kept out'}"
            signs.append(_sign(marker=marker, color=shade, markerfacecolor=shade if fill else "none", label=label))
    return signs


PHOTOS = Picture(
    name="residuals",
    title="Plate residuals of photos",
    needs=NEEDS,
    numbers=plate_residuals,
    figure=_draw_photos,
    words=_of_photos,
)
