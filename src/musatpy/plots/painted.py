"""Artists of matplotlib that draw many signs of a picture in one stroke: each alone would take as long as all."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, TextArray

_HEAD = (5.0, 4.5, 1.5)  # of an arrow, in widths of its shaft: length, where it meets the shaft, half its width
_ASCENT, _DESCENT, _MIDDLE = 0.76, 0.24, 0.365  # of the size of letters: above, below and in the middle of a line
_GROUND, _BORDER = 0.7, 0.4  # opacity of the ground of names, and how far it reaches beyond them, points
_WRITTEN = {"left": 0.0, "center": 0.5, "right": 1.0}


def painted(paint: Callable[[Any], None], zorder: float, marks: int = 1) -> Any:
    """Return an artist that draws by a function of the renderer, so many marks."""
    return _painted_class()(paint, zorder, marks)


class OwnSet:
    """The method `set` of artists: one that is written is not written anew by matplotlib, with a manual of it."""

    def set(self, **properties: Any) -> Any:
        return super().set(**properties)  # type: ignore[misc]


@cache
def _painted_class() -> Any:
    from matplotlib.artist import Artist

    class Painted(OwnSet, Artist):
        def __init__(self, paint: Callable[[Any], None], zorder: float, marks: int) -> None:
            super().__init__()
            self._paint, self.marks = paint, marks
            self.set_zorder(zorder)

        def draw(self, renderer: Any) -> None:
            self._paint(renderer)

    return Painted


def polygons(
    renderer: Any, corners: FloatArray, *, box: Any = None, fill: Any = None, line: Any = None, width: float = 0.0
) -> None:
    """Draw polygons (n, k, 2) of pixels in one stroke, or their outlines, inside a box."""
    from matplotlib.colors import to_rgba
    from matplotlib.path import Path
    from matplotlib.transforms import IdentityTransform

    if not len(corners):
        return
    n, k = corners.shape[:2]
    codes = np.full((n, k + 1), Path.LINETO, dtype=Path.code_type)
    codes[:, 0], codes[:, -1] = Path.MOVETO, Path.CLOSEPOLY
    vertices = np.concatenate([corners, corners[:, :1]], axis=1).reshape(-1, 2)
    _stroke(renderer, Path(vertices, codes.ravel()), IdentityTransform(), box, line, width, fill and to_rgba(*fill))


def lines(
    renderer: Any, starts: FloatArray, ends: FloatArray, *, box: Any = None, color: Any = "black",
    alpha: float | None = None, linewidth: float = 0.8,
) -> None:  # fmt: skip
    """Draw lines between pixels (n, 2) in one stroke, width in points."""
    from matplotlib.path import Path
    from matplotlib.transforms import IdentityTransform

    if len(starts):
        vertices = np.stack([starts, ends], axis=1).reshape(-1, 2)
        path = Path(vertices, np.tile(np.array([Path.MOVETO, Path.LINETO], dtype=Path.code_type), len(starts)))
        _stroke(renderer, path, IdentityTransform(), box, (color, alpha), linewidth, None)


def _stroke(renderer: Any, path: Any, transform: Any, box: Any, line: Any, width: float, fill: Any) -> None:
    from matplotlib.colors import to_rgba

    gc = renderer.new_gc()
    if box is not None:
        gc.set_clip_rectangle(box)
    gc.set_linewidth(width if line else 0.0)
    if line:
        gc.set_foreground(to_rgba(*line), isRGBA=True)
    gc.set_snap(fill is None)
    renderer.draw_path(gc, path, transform, fill)
    gc.restore()


def write(
    renderer: Any, figure: Any, text: str, place: tuple[float, float], size: float, across: str = "center",
    up: str = "center", turned: bool = False,
) -> None:  # fmt: skip
    """Write a text of a size in points at a pixel.

    `across` says where along the text the place is, `up` across it: `top`, `center`, `bottom`; `turned` it runs up.
    """
    from matplotlib.text import Text
    from matplotlib.transforms import IdentityTransform

    angle = 90.0 if turned else 0.0
    em = renderer.points_to_pixels(size)
    below = {"top": -_ASCENT, "center": -_MIDDLE, "bottom": _DESCENT, "baseline": 0.0}[up] * em
    x, y = place
    x, y = (x - below, y) if turned else (x, y + below)
    if (plain := getattr(renderer, "write", None)) is not None:
        plain(text, (x, y), size, _WRITTEN[across], turned)
        return
    artist = Text(x, y, text, fontsize=size, rotation=angle, ha=across, va="baseline", rotation_mode="anchor")
    artist.set_figure(figure)
    artist.set_transform(IdentityTransform())
    artist.draw(renderer)


def add_arrows(axes: Any, places: FloatArray, vectors: FloatArray, *, color: str, width: float) -> None:
    """Draw vectors (n, 2) from places (n, 2), both of the axes; `width` of the shaft in widths of these."""

    def paint(renderer: Any) -> None:
        box = axes.bbox
        corners = arrow_corners(
            axes.transData.transform(places), axes.transData.transform(places + vectors), width * box.width
        )
        polygons(renderer, corners, box=box, fill=(color,))

    if len(places):
        axes.add_artist(painted(paint, 3.0, len(places)))


def arrow_corners(starts: FloatArray, ends: FloatArray, width: float) -> FloatArray:
    """Return the corners (n, 7, 2) of arrows from pixels to pixels (n, 2), their shafts so wide.

    The head of a short one is as long as all of it.
    """
    along = ends - starts
    length = np.linalg.norm(along, axis=1, keepdims=True)
    unit = along / np.where(length > 0.0, length, 1.0)
    aside = np.column_stack([-unit[:, 1], unit[:, 0]])
    head, neck, wide = (part * width * np.minimum(length / (_HEAD[0] * width), 1.0) for part in _HEAD)
    half = 0.5 * width * np.minimum(length / (_HEAD[0] * width), 1.0)
    sides = [(starts, half), (ends - neck * unit, half), (ends - head * unit, wide)]
    left = [at + reach * aside for at, reach in sides]
    right = [at - reach * aside for at, reach in reversed(sides)]
    return np.stack([*left, ends, *right], axis=1)


def add_names(
    axes: Any, places: FloatArray, names: TextArray, *, size: float = 7.0, offset: tuple[float, float] = (5.0, 5.0)
) -> None:
    """Write names beside places (n, 2) on a light ground, size and offset in points; only those on the axes."""

    def paint(renderer: Any) -> None:
        box, point = axes.bbox, renderer.points_to_pixels(1.0)
        pixels = axes.transData.transform(places)
        seen = (pixels >= box.min).all(axis=1) & (pixels <= box.max).all(axis=1)
        at, shown = pixels[seen] + point * np.array(offset), names[seen].tolist()
        font = font_of(size)
        width = [renderer.get_text_width_height_descent(name, font, False)[0] for name in shown]
        low = at - point * np.array([_BORDER, _BORDER + _DESCENT * size])
        high = at + np.column_stack([width, np.full(len(at), point * _ASCENT * size)]) + point * _BORDER
        ground = np.stack(
            [low, np.column_stack([high[:, 0], low[:, 1]]), high, np.column_stack([low[:, 0], high[:, 1]])], 1
        )
        polygons(renderer, ground, box=box, fill=("white", _GROUND))
        for name, place in zip(shown, at.tolist(), strict=True):
            write(renderer, axes.get_figure(), name, place, size, "left", "baseline")

    if len(places):
        axes.add_artist(painted(paint, 4.0))


@cache
def font_of(size: float) -> Any:
    from matplotlib.font_manager import FontProperties

    return FontProperties(size=size)
