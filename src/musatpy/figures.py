"""The style of all pictures: colours, letters, margins, legends; and how a figure of matplotlib becomes a file."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from io import BytesIO
from typing import Any, ParamSpec, TypeVar

import numpy as np

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.extras import package

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
    "axes.titley": 1.0,  # no ticks above them to be looked for
    "figure.titlesize": 11,
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same letters on every machine
    "font.size": 8,
    "legend.fontsize": 8,
    "legend.markerscale": 1.2,
    "lines.linewidth": 1.0,
    "lines.markersize": 4,
    "grid.alpha": 0.4,
    "image.interpolation": "nearest",
    "svg.fonttype": "none",
    "svg.hashsalt": "musatpy",
}
_TAG = re.compile(rb"<[^>]*>")
_DIGITS = re.compile(rb"(\d+\.\d{2})\d+")  # of a tag, beyond a hundredth of a point: rounding errors
# Inches.
LETTER, _LINE, _HEADING = 0.073, 0.2, 0.3  # of a mean letter, a line of a legend, a title of axes
_TITLE, _CAPITAL = 0.22, 0.11  # of a line of the title of all, and a letter of it
_BESIDE, _BELOW = 0.85, 0.7  # between axes, for their ticks and labels
_LEFT, _RIGHT, _FOOT, _BAR = 0.8, 0.25, 0.6, 0.75  # around all axes, for the same; more at the right where bars are
_KEY, _COLUMNS = 0.55, 5  # beside each name of a legend, with its sign
_WIDEST = 6  # letters of names of ticks that have room beside axes without more

P = ParamSpec("P")
R = TypeVar("R")


def check_matplotlib() -> None:
    """Raise `MissingPackageError` where matplotlib is missing."""
    package("plots", "matplotlib.figure", "pictures need")


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
    widths: Sequence[float],
    heights: Sequence[float],
    title: str = "",
    beside: float = _BESIDE,
    below: float = _BELOW,
    **shared: Any,
) -> tuple[Any, Any]:
    """Return a figure and its panels (rows, columns), axes with these widths and heights in inches.

    They stand `beside` and `below` inches apart, with room around them for ticks and labels. `shared` is that of
    `Figure.subplots`. Raises `MusatError` where matplotlib is missing.
    """
    check_matplotlib()
    from matplotlib.figure import Figure

    columns, rows = len(widths), len(heights)
    figure = Figure(figsize=(sum(widths) + beside * (columns - 1), sum(heights) + below * (rows - 1)))
    grid = {"width_ratios": widths, "height_ratios": heights}
    panels = figure.subplots(rows, columns, squeeze=False, gridspec_kw=grid, **shared)
    gaps = {"wspace": beside * columns / sum(widths), "hspace": below * rows / sum(heights)}
    figure.subplots_adjust(left=0.0, right=1.0, bottom=0.0, top=1.0, **gaps)
    add_room(figure, left=_LEFT, right=_RIGHT, below=_FOOT)
    figure.suptitle(title)
    return figure, panels


def add_room(figure: Any, *, left: float = 0.0, right: float = 0.0, below: float = 0.0, above: float = 0.0) -> None:
    """Add inches at the sides of a figure, whose panels keep their sizes."""
    at, (width, height) = figure.subplotpars, figure.get_size_inches().tolist()
    ends = (at.left * width + left, at.right * width + left, at.bottom * height + below, at.top * height + below)
    width, height = width + left + right, height + below + above
    figure.set_size_inches(width, height)
    figure.subplots_adjust(
        left=ends[0] / width, right=ends[1] / width, bottom=ends[2] / height, top=ends[3] / height
    )


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
    width, longest = size_of(axes)[0], max(len(name) for name in names)
    rows = slice(None, None, int(-(-len(names) * _LINE // width)))
    turned = len(names[rows]) * (longest + 1) * LETTER > width
    axes.set_xticks(places[rows], names[rows], rotation=90 if turned else 0)
    if turned:
        add_room(axes.figure, below=LETTER * longest)


def name_rows(axes: Any, names: Sequence[str] | TextArray) -> None:
    """Write names of rows at the left of all axes."""
    axes.set_yticks(range(len(names)), names)
    add_room(axes.figure, left=LETTER * max(max(len(name) for name in names) - _WIDEST, 0))


def lay_out(figure: Any) -> None:
    """Give a figure its title above all panels, and between them one legend of what its axes name, each once.

    The legend stands in axes of its own.
    """
    named: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    (width, height), at = figure.get_size_inches().tolist(), figure.subplotpars
    wide = width * (at.right - at.left)
    columns = int(np.clip(wide / (_KEY + LETTER * max(map(len, named), default=0)), 1, _COLUMNS))
    strip = _LINE * (0.5 - len(named) // -columns) if named else 0.0
    below = height + 0.5 * _LINE + _HEADING * any(axes.get_title() for axes in figure.axes)
    bar = _BAR * any(axes.child_axes and axes.get_position(True).x1 > 0.999 * at.right for axes in figure.axes)
    lines = [textwrap.fill(line, int((width + bar) / _CAPITAL)) for line in figure.get_suptitle().splitlines()]
    title = "\n".join(lines)
    whole = below + strip + _LINE + _TITLE * len(title.splitlines())
    add_room(figure, right=bar, above=whole - height)
    figure.suptitle(title, y=(below + strip + 0.5 * _LINE) / whole, va="bottom")
    if named:
        strip_axes = figure.add_axes([at.left, below / whole, at.right - at.left, strip / whole], label="legend")
        strip_axes.set_axis_off()
        place = {"ncols": columns, "loc": "center", "borderaxespad": 0.0}
        strip_axes.legend(list(named.values()), list(named), **place)


def shades() -> Any:
    """Return the colours of growing values: alike to every eye, in print too, and dark enough on white."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["inferno"](np.linspace(0.05, 0.67, 128)), "shades")


@dataclass(frozen=True)
class ImageForm:
    """Kind of the files of pictures, each picture's own where it is empty, and the dots per inch of a PNG."""

    kind: str = ""
    dpi: int = 110


FORM = ImageForm()


@styled
def image_of(figure: Any, form: ImageForm = FORM, kind: str = "png") -> tuple[str, bytes]:
    """Return the suffix and the bytes of a figure as a PNG, SVG or PDF file; of a `kind` where the form has none.

    They are without dates: the same figure gives the same bytes.
    """
    dates: dict[str, dict[str, None]] = {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": None},
        "pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    }
    kind, buffer = form.kind or kind, BytesIO()
    figure.savefig(buffer, format=kind, metadata=dates[kind], dpi=form.dpi)
    if kind != "svg":
        return kind, buffer.getvalue()
    return kind, _TAG.sub(lambda tag: _DIGITS.sub(rb"\1", tag[0]), buffer.getvalue())


def file_of(figure: Any, form: ImageForm = FORM) -> tuple[str, bytes]:
    """Lay a figure out, and return its suffix and bytes as `image_of` does."""
    lay_out(figure)
    return image_of(figure, form)
