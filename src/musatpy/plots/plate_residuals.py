"""Residuals of plate coordinates, photo by photo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.canvas import new_figure
from musatpy.plots.enlarged import magnification
from musatpy.plots.footprints import frames
from musatpy.plots.mapping import DRY, INK, LIGHT, WET
from musatpy.plots.picture import Picture
from musatpy.plots.tables import NothingToShowError, Tables, flags, numbers, part, rows_of, texts
from musatpy.plots.wording import counted, measure, rms
from musatpy.units import MICROMETRE

_SHOWN = 0.1  # of the width of a photo: what most residuals are drawn as
_PANELS, _COLUMNS = 20, 4  # photos, and how many of them side by side
_PANEL = 2.4  # inches
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

    @property
    def rms(self) -> FloatArray:
        """(n,) um, of the coordinates of each photo, NaN of one without residuals."""
        count = np.bincount(self.photo, minlength=len(self.photos))
        squares = np.bincount(self.photo, np.square(self.residual).sum(axis=1), len(self.photos))
        return np.sqrt(squares / np.where(count, 2.0 * count, np.nan))


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
    figure = new_figure(max(_PANEL * columns, 5.0) + 0.4, (_PANEL + 0.1) * rows + 0.9)
    size = np.ptp(plates.corners[shown], axis=1).max()
    inside = np.isin(plates.photo, shown)
    factor = magnification(np.linalg.norm(plates.residual[inside], axis=1), _SHOWN * size) or 1.0
    figure.suptitle(f"Plate residuals, adjusted minus measured; {enlarged_text(factor)}", fontsize=10, wrap=True)
    for place, photo in enumerate(shown.tolist(), 1):
        axes = figure.add_subplot(rows, columns, place, aspect="equal")
        _draw_photo(axes, plates, photo, factor)
        edge = place > len(shown) - columns, place % columns == 1 or columns == 1
        axes.set_xlabel("x, mm" if edge[0] else "", fontsize=8)
        axes.set_ylabel("y, mm" if edge[1] else "", fontsize=8)
    signs = _signs(plates)
    figure.legend(handles=signs, loc="outside lower center", ncols=len(signs), fontsize=8)
    return figure


def enlarged_text(factor: float) -> str:
    """Return what arrows of um over axes of mm mean, `factor` mm for 1 um."""
    return f"arrows {1000.0 * factor:,g} times enlarged: 10 mm of the photo are {10.0 / factor:g} um"


def _draw_photo(axes: Any, plates: PlateResiduals, photo: int, factor: float) -> None:
    corners = plates.corners[photo]
    axes.plot(*np.concatenate([corners, corners[:1]]).T, "-", color=LIGHT, linewidth=0.8)
    for wet, used, marker, fill in _KINDS:
        rows = (plates.photo == photo) & (plates.submerged == wet) & (plates.used == used)
        shade = WET if wet else DRY
        axes.plot(
            *plates.xy[rows].T, marker, color=shade, markerfacecolor=shade if fill else "none", markersize=3.5
        )
        axes.quiver(
            *plates.xy[rows].T, *(factor * plates.residual[rows]).T, angles="xy", scale_units="xy", scale=1.0,
            color=shade, width=0.006,
        )  # fmt: skip
    axes.set_title(f"{plates.photos[photo]}: RMS {measure(plates.rms[photo], 'um')}", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.locator_params(nbins=5)
    border = 0.06 * np.ptp(corners, axis=0).max()
    axes.set_xlim(corners[:, 0].min() - border, corners[:, 0].max() + border)
    axes.set_ylim(corners[:, 1].min() - border, corners[:, 1].max() + border)


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
