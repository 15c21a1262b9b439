"""Compiled points against those of the run by the same names: where they lie, and what the stages should read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.sightings import image_coordinates
from musatpy.adjustment.waterline import water_line
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.compilation.compiled import CompiledModel
from musatpy.compilation.errors_of_differences import difference_covariances
from musatpy.compilation.readings_of_run import are_of_run, points_of_run
from musatpy.compilation.true_points import Readings, network_of

_NONE = 1e-9  # of the largest variance, up to which a direction has none
_EXACT = 1e-6  # m: sigmas of differences of points that are the same


@dataclass(frozen=True, kw_only=True, eq=False)
class AgainstRun:
    """r points of a model that the run has too: `rows` of its readings, `points` rows of those of the run.

    difference (r, 3) m, compiled minus run along east, north, up, with its covariance (r, 3, 3), NaN where that is
    not known; shared (r,) are those whose readings are the
    plate measurements of the run; stages (r, 2, 2) mm read minus predicted by the points of the run. `again` (r,)
    are those of class R, which say whether the `model` is recovered.
    """

    model: CompiledModel
    rows: IntArray
    points: IntArray
    difference: FloatArray
    covariance: FloatArray
    shared: BoolArray
    stages: FloatArray
    again: BoolArray

    @property
    def length(self) -> FloatArray:
        """(r,) m, of the differences."""
        return np.asarray(np.linalg.norm(self.difference, axis=1))

    @property
    def sigma(self) -> FloatArray:
        """(r, 3) m, of the differences."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=1, axis2=2), 0.0))

    @property
    def test(self) -> FloatArray:
        """(r,) roots of the mean squares of the differences in their covariances; NaN where these are not known."""
        out = np.full(len(self.rows), np.nan)
        known = np.isfinite(self.covariance).all(axis=(1, 2))
        for row in np.flatnonzero(known & (self.sigma.max(axis=1) > _EXACT)).tolist():
            values, axes = np.linalg.eigh(self.covariance[row])
            held = values > _NONE * values[-1]
            along = axes.T[held] @ self.difference[row]
            out[row] = np.sqrt(np.mean(np.square(along) / values[held]))
        return out

    @property
    def rms(self) -> FloatArray:
        """(2, 2) mm, of the points read again: left and right, x and y; NaN without any."""
        squares = np.square(self.stages[self.again])
        return np.sqrt(squares.mean(axis=0)) if len(squares) else np.full((2, 2), np.nan)

    @property
    def largest(self) -> tuple[float, str | None]:
        """The largest difference of a coordinate of a stage, mm, and its point; None without any."""
        size = np.abs(self.stages[self.again]).max(axis=(1, 2), initial=0.0)
        if not len(size):
            return np.nan, None
        return float(size.max()), str(self.model.readings.ids[self.rows[self.again]][size.argmax()])

    @property
    def recovered(self) -> bool | None:
        """Whether no root mean square is over the limit of the model; None without points read again."""
        return bool((self.rms <= self.model.limit).all()) if self.again.any() else None

    def warnings(self) -> Iterator[str]:
        """Yield that the model is not recovered."""
        if self.recovered is False:
            size, point = self.largest
            yield (
                f"model {self.model.name} is not recovered: points read again differ from the run by "
                f"{1e3 * self.rms.max():.1f} um RMS, {1e3 * size:.1f} um at point {point}"
            )


def against_run(model: CompiledModel, again: BoolArray) -> AgainstRun:
    """Return the points of a model beside those of the run; `again` (k,) are readings of class R."""
    run = model.stereo.run
    point = points_of_run(model)
    known = (point >= 0) & np.isfinite(model.points.position).all(axis=1)
    rows = np.flatnonzero(known & np.isfinite(run.position[point]).all(axis=1))
    points, frame = point[rows], run.frame
    at, shared = frame.working(run.position[points]), are_of_run(model, rows, points)
    gap = frame.working(model.points.position[rows]) - at
    return AgainstRun(
        model=model,
        again=again[rows],
        rows=rows,
        points=points,
        difference=np.einsum("kij,kj->ki", frame.axes(at), gap),
        covariance=difference_covariances(model, rows, points, shared),
        shared=shared,
        stages=model.readings.xy[rows] - predicted(model, points),
    )


def predicted(model: CompiledModel, points: IntArray) -> FloatArray:
    """Return what the stages (r, 2, 2) mm should read of points (r,) of the run."""
    run = model.stereo.run
    shape = (len(points), 2, 2)
    readings = Readings(
        ids=run.block.points.ids[points],
        submerged=run.block.points.bathymetric[points],
        xy=np.zeros(shape),
        sigma=np.full(shape, model.pointing),
    )
    _, network, state = network_of(run, model.stereo.photos, readings)
    state = replace(state, ground=run.frame.working(run.position[points]))
    line = water_line(network, state, readings.submerged)
    network = network.with_plates(network.xy, line.wet)
    xy = image_coordinates(network, state, np.arange(2 * len(points)), state.ground[network.point])
    return np.swapaxes(xy.reshape(2, len(points), 2), 0, 1)
