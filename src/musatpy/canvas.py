"""A figure of matplotlib, and how it becomes the bytes of a PNG or SVG file, or a page of PDF."""

from __future__ import annotations

import re
from io import BytesIO, StringIO
from typing import Any

from musatpy.errors import MusatError
from musatpy.lettering import renderer_of

_COLOURS = 128
_DPI = 110
_COMPRESSION = 1  # of nine: a third of the time of six, for a tenth more bytes
_FONT = "'DejaVu Sans', Verdana, sans-serif"
_TAG = re.compile(r"<[^>]*>")
_DIGITS = re.compile(r"(\d+\.\d{2})\d+")  # of a tag, beyond a hundredth of a point
# What makes an SVG file half as long and changes no picture: pattern -> what stands for it.
_SHORTER = (
    (re.compile(r" ?font-family: [^;\"]*;?"), ""),  # stated once
    (re.compile(r"\*\{stroke-linejoin"), f"text{{font-family: {_FONT}}} *{{stroke-linejoin"),
    (re.compile(r' transform="rotate\(-0 [^)]*\)"'), ""),
    (re.compile(r"\n\s*"), "\n"),
)


def check_matplotlib() -> Any:
    """Return the class of figures of matplotlib. Raises `MusatError` where that is missing."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MusatError("pictures need matplotlib: pip install 'musatpy[plots]'") from error
    return Figure


def new_figure(width: float, height: float, layout: str = "constrained") -> Any:
    """Return an empty figure of the given size (inches), by default one that lays its panels out by their texts.

    Raises `MusatError` where matplotlib is missing.
    """
    return check_matplotlib()(figsize=(width, height), layout=layout)


def lay_out(figure: Any) -> None:
    """Lay a figure out once for all: while it is saved this would be done, and all be drawn, twice."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)


def png(figure: Any) -> bytes:
    """Return the figure as a PNG file, without date and version: the same figure gives the same bytes."""
    buffer = BytesIO()
    lay_out(figure)
    figure.savefig(buffer, format="png", dpi=_DPI, metadata={"Software": None})
    return buffer.getvalue()


def small_png(figure: Any) -> bytes:
    """Return the figure as `png` does, in colours of a palette: a third as long, and the same to the eye."""
    from PIL import Image  # matplotlib needs it

    lay_out(figure)
    figure.set_dpi(_DPI)
    renderer = renderer_of(figure.bbox.width, figure.bbox.height, _DPI)
    figure.draw(renderer)
    size = int(renderer.width), int(renderer.height)
    image = Image.frombuffer("RGBA", size, renderer.buffer_rgba(), "raw", "RGBA", 0, 1)
    flat = image.convert("RGB").quantize(_COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    buffer = BytesIO()
    flat.save(buffer, format="png", compress_level=_COMPRESSION)
    return buffer.getvalue()


def pdf(figure: Any) -> bytes:
    """Return the figure as a page of PDF, without its date: the same figure gives the same bytes."""
    buffer = BytesIO()
    figure.savefig(buffer, format="pdf", metadata={"CreationDate": None, "Producer": None, "Creator": None})
    return buffer.getvalue()


def svg(figure: Any, salt: str) -> bytes:
    """Return the figure as SVG, its texts as texts; the same figure and salt of its ids give the same bytes."""
    from matplotlib import rc_context

    text = StringIO()
    lay_out(figure)
    with rc_context({"svg.hashsalt": salt, "svg.fonttype": "none"}):
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    short = _TAG.sub(lambda tag: _DIGITS.sub(r"\1", tag[0]), text.getvalue())
    for pattern, other in _SHORTER:
        short = pattern.sub(other, short)
    return short.encode()
