"""The mean residual image: what lens and water leave in every photo at the same place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.plots.enlarged import magnification
from musatpy.plots.mapping import GREY, INK, SHADES
from musatpy.plots.painted import add_arrows
from musatpy.plots.picture import Picture
from musatpy.plots.plate_residuals import NEEDS, PlateResiduals, enlarged_text, plate_residuals
from musatpy.plots.sheet import Margins, bar_beside, legend_below, new_sheet
from musatpy.plots.tables import NothingToShowError, Tables
from musatpy.plots.wording import counted, measure

CELLS = (24, 16)  # of a photo, along x and y
_LIMIT = 2.448  # sigmas of 95 % in two dimensions
_MEDIAN = 0.6745  # of the magnitude of a standard normal variable
_LEAST = 3  # images of a cell whose mean is drawn
_PANEL = 4.4  # inches


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
    column, row = (np.clip((xy - low) / (high - low) * CELLS, 0, np.array(CELLS) - 1).astype(int)).T
    cell, number = row * CELLS[0] + column, CELLS[0] * CELLS[1]
    shape = CELLS[::-1]
    count = np.bincount(cell, minlength=number)
    size = np.where(count > 0, count, np.nan)
    means = [np.bincount(cell, residual[:, i], number) / size for i in (0, 1)]
    unit = float(np.median(np.abs(residual / sigma))) / _MEDIAN
    variance = np.square(unit) * np.bincount(cell, np.square(sigma).mean(axis=1), number)
    return CellMeans(
        what=what,
        corners=corners,
        count=count.reshape(shape),
        mean=np.stack(means, axis=-1).reshape(*shape, 2),
        sigma=(np.sqrt(variance) / size).reshape(shape),
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


def _of_camera(plates: PlateResiduals, camera: int, name: str, wet: bool) -> CellMeans | None:
    of = plates.camera == camera
    rows = of[plates.photo] & (plates.submerged == wet) & plates.used
    if not rows.any():
        return None
    formats = plates.corners[of].reshape(-1, 2)
    what = f"{'submerged' if wet else 'dry'} points" + (f", camera {name}" if len(plates.cameras) > 1 else "")
    corners = np.array([formats.min(axis=0), formats.max(axis=0)])
    return cell_means(plates.xy[rows], plates.residual[rows], plates.sigma[rows], corners, what)


def sentence(means: list[CellMeans]) -> str:
    """Return what the mean residual image says."""
    parts = []
    for part in means:
        length = np.where(part.drawn, np.linalg.norm(part.mean, axis=2), np.nan)
        row, column = np.unravel_index(np.nanargmax(length), length.shape)
        x, y = part.places[row, column]
        cells, beyond = int(part.drawn.sum()), int(part.beyond.sum())
        parts.append(
            f"{part.what}: {counted(int(part.count.sum()), 'image')}, {beyond} of {cells} cells beyond their 95 % "
            f"limit ({measure(0.05 * cells, '')} by chance), the largest mean {measure(length[row, column], 'um')} "
            f"at x {x:.0f}, y {y:.0f} mm"
        )
    return "Mean residuals of " + "; ".join(parts) + "."


def figure(means: list[CellMeans]) -> Any:
    """Return the figure of means. Raises `MusatError` where matplotlib is missing."""
    columns = min(len(means), 2)
    rows = -(-len(means) // columns)
    cell = min(float((np.ptp(part.corners, axis=0) / CELLS).min()) for part in means)
    lengths = np.concatenate([np.linalg.norm(part.mean, axis=2)[part.drawn] for part in means])
    factor = magnification(lengths, 1.2 * cell) or 1.0
    tall = _PANEL * max(float(np.divide(*np.ptp(part.corners, axis=0)[::-1])) for part in means)
    title = f"Mean residuals, adjusted minus measured; {enlarged_text(factor)}"
    sheet = new_sheet(([_PANEL] * columns, [tall] * rows), Margins(right=0.95), title=title, legend=1)
    panels = sheet.panels.ravel()
    most = max(int(part.count.max()) for part in means)
    shade = None
    for axes, part in zip(panels, means, strict=False):
        shade = _draw(axes, part, factor, most)
    for axes in panels[len(means) :]:
        axes.set_axis_off()
    bar_beside(sheet.figure, panels[columns - 1], shade, "images in a cell")
    signs = [_arrow(INK, 1.6, "mean beyond its 95 % limit"), _arrow(GREY, 0.8, "mean within it")]
    legend_below(sheet.figure, 2, signs, [sign.get_label() for sign in signs])
    return sheet.figure


def _arrow(shade: str, width: float, label: str) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=shade, linewidth=width, label=label)


def _draw(axes: Any, part: CellMeans, factor: float, most: int) -> Any:
    """Draw the means of one panel, and return what its shades mean."""
    (west, south), (east, north) = part.corners
    count = np.ma.masked_equal(part.count, 0)
    shade = axes.imshow(
        count, origin="lower", extent=(west, east, south, north), cmap=SHADES, alpha=0.35, vmin=1,
        vmax=max(most, 2), interpolation="nearest",
    )  # fmt: skip
    for rows, color, width in ((part.drawn & ~part.beyond, GREY, 0.0022), (part.beyond, INK, 0.0045)):
        add_arrows(axes, part.places[rows], factor * part.mean[rows], color=color, width=width)
    axes.set_title(f"{counted(int(part.count.sum()), 'image')} of {part.what}", fontsize=9)
    axes.set_xlabel("x, mm")
    axes.set_ylabel("y, mm")
    axes.tick_params(labelsize=8)
    return shade


MEANS = Picture(
    name="mean_residuals",
    title="Mean residuals in the photo",
    needs=NEEDS,
    numbers=mean_residuals,
    figure=figure,
    words=sentence,
)
