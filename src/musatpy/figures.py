"""The style of all pictures: colours, letters, legends; and how a figure of matplotlib becomes a file."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import wraps
from io import BytesIO
from textwrap import wrap
from typing import Any, ParamSpec, TypeVar

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
    "figure.constrained_layout.h_pad": 0.08,  # inches
    "figure.constrained_layout.w_pad": 0.08,
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
_LETTER = 0.092  # inches, of a letter of the title
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


def new_figure(width: float, height: float, title: str = "") -> Any:
    """Return an empty figure (inches) that lays its axes out by their texts, with a title wrapped to its width.

    Raises `MusatError` where matplotlib is missing.
    """
    check_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="compressed")
    set_title(figure, title)
    return figure


def set_title(figure: Any, *paragraphs: str) -> None:
    """Give a figure a title, a line or more to each line of its paragraphs."""
    letters = int(figure.get_figwidth() / _LETTER)
    lines = [line for text in "\n".join(paragraphs).splitlines() for line in wrap(text, letters)]
    if lines:
        figure.suptitle("\n".join(lines))


def shades() -> Any:
    """Return the colours of growing values: alike to every eye, in print too, and dark enough on white."""
    import numpy as np
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["inferno"](np.linspace(0.05, 0.67, 128)), "shades")


def add_legend(figure: Any, columns: int = 4) -> None:
    """Draw one legend below all axes, of what these have names for, each once."""
    named: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    if named:
        figure.legend(list(named.values()), list(named), loc="outside lower center", ncols=min(len(named), columns))


@styled
def image_of(figure: Any, kind: str) -> bytes:
    """Return a figure as a PNG, SVG or PDF file; without dates, so that the same figure gives the same bytes."""
    dates: dict[str, dict[str, None]] = {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": None},
        "pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    }
    buffer = BytesIO()
    if (engine := figure.get_layout_engine()) is not None:
        for spine in (spine for axes in figure.axes for spine in axes.spines.values()):
            spine.set_in_layout(False)  # a tenth of the time, and never farther out than ticks
        engine.execute(figure)
        figure.set_layout_engine(None)  # else it is laid out, and drawn, twice
    figure.savefig(buffer, format=kind, metadata=dates[kind])
    if kind != "svg":
        return buffer.getvalue()
    return _TAG.sub(lambda tag: _DIGITS.sub(rb"\1", tag[0]), buffer.getvalue())
