"""Points corrected by their sea: through an estimated surface of the water, or by errors at control points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.correction.methods import REASON, SIGMAS, CorrectedPoints, Method, ResultColumn, Tally
from musatpy.errors import CollocationError, Problem, ProblemsError, SeaError
from musatpy.geometry.crs import MapPlan
from musatpy.geometry.projected import Projected
from musatpy.refraction.apparent import REASONS, Fault
from musatpy.sea.interpolation.interpolate import Interpolation
from musatpy.sea.stereo import through
from musatpy.sea.stereo.point_records import SIGMA, PointPrecision
from musatpy.sea.stereo.surface_points import FittedSurface


@dataclass(frozen=True, kw_only=True, eq=False)
class ThroughSurface(Method):
    """Apparent points of a pair of stations (2, 3) seen through a surface, on a map or in local coordinates."""

    fitted: FittedSurface
    stations: FloatArray
    index: float
    precision: PointPrecision
    source: str  # file of the stations
    map: Projected | None = None
    inputs: ClassVar[tuple[str, ...]] = SIGMA

    @property
    def columns(self) -> Mapping[str, ResultColumn]:
        """What is said of a point beside its places."""
        return {
            "depth": ResultColumn("below the level of the water, m"),
            "parallax": ResultColumn("in air, made by the waves, m"),
            "reason": REASON,
            **SIGMAS,
            "sigma_surface": ResultColumn("part of it by the surface, m"),
        }

    def require_use(self, source: Path, tally: Tally, apparent: FloatArray) -> None:
        """Raise `SeaError` where sigmas were given besides those of all points."""
        if self.precision.is_known and tally.corrected and not tally.lacking:
            message = "all points of the file have sigmas of their own, so none can be given"
            raise SeaError([Problem(file=str(source), message=message)])

    def corrected(self, points: FloatArray, covariance: FloatArray, classes: IntArray) -> CorrectedPoints:
        """Return true places, depths, parallaxes and sigmas; without a covariance by the precision."""
        plan = None if self.map is None else MapPlan(system=self.system, map=self.map)
        apparent = points if plan is None else plan.places(points)
        unknown = np.isnan(covariance[:, 0, 0])
        given = self.precision.covariance(apparent[unknown], plan)
        covariance[unknown] = np.nan if given is None else given
        try:
            seen = through.correct(self.fitted, self.stations, apparent, covariance, self.index, plan)
        except ValueError as error:
            raise SeaError([Problem(file=self.source, message=str(error))]) from error
        true, good = seen.position.copy(), seen.fault == Fault.NONE
        if plan is not None:
            true[good] = plan.coordinates(true[good])
        values = {
            "depth": self.fitted.level - seen.position[:, 2],
            "parallax": seen.parallax,
            **dict(zip(SIGMAS, seen.sigma.T, strict=True)),
            "sigma_surface": seen.surface_sigma,
        }
        fault, lacking = seen.fault.astype(np.int64), int(np.count_nonzero(unknown))
        return CorrectedPoints(true=true, fault=fault, values=values, lacking=lacking)


@dataclass(frozen=True, kw_only=True, eq=False)
class ByControl(Method):
    """Heights less the errors that are interpolated between control points, on the map of a plan if any."""

    interpolation: Interpolation
    plan: MapPlan | None = None
    error: ClassVar[type[ProblemsError]] = CollocationError

    @property
    def columns(self) -> Mapping[str, ResultColumn]:
        """What is said of a point beside its places."""
        correction = ResultColumn("of the height, m")
        return {"correction": correction, "reason": REASON, "sigma_height": SIGMAS["sigma_height"]}

    @property
    def reasons(self) -> Mapping[int, str]:
        """Why points are not corrected."""
        return {**REASONS, Fault.NO_CONTROL: f"no control within {self.interpolation.reach:.1f} m"}

    def corrected(self, points: FloatArray, covariance: FloatArray, classes: IntArray) -> CorrectedPoints:
        """Return true places, corrections of heights and their sigmas."""
        places = points if self.plan is None else self.plan.places(points)
        predicted = self.interpolation.uncertain.predict(places[:, :2])
        far = predicted.distance > self.interpolation.reach
        correction, sigma = np.where(far, np.nan, [-predicted.value, self.interpolation.sigma(predicted)])
        return CorrectedPoints(
            true=np.where(far[:, None], np.nan, points + np.outer(correction, [0.0, 0.0, 1.0])),
            fault=np.where(far, Fault.NO_CONTROL, Fault.NONE),
            values={"correction": correction, "sigma_height": sigma},
        )

    def lines(self, tally: Tally) -> list[str]:
        """Return what has come of points in words."""
        first, *lost = super().lines(tally)
        return [f"{first}, by {tally.rms('correction'):.3f} m RMS", *lost]
