"""The plotter's real-time loop: the mark in the model -> both stages, and back, through the water.

`TRUE`: the mark is the true point, the stages stand at its refracted images, no y-parallax is left. `AIR`: the mark
is where straight rays meet, as on the AS-11AM of 1983. Stages are refined plate coordinates. Waves of the run stand
as they did at the exposure of each photo, whatever the time on the plotter.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from musatpy.adjustment.water_surface import surface
from musatpy.adjustment.wavy_water import WorkingSea
from musatpy.arrays import FloatArray
from musatpy.compilation.stereomodels import Stereomodel
from musatpy.errors import CompilationError, Problem
from musatpy.geometry import collinearity
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
    """The loop of one stereomodel; what stays from cycle to cycle is computed once.

    Raises `CompilationError` where marks are true points and the water is not known at both photos.
    """

    stereo: Stereomodel
    drive: Drive = Drive.TRUE
    camera: FloatArray = field(init=False)  # (2, 3) working
    turn: FloatArray = field(init=False)  # (2, 3, 3) working axes to photo
    focal_length: FloatArray = field(init=False)  # (2,) mm
    principal_point: FloatArray = field(init=False)  # (2, 2) mm
    slope: FloatArray = field(init=False)  # (3,) of the water, working
    sea: WorkingSea | None = field(init=False)  # waves on it

    def __post_init__(self) -> None:
        stereo, water = self.stereo, self.stereo.run.block.water
        if self.drive is Drive.TRUE and (water is None or not np.isfinite(stereo.tides).all()):
            raise CompilationError([Problem(message="true marks need water with a tide at both photos: drive AIR")])
        for name, value in (
            ("camera", stereo.working(stereo.stations)),
            ("turn", stereo.rotation @ stereo.axes),
            ("focal_length", stereo.camera("focal_length")),
            ("principal_point", stereo.camera("principal_point")),
            ("slope", stereo.water_slope),
            ("sea", None if stereo.run.sea is None else WorkingSea.of(stereo.run.sea, stereo.run.frame).known),
        ):
            object.__setattr__(self, name, value)

    def stages(self, mark: FloatArray) -> Stages:
        """Return the stages of marks (k, 3) in the model, with their partials.

        Raises `AdjustmentError` where a ray cannot be followed through waves.
        """
        ground = np.repeat(self.stereo.working(mark)[:, None], 2, axis=1)
        v, by_ground = ground - self.camera, np.broadcast_to(np.eye(3), (*ground.shape, 3))
        if self.drive is Drive.TRUE:
            bent = self._incidence(ground)
            v, by_ground = bent.v.reshape(v.shape), bent.by_ground.reshape(by_ground.shape)
        xy, by_v = collinearity.image_by_vector(v, self.turn, self.focal_length, self.principal_point)
        return Stages(xy=xy, by_mark=by_v @ by_ground @ self.stereo.axes.T)

    def _incidence(self, ground: FloatArray) -> flat.Incidence:
        """Return the incidence points of marks (k, 2, 3) at the exposures of both photos."""
        camera, tides, index = np.broadcast_to(self.camera, ground.shape), self.stereo.tides, self.stereo.index
        if self.sea is None:
            over = surface(self.stereo.run.frame, self.slope, tides, ground)
            return flat.incidence(camera, ground, over.normal, over.depth, index)
        photo, tide = np.tile(self.stereo.photos, len(ground)), np.tile(tides, len(ground))
        return self.sea.incidence(photo, camera.reshape(-1, 3), ground.reshape(-1, 3), tide, index)

    def mark(self, xy: FloatArray) -> FloatArray:
        """Return the marks (k, 3) in the model of stages (k, 2, 2) mm: the least squares of their coordinates.

        A mark on the water line, from whose either side the other is nearer, is approached by ever shorter steps.
        """
        mark, active = self.stereo.apparent(xy), np.arange(len(xy))
        factor, last = np.ones(len(xy)), np.full(len(xy), np.inf)
        for _ in range(_STEPS):
            now = self.stages(mark[active])
            B, v = now.by_mark.reshape(-1, 4, 3), (xy[active] - now.xy).reshape(-1, 4, 1)
            Bt = np.swapaxes(B, 1, 2)
            step = np.linalg.solve(Bt @ B, Bt @ v)[..., 0] * factor[active, None]
            mark[active] += step
            size = np.abs(step).max(axis=1)
            factor[active] *= np.where(size > 0.5 * last[active], 0.5, 1.0)
            last[active] = size
            active = active[size > _STILL]
            if not len(active):
                break
        return mark
