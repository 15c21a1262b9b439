"""Layers of an old compilation corrected: points, lines, and grids of apparent heights.

A grid is read off at its own posts again, as true points lie beside the apparent ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.compilation.correcting import CHUNK, REASONS, Corrected
from musatpy.interchange.layers import Column, Grid, Lines, Points

_TURNS = 3  # times that the posts of a grid are looked for; what is left is the cube of a slope of the correction


@dataclass(frozen=True, kw_only=True, eq=False)
class Tally:
    """What came of points in numbers: how many there are, have a position, are under water; lost ones by `REASONS`.

    deepest and shift, the largest in plan, in m; sum of squares of the sigmas of depths, m2.
    """

    count: int
    known: int
    wet: int
    lost: IntArray
    deepest: float
    shift: float
    squares: float

    @classmethod
    def of(cls, done: Corrected) -> Tally:
        """Return the tally of points."""
        wet, known = np.isfinite(done.depth), done.known
        return cls(
            count=len(known),
            known=int(known.sum()),
            wet=int(wet.sum()),
            lost=np.bincount(done.reason[~known], minlength=len(REASONS)),
            deepest=float(done.depth[wet].max(initial=-np.inf)),
            shift=float(done.shift[known].max(initial=0.0)),
            squares=float(np.square(done.depth_sigma[wet]).sum()),
        )

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            count=self.count + other.count,
            known=self.known + other.known,
            wet=self.wet + other.wet,
            lost=self.lost + other.lost,
            deepest=max(self.deepest, other.deepest),
            shift=max(self.shift, other.shift),
            squares=self.squares + other.squares,
        )

    @property
    def depth_sigma(self) -> float:
        """Root mean square of the sigmas of depths, m."""
        return float(np.sqrt(self.squares / self.wet)) if self.wet else np.nan


class Corrector(Protocol):
    """What corrects apparent points (k, 3)."""

    def __call__(self, apparent: FloatArray) -> Corrected:
        """Return the true points."""


def corrected_points(correction: Corrector, points: Points) -> tuple[Points, Tally]:
    """Return the true points of a layer, those without a position left out, and what came of all of them."""
    done = correction(points.xyz)
    known = done.known
    columns = {name: replace(column, values=column.values[known]) for name, column in points.columns.items()}
    return replace(points, xyz=done.xyz[known], columns=columns | _columns(done, known)), Tally.of(done)


def corrected_lines(correction: Corrector, lines: Lines) -> tuple[Lines, Tally]:
    """Return the true lines of a layer, cut where vertices have no position, and what came of all vertices."""
    sizes = [len(path) for path in lines.vertices]
    done = correction(np.concatenate(lines.vertices))
    known, first = done.known, np.concatenate([[0], np.cumsum(sizes)])
    pieces: list[FloatArray] = []
    source: list[int] = []
    closed: list[bool] = []
    for line in range(len(sizes)):
        rows = np.arange(first[line], first[line + 1])
        runs = [run for run in np.split(rows, np.flatnonzero(np.diff(known[rows])) + 1) if known[run[0]]]
        whole = len(runs) == 1 and len(runs[0]) == len(rows)
        pieces += [done.xyz[run] for run in runs if len(run) > 1]
        source += [line for run in runs if len(run) > 1]
        closed += [whole and bool(lines.closed[line]) for run in runs if len(run) > 1]
    rows_of = np.array(source, dtype=np.int64)
    columns = {name: replace(column, values=column.values[rows_of]) for name, column in lines.columns.items()}
    return replace(lines, vertices=pieces, closed=np.array(closed, dtype=bool), columns=columns), Tally.of(done)


def corrected_grid(correction: Corrector, grid: Grid, band: str) -> tuple[Grid, Tally]:
    """Return the true surface of a band of apparent heights at the posts of the same grid, and what came of these.

    The apparent place of each post is the one whose true point stands on the post.
    """
    rows, columns = grid.shape
    values = {name: np.empty((rows, columns)) for name in ("height", "depth", "sigma")}
    parts = []
    step = max(1, CHUNK // columns)
    for first in range(0, rows, step):
        part = np.arange(first, min(first + step, rows))
        done = _posts(correction, grid, band, part)
        for name, column in (("height", done.xyz[:, 2]), ("depth", done.depth), ("sigma", done.sigma[:, 2])):
            values[name][part] = column.reshape(len(part), columns)
        parts.append(Tally.of(done))
    return replace(grid, bands=values, units=dict.fromkeys(values, "m")), sum(parts[1:], start=parts[0])


def _posts(correction: Corrector, grid: Grid, band: str, rows: IntArray) -> Corrected:
    """Return what came of the posts of some rows."""
    x, y = np.meshgrid(grid.west + grid.spacing * np.arange(grid.shape[1]), grid.south + grid.spacing * rows)
    posts = np.column_stack([x.ravel(), y.ravel()])
    place = posts.copy()
    for turn in range(_TURNS):
        height = _bilinear(grid, grid.bands[band], place)
        given = np.flatnonzero(np.isfinite(height))
        done = Corrected.nothing(len(posts))
        done.put(given, correction(np.column_stack([place, height])[given]))
        if turn + 1 < _TURNS:
            place -= np.nan_to_num(done.xyz[:, :2] - posts)
    return done


def _bilinear(grid: Grid, values: FloatArray, place: FloatArray) -> FloatArray:
    """Return values (k,) of a grid between its posts, NaN outside and beside an empty one."""
    rows, columns = values.shape
    at = (place - [grid.west, grid.south]) / grid.spacing
    at = np.where(np.abs(at - np.rint(at)) < 1e-9, np.rint(at), at)
    low = np.clip(np.floor(at).astype(np.int64), 0, [max(columns - 2, 0), max(rows - 2, 0)])
    high = np.minimum(low + 1, [columns - 1, rows - 1])
    u, v = (at - low).T
    out = np.zeros(len(place))
    for row, weight_v in ((low[:, 1], 1.0 - v), (high[:, 1], v)):
        for column, weight_u in ((low[:, 0], 1.0 - u), (high[:, 0], u)):
            weight = weight_u * weight_v
            out += np.where(weight == 0.0, 0.0, weight * values[row, column])
    outside = (at < 0.0).any(axis=1) | (at > [columns - 1, rows - 1]).any(axis=1)
    return np.where(outside, np.nan, out)


def _columns(done: Corrected, known: BoolArray) -> dict[str, Column]:
    values = {
        "depth": done.depth, "sigma_depth": done.depth_sigma, "sigma_east": done.sigma[:, 0],
        "sigma_north": done.sigma[:, 1], "sigma_up": done.sigma[:, 2],
    }  # fmt: skip
    return {name: Column.of(column[known], "m") for name, column in values.items()}
