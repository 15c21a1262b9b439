"""The style of all pictures: colours, letters, margins, legends; and how a figure of matplotlib becomes a file."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import wraps
from io import BytesIO
from textwrap import wrap
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
    "axes.titley": 1.0,  # else ticks are measured for a place above them
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
_MATH = re.compile(r"\$|\\\w+|[{}^]")  # of a power of ten: what is no letter
_TAG = re.compile(rb"<[^>]*>")
_DIGITS = re.compile(rb"(\d+\.\d{2})\d+")  # of a tag, beyond a hundredth of a point: rounding errors
# Inches. Rooms for texts go by their letters, as these have the same widths everywhere: nothing is measured.
_BORDER, _BESIDE = 0.08, 0.12  # of a figure, and between axes and what stands beside them
LETTER, _LINE = 0.073, 0.16  # of a mean letter and a line of ticks and legends
_TITLE_LETTER, _TITLE_LINE = 0.092, 0.2
_HEADING, _LABEL = 0.25, 0.2  # of a title of axes, and of what their numbers are
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
    widths: Sequence[float], heights: Sequence[float], title: str = "", **shared: Any
) -> tuple[Any, Any]:
    """Return a figure and its panels (rows, columns), axes with these widths and heights in inches.

    The figure is larger, by what `lay_out` gives to texts. `shared` is that of `Figure.subplots`. Raises
    `MusatError` where matplotlib is missing.
    """
    check_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure()
    grid = {"width_ratios": widths, "height_ratios": heights}
    panels = figure.subplots(len(heights), len(widths), squeeze=False, gridspec_kw=grid, **shared)
    figure.suptitle(title)
    _place(figure, np.full((2, len(widths)), _LABEL), np.full((2, len(heights)), _LABEL), 0.0, 0.0)
    return figure, panels


def size_of(axes: Any) -> FloatArray:
    """Return width and height (inches) of axes."""
    return np.array(axes.get_position().size * axes.figure.get_size_inches())


def add_bar(axes: Any, shaded: Any, label: str, **options: Any) -> None:
    """Draw at the right of axes what the shades of a map or of an image in them mean."""
    step = _BESIDE / size_of(axes)[0]
    axes.figure.colorbar(shaded, cax=axes.inset_axes([1.0 + step, 0.0, step, 1.0]), label=label, **options)


def write_beside(
    axes: Any, places: FloatArray, names: TextArray, offset: tuple[float, float], **style: Any
) -> None:
    """Write names at places (n, 2) of axes, moved by an offset (points)."""
    from matplotlib.transforms import offset_copy

    transform = offset_copy(axes.transData, axes.figure, *offset, units="points")
    for (x, y), name in zip(places.tolist(), names.tolist(), strict=True):
        axes.text(x, y, name, transform=transform, **{"fontsize": 7, **style})


def name_ticks(axes: Any, places: FloatArray | IntArray, names: Sequence[str] | TextArray) -> None:
    """Write names at places along x, turned where they have no room side by side; of many every second or so."""
    width = size_of(axes)[0]
    rows = slice(None, None, int(-(-len(names) * _LINE // width)))
    turned = len(names[rows]) * (max(len(name) for name in names) + 1) * LETTER > width
    axes.set_xticks(places[rows], names[rows], rotation=90 if turned else 0)


def lay_out(figure: Any) -> None:
    """Give a figure its legend, below all panels, its title in lines, and the size that panels and texts need."""
    rows, columns = figure.axes[0].get_gridspec().get_geometry()
    beside, around = np.full((2, columns), _BESIDE), np.full((2, rows), _BESIDE)  # left and right, above and below
    for axes in figure.axes:
        row, column = _cell(axes)
        bars = sum(2.0 * _BESIDE + _room(bar.yaxis, "labelright", True) for bar in axes.child_axes)
        turned = any(text.get_rotation() for text in axes.get_xticklabels())
        across = _room(axes.yaxis, "labelleft", True), bars
        along = _HEADING * bool(axes.get_title()), _room(axes.xaxis, "labelbottom", turned)
        beside[:, column] = np.maximum(beside[:, column], across)
        around[:, row] = np.maximum(around[:, row], along)
    width = beside.sum() + sum(figure.axes[0].get_gridspec().get_width_ratios()) + 2.0 * _BORDER
    letters = int(width / _TITLE_LETTER)
    lines = [line for text in figure.get_suptitle().splitlines() for line in wrap(text, letters)]
    _place(figure, beside, around, _TITLE_LINE * len(lines), _add_legend(figure, width))
    if lines:
        figure.suptitle("\n".join(lines), y=1.0 - _BORDER / figure.get_figheight())


def _place(figure: Any, beside: FloatArray, around: FloatArray, top: float, bottom: float) -> None:
    """Size a figure and place its panels, with room (2, columns) beside, (2, rows) around them, and for texts."""
    grid = figure.axes[0].get_gridspec()
    widths, heights = np.array(grid.get_width_ratios()), np.array(grid.get_height_ratios())
    width = beside.sum() + widths.sum() + 2.0 * _BORDER
    height = around.sum() + heights.sum() + 2.0 * _BORDER + top + bottom
    left = _BORDER + np.cumsum(beside[0] + widths + beside[1]) - widths - beside[1]
    low = height - _BORDER - top - np.cumsum(around[0] + heights + around[1]) + around[1]
    figure.set_size_inches(width, height)
    for axes in figure.axes:
        row, column = _cell(axes)
        size = widths[column] / width, heights[row] / height
        axes.set_position([left[column] / width, low[row] / height, *size])


def _cell(axes: Any) -> tuple[int, int]:
    spec = axes.get_subplotspec()
    return spec.rowspan.start, spec.colspan.start


def _room(axis: Any, side: str, along: bool) -> float:
    """Return what ticks and label of an axis need (inches); `along`: across the axis goes the length of a tick."""
    room = _BESIDE + _LABEL * len(axis.get_label_text().splitlines())
    if not axis.get_tick_params().get(side, True):
        return room
    ticks = axis.get_major_formatter().format_ticks(axis.get_majorticklocs())
    if along:
        return room + LETTER * max((len(_MATH.sub("", text)) for text in ticks), default=0)
    return room + _LINE * max((1 + text.count("\n") for text in ticks), default=0)


def _add_legend(figure: Any, width: float) -> float:
    """Draw one legend of what the axes have names for, each once; return its height (inches), 0 of none."""
    named: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    if not named:
        return 0.0
    letters = np.array([len(name) for name in named])
    for columns in range(min(len(named), _COLUMNS), 0, -1):
        parts = np.array_split(letters, columns)
        if sum(_KEY + LETTER * part.max() for part in parts) < width:
            break
    figure.legend(list(named.values()), list(named), ncols=columns, loc="lower center")
    return _BESIDE + _LINE * len(parts[0])


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
    figure.savefig(buffer, format=kind, metadata=dates[kind])
    if kind != "svg":
        return buffer.getvalue()
    return _TAG.sub(lambda tag: _DIGITS.sub(rb"\1", tag[0]), buffer.getvalue())
