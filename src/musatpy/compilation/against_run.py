"""A model beside its run: compiled points against those by the same names, and what the model says before any.

What the stages should read of points of the run, and the precision to expect of points at places of the model.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from musatpy.adjustment.iteration import State
from musatpy.adjustment.network import Network, group_points
from musatpy.adjustment.propagation import pieces
from musatpy.adjustment.sparse import Pattern
from musatpy.adjustment.waterline import water_line
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray, rows_of
from musatpy.compilation import true_points
from musatpy.compilation.compiled import CompiledModel, plates_of_run, same_readings
from musatpy.compilation.loop import Drive, stages
from musatpy.compilation.stereomodels import off_plate
from musatpy.compilation.triangulation import AdjustedRun, covariances_in
from musatpy.geometry.collinearity import in_front
from musatpy.model.compilation import AGAIN
from musatpy.model.tables import taken

_NONE = 1e-9  # of the largest variance, up to which a direction has none
_EXACT = 1e-6  # m: sigmas of differences of points that are the same
DEPTHS = (0.0, 5.0, 15.0, 30.0)  # m below the water, where errors are expected; 0: on land at its height
_ALONG = (0.0, 0.5, 1.0)  # of the base, from the left station
_ACROSS = (-0.8, 0.0, 0.8)  # of half the format


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
    point = rows_of(run.block.points.ids, model.readings.ids)
    known = (point >= 0) & np.isfinite(model.points.position).all(axis=1)
    rows = np.flatnonzero(known & np.isfinite(run.position[point]).all(axis=1))
    points, frame = point[rows], run.frame
    at, plates = frame.working(run.position[points]), plates_of_run(model, points)
    shared = same_readings(model, rows, plates)
    gap = frame.working(model.points.position[rows]) - at
    return AgainstRun(
        model=model,
        again=again[rows],
        rows=rows,
        points=points,
        difference=np.einsum("kij,kj->ki", frame.axes(at), gap),
        covariance=difference_covariances(model, rows, points, plates, shared),
        shared=shared,
        stages=model.readings.xy[rows] - predicted(model, points),
    )


def predicted(model: CompiledModel, points: IntArray) -> FloatArray:
    """Return what the stages (r, 2, 2) mm should read of points (r,) of the run."""
    run = model.stereo.run
    ground, submerged = run.frame.working(run.position[points]), run.block.points.bathymetric[points]
    return true_points.images_of(run, model.stereo.photos, ground, submerged)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Influence:
    """Of one point: its partials (3, u), along working axes, by errors of unknowns (u,), less their sign.

    alone (3, 3) is the covariance of the point for stations without error.
    """

    by_unknown: FloatArray
    unknowns: IntArray
    alone: FloatArray


def difference_covariances(
    model: CompiledModel, rows: IntArray, points: IntArray, plates: IntArray, shared: BoolArray
) -> FloatArray:
    """Return the covariances (r, 3, 3) of compiled points `rows` less `points` of the run, along east, north, up.

    `shared` (r,) are those whose readings are the measurements `plates` (r, 2) of the run. With C = F_c Q F_t' by
    all that both hang on, S_c + S_t - C - C' where readings are new. Of readings of the run a point that took part
    is the best estimate of all data, S_c - S_t; of one that was kept out the pointing of the run is common too. NaN
    for control points, where the run has a point not on both photos, and where it has kept out one of the readings
    of a point.
    """
    run = model.stereo.run
    _, network, state = true_points.network_of(run, model.stereo.photos, model.readings[rows])
    state = replace(state, ground=run.frame.working(model.points.position[rows]))
    network = network.with_plates(network.xy, model.points.wet[rows].T.reshape(-1))
    compiled, of_run = _influences(run, network, state), _influences(run, *_run_network(run, points))
    pattern = Pattern.of(len(run.block.photos.ids), network.pattern.size, [run.pairs.photo])
    Q = covariances_in(run, pattern, run.water.covariance.shape[0] if run.water else 0)
    took_part = shared & np.isin(points, run.block.plates.point[run.triangulated])
    tested = ~run.control[points]
    tested[took_part] &= run.triangulated[plates[took_part]].all(axis=1)
    out = np.full((len(rows), 3, 3), np.nan)
    axes = run.frame.axes(run.frame.working(run.position[points]))
    for row in np.flatnonzero(tested).tolist():
        c, t = compiled.get(row), of_run.get(row)
        if c is None or t is None or not _meet(pattern, c.unknowns, t.unknowns):
            continue
        if took_part[row]:
            S = model.points.covariance[rows[row]] - run.point_covariance[points[row]]
            out[row] = 0.5 * (S + S.T)
            continue
        total = c.alone + (-t.alone if shared[row] else t.alone)
        for a, b, sign in ((c, c, 1.0), (t, t, 1.0), (c, t, -1.0), (t, c, -1.0)):
            total = total + sign * a.by_unknown @ Q.between(a.unknowns[None], b.unknowns[None])[0] @ b.by_unknown.T
        out[row] = axes[row] @ total @ axes[row].T
    return out


def _meet(pattern: Pattern, a: IntArray, b: IntArray) -> bool:
    """Return whether all photos of two sets of unknowns meet one another in the run."""
    i, j = (np.unique(part[part < pattern.order] // pattern.size) for part in (a, b))
    low, high = np.minimum(i[:, None], j), np.maximum(i[:, None], j)
    return bool(np.isin(low * pattern.count + high, pattern.keys).all())


def _run_network(run: AdjustedRun, points: IntArray) -> tuple[Network, State]:
    """Return the network of points of the run by the rays that gave them their positions."""
    plates, block = run.block.plates, run.block
    took_part = np.isin(plates.point, plates.point[run.triangulated])
    used = np.isin(plates.point, points) & (run.triangulated | ~took_part)
    number = np.full(len(block.points.ids), -1)
    number[points] = np.arange(len(points))
    part = taken(plates, np.flatnonzero(used))
    sigma = part.sigma * run.unit_sigma
    part = replace(part, point=number[part.point], sigma=sigma, triangulated=np.zeros(len(sigma), dtype=bool))
    _, network, state = true_points.network_of_plates(run, taken(block.points, points), part)
    state = replace(state, ground=run.frame.working(run.position[points]))
    line = water_line(network, state, block.points.bathymetric[points])
    return network.with_plates(network.xy, line.wet), state


def _influences(run: AdjustedRun, network: Network, state: State) -> dict[int, _Influence]:
    """Return the influences of the points of a network."""
    out: dict[int, _Influence] = {}
    Q = covariances_in(run, network.pattern, network.border.size)
    rays, points = np.ones(len(network.photo), dtype=bool), np.ones(network.points, dtype=bool)
    for group in group_points(network.photo, network.point, rays, points):
        if group.rays.shape[1] < 2:
            continue
        for _, piece in pieces(network, state, group, Q):
            unknowns = network.unknowns(piece.group, piece.E.extras.index)
            for place, point in enumerate(piece.group.point.tolist()):
                out[point] = _Influence(
                    by_unknown=piece.F[place], unknowns=unknowns[place], alone=piece.E.inverse[place]
                )
    return out


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
    points: true_points.CompiledPoints
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
    again = np.flatnonzero(kind == AGAIN)
    _, place, row = np.intersect1d(run.block.points.ids[points], model.readings.ids[again], return_indices=True)
    read = np.full_like(images, np.nan)
    read[place] = model.readings.xy[again[row]]
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
    images = stages(stereo, place, Drive.TRUE if with_water else Drive.AIR)
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


def _compiled(model: CompiledModel, xy: FloatArray, submerged: BoolArray) -> true_points.CompiledPoints:
    return true_points.true_points(
        model.stereo.run, model.stereo.photos, true_points.Readings.of(xy, submerged, model.pointing)
    )
