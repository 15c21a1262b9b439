"""What a stereomodel says before anything is compiled in it: the points of the run, and the precision to expect."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.compilation.against_run import predicted
from musatpy.compilation.compiled import CompiledModel
from musatpy.compilation.loop import Drive, Loop
from musatpy.compilation.stereomodels import off_plate
from musatpy.compilation.true_points import CompiledPoints, Readings, true_points
from musatpy.geometry.collinearity import in_front
from musatpy.model.compilation import AGAIN

DEPTHS = (0.0, 5.0, 15.0, 30.0)  # m below the water; 0: on land at its height
_ALONG = (0.0, 0.5, 1.0)  # of the base, from the left station
_ACROSS = (-0.8, 0.0, 0.8)  # of half the format


@dataclass(frozen=True, kw_only=True, eq=False)
class RunPoints:
    """r points of the run, `points` its rows, that both photos show.

    predicted and read (r, 2, 2) mm, what the stages should read and what they do, NaN where they were not read.
    y-parallaxes (r,) mm, of what was read, else predicted: of refracted rays, and of straight ones.
    """

    points: IntArray
    predicted: FloatArray
    read: FloatArray
    parallax: FloatArray
    straight: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Expected:
    """What g points at places of a model, place (g, 3) m in it, will have: depth (g,) m, and their errors.

    pointing (g,) m: what the height would have with stations and water without error.
    """

    place: FloatArray
    depth: FloatArray
    points: CompiledPoints
    pointing: FloatArray

    @property
    def sigma(self) -> FloatArray:
        """(g, 3) m, east, north, up."""
        return np.sqrt(np.diagonal(self.points.covariance, axis1=1, axis2=2))

    @property
    def of_run(self) -> FloatArray:
        """(g,) m, what stations and water of the run add to the height."""
        return np.sqrt(np.maximum(np.square(self.sigma[:, 2]) - np.square(self.pointing), 0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelSetUp:
    """A model with the points of the run in it, and what to expect of it."""

    model: CompiledModel
    again: RunPoints
    expected: Expected


def model_set_up(model: CompiledModel, kind: TextArray) -> ModelSetUp:
    """Return the set-up of a model whose readings have the classes `kind` (k,)."""
    return ModelSetUp(model=model, again=_run_points(model, kind), expected=_expected(model))


def _run_points(model: CompiledModel, kind: TextArray) -> RunPoints:
    stereo, run = model.stereo, model.stereo.run
    points = np.flatnonzero(np.isfinite(run.position).all(axis=1))
    gap = stereo.model(run.frame.working(run.position[points]))[:, None] - stereo.stations
    points = points[in_front(gap, stereo.rotation).all(axis=1)]
    images = predicted(model, points)
    shown = ~off_plate(stereo, images).any(axis=1)
    points, images = points[shown], images[shown]
    row = {name: row for row, name in enumerate(model.readings.ids.tolist()) if kind[row] == AGAIN}
    read = np.full_like(images, np.nan)
    for place, name in enumerate(run.block.points.ids[points].tolist()):
        if name in row:
            read[place] = model.readings.xy[row[name]]
    given = np.where(np.isnan(read), images, read)
    submerged = run.block.points.bathymetric[points]
    return RunPoints(
        points=points,
        predicted=images,
        read=read,
        parallax=_compiled(model, given, submerged).y_parallax,
        straight=_compiled(model, given, np.zeros_like(submerged)).y_parallax,
    )


def _expected(model: CompiledModel) -> Expected:
    """Return what points will have along the base and across it, at some depths, where both photos show them."""
    stereo = model.stereo
    with_water = stereo.run.block.water is not None and bool(np.isfinite(stereo.tides).all())
    half = 0.5 * float(stereo.camera("format_size")[:, 1].min()) / float(stereo.camera("focal_length").mean())
    places = [
        (x * stereo.stations[1, 0] + (1.0 - x) * stereo.stations[0, 0], y * half * stereo.height)
        for x, y in product(_ALONG, _ACROSS)
    ]
    depth = np.repeat(DEPTHS if with_water else DEPTHS[:1], len(places))
    xy = np.tile(places, (len(depth) // len(places), 1))
    place = _below_water(model, xy, depth)
    images = Loop(stereo=stereo, drive=Drive.TRUE if with_water else Drive.AIR).stages(place).xy
    shown = ~off_plate(stereo, images).any(axis=1)
    points = _compiled(model, images[shown], depth[shown] > 0.0)
    exact = replace(model, stereo=replace(stereo, run=stereo.run.without_errors))
    pointing = np.sqrt(_compiled(exact, images[shown], depth[shown] > 0.0).covariance[:, 2, 2])
    return Expected(place=place[shown], depth=depth[shown], points=points, pointing=pointing)


def _below_water(model: CompiledModel, xy: FloatArray, depth: FloatArray) -> FloatArray:
    """Return places (g, 3) of the model at X, Y (g, 2) and depths (g,) below its water, or its mean ground."""
    stereo, frame = model.stereo, model.stereo.run.frame
    level = float(frame.height(stereo.origin[None])[0])
    place = np.column_stack([xy, np.zeros(len(xy))])
    for _ in range(2):  # the water bends away from the model by metres, and its vertical by milliradians
        place[:, 2] += level - depth - frame.height(stereo.working(place))
    return place


def _compiled(model: CompiledModel, xy: FloatArray, submerged: BoolArray) -> CompiledPoints:
    readings = Readings(
        ids=np.arange(len(xy)).astype(np.str_),
        submerged=submerged,
        xy=xy,
        sigma=np.full(xy.shape, model.pointing),
    )
    return true_points(model.stereo.run, model.stereo.photos, readings)
