"""What every orientation of a task has: photos, points and the water, in the system of the job or of a model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from musatpy import model
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix
from musatpy.model.block import in_order
from musatpy.model.findings import GRADES, Concern, Reason, Verdict
from musatpy.model.tables import empty
from musatpy.orientation.twomedia.oriented import PlaneVerdict
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orienting.task import OrientationTask


@dataclass(frozen=True, kw_only=True, eq=False)
class Placement:
    """m photos, p points and the water of a task as oriented. Sigmas are scaled by sigma0, NaN for what is held.

    `at` has the photos over the water, in the axes of the task, and inside (p, 3) the points in these axes, NaN for
    those without a place; depth (p,) m is that below the water, negative above it. outliers (p,) are left out, as
    they do not fit; rays (p,) are the images that took part. sigma0 is NaN without redundancy, and `fits` says
    whether it passes its test. `plane`: whether the plane is determined, and the sigma of its level over the mean
    depth. Of photos there are sigmas (m, 3) in m and rad, and phi, omega, kappa, X0, Y0, Z0 of the paper (m, 6);
    point_sigma (p, 3) m is that of points without control. water (4,) has slopes towards X and Y, the level at the
    origin of the axes (m) and the index. `misgivings` speak against it all, besides points on the wrong side of the
    water.
    """

    task: OrientationTask
    at: Orientation
    inside: FloatArray
    depth: FloatArray
    outliers: BoolArray
    rays: IntArray
    sigma0: float
    redundancy: int
    fits: bool
    plane: tuple[PlaneVerdict, float]
    position_sigma: FloatArray
    attitude_sigma: FloatArray
    point_sigma: FloatArray
    paper_photos: FloatArray
    paper_photo_sigmas: FloatArray
    water: FloatArray
    water_sigma: FloatArray
    misgivings: tuple[Reason, ...]

    @property
    def block(self) -> model.Block:
        """The block, its plates refined."""
        return self.task.block

    @property
    def photos(self) -> TextArray:
        """(m,)."""
        return self.task.sights.photos

    @property
    def summary(self) -> str:
        """The plane of water in a few words."""
        plane, share = self.plane
        text = f"plane of water {plane} ({share:.3g} of the depth)"
        return "no point under water: straight rays" if self.task.dry else text

    @cached_property
    def position(self) -> FloatArray:
        """(m, 3) in the system of the job, or of the model."""
        return self.task.axes.system(self.at.station)

    @cached_property
    def attitude(self) -> FloatArray:
        """(m, 3) rad, in the local vertical of the station, or the axes of the model."""
        return local_attitude(self.task, self.at)

    @cached_property
    def point_position(self) -> FloatArray:
        """(p, 3) in the system of the job, or of the model, NaN where there is none."""
        place = np.full(self.inside.shape, np.nan)
        known = np.isfinite(self.inside).all(axis=1)
        place[known] = self.task.axes.system(self.inside[known])
        return place

    @property
    def control(self) -> TextArray:
        """(p,) the components that are known: XYZ, XY, XZ, ..., or nothing."""
        known = np.isfinite(self.task.sights.control)
        texts = np.char.add(np.where(known[:, 0], "X", ""), np.where(known[:, 1], "Y", ""))
        return np.char.add(texts, np.where(known[:, 2], "Z", ""))

    @cached_property
    def verdict(self) -> Verdict:
        """What the answer is worth; points on the other side of the water than their flag says make it doubtful."""
        ids, wet = self.task.sights.points, self.task.sights.wet
        contradictions = (
            (wet & (self.depth < 0.0), "flagged submerged, and stand above the water"),
            (~wet & (self.depth > 0.0), "not flagged submerged, and stand under it"),
        )
        reasons = [*self.misgivings]
        for rows, what in contradictions:
            if rows.any():
                reasons.append(doubt(Concern.STATION, f"points {', '.join(ids[rows].tolist())} are {what}"))
        return Verdict(reasons=tuple(sorted(reasons, key=lambda reason: -GRADES.index(reason.grade))))


def local_attitude(task: OrientationTask, at: Orientation) -> FloatArray:
    """Return attitudes (m, 3), rad, in the local vertical of the stations, or the axes of the model."""
    turn = task.axes.local_turn(at.station)
    return attitude_from_matrix(attitude_matrix(at.attitude) @ np.swapaxes(turn, -1, -2))


doubt, rejection = (partial(Reason, grade, section="") for grade in (model.Grade.DOUBTFUL, model.Grade.REJECTED))


def misfit(sigma0: float, what: str = "images") -> Reason:
    """Return the reason to reject an answer whose images, or `what` there is, do not fit."""
    return rejection(Concern.SIGMA0, f"sigma0 {sigma0:.3g}: the {what} do not fit, by the test of 99.9 %")


def left_out(ids: TextArray, outliers: BoolArray) -> list[Reason]:
    """Return the doubt of points that do not fit."""
    text = f"left out, as they do not fit: {', '.join(ids[outliers].tolist())}"
    return [doubt(Concern.OBSERVATION, text)] if outliers.any() else []


def punched(task: OrientationTask, at: Orientation) -> model.Block:
    """Return the block that IIIA adjusts from an orientation, with the same of the water unknown.

    Of a model it is a free network in its axes, without the control, which stands in others.
    """
    block, options, plane = task.block, task.block.options, task.spec.plane
    photos, water = block.photos, block.water
    position, attitude, tide = photos.position.copy(), photos.attitude.copy(), photos.tide.copy()
    position[task.photos], attitude[task.photos] = task.axes.system(at.station), local_attitude(task, at)
    if not task.dry:  # the tilt of a deck turns about the middle of the stations
        rise = 0.0 if task.plane.rise is None else task.plane.rise
        tide[task.photos] = float(at.level) + at.station[:, :2].mean(axis=0) @ at.slope + rise
        tilted = plane is model.PlaneTreatment.ADJUST or at.slope.any()
        east, north = (float(part) if tilted else None for part in at.slope)
        water = None if water is None else replace(water, tilt_east=east, tilt_north=north)
    result = replace(
        block,
        options=replace(
            options,
            program=model.Program.IIIA,
            refraction=model.Refraction.RIGOROUS,
            system=model.CoordinateSystem.LOCAL if task.in_model else options.system,
            initial=model.Initial.GIVEN,
            water_level=model.WaterLevel.KNOWN if plane is model.PlaneTreatment.KNOWN else model.WaterLevel.ONE,
            water_tilt=model.Treatment.ADJUST if plane is model.PlaneTreatment.ADJUST else model.Treatment.KNOWN,
            datum=model.Datum.FREE if task.in_model else model.Datum.CONTROL,
        ),
        orientation=None,
        photos=replace(photos, position=position, attitude=attitude, tide=tide),
        water=water,
    )
    if not task.in_model:
        return result
    return in_order(replace(result, ellipsoid=None, control=empty(model.Control), given_in=None, stated_in=None))
