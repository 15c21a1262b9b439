"""Layers of an old compilation corrected: points, clouds and lines, and what came of them in numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.compilation.correcting import REASONS, Corrected
from musatpy.interchange.layers import Column, Lines, Points
from musatpy.pointfiles.las_files import coordinates, rewritten

_FEW = 20_000  # points by which a file is known to be of the model
_ADDED = {  # extra dimensions of a cloud
    "depth": ("f4", "below the water, m"),
    "sigma_depth": ("f4", "m"),
    "sigma_east": ("f4", "m"),
    "sigma_north": ("f4", "m"),
    "sigma_up": ("f4", "m"),
}


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


def total(tallies: Sequence[Tally]) -> Tally:
    """Return the tally of the parts, one or more, of a layer."""
    return sum(tallies[1:], start=tallies[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class Survey:
    """Apparent points before they are corrected: how many, their lowest and highest, and few (k, 3) of them all."""

    count: int
    heights: tuple[float, float]
    few: FloatArray

    @classmethod
    def of(cls, chunks: Iterable[FloatArray]) -> Survey:
        """Return the survey of points that come in chunks (k, 3)."""
        count, low, high = 0, np.inf, -np.inf
        step, few = 1, np.empty((0, 3))
        for xyz in chunks:
            few = np.concatenate([few, xyz[-count % step :: step]])
            while len(few) > 2 * _FEW:
                step, few = 2 * step, few[::2]
            count += len(xyz)
            low, high = min(low, xyz[:, 2].min(initial=np.inf)), max(high, xyz[:, 2].max(initial=-np.inf))
        return cls(count=count, heights=(float(low), float(high)), few=few)


class Corrector(Protocol):
    """What corrects apparent points (k, 3)."""

    def __call__(self, apparent: FloatArray) -> Corrected:
        """Return the true points."""


def corrected_points(correction: Corrector, points: Points) -> tuple[Points, Tally]:
    """Return the true points of a layer, those without a position left out, and what came of all of them."""
    done = correction(points.xyz)
    known = done.known
    columns = {name: replace(column, values=column.values[known]) for name, column in points.columns.items()}
    return replace(points, xyz=done.xyz[known], columns=columns | measures(done, known)), Tally.of(done)


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


def measures(done: Corrected, known: BoolArray) -> dict[str, Column]:
    """Return depths and sigmas of those that are known (k,) as columns."""
    values = {
        "depth": done.depth, "sigma_depth": done.depth_sigma, "sigma_east": done.sigma[:, 0],
        "sigma_north": done.sigma[:, 1], "sigma_up": done.sigma[:, 2],
    }  # fmt: skip
    return {name: Column.of(column[known], "m") for name, column in values.items()}


def correct_cloud(source: Path, target: Path, correction: Corrector, tallies: list[Tally]) -> None:
    """Correct the points of a LAS or LAZ file by chunks; those without a position are left out, and tallied.

    Raises `InterchangeError` for a file that has one of the dimensions of depths and sigmas already, or that cannot
    hold the true points; `OSError`.
    """
    with rewritten(source, target, _ADDED) as (chunks, write):
        for given in chunks:
            done = correction(coordinates(given))
            tallies.append(Tally.of(done))
            measured = {name: column.values for name, column in measures(done, done.known).items()}
            write(given[done.known], dict(zip("xyz", done.xyz[done.known].T, strict=True)) | measured)
