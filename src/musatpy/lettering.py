"""Texts of a raster picture, drawn by Pillow: to draw letters takes matplotlib most of the time of a picture."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

_FAMILY = "DejaVu Sans"  # comes with matplotlib: the same letters on every machine
_UPRIGHT, _UP = 0.0, 90.0  # degrees
_KEPT = 4096  # texts


@lru_cache
def _font(family: str, size: float) -> Any:
    """Return a font of Pillow of a size in pixels."""
    from matplotlib.font_manager import findfont
    from PIL import ImageFont

    return ImageFont.truetype(findfont(family), size, layout_engine=ImageFont.Layout.BASIC)


@lru_cache(_KEPT)
def _box(text: str, size: float) -> tuple[float, float, float]:
    """Return advance, height above and depth below the baseline of a text, pixels."""
    font = _font(_FAMILY, size)
    _, top, _, bottom = font.getbbox(text, anchor="ls")
    return float(font.getlength(text)), float(-top), float(max(bottom, 0))


@lru_cache(_KEPT)
def _letters(text: str, size: float) -> tuple[NDArray[np.uint8], int, int]:
    """Return the coverage of the pixels of a text, and where its left and lower borders lie off its beginning."""
    from PIL import Image, ImageDraw

    font = _font(_FAMILY, size)
    left, top, right, bottom = font.getbbox(text, anchor="ls")
    image = Image.new("L", (max(right - left, 1), max(bottom - top, 1)))
    ImageDraw.Draw(image).text((-left, -top), text, fill=255, font=font, anchor="ls")
    return np.array(image), left, bottom


def renderer_of(width: float, height: float, dpi: float) -> Any:
    """Return a renderer of Agg that draws the plain texts of the usual font by Pillow, and all else as it does."""
    from matplotlib.backends.backend_agg import RendererAgg

    base: Any = RendererAgg  # of which other versions of matplotlib tell mypy other things

    class Renderer(base):  # type: ignore[misc]
        def _size(self, s: str, prop: Any, ismath: Any) -> float | None:
            """Return the size in pixels of a text that is drawn here."""
            if ismath or prop.get_name() != _FAMILY or prop.get_weight() not in ("normal", 400):
                return None
            return float(prop.get_size_in_points() * self.dpi / 72.0)

        def get_text_width_height_descent(self, s: str, prop: Any, ismath: Any) -> Any:
            size = self._size(s, prop, ismath)
            if size is None:
                return super().get_text_width_height_descent(s, prop, ismath)
            width, above, below = _box(s, size)
            return width, above + below, below

        def draw_text(
            self,
            gc: Any,
            x: float,
            y: float,
            s: str,
            prop: Any,
            angle: float,
            ismath: Any = False,
            mtext: Any = None,
        ) -> None:
            size = self._size(s, prop, ismath)
            if size is None or angle not in (_UPRIGHT, _UP):
                super().draw_text(gc, x, y, s, prop, angle, ismath, mtext)
                return
            self._put(gc, x, y, s, size, angle == _UP)

        def write(self, s: str, place: tuple[float, float], size: float, share: float, turned: bool) -> None:
            """Write a text of a size in points, `share` of it before a pixel of its baseline counted from below."""
            pixels = size * self.dpi / 72.0
            before = share * _box(s, pixels)[0]
            x, y = (place[0], place[1] - before) if turned else (place[0] - before, place[1])
            self._put(self.new_gc(), x, self.height - y, s, pixels, turned)

        def _put(self, gc: Any, x: float, y: float, s: str, size: float, turned: bool) -> None:
            letters, left, below = _letters(s, size)
            if turned:
                place = round(x) + below - letters.shape[0], round(y) - left
                letters = np.ascontiguousarray(np.rot90(letters))
            else:
                place = round(x) + left, round(y) + below
            self._renderer.draw_text_image(letters, *place, 0.0, gc)

    return Renderer(width, height, dpi)
