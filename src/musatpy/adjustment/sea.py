"""Waves on the water of a job, known beforehand: refraction at any surface in place of the flat one.

The surface stands on the level water of each exposure, its tide. Its axes x and y are east and north at the origin
of the waves, carried to each ground point without a turn about the vertical; the vertical is that of the ground
point, as for the flat surface.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from musatpy.errors import AdjustmentError, Problem
from musatpy.geometry.frames import Frame
from musatpy.model import Block, Program, Refraction, Treatment
from musatpy.model.waves import SIGMAS
from musatpy.refraction.flat import Incidence, RefractedRay

if TYPE_CHECKING:  # most runs have no waves
    from musatpy.refraction.bending import WaveRay
    from musatpy.refraction.surface import Surface

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Result = TypeVar("Result")


@dataclass(frozen=True, kw_only=True, eq=False)
class Sea:
    """Waves over the tides of a job, their parameters known.

    surface: heights about level 0, axes east, north, up (m) about `origin`; time (n,) s of the exposure of each
    photo; origin (3,) in the job's coordinate system, where the surface has its x = y = 0.
    """

    surface: Surface
    time: FloatArray
    origin: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class WorkingSea:
    """A sea in the working frame of a job: origin (3,) and axes (3, 3), rows east, north, up there."""

    sea: Sea
    frame: Frame
    origin: FloatArray
    axes: FloatArray

    @classmethod
    def of(cls, sea: Sea, frame: Frame) -> WorkingSea:
        """Return the sea in a frame."""
        origin = np.asarray(frame.working(sea.origin))
        return cls(sea=sea, frame=frame, origin=origin, axes=np.asarray(frame.axes(origin)))

    def incidence(
        self, photo: IntArray, camera: FloatArray, ground: FloatArray, tide: FloatArray, index: float
    ) -> Incidence:
        """Return the incidence points of rays (N,) from ground points to cameras (N, 3), with partials as `flat`.

        A point above its wave keeps its straight ray. Raises `AdjustmentError`.
        """
        from musatpy.refraction import fermat

        R, lift = self._local(ground)
        found = _refracted(
            lambda: fermat.incidence(
                self.sea.surface,
                self._place(R, lift - tide, camera, ground),
                self._place(R, lift - tide, ground, ground),
                index,
                self.sea.time[photo],
            )
        )
        Rt = np.swapaxes(R, -1, -2)
        return Incidence(
            v=_turned(Rt, found.v),
            by_camera=Rt @ found.by_camera @ R,
            by_ground=Rt @ found.by_ground @ R,
            by_level=_turned(Rt, found.by_level),
            by_index=_turned(Rt, found.by_index),
        )

    def refracted_ray(
        self,
        photo: IntArray,
        camera: FloatArray,
        direction: FloatArray,
        ground: FloatArray,
        tide: FloatArray,
        index: float,
    ) -> tuple[RefractedRay, FloatArray]:
        """Return where image rays (N,) enter the water, and the partials (N, 3, 3) of their direction by camera.

        The ground points (N, 3) only say where the vertical is. Raises `AdjustmentError`.
        """
        from musatpy.refraction import bending

        R, lift = self._local(ground)
        start = self._place(R, lift - tide, camera, ground)
        bent: WaveRay = _refracted(
            lambda: bending.refracted_ray(
                self.sea.surface, start, _turned(R, direction), index, self.sea.time[photo]
            )
        )
        Rt = np.swapaxes(R, -1, -2)
        ray = RefractedRay(
            origin=camera + _turned(Rt, bent.origin - start),
            direction=_turned(Rt, bent.direction),
            origin_by_camera=Rt @ bent.origin_by_camera @ R,
            origin_by_direction=Rt @ bent.origin_by_direction @ R,
            direction_by_direction=Rt @ bent.direction_by_direction @ R,
            origin_by_level=_turned(Rt, bent.origin_by_level),
            direction_by_index=_turned(Rt, bent.direction_by_index),
        )
        return ray, Rt @ bent.direction_by_camera @ R

    def _local(self, ground: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the axes (N, 3, 3) at ground points, rows x, y, up, and the heights (N,) of these points."""
        up, height = self.frame.vertical(ground)
        up = np.broadcast_to(up, ground.shape)
        old = self.axes[2]
        # the shortest turn from the vertical at the origin to that at the ground point
        lean = np.einsum("ni,ki->nk", up, self.axes[:2]) / (1.0 + up @ old)[:, None]
        rows = self.axes[:2] - lean[:, :, None] * (up + old)[:, None, :]
        return np.concatenate([rows, up[:, None, :]], axis=1), height

    def _place(self, R: FloatArray, lift: FloatArray, point: FloatArray, ground: FloatArray) -> FloatArray:
        """Return local coordinates (N, 3) of points: x, y about the origin of the waves, z above the tide."""
        plan = _turned(R, point - self.origin)[:, :2]
        z = np.einsum("ni,ni->n", R[:, 2], point - ground) + lift
        return np.concatenate([plan, z[:, None]], axis=1)


def sea_of(block: Block, given: Sea | None) -> Sea | None:
    """Return the waves that stand on the water of a block: those of its cards, or those `given` beside it.

    The only place that makes a sea of cards. Raises `AdjustmentError` with every reason why it cannot be adjusted
    with.
    """
    waves, origin = block.waves, block.wave_origin
    if not len(waves.ids):
        if given is not None:
            require_sea(block, given)
        return given
    reasons = []
    if given is not None:
        reasons.append("waves stand on the cards of the job, and others are given beside it")
    if origin is None:
        reasons.append("waves need the place from which their crests count")
    if np.isfinite([getattr(waves, name) for name in SIGMAS]).any():
        reasons.append("waves with sigmas: their parameters must be known")
    if reasons or origin is None:
        raise AdjustmentError([Problem(message=reason) for reason in reasons])
    from musatpy.waves.deck import surface_of  # most jobs have none

    try:
        surface = surface_of(waves)
    except ValueError as error:
        raise AdjustmentError([Problem(message=f"waves: {error}")]) from error
    sea = Sea(surface=surface, time=block.photos.time, origin=np.array(origin.position))
    require_sea(block, sea)
    return sea


def require_sea(block: Block, sea: Sea) -> None:
    """Raise `AdjustmentError` where a block cannot be adjusted with waves, with every reason."""
    options, water = block.options, block.water
    reasons = []
    if options.program is not Program.IIIA and options.refraction is not Refraction.RIGOROUS:
        reasons.append("waves need the refraction RIGOROUS, or the program IIIA")
    if options.water_tilt is Treatment.ADJUST or (water and (water.tilt_east or water.tilt_north)):
        reasons.append("waves stand on level water: a tilt of it and waves exclude each other")
    if np.shape(sea.time) != block.photos.tide.shape:
        reasons.append("waves need the time of every exposure above water")
    else:
        seen = np.unique(block.plates.photo[np.isfinite(block.photos.tide)[block.plates.photo]])
        lacking = ", ".join(block.photos.ids[seen[~np.isfinite(sea.time[seen])]])
        if lacking:
            reasons.append(f"waves need the time of every exposure above water; there is none of photo {lacking}")
    if reasons:
        raise AdjustmentError([Problem(message=reason) for reason in reasons])


def _refracted(trace: Callable[[], Result]) -> Result:
    try:
        return trace()
    except ValueError as error:
        raise AdjustmentError([Problem(message=f"waves: {error}")]) from error


def _turned(R: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("nij,nj->ni", R, vectors))
