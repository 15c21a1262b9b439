"""The plotter's real-time loop: the mark in the model -> both stages, and back, through the water.

`TRUE`: the mark is the true point, the stages stand at its refracted images, no y-parallax is left. `AIR`: the mark
is where straight rays meet, as on the AS-11AM of 1983. Stages are refined plate coordinates. Waves of the run stand
as they did at the exposure of each photo, whatever the time on the plotter.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from musatpy.adjustment.wavy_water import WorkingSea
from musatpy.arrays import FloatArray
from musatpy.compilation.stereomodels import Stereomodel
from musatpy.errors import CompilationError, Problem
from musatpy.geometry import collinearity
from musatpy.geometry.geodesy import surface
from musatpy.refraction import flat

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

    def mark(self, xy: FloatArray) -> FloatArray:
        """Return the marks (k, 3) in the model of stages (k, 2, 2) mm: the least squares of their coordinates.

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

    def _incidence(self, mark: FloatArray) -> flat.Incidence:
        """Return the rays (2 k,) from both stations to marks through the water, in working axes."""
        stereo, frame, count = self.stereo, self.stereo.run.frame, len(mark)
        ground = np.repeat(stereo.working(mark), 2, axis=0)
        camera, tide = np.tile(stereo.working(stereo.stations), (count, 1)), np.tile(stereo.tides, count)
        if self.sea is not None:
            return self.sea.incidence(np.tile(stereo.photos, count), camera, ground, tide, stereo.index)
        over = surface(frame, stereo.water_slope, tide, ground)
        return flat.incidence(camera, ground, over.normal, over.depth, stereo.index)
