"""Contours of triangles, straight in each, and of grids of nodes; with the greater values on their right."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import SurfaceError
from musatpy.extras import package
from musatpy.figures import check_matplotlib
from musatpy.surfaces.tin import Tin

_MOST_LEVELS = 2000
_SAME = 1e-9  # m, of the ends of a closed line


@dataclass(frozen=True, kw_only=True, eq=False)
class Contour:
    """A line of a level: xy (k, 2) m, its end its beginning where it is closed. `index` lines are drawn thick."""

    level: float
    xy: FloatArray
    closed: bool
    index: bool = False

    @property
    def length(self) -> float:
        """In plan, m."""
        return float(np.linalg.norm(np.diff(self.xy, axis=0), axis=1).sum())

    @property
    def area(self) -> float:
        """Of a closed line, m2: positive where it runs counter-clockwise, around lesser values; else 0."""
        if not self.closed:
            return 0.0
        x, y = (self.xy - self.xy[0]).T
        return float(0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Contours:
    """The lines of a surface, level by level, and how many pieces were too short to be drawn."""

    lines: tuple[Contour, ...]
    dropped: int


def levels_between(low: float, high: float, interval: float) -> FloatArray:
    """Return the multiples of an interval within limits. Raises `SurfaceError` for too many of them."""
    first, last = np.ceil(low / interval), np.floor(high / interval)
    if not last - first < _MOST_LEVELS:
        message = f"{last - first + 1.0:.3g} contours from {low:g} to {high:g} m, {_MOST_LEVELS} are the most"
        raise SurfaceError.of(message)
    return np.asarray(interval * np.arange(first, last + 1.0) + 0.0)  # no -0


def contours(tin: Tin, levels: Sequence[float], index: Sequence[float] = (), shortest: float = 0.0) -> Contours:
    """Return the contours of a network at levels; open pieces shorter than a limit (m) are left out.

    Raises `MusatError` where matplotlib is missing.
    """
    return kept(_traced(tin, sorted(levels)), index, shortest)


def kept(lines: Iterable[tuple[float, FloatArray]], index: Sequence[float], shortest: float) -> Contours:
    """Return lines, each a level and its vertices (k, 2), without open ones shorter than a limit (m)."""
    long, dropped = [], 0
    for level, xy in lines:
        closed = bool(np.abs(xy[0] - xy[-1]).max() <= _SAME) and len(xy) > 3
        line = Contour(level=level, xy=xy, closed=closed, index=level in index)
        if line.length < (_SAME if closed else max(shortest, _SAME)):  # a ring is a shoal or a hollow
            dropped += 1
        else:
            long.append(line)
    return Contours(lines=tuple(long), dropped=dropped)


def _traced(tin: Tin, levels: Sequence[float]) -> Iterator[tuple[float, FloatArray]]:
    """Yield the lines of each level."""
    check_matplotlib()
    from matplotlib.figure import Figure
    from matplotlib.tri import Triangulation

    mesh = Triangulation(tin.xy[:, 0], tin.xy[:, 1], tin.triangles, mask=~tin.kept)
    reached = [level for level in levels if tin.z.min() < level < tin.z.max()]
    if not reached or not tin.kept.any():
        return
    axes: Any = Figure().add_subplot()
    drawn = axes.tricontour(mesh, tin.z, levels=reached)
    for level, path in zip(reached, drawn.get_paths(), strict=True):
        path.should_simplify = False  # vertices would be left out, as if metres were pixels
        for xy in path.to_polygons(closed_only=False):
            if len(xy) > 1:  # matplotlib has the greater values on the left
                yield float(level), np.asarray(xy[::-1], dtype=float)


def bounds(lines: Sequence[Contour]) -> list[tuple[float, int, float, float]]:
    """Return level, number of lines, length (m) and enclosed area (m2) of each level."""
    rows = []
    for level in sorted({line.level for line in lines}):
        of_level = [line for line in lines if line.level == level]
        area = abs(sum(line.area for line in of_level))
        rows.append((level, len(of_level), sum(line.length for line in of_level), area))
    return rows


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
    generator = package("plots", "contourpy", "contours need").contour_generator(
        corner[0] + spacing * np.arange(columns),
        corner[1] + spacing * np.arange(rows),
        np.ma.masked_invalid(values),
        name="serial",
        corner_mask=True,
        line_type="Separate",
    )
    # contourpy has the greater values on the left
    lines = ((level, xy[::-1]) for level in sorted(levels) for xy in generator.lines(level) if len(xy) > 1)
    return kept(lines, index, shortest)
