"""Contours of the depth factor over a stereo model as a picture. Needs matplotlib, the extra `plots`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import DepthError, Problem
from musatpy.figures import INK, add_bar, image_of, lay_out, new_panels, styled
from musatpy.files import write_files

_LONG, _LEAST = 6.5, 4.0  # inches, of the sides of the map
_BORDER = 0.05  # of the extent, around it
_FILES = ("png", "svg", "pdf")


@styled
def contour_picture(
    path: Path,
    x: FloatArray,
    y: FloatArray,
    factor: FloatArray,
    stations: FloatArray,
    *,
    title: str,
    step: float,
    unit: str = "",
) -> None:
    """Write contours of factors (ny, nx) at x (nx,), y (ny,), and stations (k, 2), as Groeneveld Meijer's Figure 4.

    The format is that of the suffix, PNG, SVG or PDF; stations far from the contours are not drawn. Raises
    `MusatError` without matplotlib, and `DepthError` for another suffix.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in _FILES:
        raise DepthError([Problem(message=f"a picture is .png, .svg or .pdf, not '{path.suffix}'")])
    sides = np.array([np.ptp(x), np.ptp(y)])
    low, high = np.array([x.min(), y.min()]) - _BORDER * sides, np.array([x.max(), y.max()]) + _BORDER * sides
    size = np.maximum(_LONG * sides / sides.max(), _LEAST)
    figure, ((axes,),) = new_panels(size[:1], size[1:], title)
    shown = np.ma.masked_invalid(factor)
    levels = step * np.arange(np.floor(shown.min() / step), np.ceil(shown.max() / step) + 1)
    filled = axes.contourf(x, y, shown, levels=levels, cmap="viridis_r", alpha=0.35)
    lines = axes.contour(x, y, shown, levels=levels, colors="0.2", linewidths=0.8)
    axes.clabel(lines, fmt=f"%.{max(2, int(np.ceil(-np.log10(step))))}f")
    near = stations[((stations >= low) & (stations <= high)).all(axis=1)]
    if len(near):
        axes.plot(*near.T, "^", color=INK, markersize=7, label="exposure stations")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel=f"x{unit}", ylabel=f"y{unit}")
    add_bar(axes, filled, "depth factor F")
    lay_out(figure)
    write_files({path: image_of(figure, kind)})
