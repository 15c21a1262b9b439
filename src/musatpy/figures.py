"""The style of all pictures: colours, letters, margins, legends; and how a figure of matplotlib becomes a file."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import wraps
from io import BytesIO
from typing import Any, ParamSpec, TypeVar

import numpy as np

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.errors import MusatError

# Every colour of a mark has a contrast of three to one on white, and a second sign beside it: a marker, a dash.
INK, GREY, LIGHT = "black", "0.4", "0.55"
DRY, WET, CONTROL, WATER = "#9a6700", "#00457c", "#b3001b", "#2a7fb8"
BLUE, RED = "#1f5a8c", "#b5402a"
BAND = {"color": "0.87", "edgecolor": LIGHT, "linewidth": 0.5}  # of an area between two lines
STYLE: Any = {
    "axes.formatter.limits": (-6, 9),
    "axes.formatter.useoffset": False,
    "axes.labelsize": 9,
    "axes.titlesize": 10,
    "figure.titlesize": 11,
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same letters on every machine
    "font.size": 8,
    "legend.fontsize": 8,
    "legend.markerscale": 1.2,
    "lines.linewidth": 1.0,
    "lines.markersize": 4,
    "grid.alpha": 0.4,
    "image.interpolation": "nearest",
    "savefig.dpi": 110,
    "svg.fonttype": "none",
    "svg.hashsalt": "musatpy",
}
_TAG = re.compile(rb"<[^>]*>")
_DIGITS = re.compile(rb"(\d+\.\d{2})\d+")  # of a tag, beyond a hundredth of a point: rounding errors
# Inches.
LETTER, _LINE, _HEADING = 0.073, 0.2, 0.3  # of a mean letter, a line of a legend, a title of axes
_BESIDE, _BELOW = 0.85, 0.7  # between axes, for their ticks and labels
_BORDER = 0.08  # around all that is drawn
_KEY, _COLUMNS = 0.55, 5  # beside each name of a legend, with its sign

P = ParamSpec("P")
R = TypeVar("R")


def check_matplotlib() -> None:
    """Raise `MusatError` where matplotlib is missing."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise MusatError("pictures need the package matplotlib: pip install 'musatpy[plots]'") from error


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Return a function that draws in the style of all pictures, and raises `MusatError` without matplotlib."""

    @wraps(draw)
    def in_style(*arguments: P.args, **options: P.kwargs) -> R:
        check_matplotlib()
        from matplotlib import rc_context

        with rc_context(STYLE):
            return draw(*arguments, **options)

    return in_style


def new_panels(
    widths: Sequence[float], heights: Sequence[float], title: str = "", beside: float = _BESIDE, **shared: Any
) -> tuple[Any, Any]:
    """Return a figure and its panels (rows, columns), axes with these widths and heights in inches.

    Panels fill the figure, `beside` inches apart: what stands around them, a file has room for as it is written.
    `shared` is that of `Figure.subplots`. Raises `MusatError` where matplotlib is missing.
    """
    check_matplotlib()
    from matplotlib.figure import Figure

    columns, rows = len(widths), len(heights)
    figure = Figure(figsize=(sum(widths) + beside * (columns - 1), sum(heights) + _BELOW * (rows - 1)))
    gaps = {"wspace": beside * columns / sum(widths), "hspace": _BELOW * rows / sum(heights)}
    grid = {"width_ratios": widths, "height_ratios": heights, "left": 0, "right": 1, "bottom": 0, "top": 1, **gaps}
    panels = figure.subplots(rows, columns, squeeze=False, gridspec_kw=grid, **shared)
    figure.suptitle(title)
    return figure, panels


def size_of(axes: Any) -> FloatArray:
    """Return width and height (inches) of axes."""
    return np.array(axes.get_position().size * axes.figure.get_size_inches())


def add_bar(axes: Any, shaded: Any, label: str, **options: Any) -> None:
    """Draw at the right of axes what the shades of a map or of an image in them mean."""
    step = 0.12 / size_of(axes)[0]
    axes.figure.colorbar(shaded, cax=axes.inset_axes([1.0 + step, 0.0, step, 1.0]), label=label, **options)


def write_beside(
    axes: Any, places: FloatArray, names: TextArray, offset: tuple[float, float], **style: Any
) -> None:
    """Write names at places (n, 2) of axes, moved by an offset (points)."""
    for place, name in zip(places.tolist(), names.tolist(), strict=True):
        axes.annotate(name, place, offset, textcoords="offset points", **{"fontsize": 7, **style})


def name_ticks(axes: Any, places: FloatArray | IntArray, names: Sequence[str] | TextArray) -> None:
    """Write names at places along x, turned where they have no room side by side; of many every second or so."""
    width = size_of(axes)[0]
    rows = slice(None, None, int(-(-len(names) * _LINE // width)))
    turned = len(names[rows]) * (max(len(name) for name in names) + 1) * LETTER > width
    axes.set_xticks(places[rows], names[rows], rotation=90 if turned else 0)


def lay_out(figure: Any) -> None:
    """Give a figure its title above all panels, and between them one legend of what its axes name, each once."""
    named: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    width, height = figure.get_size_inches().tolist()
    room = _HEADING * any(axes.get_title() for axes in figure.axes) + 0.5 * _LINE
    if named:
        columns = int(np.clip(width / (_KEY + LETTER * max(map(len, named))), 1, min(len(named), _COLUMNS)))
        place = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0 + room / height), "borderaxespad": 0}
        figure.legend(list(named.values()), list(named), ncols=columns, **place)
        room += _LINE * (0.5 - len(named) // -columns)
    figure.suptitle(figure.get_suptitle(), y=1.0 + room / height, va="bottom")


def shades() -> Any:
    """Return the colours of growing values: alike to every eye, in print too, and dark enough on white."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["inferno"](np.linspace(0.05, 0.67, 128)), "shades")


@styled
def image_of(figure: Any, kind: str) -> bytes:
    """Return a figure as a PNG, SVG or PDF file; without dates, so that the same figure gives the same bytes."""
    dates: dict[str, dict[str, None]] = {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": None},
        "pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    }
    buffer = BytesIO()
    box = figure.get_tightbbox().padded(_BORDER)  # "tight" would draw the figure once more before
    figure.savefig(buffer, format=kind, metadata=dates[kind], bbox_inches=box)
    if kind != "svg":
        return buffer.getvalue()
    return _TAG.sub(lambda tag: _DIGITS.sub(rb"\1", tag[0]), buffer.getvalue())
