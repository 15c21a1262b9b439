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
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np

from musatpy.adjustment.wavy_water import WorkingSea
from musatpy.arrays import FloatArray
from musatpy.compilation.stereomodels import Stereomodel, off_plate
from musatpy.errors import CompilationError, Problem
from musatpy.geometry import collinearity
from musatpy.geometry.geodesy import surface
from musatpy.model import CoordinateSystem
from musatpy.pointfiles.columns import FileColumn, Wanted
from musatpy.pointfiles.point_tables import read_table
from musatpy.refraction import flat
from musatpy.units import DEGREE

_MOST_CYCLES = 1e7  # two days at 50 Hz: more is another unit of time


class Drive(StrEnum):
    """What the mark is."""

    TRUE = "TRUE"
    AIR = "AIR"


@dataclass(frozen=True, kw_only=True, eq=False)
class Stages:
    """Plate coordinates xy (k, 2, 2) mm of both stages, and their partials by_mark (k, 2, 2, 3) mm/m."""

    xy: FloatArray
    by_mark: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Loop:
    """The loop of one stereomodel; waves on its water, if any, are looked up once.

    Raises `CompilationError` where marks are true points and the water is not known at both photos.
    """

    stereo: Stereomodel
    drive: Drive = Drive.TRUE
    sea: WorkingSea | None = field(init=False)

    def __post_init__(self) -> None:
        run, tides = self.stereo.run, self.stereo.tides
        if self.drive is Drive.TRUE and (run.block.water is None or not np.isfinite(tides).all()):
            raise CompilationError([Problem(message="true marks need water with a tide at both photos: drive AIR")])
        object.__setattr__(self, "sea", None if run.sea is None else WorkingSea.of(run.sea, run.frame).known)

    def stages(self, mark: FloatArray) -> Stages:
        """Return the stages of marks (k, 3) in the model, with their partials.

        Raises `AdjustmentError` where a ray cannot be followed through waves.
        """
        stereo, axes = self.stereo, self.stereo.axes
        v, by_mark = mark[:, None] - stereo.stations, np.eye(3)
        if self.drive is Drive.TRUE:
            bent = self._incidence(mark)
            v = bent.v.reshape(-1, 2, 3) @ axes.T
            by_mark = axes @ bent.by_ground.reshape(-1, 2, 3, 3) @ axes.T
        focal_length, principal_point = stereo.camera("focal_length"), stereo.camera("principal_point")
        with np.errstate(divide="ignore", invalid="ignore"):  # as high as a camera: infinite
            xy, by_v = collinearity.image_by_vector(v, stereo.rotation, focal_length, principal_point)
            return Stages(xy=xy, by_mark=by_v @ by_mark)

    def _incidence(self, mark: FloatArray) -> flat.Incidence:
        """Return the rays (2 k,) from both stations to marks through the water, in working axes."""
        stereo, frame, count = self.stereo, self.stereo.run.frame, len(mark)
        ground = np.repeat(stereo.working(mark), 2, axis=0)
        camera, tide = np.tile(stereo.working(stereo.stations), (count, 1)), np.tile(stereo.tides, count)
        if self.sea is not None:
            return self.sea.incidence(np.tile(stereo.photos, count), camera, ground, tide, stereo.index)
        over = surface(frame, stereo.water_slope, tide, ground)
        return flat.incidence(camera, ground, over.normal, over.depth, stereo.index)


def stages_of(loop: Loop, place: FloatArray, parallax: FloatArray) -> FloatArray:
    """Return the stages (k, 2, 2) mm of model points (k, 3) m with y-parallaxes (k,) mm, NaN where not read."""
    stages = loop.stages(place)
    xy, along = stages.xy, stages.by_mark[..., 1]
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    half = 0.5 * np.nan_to_num(parallax)[:, None] * [-1.0, 1.0]
    return np.asarray(xy + half[..., None] * along)


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

    def off(self, loop: Loop) -> FloatArray:
        """Return the times at which the mark stands off the plates."""
        return self.t[off_plate(loop.stereo, self.xy).any(axis=1)]


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
        raise CompilationError([Problem(file=str(source), message=f"{len(path)} rows: a path has two at least")])
    if of_job:
        place = path[:, 1:] * (np.array([DEGREE, DEGREE, 1.0]) if angular else np.ones(3))
        path = np.column_stack([path[:, 0], stereo.model(stereo.run.frame.working(place))])
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
    return Driven(t=t, xy=xy, seconds=seconds, rate=rate)


def driven_csv(result: Driven) -> str:
    """Return the stages of every cycle as comma-separated values."""
    lines = ["t,x1,y1,x2,y2"]
    rows = zip(result.t.tolist(), result.xy.reshape(-1, 4).tolist(), strict=True)
    lines += [f"{t:.4f}," + ",".join(f"{v:.6f}" if v == v else "" for v in xy) for t, xy in rows]
    return "\n".join(lines) + "\n"
