"""The reduction of plates, in the order of the field; what every step did is part of the result.

    repeated readings meaned -> comparator -> fiducial transformation -> reseau -> lens distortion
    -> atmospheric refraction -> earth curvature

which undoes, last influence first, what happened to a ray: the earth's shape, the air, the lens, the film, the
comparator. Marks and crosses of the reseau take the same way as the points, up to the step that they serve.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.reduction import displacements, fiducials, readings
from musatpy.reduction.displacements import Curvature, View
from musatpy.reduction.fiducials import Axes, DistanceFit, FiducialSolution, Marks, Reason, Refusal
from musatpy.reduction.planar import PlanarKind
from musatpy.reduction.reseau import Reseau


class Step(Protocol):
    """What every step can do with points (m, 2)."""

    def apply(self, xy: FloatArray) -> FloatArray:
        """Return the points after the step."""

    def partials(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (m, 2, 2) of the points after it by those before, which are given."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Applied:
    """One step and what it did to the m points of a plate."""

    name: str  # comparator, fiducials, reseau, lens, refraction, curvature
    step: Step
    before: FloatArray  # (m, 2)
    after: FloatArray  # (m, 2) mm
    displaces: bool  # within the fiducial system; False: it takes the points from one system to another

    @property
    def displacement(self) -> FloatArray:
        """Return the displacements (m, 2) mm, NaN of a step that changes the system."""
        shift = self.after - self.before
        return shift if self.displaces else np.full_like(shift, np.nan)

    @property
    def largest(self) -> float:
        """Return the largest displacement applied, mm; NaN where the step changes the system, or without points."""
        length = np.linalg.norm(self.displacement, axis=1)
        length = length[np.isfinite(length)]
        return float(length.max()) if length.size else float("nan")


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateReduction:
    """What came of one plate: m points, the means of repeated readings.

    `xy` are refined plate coordinates in the fiducial system, NaN where `refusal` says why there are none.
    `by_reading` are their derivatives by the mean readings, and `sigma` what the sigmas of the readings
    become by them.
    """

    photo: str
    ids: TextArray  # (m,)
    xy: FloatArray  # (m, 2) mm
    sigma: FloatArray  # (m, 2) mm
    by_reading: FloatArray  # (m, 2, 2)
    mark_means: readings.Means
    point_means: readings.Means
    cross_means: readings.Means
    marks: FiducialSolution | None  # None: no fiducial step, or one by distances
    mark_distances: DistanceFit | None
    ends: TextArray  # (e, 2) marks of the distances that were fitted
    steps: tuple[Applied, ...]
    beyond_reseau: tuple[str, ...]  # points outside the crosses measured, which follow the nearest cell
    beyond_table: tuple[str, ...]  # points outside the calibrated radii of the lens
    refusal: Refusal | None

    def step(self, name: str) -> Applied | None:
        """Return a step by its name, None where it was not taken."""
        return next((applied for applied in self.steps if applied.name == name), None)


def reduce_plate(
    plate: readings.PlateReadings, camera: readings.Calibration, plan: readings.ReductionPlan
) -> PlateReduction:
    """Return the refined coordinates of one plate, or why it is refused."""
    return _Reducer(plate, camera, plan).result()


class _Reducer:
    """One plate on its way: each step takes the points, and the marks and crosses as long as they are needed."""

    def __init__(
        self, plate: readings.PlateReadings, camera: readings.Calibration, plan: readings.ReductionPlan
    ) -> None:
        self.plate, self.camera, self.plan = plate, camera, plan
        sigma, limit = plan.reading_sigma, plan.repeat_limit
        self.marks = readings.mean_readings(plate.mark_ids, plate.marks, sigma, limit)
        self.points = readings.mean_readings(plate.point_ids, plate.points, sigma, limit)
        self.crosses = readings.mean_readings(plate.cross_ids, plate.crosses, sigma, limit)
        self.mark_xy, self.xy, self.cross_xy = self.marks.xy, self.points.xy, self.crosses.xy
        self.steps: list[Applied] = []
        self.solution: FiducialSolution | None = None
        self.by_distances: DistanceFit | None = None
        self.ends: TextArray = np.zeros((0, 2), dtype=np.str_)
        self.in_system = plan.fiducials is None  # the points stand in the fiducial system
        self.beyond: dict[str, tuple[str, ...]] = {"reseau": (), "lens": ()}

    def result(self) -> PlateReduction:
        refusal = self._interior() or self._image()
        if refusal is not None:
            self.xy = np.full_like(self.xy, np.nan)
        by_reading = np.broadcast_to(np.eye(2), (len(self.xy), 2, 2))
        for applied in self.steps:
            by_reading = applied.step.partials(applied.before) @ by_reading
        variance = np.square(self._sigma(self.points, self.plate.point_sigma))
        sigma = np.sqrt(np.einsum("mij,mj->mi", np.square(by_reading), variance))
        return PlateReduction(
            photo=self.plate.photo,
            ids=self.points.ids,
            xy=self.xy,
            sigma=np.where(np.isfinite(self.xy), sigma, np.nan),
            by_reading=by_reading,
            mark_means=self.marks,
            point_means=self.points,
            cross_means=self.crosses,
            marks=self.solution,
            mark_distances=self.by_distances,
            ends=self.ends,
            steps=tuple(self.steps),
            beyond_reseau=self.beyond["reseau"],
            beyond_table=self.beyond["lens"],
            refusal=refusal,
        )

    def _sigma(self, means: readings.Means, given: FloatArray | None) -> FloatArray:
        """Return the sigmas (g, 2) of means, of those of their readings."""
        stated = self.plan.reading_sigma
        each = np.full(means.deviations.shape, stated) if given is None else np.where(given > 0.0, given, stated)
        total = np.zeros_like(means.xy)
        np.add.at(total, means.target, np.square(each))
        return np.sqrt(total) / means.count[:, None]

    def _take(self, name: str, step: Step) -> None:
        before = self.xy
        self.xy = step.apply(before) if len(before) else before
        displaces = self.in_system and name != "comparator"
        self.steps.append(Applied(name=name, step=step, before=before, after=self.xy, displaces=displaces))
        self.in_system = self.in_system or name in ("fiducials", "reseau")

    def _interior(self) -> Refusal | None:
        """Take the steps from the readings to the fiducial system."""
        if self.plan.comparator is not None:
            self._take("comparator", self.plan.comparator)
            self.mark_xy = self.plan.comparator.apply(self.mark_xy)
            self.cross_xy = self.plan.comparator.apply(self.cross_xy)
        if self.plan.fiducials is None:
            return None
        if self.camera.distances is not None:
            return self._distances(self.camera.distances)
        if len(self.camera.mark_ids):
            return self._fiducials(self.plan.fiducials)
        if self.plan.reseau and self.camera.reseau is not None and len(self.crosses.ids):
            return None  # the crosses alone lead to the fiducial system
        message = "the camera has no calibrated marks, distances or crosses that were measured"
        return Refusal(reason=Reason.MISSING, message=message)

    def _fiducials(self, kind: PlanarKind) -> Refusal | None:
        mark_sigma = np.where(np.isfinite(self.camera.mark_sigma), self.camera.mark_sigma, self.plan.mark_sigma)
        turned = np.eye(2) if self.plan.comparator is None else self.plan.comparator.matrix()
        sigma = np.sqrt(np.square(self._sigma(self.marks, self.plate.mark_sigma)) @ np.square(turned).T)
        self.solution = fiducials.transform(
            kind,
            Marks(ids=self.marks.ids, xy=self.mark_xy, sigma=sigma),
            Marks(ids=self.camera.mark_ids, xy=self.camera.marks, sigma=mark_sigma),
            self.plan.limits,
        )
        if self.solution.refusal is None and self.solution.fit is not None:
            self._take("fiducials", self.solution.fit.plane)
            self.cross_xy = self.solution.fit.plane.apply(self.cross_xy)
        return self.solution.refusal

    def _distances(self, known: readings.MarkDistances) -> Refusal | None:
        row = {str(name): i for i, name in enumerate(self.marks.ids)}
        axes = (*known.first, *known.second)
        missing = tuple(dict.fromkeys(name for name in axes if name not in row))
        if missing:
            message = f"marks {', '.join(missing)} of the axes are not measured"
            return Refusal(reason=Reason.MISSING, message=message, ids=missing)
        usable = np.array([a in row and b in row for a, b in known.ends.tolist()], dtype=bool)
        ends = np.array([[row[a], row[b]] for a, b in known.ends[usable].tolist()], dtype=np.int64).reshape(-1, 2)
        first, second = ((row[pair[0]], row[pair[1]]) for pair in (known.first, known.second))
        self.by_distances = fiducials.fit_distances(
            known.scales,
            self.mark_xy,
            ends,
            known.distance[usable],
            known.sigma[usable],
            Axes(first=first, second=second, corners=known.corners),
        )
        return self._judge_distances(known.ends[usable])

    def _judge_distances(self, ends: TextArray) -> Refusal | None:
        fit, limits = self.by_distances, self.plan.limits
        if fit is None:
            message = "the distances do not give scales and axes: too few, in one direction, or a mirrored plate"
            return Refusal(reason=Reason.DEGENERATE, message=message)
        self.ends = ends
        worst = int(np.abs(fit.residuals).argmax())
        if abs(fit.residuals[worst]) > limits.residual:
            a, b = ends[worst].tolist()
            message = f"distance {a} - {b} is {limits.exceeded_by(fit.residuals[worst])}"
            return Refusal(reason=Reason.LIMIT, message=message, ids=(a, b))
        self._take("fiducials", fit.plane)
        self.cross_xy = fit.plane.apply(self.cross_xy)
        return None

    def _image(self) -> Refusal | None:
        """Take the steps within the fiducial system."""
        refusal = self._film()
        if refusal is not None:
            return refusal
        lens = self.camera.lens if self.plan.lens else None
        if lens is not None:
            self._take("lens", lens)
            self.beyond["lens"] = self._named(lens.beyond_table(self.steps[-1].before))
        view = View(
            focal_length=self.camera.focal_length,
            principal_point=self.camera.principal_point,
            nadir=self.plate.nadir,
        )
        high, low = self.plate.camera_height, self.plate.ground_height
        if self.plan.refraction is not None:
            try:
                K = displacements.constant(self.plan.refraction, high, low)
            except ValueError as error:
                return Refusal(reason=Reason.HEIGHTS, message=str(error))
            self._take("refraction", displacements.Refraction(view=view, K=K))
        if self.plan.curvature:
            if not high > low:
                message = "earth curvature needs the heights of camera and ground, the camera above"
                return Refusal(reason=Reason.HEIGHTS, message=message)
            self._take("curvature", Curvature(view=view, height=high - low, radius=self.plan.earth_radius))
        return self._lost()

    def _film(self) -> Refusal | None:
        grid = self.camera.reseau if self.plan.reseau else None
        if grid is None or not len(self.crosses.ids):
            return None
        row = {str(name): i for i, name in enumerate(self.crosses.ids)}
        measured = np.full_like(grid.xy, np.nan)
        for index, name in np.ndenumerate(grid.ids):
            if str(name) in row:
                measured[index] = self.cross_xy[row[str(name)]]
        try:
            reseau = Reseau(calibrated=grid.xy, measured=measured)
        except ValueError as error:
            return Refusal(reason=Reason.MISSING, message=str(error))
        self.beyond["reseau"] = self._named(~reseau.inside(self.xy))
        self._take("reseau", reseau)
        return None

    def _lost(self) -> Refusal | None:
        lost = self._named(np.asarray(~np.isfinite(self.xy).all(axis=1)))
        if not lost:
            return None
        message = f"no position of {', '.join(lost)} fits the calibration of the camera"
        return Refusal(reason=Reason.LOST, message=message, ids=lost)

    def _named(self, rows: BoolArray) -> tuple[str, ...]:
        return tuple(str(name) for name in self.points.ids[rows])
