"""Contours of a grid of nodes: linear along the sides of its squares, with the greater values on their right."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import MusatError
from musatpy.surfaces.contours import Contours, kept


def grid_contours(
    values: FloatArray,
    corner: tuple[float, float],
    spacing: float,
    levels: Sequence[float],
    index: Sequence[float] = (),
    shortest: float = 0.0,
) -> Contours:
    """Return the contours of nodes (rows, columns), north and east of a corner, without open pieces below a length.

    Lines end beside nodes that are NaN, but in corners of squares whose other three nodes are there. Raises
    `MusatError` where contourpy is missing.
    """
    rows, columns = values.shape
    if min(rows, columns) < 2:
        return Contours(lines=(), dropped=0)
    try:
        from contourpy import contour_generator
    except ImportError as error:
        raise MusatError("contours need contourpy: pip install 'musatpy[plots]'") from error
    generator = contour_generator(
        corner[0] + spacing * np.arange(columns),
        corner[1] + spacing * np.arange(rows),
        np.ma.masked_invalid(values),
        name="serial",
        corner_mask=True,
        line_type="Separate",
    )
    return kept(_traced(generator, sorted(levels)), index, shortest)


def _traced(generator: Any, levels: Sequence[float]) -> Iterator[tuple[float, FloatArray]]:
    for level in levels:
        for xy in generator.lines(level):
            if len(xy) > 1:  # contourpy has the greater values on the left
                yield float(level), np.asarray(xy[::-1], dtype=float)
