"""Compiled points against those of the run by the same names: where they lie, and what the stages should read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.iteration import State
from musatpy.adjustment.network import Network, group_points
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.propagation import pieces
from musatpy.adjustment.sightings import image_coordinates
from musatpy.adjustment.sparse import Pattern
from musatpy.adjustment.waterline import water_line
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.compilation.compiled import CompiledModel, are_of_run, on_both_photos, points_of_run
from musatpy.compilation.triangulation import AdjustedRun, covariances_in
from musatpy.compilation.true_points import Readings, network_of, network_of_plates
from musatpy.model.tables import taken

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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Influence:
    """Of one point: its partials (3, u), along working axes, by errors of unknowns (u,), less their sign.

    alone (3, 3) is the covariance of the point for stations without error.
    """

    by_unknown: FloatArray
    unknowns: IntArray
    alone: FloatArray


def difference_covariances(model: CompiledModel, rows: IntArray, points: IntArray, shared: BoolArray) -> FloatArray:
    """Return the covariances (r, 3, 3) of compiled points `rows` less `points` of the run, along east, north, up.

    `shared` (r,) are those whose readings are those of the run. With C = F_c Q F_t' by all that both hang on,
    S_c + S_t - C - C' where readings are new. Of readings of the run a point that took part is the best estimate
    of all data, S_c - S_t; of one that was kept out the pointing of the run is common too. NaN for control points,
    where the run has a point not on both photos, and where it has kept out one of the readings of a point.
    """
    run = model.stereo.run
    network, state = _compiled_network(model, rows)
    compiled = _influences(run, network, state, np.arange(len(rows)))
    of_run = _influences(run, *_run_network(run, points), np.arange(len(points)))
    pattern = Pattern.of(len(run.block.photos.ids), network.pattern.size, [run.pairs.photo])
    border = run.water.covariance.shape[0] if run.water else 0
    Q = covariances_in(run, pattern, border)
    took_part = np.isin(points, run.block.plates.point[run.triangulated])
    frame, out = run.frame, np.full((len(rows), 3, 3), np.nan)
    axes = frame.axes(frame.working(run.position[points]))
    for row in range(len(rows)):
        c, t = compiled.get(row), of_run.get(row)
        if c is None or t is None or run.control[points[row]] or not _meet(pattern, c.unknowns, t.unknowns):
            continue
        if shared[row] and took_part[row] and not on_both_photos(model, int(points[row])):
            continue
        if shared[row] and took_part[row]:
            S = model.points.covariance[rows[row]] - run.point_covariance[points[row]]
            out[row] = 0.5 * (S + S.T)
            continue
        parts = (
            (c, c, 1.0), (t, t, 1.0), (c, t, -1.0), (t, c, -1.0)
        )  # fmt: skip
        total = sum(sign * _product(Q, a, b) for a, b, sign in parts)
        total = total + c.alone + t.alone - (2.0 * t.alone if shared[row] else 0.0)
        out[row] = axes[row] @ total @ axes[row].T
    return out


def _product(Q: Cofactors, a: _Influence, b: _Influence) -> FloatArray:
    return np.asarray(a.by_unknown @ Q.between(a.unknowns[None], b.unknowns[None])[0] @ b.by_unknown.T)


def _meet(pattern: Pattern, a: IntArray, b: IntArray) -> bool:
    """Return whether all photos of two sets of unknowns meet one another in the run."""
    i, j = (np.unique(part[part < pattern.order] // pattern.size) for part in (a, b))
    low, high = np.minimum(i[:, None], j), np.maximum(i[:, None], j)
    return bool(np.isin(low * pattern.count + high, pattern.keys).all())


def _compiled_network(model: CompiledModel, rows: IntArray) -> tuple[Network, State]:
    _, network, state = network_of(model.stereo.run, model.stereo.photos, model.readings.part(rows))
    state = replace(state, ground=model.stereo.run.frame.working(model.points.position[rows]))
    wet = model.points.wet[rows].T.reshape(-1)
    return network.with_plates(network.xy, wet), state


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
    _, network, state = network_of_plates(run, taken(block.points, points), part)
    state = replace(state, ground=run.frame.working(run.position[points]))
    line = water_line(network, state, block.points.bathymetric[points])
    return network.with_plates(network.xy, line.wet), state


def _influences(run: AdjustedRun, network: Network, state: State, points: IntArray) -> dict[int, _Influence]:
    """Return the influences of the points of a network."""
    out: dict[int, _Influence] = {}
    Q = covariances_in(run, network.pattern, network.border.size)
    every = np.ones(len(network.photo), dtype=bool)
    for group in group_points(network.photo, network.point, every, np.isin(np.arange(network.points), points)):
        if group.rays.shape[1] < 2:
            continue
        for _, piece in pieces(network, state, group, Q):
            unknowns = network.unknowns(piece.group, piece.E.extras.index)
            for place, point in enumerate(piece.group.point.tolist()):
                out[point] = _Influence(
                    by_unknown=piece.F[place], unknowns=unknowns[place], alone=piece.E.inverse[place]
                )
    return out
