"""What adjusted lenses do to their plates: vectors of distortion and affinity, and a map of their sigmas."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.figures import DRY, add_bar, new_panels, shades
from musatpy.model import GRID_PLACES
from musatpy.plots.maps import add_key, magnification, quiver, spacing
from musatpy.plots.picture import NothingToShowError, Picture, measure
from musatpy.records.tables import Tables, numbers, part, texts
from musatpy.units import MICROMETRE

_CAMERAS = 4  # at most, those with the largest distortion
_PANEL, _BORDER = 4.0, 0.17  # inches; of the extent, around the grid and for the key
_SHARE = 0.8  # of the distance of places that nine in ten vectors are drawn as


@dataclass(frozen=True, kw_only=True, eq=False)
class LensGrid:
    """The lens of a camera at g places of a square grid; sigmas NaN where they are not determined."""

    camera: str
    place: FloatArray  # (g, 2) mm from the principal point
    distortion: FloatArray  # (g, 2) um, measured minus ideal
    sigma: FloatArray  # (g,) um, of both components together

    @property
    def length(self) -> FloatArray:
        """(g,) um, of the distortion."""
        return np.linalg.norm(self.distortion, axis=1)


def lens_grids(tables: Tables) -> list[LensGrid]:
    """Return the lenses of a record, no more than four. Raises `NothingToShowError` where none was adjusted."""
    table = part(tables, "distortion_grid")
    camera, sigma = texts(table, "camera"), numbers(table, "sigma", 2) / MICROMETRE
    grids = [
        LensGrid(
            camera=name,
            place=numbers(table, "place", 2)[camera == name],
            distortion=numbers(table, "distortion", 2)[camera == name] / MICROMETRE,
            sigma=np.linalg.norm(sigma[camera == name], axis=1),
        )
        for name in dict.fromkeys(camera.tolist())
    ]
    if not grids:
        raise NothingToShowError("the distortion of no camera was adjusted")
    return sorted(grids, key=lambda grid: -grid.length.max())[:_CAMERAS]


def _words(grids: list[LensGrid]) -> str:
    """Return how far lenses move images, and how sure that is."""
    parts = []
    for grid in grids:
        sigma = np.nanmax(grid.sigma) if np.isfinite(grid.sigma).any() else np.nan
        known = f"with sigmas to {measure(sigma, 'um')}" if np.isfinite(sigma) else "and is not determined"
        parts.append(
            f"the lens of camera {grid.camera} moves images by up to {measure(grid.length.max(), 'um')}, {known}"
        )
    text = "; ".join(parts)
    return f"{text[0].upper()}{text[1:]}."


def _figure(grids: list[LensGrid]) -> Any:
    extent = np.max([np.ptp(grid.place, axis=0) for grid in grids], axis=0)
    room = _BORDER * extent
    size = [_PANEL] * 2, [_PANEL * float((extent + 2.0 * room)[1] / (extent + 2.0 * room)[0])] * len(grids)
    figure, panels = new_panels(*size, "Distortion, measured minus ideal, and its sigma")
    for (left, right), grid in zip(panels, grids, strict=True):
        low, high = grid.place.min(axis=0) - room, grid.place.max(axis=0) + room
        for axes, what in ((left, "distortion"), (right, "sigma")):
            axes.set_title(f"camera {grid.camera}, {what}")
        factor = magnification(grid.length, spacing(high - low, len(grid.place)), _SHARE) or 1.0
        left.plot(*grid.place.T, ".", color=DRY, markersize=3)
        drawn = quiver(left, grid.place, grid.distortion, factor, color=DRY, width=0.005)
        _draw_sigmas(right, grid)
        for axes in (left, right):  # a map sets limits of its own
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x, mm", ylabel="y, mm")
        add_key(left, drawn, factor, "um")
    return figure


def _draw_sigmas(axes: Any, grid: LensGrid) -> None:
    """Draw the sigmas of a lens as a map with numbers; nothing where they are not determined."""
    half = np.ptp(grid.place, axis=0) / (GRID_PLACES - 1) / 2.0
    (west, south), (east, north) = grid.place.min(axis=0) - half, grid.place.max(axis=0) + half
    if not np.isfinite(grid.sigma).any():
        axes.text(0.5, 0.5, "not determined", ha="center", transform=axes.transAxes)
        return
    values = grid.sigma.reshape(GRID_PLACES, GRID_PLACES)
    drawn = axes.imshow(values, origin="lower", extent=(west, east, south, north), cmap=shades(), vmin=0.0)
    for place, value in zip(grid.place.tolist(), grid.sigma.tolist(), strict=True):
        axes.text(*place, f"{value:z.1f}", ha="center", va="center", fontsize=6, color="white")
    add_bar(axes, drawn, "sigma, um")


LENS = Picture("lens", "Distortion of lenses", ("distortion_grid",), lens_grids, _figure, _words)
