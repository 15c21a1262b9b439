"""Residuals: of plates, by photos and at the same place of all; of all kinds beside the normal distribution."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from statistics import NormalDist
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray, rms, rows_of
from musatpy.figures import DRY, GREY, INK, LIGHT, WET, new_panels
from musatpy.plots.maps import NORMAL, add_key, draw_rings, magnification, quiver, spacing, without_paths
from musatpy.plots.picture import NothingToShowError, Picture, counted, measure
from musatpy.plots.plane import frames
from musatpy.records.tables import Tables, flags, numbers, part, texts
from musatpy.units import MICROMETRE

CELLS = (24, 16)  # of a photo, along x and y
_LIMIT = 2.448  # sigmas of 95 % in two dimensions
_MEDIAN = 0.6745  # of the magnitude of a standard normal variable
_CIRCLE = 140.0  # points squared, of the cell with most images
_LEAST = 3  # images of a cell whose mean is drawn
_MEAN_SHARE = 0.6  # of the distance of cells, which are neighbours in rows: what nine in ten means are drawn as
_SHORT = 8  # letters of a name that stands before its RMS in one line
_PHOTOS, _COLUMNS = 20, 4  # photos at most, and how many of them side by side
_PANEL, _WIDE, _MEANS = 3.2, 10.0, 4.5  # inches, of a photo at most, of all photos, and of the means of a camera
_BORDER, _KEY = 0.04, 0.14  # of a format, around it, and for the key below
_KINDS = ((False, True, ".", DRY), (True, True, "x", WET), (False, False, "o", "none"), (True, False, "D", "none"))
NEEDS = ("plates", "stations", "points", "cameras")


@dataclass(frozen=True, kw_only=True, eq=False)
class ImageResiduals:
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


def plate_residuals(tables: Tables) -> ImageResiduals:
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
    return ImageResiduals(
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


def _of_photos(plates: ImageResiduals) -> str:
    every, wet = plates.residual, plates.submerged
    shown, worst = worst_photos(plates.rms, _PHOTOS), int(np.nanargmax(plates.rms))
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


def _draw_photos(plates: ImageResiduals) -> Any:
    shown = worst_photos(plates.rms, _PHOTOS)
    columns = min(_COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    corners = plates.corners[shown]
    extent = np.ptp(corners, axis=(0, 1))
    length = np.linalg.norm(plates.residual[np.isin(plates.photo, shown)], axis=1)
    factor = magnification(length, spacing(extent, len(length) // len(shown))) or 1.0
    width = min(_PANEL, _WIDE / columns)
    size = [width] * columns, [width * _slope(extent)] * rows
    figure, panels = new_panels(*size, "Plate residuals, adjusted minus measured", beside=0.3, below=0.45)
    names = without_paths(plates.photos)
    for axes, photo in zip(panels.ravel(), shown.tolist(), strict=False):
        _set_format(axes, corners)
        draw_rings(axes, plates.corners[photo][None])
        gap = " " if len(names[photo]) <= _SHORT else "\n"
        axes.set_title(f"{names[photo]}:{gap}RMS {measure(plates.rms[photo], 'um')}")
        _draw_images(axes, plates, plates.photo == photo, factor)
    for axes in panels.ravel()[len(shown) :]:
        axes.remove()
    return figure


def _draw_images(axes: Any, plates: ImageResiduals, of_photo: BoolArray, factor: float) -> None:
    """Draw the images of a photo and their residuals, with a key."""
    for wet, used, marker, fill in _KINDS:
        rows = of_photo & (plates.submerged == wet) & (plates.used == used)
        if rows.any():
            style = {"color": WET if wet else DRY, "markerfacecolor": fill}
            label = f"{'submerged' if wet else 'dry'}{'' if used else ', kept out'}"
            axes.plot(*plates.xy[rows].T, marker, label=label, **style)
            drawn = quiver(axes, plates.xy[rows], plates.residual[rows], factor, color=style["color"], width=0.006)
    if of_photo.any():
        add_key(axes, drawn, factor, "um")


def _slope(extent: FloatArray) -> float:
    """Return height over width of the axes of formats of an extent (2,), as `_set_format` bounds them."""
    return float(extent[1] / extent[0] * (1.0 + 2.0 * _BORDER + _KEY) / (1.0 + 2.0 * _BORDER))


def _set_format(axes: Any, corners: FloatArray) -> None:
    """Give axes the bounds of formats with corners (n, 4, 2), with room for a key."""
    (west, south), (east, north) = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    x, y = _BORDER * (east - west), _BORDER * (north - south)
    axes.set(xlim=(west - x, east + x), ylim=(south - y - _KEY * (north - south), north + y), aspect="equal")
    axes.set(xlabel="x, mm", ylabel="y, mm")
    axes.locator_params(nbins=4)
    axes.label_outer()


@dataclass(frozen=True, kw_only=True, eq=False)
class CellMeans:
    """Means of residuals in the cells of a format, rows from the least y, columns from the least x."""

    what: str
    corners: FloatArray  # (2, 2) mm, least and greatest x, y
    count: IntArray  # (16, 24)
    mean: FloatArray  # (16, 24, 2) um; NaN where there is no image
    sigma: FloatArray  # (16, 24) um, of a component of the mean by chance

    @property
    def drawn(self) -> Any:
        """(16, 24) cells with images enough."""
        return self.count >= _LEAST

    @property
    def beyond(self) -> Any:
        """(16, 24) of these, whose mean is longer than chance explains in 95 of 100."""
        return self.drawn & (np.linalg.norm(self.mean, axis=2) > _LIMIT * self.sigma)

    @property
    def places(self) -> FloatArray:
        """(16, 24, 2) mm, the middles of cells."""
        low, high = self.corners
        step = (high - low) / CELLS
        x, y = (low[i] + step[i] * (np.arange(CELLS[i]) + 0.5) for i in (0, 1))
        return np.stack(np.meshgrid(x, y), axis=-1)


def cell_means(
    xy: FloatArray, residual: FloatArray, sigma: FloatArray, corners: FloatArray, what: str
) -> CellMeans:
    """Return the means of residuals (m, 2) um with sigmas (m, 2) um at xy (m, 2) mm in the cells of a format.

    What lies beyond the format counts in the cells at its border. Residuals are smaller than errors: sigmas of
    means are those given, times the median of residuals over their sigmas, over that of a normal distribution.
    """
    low, high = corners
    edges = [np.linspace(low[i], high[i], CELLS[i] + 1) for i in (1, 0)]
    x, y = np.clip(xy, low, high).T

    def sums(values: FloatArray | None = None) -> FloatArray:
        return np.histogram2d(y, x, edges, weights=values)[0]

    count = sums()
    size = np.where(count > 0, count, np.nan)
    unit = float(np.median(np.abs(residual / sigma))) / _MEDIAN
    return CellMeans(
        what=what,
        corners=corners,
        count=count.astype(int),
        mean=np.stack([sums(residual[:, i]) / size for i in (0, 1)], axis=-1),
        sigma=unit * np.sqrt(sums(np.square(sigma).mean(axis=1))) / size,
    )


def mean_residuals(tables: Tables) -> list[CellMeans]:
    """Return the means of each camera, on land and through the water apart, of images that took part.

    Raises `NothingToShowError` where fewer than two photos have residuals.
    """
    plates = plate_residuals(tables)
    if len(np.unique(plates.photo)) < 2:
        raise NothingToShowError("means over photos need two photos with residuals")
    means = [
        found
        for camera, name in enumerate(plates.cameras.tolist())
        for wet in (False, True)
        if (found := _of_camera(plates, camera, name, wet)) is not None and found.drawn.any()
    ]
    if not means:
        raise NothingToShowError("no cell of the format has three images")
    return means


def _of_camera(plates: ImageResiduals, camera: int, name: str, wet: bool) -> CellMeans | None:
    of = plates.camera == camera
    rows = of[plates.photo] & (plates.submerged == wet) & plates.used
    if not rows.any():
        return None
    formats = plates.corners[of].reshape(-1, 2)
    what = f"{'submerged' if wet else 'dry'} points" + (f", camera {name}" if len(plates.cameras) > 1 else "")
    corners = np.array([formats.min(axis=0), formats.max(axis=0)])
    return cell_means(plates.xy[rows], plates.residual[rows], plates.sigma[rows], corners, what)


def _of_cells(means: list[CellMeans]) -> str:
    """Return what the mean residual image says."""
    parts = []
    for cells in means:
        length = np.where(cells.drawn, np.linalg.norm(cells.mean, axis=2), np.nan)
        row, column = np.unravel_index(np.nanargmax(length), length.shape)
        x, y = cells.places[row, column]
        number, beyond = int(cells.drawn.sum()), int(cells.beyond.sum())
        parts.append(
            f"{cells.what}: {counted(int(cells.count.sum()), 'image')}, {beyond} of {number} cells beyond their "
            f"95 % limit ({measure(0.05 * number, '')} by chance), the largest mean "
            f"{measure(length[row, column], 'um')} at x {x:z.0f}, y {y:z.0f} mm"
        )
    return "Mean residuals of " + "; ".join(parts) + "."


def _draw_means(means: list[CellMeans]) -> Any:
    columns = min(len(means), 2)
    rows = -(-len(means) // columns)
    extent = np.max([np.ptp(cells.corners, axis=0) for cells in means], axis=0)
    lengths = np.concatenate([np.linalg.norm(cells.mean, axis=2)[cells.drawn] for cells in means])
    apart = spacing(extent, max(int(cells.drawn.sum()) for cells in means))
    factor = magnification(lengths, apart, _MEAN_SHARE) or 1.0
    size = [_MEANS] * columns, [_MEANS * _slope(extent)] * rows
    figure, panels = new_panels(*size, "Mean residuals, adjusted minus measured")
    most = max(int(cells.count.max()) for cells in means)
    for axes, cells in zip(panels.ravel(), means, strict=False):
        _draw_cells(axes, cells, factor, most)
    for axes in panels.ravel()[len(means) :]:
        axes.remove()
    return figure


def _draw_cells(axes: Any, cells: CellMeans, factor: float, most: int) -> None:
    """Draw the means of one panel, over circles as large as the numbers of their images."""
    _set_format(axes, cells.corners[None])
    axes.set_title(f"{counted(int(cells.count.sum()), 'image')} of {cells.what}")
    known = cells.count > 0
    style = {"facecolors": "none", "edgecolors": LIGHT, "linewidths": 0.5}
    label = f"images of a cell, by area: {most:,} at most"
    axes.scatter(*cells.places[known].T, s=_CIRCLE * cells.count[known] / most, label=label, **style)
    for rows, color, width, label in (
        (cells.drawn & ~cells.beyond, GREY, 0.003, "mean within its 95 % limit"),
        (cells.beyond, INK, 0.006, "mean beyond its 95 % limit"),
    ):
        if rows.any():
            drawn = quiver(axes, cells.places[rows], cells.mean[rows], factor, color=color, width=width)
            axes.plot([], [], "->", color=color, linewidth=300.0 * width, label=label)
    add_key(axes, drawn, factor, "um")


PHOTOS = Picture("residuals", "Plate residuals of photos", NEEDS, plate_residuals, _draw_photos, _of_photos)
MEANS = Picture("mean_residuals", "Mean residuals in the photo", NEEDS, mean_residuals, _draw_means, _of_cells)


# --- normalised residuals ---


LEAST_RESIDUALS = 3  # of a kind
_SPAN = 4.5  # sigmas of a histogram; what is beyond counts in its last bars
_BARS = (9, 36)  # least and most
_FAR = 3.29  # 99.9 %
_WIDTH, _HEIGHT = 3.5, 1.7  # inches, of a panel


@dataclass(frozen=True, kw_only=True, eq=False)
class Residuals:
    """The normalised residuals (n,) of a kind of observations, growing."""

    kind: str
    values: FloatArray


def residuals_by_kind(tables: Tables) -> list[Residuals]:
    """Return the residuals of each kind that has some. Raises `NothingToShowError` where none has."""
    observed = part(tables, "observations")
    kind, value = texts(observed, "kind"), numbers(observed, "standardised")
    known = np.isfinite(value)
    data = []
    for name in dict.fromkeys(kind.tolist()):
        values = value[known & (kind == name)]
        if len(values) >= LEAST_RESIDUALS:
            data.append(Residuals(kind=str(name).replace("_", " "), values=np.sort(values)))
    if not data:
        raise NothingToShowError("no kind of observation has three checked residuals")
    return data


def normalised_sentence(data: list[Residuals]) -> str:
    """Return what the histograms say."""
    parts = [
        f"{of_kind.kind}: {counted(len(of_kind.values), 'residual')}, root mean square {rms(of_kind.values):.2f}, "
        f"{np.mean(np.abs(of_kind.values) > NORMAL):.1%} beyond {NORMAL:g} (5 % expected), "
        f"largest {np.abs(of_kind.values).max():.2f}"
        for of_kind in data
    ]
    return "Residuals over their own sigmas; " + "; ".join(parts) + "."


def normalised_figure(data: list[Residuals]) -> Any:
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
    axes.set(ylabel="residuals", title=f"{of_kind.kind}: {len(of_kind.values):,}, RMS {rms(of_kind.values):.2f}")
    axes.locator_params(axis="y", nbins=4, integer=True)


def _draw_quantiles(axes: Any, of_kind: Residuals) -> None:
    normal, number = NormalDist(), len(of_kind.values)  # scipy's would have to be loaded, for this alone
    expected = list(map(normal.inv_cdf, ((np.arange(number) + 0.5) / number).tolist()))
    ends = [expected[0] - 0.3, expected[-1] + 0.3]
    axes.plot(ends, ends, "-", color=WET, linewidth=1.4)
    axes.plot(expected, of_kind.values, ".", color=INK, label="quantiles")
    for limit in (-_FAR, _FAR):
        axes.axhline(limit, color=DRY, linestyle="--")
    axes.set_ylabel("residual over sigma")
    axes.locator_params(nbins=6)


NORMALISED = Picture(
    "normalised",
    "Normalised residuals",
    ("observations",),
    residuals_by_kind,
    normalised_figure,
    normalised_sentence,
)
