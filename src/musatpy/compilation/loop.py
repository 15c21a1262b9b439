"""The plotter's real-time loop: from the mark in the model to both stages, through the water; driven paths.

`TRUE`: the mark is the true point, the stages stand at its refracted images, no y-parallax is left. `AIR`: the mark
is where straight rays meet, as on the AS-11AM of 1983. Stages are refined plate coordinates. Waves of the run stand
as they did at the exposure of each photo, whatever the time on the plotter.

Model points are what a plotter without stage output leaves: their rays are rebuilt from the mark and its parallax.
The operator has removed the x-parallax: at the height of the mark both straight rays have its X, and lie to both
sides of it by half the y-parallax. Where that was not read the rays are those to the mark, which a submerged point
has not (ETL-0306, section 5, takes them so). Where the loop of the plotter goes through the water the mark is the
true point, the rays are those to its refracted images, and a y-parallax is what the operator saw beside these.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.stereomodels import Stereomodel, off_plate
from musatpy.compilation.true_points import images_of
from musatpy.errors import CompilationError
from musatpy.model import CoordinateSystem
from musatpy.pointfiles.columns import FileColumn, Wanted
from musatpy.pointfiles.point_tables import read_table
from musatpy.units import DEGREE

_STEP = 0.01  # m, to either side of a mark, for the direction of its images
_MOST_CYCLES = 1e7  # two days at 50 Hz: more is another unit of time


class Drive(StrEnum):
    """What the mark is."""

    TRUE = "TRUE"
    AIR = "AIR"


def stages(stereo: Stereomodel, mark: FloatArray, drive: Drive = Drive.TRUE) -> FloatArray:
    """Return the stages (k, 2, 2) mm of marks (k, 3) in the model.

    Raises `CompilationError` where marks are true points and the water is not known at both photos, and
    `AdjustmentError` where a ray cannot be followed through waves.
    """
    run = stereo.run
    if drive is Drive.AIR:
        return stereo.images(np.repeat(mark[:, None], 2, axis=1))
    if run.block.water is None or not np.isfinite(stereo.tides).all():
        raise CompilationError.of("true marks need water with a tide at both photos: drive AIR")
    with np.errstate(divide="ignore", invalid="ignore"):  # as high as a camera: infinite
        return images_of(run, stereo.photos, stereo.working(mark), np.ones(len(mark), dtype=bool))


def stages_of(stereo: Stereomodel, place: FloatArray, parallax: FloatArray, drive: Drive) -> FloatArray:
    """Return the stages (k, 2, 2) mm of model points (k, 3) m with y-parallaxes (k,) mm, NaN where not read."""
    step = np.array([0.0, _STEP, 0.0])
    along = stages(stereo, place + step, drive) - stages(stereo, place - step, drive)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    half = 0.5 * np.nan_to_num(parallax)[:, None] * [-1.0, 1.0]
    return np.asarray(stages(stereo, place, drive) + half[..., None] * along)


@dataclass(frozen=True, kw_only=True, eq=False)
class Driven:
    """c cycles: times t (c,) s, stages xy (c, 2, 2) mm, seconds (c,) of each."""

    t: FloatArray
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

    def off(self, stereo: Stereomodel) -> FloatArray:
        """Return the times at which the mark stands off the plates."""
        return self.t[off_plate(stereo, self.xy).any(axis=1)]


def read_path(source: Path, stereo: Stereomodel, *, of_job: bool = False) -> FloatArray:
    """Return the path (r, 4) of a file: time (s) and the mark in the model, or read in the system of the job.

    Raises `CompilationError` with every line that cannot be used, and `OSError`.
    """
    angular = of_job and stereo.run.block.options.system is CoordinateSystem.GEOGRAPHIC
    columns = ("t", "lat", "lon", "height") if angular else ("t", "x", "y", "z")
    table = read_table(source, Wanted(columns=tuple(FileColumn(name=name) for name in columns), bare=columns))
    path = table.numbers(*columns)
    for row in np.flatnonzero(np.diff(path[:, 0]) <= 0.0) + 1:
        table.refuse("time does not go on", int(row), "t")
    table.require(CompilationError)
    if len(path) < 2:
        raise CompilationError.of(f"{len(path)} rows: a path has two at least", file=source)
    if of_job:
        place = path[:, 1:] * (np.array([DEGREE, DEGREE, 1.0]) if angular else np.ones(3))
        path = np.column_stack([path[:, 0], stereo.model(stereo.run.frame.working(place))])
    return path


def driven(stereo: Stereomodel, path: FloatArray, rate: float, drive: Drive = Drive.TRUE) -> Driven:
    """Return what driving a path (r, 4) does at so many cycles a second; between rows the mark goes straight.

    Raises `CompilationError` for a path of more than ten million cycles.
    """
    cycles = (path[-1, 0] - path[0, 0]) * rate
    if cycles > _MOST_CYCLES:
        message = f"{cycles:.3g} cycles from t = {path[0, 0]:g} to {path[-1, 0]:g} s: t counts seconds"
        raise CompilationError.of(message)
    t = path[0, 0] + np.arange(math.floor(cycles) + 1) / rate
    marks = np.stack([np.interp(t, path[:, 0], path[:, axis]) for axis in (1, 2, 3)], axis=1)
    xy, seconds = np.empty((len(t), 2, 2)), np.empty(len(t))
    stages(stereo, marks[:1], drive)  # what the first cycle loads
    for cycle in range(len(t)):
        start = time.perf_counter()
        xy[cycle] = stages(stereo, marks[cycle : cycle + 1], drive)[0]
        seconds[cycle] = time.perf_counter() - start
    return Driven(t=t, xy=xy, seconds=seconds, rate=rate)


def driven_csv(result: Driven) -> str:
    """Return the stages of every cycle as comma-separated values."""
    lines = ["t,x1,y1,x2,y2"]
    rows = zip(result.t.tolist(), result.xy.reshape(-1, 4).tolist(), strict=True)
    lines += [f"{t:.4f}," + ",".join(f"{v:.6f}" if v == v else "" for v in xy) for t, xy in rows]
    return "\n".join(lines) + "\n"
