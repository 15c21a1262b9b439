"""Contours of a grid of posts: straight from edge to edge of its cells, with the greater values on their right."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import MusatError
from musatpy.surfaces.contours import Contours, gathered


def grid_contours(
    values: FloatArray,
    west_south: tuple[float, float],
    spacing: float,
    levels: Sequence[float],
    index: Sequence[float] = (),
    shortest: float = 0.0,
) -> Contours:
    """Return the contours of posts (rows, columns) from south and west on, m; NaN where there is no surface.

    A cell without one post is cut along its diagonal, one without more has no contour. Open pieces shorter than a
    limit (m) are left out. Raises `MusatError` where contourpy is missing.
    """
    origin = np.array(west_south)

    def gradient(places: FloatArray) -> FloatArray:
        return _gradient(values, (places - origin) / spacing) / spacing

    return gathered(_traced(values, origin, spacing, sorted(levels)), gradient, index, shortest)


def _traced(
    values: FloatArray, origin: FloatArray, spacing: float, levels: Sequence[float]
) -> Iterator[tuple[float, FloatArray]]:
    """Yield the lines of each level."""
    if min(values.shape) < 2:
        return
    try:
        from contourpy import LineType, contour_generator
    except ImportError as error:
        raise MusatError('contours of grids need contourpy: pip install "musatpy[plots]"') from error
    generator = contour_generator(
        z=np.ma.masked_invalid(values), line_type=LineType.Separate, corner_mask=True, name="serial"
    )
    for level in levels:
        for line in generator.lines(level):
            if len(line) > 1:
                yield float(level), origin + spacing * np.asarray(line, dtype=float)


def _gradient(values: FloatArray, places: FloatArray) -> FloatArray:
    """Return the gradient (m, 2), a post's distance being 1, by the posts that the cells of places (m, 2) have."""
    rows, columns = values.shape
    j = np.clip(np.floor(places[:, 0]).astype(int), 0, columns - 2)
    i = np.clip(np.floor(places[:, 1]).astype(int), 0, rows - 2)
    u, v = places[:, 0] - j, places[:, 1] - i
    along = _between(values[i, j + 1] - values[i, j], values[i + 1, j + 1] - values[i + 1, j], v)
    across = _between(values[i + 1, j] - values[i, j], values[i + 1, j + 1] - values[i, j + 1], u)
    return np.stack([along, across], axis=1)


def _between(first: FloatArray, second: FloatArray, part: FloatArray) -> FloatArray:
    """Return a value between two, or the one that is known."""
    mean = (1.0 - part) * first + part * second
    return np.where(np.isnan(first), second, np.where(np.isnan(second), first, mean))
