"""A path of the mark driven at a rate: what the stages do, and whether every cycle of the loop ends in time."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.loop import Loop
from musatpy.compilation.stereomodels import Stereomodel, off_plate
from musatpy.errors import CompilationError, Problem
from musatpy.model import CoordinateSystem
from musatpy.pointfiles.columns import Column, Wanted
from musatpy.pointfiles.point_tables import read_table
from musatpy.units import DEGREE

IN_MODEL = ("t", "x", "y", "z")
GEOGRAPHIC = ("t", "lat", "lon", "height")
_MOST_CYCLES = 1e7  # two days at 50 Hz: more is another unit of time


@dataclass(frozen=True, kw_only=True, eq=False)
class Driven:
    """c cycles: times t (c,) s, marks (c, 3) m in the model, stages xy (c, 2, 2) mm, seconds (c,) of each."""

    t: FloatArray
    marks: FloatArray
    xy: FloatArray
    seconds: FloatArray
    rate: float

    @property
    def missed(self) -> int:
        """Cycles that took longer than the rate allows."""
        return int(np.count_nonzero(self.seconds * self.rate > 1.0))

    @property
    def speed(self) -> float:
        """Largest speed of a stage along an axis, mm/s."""
        change = np.abs(np.diff(self.xy, axis=0)).max(axis=(1, 2), initial=0.0)
        speed = change / np.diff(self.t)
        return float(speed[np.isfinite(speed)].max(initial=0.0))

    def off(self, loop: Loop) -> FloatArray:
        """Return the times at which the mark stands off the plates."""
        return self.t[off_plate(loop.stereo, self.xy).any(axis=1)]


def columns_of(stereo: Stereomodel, *, of_job: bool) -> tuple[str, ...]:
    """Return the columns of a path in the model, or in the system of the job."""
    geographic = stereo.run.block.options.system is CoordinateSystem.GEOGRAPHIC
    return GEOGRAPHIC if of_job and geographic else IN_MODEL


def in_model(stereo: Stereomodel, path: FloatArray, columns: tuple[str, ...]) -> FloatArray:
    """Return a path (r, 4) in the system of the job (degrees, m) as one in the model."""
    unit = np.array([DEGREE, DEGREE, 1.0]) if columns == GEOGRAPHIC else np.ones(3)
    return np.column_stack([path[:, 0], stereo.model(stereo.run.frame.working(path[:, 1:] * unit))])


def read_path(source: Path, columns: tuple[str, ...] = IN_MODEL) -> FloatArray:
    """Return the path (r, 4) of a file with these columns: time (s) and the mark.

    Raises `CompilationError` with every line that cannot be used, and `OSError`.
    """
    table = read_table(source, Wanted(columns=tuple(Column(name=name) for name in columns), bare=columns))
    path = table.numbers(*columns)
    for row in np.flatnonzero(np.diff(path[:, 0]) <= 0.0) + 1:
        table.refuse("time does not go on", int(row), "t")
    table.require(CompilationError)
    if len(path) < 2:
        raise CompilationError([Problem(file=str(source), message=f"{len(path)} rows: a path has two at least")])
    return path


def driven(loop: Loop, path: FloatArray, rate: float) -> Driven:
    """Return what driving a path (r, 4) does at so many cycles a second; between rows the mark goes straight.

    Raises `CompilationError` for a path of more than ten million cycles.
    """
    cycles = (path[-1, 0] - path[0, 0]) * rate
    if cycles > _MOST_CYCLES:
        message = f"{cycles:.3g} cycles from t = {path[0, 0]:g} to {path[-1, 0]:g} s: t counts seconds"
        raise CompilationError([Problem(message=message)])
    t = path[0, 0] + np.arange(math.floor(cycles) + 1) / rate
    marks = np.stack([np.interp(t, path[:, 0], path[:, axis]) for axis in (1, 2, 3)], axis=1)
    xy, seconds = np.empty((len(t), 2, 2)), np.empty(len(t))
    loop.stages(marks[:1])  # what the first cycle loads
    for cycle in range(len(t)):
        start = time.perf_counter()
        xy[cycle] = loop.stages(marks[cycle : cycle + 1]).xy[0]
        seconds[cycle] = time.perf_counter() - start
    return Driven(t=t, marks=marks, xy=xy, seconds=seconds, rate=rate)


def driven_csv(result: Driven) -> str:
    """Return the stages of every cycle as comma-separated values."""
    lines = ["t,x1,y1,x2,y2"]
    rows = zip(result.t.tolist(), result.xy.reshape(-1, 4).tolist(), strict=True)
    lines += [f"{t:.4f}," + ",".join(f"{v:.6f}" if v == v else "" for v in xy) for t, xy in rows]
    return "\n".join(lines) + "\n"
