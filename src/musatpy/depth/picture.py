"""Contours of the depth factor over a stereo model as a picture. Needs matplotlib, the extra `plots`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import DepthError, Problem
from musatpy.files import whole_file

_LONG_SIDE = 6.5  # inches


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

    The format is that of the suffix, PNG, SVG or PDF. Raises `DepthError` without matplotlib or for another suffix.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg", "pdf"):
        raise DepthError([Problem(message=f"a picture is .png, .svg or .pdf, not '{path.suffix}'")])
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        message = "pictures need the package matplotlib: pip install 'musatpy[plots]'"
        raise DepthError([Problem(message=message)]) from error
    width, height = float(np.ptp(x)), float(np.ptp(y))
    long = max(width, height) / _LONG_SIDE
    figure = Figure(figsize=(max(width / long, 2.5) + 2.0, max(height / long, 2.5) + 1.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    shown = np.ma.masked_invalid(factor)
    low, high = np.floor(shown.min() / step), np.ceil(shown.max() / step)
    levels = step * np.arange(low, high + 1)
    filled = axes.contourf(x, y, shown, levels=levels, cmap="viridis_r", alpha=0.35)
    lines = axes.contour(x, y, shown, levels=levels, colors="0.2", linewidths=0.8)
    decimals = max(2, int(np.ceil(-np.log10(step))))
    axes.clabel(lines, fmt=f"%.{decimals}f", fontsize=8)
    axes.plot(stations[:, 0], stations[:, 1], "k^", markersize=7, clip_on=False, label="exposure stations")
    axes.set_aspect("equal")
    axes.set_title(title, fontsize=10)
    axes.set_xlabel(f"x{unit}")
    axes.set_ylabel(f"y{unit}")
    figure.legend(loc="outside lower center", fontsize=8)
    figure.colorbar(filled, ax=axes, label="depth factor F", shrink=0.8)
    with whole_file(path) as file:
        figure.savefig(file, format=kind, dpi=150, bbox_inches="tight")
