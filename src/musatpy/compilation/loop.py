"""The plotter's real-time loop: the mark in the model -> both stages, and back, through the water.

`TRUE`: the mark is the true point, the stages stand at its refracted images, no y-parallax is left. `AIR`: the mark
is where straight rays meet, as on the AS-11AM of 1983. Stages are refined plate coordinates. Waves of the run stand
as they did at the exposure of each photo, whatever the time on the plotter.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property

import numpy as np

from musatpy.adjustment.wavy_water import WorkingSea
from musatpy.arrays import BoolArray, FloatArray
from musatpy.compilation.bent_rays import Image, Matrix, Numbers, Value, Vector, matrix, turned_by
from musatpy.compilation.pair_images import (
    APART,
    AT_REST,
    Pair,
    Side,
    Vertical,
    Water,
    chunks,
    curvature,
    image_of,
    inverse,
    look,
    met,
    size,
    step,
    sunk,
    water_over,
)
from musatpy.compilation.stereomodels import Stereomodel
from musatpy.errors import CompilationError, Problem
from musatpy.geometry import collinearity

_STEPS = 60
_STILL = 1e-7  # m; what is left after a step of this size is rounding


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
    """The loop of one stereomodel; what stays from cycle to cycle is computed once.

    Raises `CompilationError` where marks are true points and the water is not known at both photos.
    """

    stereo: Stereomodel
    drive: Drive = Drive.TRUE
    pair: Pair = field(init=False)  # in the model
    sea: WorkingSea | None = field(init=False)  # waves on its water

    def __post_init__(self) -> None:
        run, tides = self.stereo.run, self.stereo.tides
        if self.drive is Drive.TRUE and (run.block.water is None or not np.isfinite(tides).all()):
            raise CompilationError([Problem(message="true marks need water with a tide at both photos: drive AIR")])
        object.__setattr__(self, "pair", _pair(self.stereo))
        object.__setattr__(self, "sea", None if run.sea is None else WorkingSea.of(run.sea, run.frame).known)

    def stages(self, mark: FloatArray) -> Stages:
        """Return the stages of marks (k, 3) in the model, with their partials.

        Raises `AdjustmentError` where a ray cannot be followed through waves.
        """
        if self.drive is Drive.TRUE and self.sea is not None:
            return self._through_waves(self.sea, mark)
        if len(mark) == 1:
            with suppress(ZeroDivisionError):  # as high as a camera: infinite, as arrays have it
                return self._stages_of_one(mark)
        both, partials = np.empty((2, 2, len(mark))), np.empty((2, 2, 3, len(mark)))  # as they come: points last
        for rows in chunks(len(mark)):
            X = np.ascontiguousarray(mark[rows].T)
            vertical = self._vertical(X) if self.drive is Drive.TRUE else None
            for number, side in enumerate(self.pair.sides):
                self._put_images(both[number, :, rows], partials[number, ..., rows], side, X, vertical)
        return Stages(xy=np.moveaxis(both, -1, 0), by_mark=np.moveaxis(partials, -1, 0))

    def mark(self, xy: FloatArray) -> FloatArray:
        """Return the marks (k, 3) in the model of stages (k, 2, 2) mm: the least squares of their coordinates."""
        out, left = np.empty((len(xy), 3)), np.ones(len(xy), dtype=bool)
        if self.drive is Drive.AIR or self.sea is None:
            for rows in chunks(len(xy)):
                with np.errstate(all="ignore"):  # of rays that do not meet: these marks are not clear
                    X, clear = self._clear_marks(np.ascontiguousarray(xy[rows].reshape(-1, 4).T))
                out[rows], left[rows] = X.T, ~clear
        out[left] = self._approached(xy[left])
        return out

    @cached_property
    def _axes(self) -> Matrix:
        """The axes of the model by plain numbers."""
        return matrix(self.stereo.axes)

    @cached_property
    def _origin(self) -> Numbers:
        """The origin of the model by plain numbers."""
        x, y, z = self.stereo.origin.tolist()
        return x, y, z

    def _vertical(self, X: FloatArray) -> Vertical:
        """Return the vertical of marks (3, c), in the model."""
        x, y, z = X
        up, height = self._vertical_at(x, y, z)
        return np.stack(up), height

    def _vertical_at(self, x: Value, y: Value, z: Value) -> tuple[Vector[Value], Value]:
        """Return the vertical at a mark by components."""
        (a, b, c), (d, e, f), (g, h, i) = axes = self._axes
        sx, sy, sz = self._origin
        up, height = self.stereo.run.frame.vertical_at(
            a * x + d * y + g * z + sx, b * x + e * y + h * z + sy, c * x + f * y + i * z + sz
        )
        return turned_by(axes, up), height

    def _stages_of_one(self, mark: FloatArray) -> Stages:
        """Return the stages of one mark (1, 3), by plain numbers."""
        water, both, partials = self.pair.water, [], []
        (x, y, z), X = mark[0].tolist(), mark.T
        vertical = None
        if self.drive is Drive.TRUE:
            up, height = self._vertical_at(x, y, z)
            vertical = np.array(up)[:, None], np.array([height])
        for side in self.pair.sides:
            sx, sy, sz = side.place
            gap, surface = (x - sx, y - sy, z - sz), None
            if vertical is not None:
                over = water_over(water, side.tide, X, *vertical)
                depth = float(over.depth[0])
                if depth > 0.0:
                    (ux,), (uy,), (uz,) = over.normal.tolist()
                    surface = (ux, uy, uz), depth
            (right, up), by_mark = image_of(side, gap, surface, water.index)
            both.append((right, up))
            partials.append(by_mark)
        return Stages(xy=np.array([both]), by_mark=np.array([partials]))

    def _put_images(
        self, xy: FloatArray, by_mark: FloatArray, side: Side, X: FloatArray, vertical: Vertical | None
    ) -> None:
        """Put the images of marks (3, c) on a side into xy (2, c), and their partials into by_mark (2, 3, c).

        True marks have their vertical: those below the water are refracted.
        """
        (x, y, z), (sx, sy, sz) = X, side.place
        gap, index = (x - sx, y - sy, z - sz), self.pair.water.index
        over = None if vertical is None else water_over(self.pair.water, side.tide, X, *vertical)
        wet = np.zeros(len(x), dtype=bool) if over is None else over.depth > 0.0
        if over is not None and wet.all():
            _put(xy, by_mark, image_of(side, gap, (over.components, over.depth), index))
            return
        _put(xy, by_mark, image_of(side, gap, None, index))
        if over is not None and wet.any():
            below = over.part(wet)
            (gx, gy, gz), some = gap, np.empty((2, 4, int(wet.sum())))
            part = image_of(side, (gx[wet], gy[wet], gz[wet]), (below.components, below.depth), index)
            _put(some[:, 0], some[:, 1:], part)
            xy[:, wet], by_mark[..., wet] = some[:, 0], some[:, 1:]

    def _clear_marks(self, xy: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the marks (3, c) of stages (4, c), and which are clear: at rest, not on the water line."""
        pair, weight = self.pair, np.ones_like(xy)
        X, last, sine2 = met(pair, xy, weight)
        clear = (last < AT_REST) & (sine2 > APART) & pair.seen(X)
        if self.drive is Drive.AIR:
            return X, clear
        up, height = self._vertical(X)
        under = pair.gaps(X, height) > 0.0
        wet = np.flatnonzero(clear & under.all(axis=0))
        xy, weight = xy[:, wet], weight[:, wet]
        true = sunk(pair, xy, weight, X[:, wet], (up[:, wet], height[wet]))
        vertical = self._vertical(true)
        at = look(pair, xy, true, vertical)
        move = step(inverse(at.B, weight), at, weight)
        X[:, wet] = true + move
        clear &= ~under.any(axis=0) | under.all(axis=0)
        clear[wet] &= (size(move) < AT_REST) & (pair.gaps(true, vertical[1]) > AT_REST).all(axis=0)
        return X, clear

    def _approached(self, xy: FloatArray) -> FloatArray:
        """Return the marks (k, 3) of stages, step by step.

        One on the water line, from whose either side the other is nearer, is approached by ever shorter steps.
        """
        mark, active = self.stereo.half_way(xy), np.arange(len(xy))
        factor, last = np.ones(len(xy)), np.full(len(xy), np.inf)
        for _ in range(_STEPS):
            if not len(active):
                break
            now = self.stages(mark[active])
            B, v = now.by_mark.reshape(-1, 4, 3), (xy[active] - now.xy).reshape(-1, 4, 1)
            Bt = np.swapaxes(B, 1, 2)
            move = np.linalg.solve(Bt @ B, Bt @ v)[..., 0] * factor[active, None]
            mark[active] += move
            length = np.abs(move).max(axis=1)
            factor[active] *= np.where(length > 0.5 * last[active], 0.5, 1.0)
            last[active] = length
            active = active[length > _STILL]
        return mark

    def _through_waves(self, sea: WorkingSea, mark: FloatArray) -> Stages:
        """Return the stages of true marks through the waves at the exposures of both photos."""
        stereo, count = self.stereo, len(mark)
        ground, camera = (
            np.repeat(stereo.working(mark), 2, axis=0),
            np.tile(stereo.working(stereo.stations), (count, 1)),
        )
        photo, tide = np.tile(stereo.photos, count), np.tile(stereo.tides, count)
        bent = sea.incidence(photo, camera, ground, tide, stereo.index)
        v, by_mark = bent.v.reshape(-1, 2, 3) @ stereo.axes.T, bent.by_ground.reshape(-1, 2, 3, 3) @ stereo.axes.T
        focal_length, principal_point = stereo.camera("focal_length"), stereo.camera("principal_point")
        xy, by_v = collinearity.image_by_vector(v, stereo.rotation, focal_length, principal_point)
        return Stages(xy=xy, by_mark=by_v @ stereo.axes @ by_mark)


def _put(xy: FloatArray, by_mark: FloatArray, image: Image[FloatArray]) -> None:
    """Put an image by components into xy (2, c), and its partials into by_mark (2, 3, c)."""
    places, partials = image
    for row, (place, by) in enumerate(zip(places, partials, strict=True)):
        xy[row] = place
        for axis, component in enumerate(by):
            by_mark[row, axis] = component


def _pair(stereo: Stereomodel) -> Pair:
    """Return the pair of a model, in its axes."""
    slope = stereo.water_slope
    left, right = (
        Side(
            station=stereo.stations[number],
            M=stereo.rotation[number],
            focal_length=float(stereo.camera("focal_length")[number]),
            principal_point=stereo.camera("principal_point")[number],
            tide=float(stereo.tides[number] + slope @ stereo.origin),
        )
        for number in range(2)
    )
    level = Water(index=stereo.index, slope=stereo.axes @ slope, curvature=curvature(stereo.run.frame))
    return Pair(sides=(left, right), water=level)
