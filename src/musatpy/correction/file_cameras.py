"""Points of a cloud through the cameras of its file: to their pixels, and from there along rays through water.

A cloud of a program that knew of no water is where straight rays of its cameras meet, and these have bent to the
water. So each point goes back through these cameras to its pixels; from there refracted rays of the adjusted ones
meet, each at the water of its own photo. Dry points go the same way in air: there is no step at the shore.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
import pyproj

from musatpy.adjustment.iteration import State
from musatpy.adjustment.network import Network, PointGroup, group_points
from musatpy.adjustment.propagation import covariances_with_depths, pieces
from musatpy.adjustment.sightings import residuals, straight_rays
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.compilation.triangulation import AdjustedRun, covariances_in, of_record
from musatpy.compilation.true_points import at_rest, in_parts, network_of_plates
from musatpy.correction.methods import REASON, CorrectedPoints, Method, ResultColumn, Tally
from musatpy.errors import DepthError, Problem, ProblemsError
from musatpy.geometry.geodesy import surface, water_heights
from musatpy.model import PlateMeasurements, Points
from musatpy.model.tables import finite_rows
from musatpy.records import run_tables
from musatpy.records.json_files import read_record
from musatpy.reduction.pixel_lens import PixelLens
from musatpy.refraction.apparent import Fault
from musatpy.sfm.export import adjusted_lenses
from musatpy.sfm.model import links
from musatpy.sfm.source import FileCameras, cameras_of_job, spread_over
from musatpy.units import DEGREE, MICROMETRE

MODEL = "model"  # the system of points in the coordinates of the model itself
_COLUMNS = {
    "depth": ResultColumn("below the mean water of its photos, m"),
    "sigma_depth": ResultColumn("m"),
    "sigma_z": ResultColumn("of the height, m"),
    "sigma_h": ResultColumn("of the position in plan, m"),
    "dz": ResultColumn("true minus apparent height, m"),
    "incidence": ResultColumn("mean angle in air, degrees", "deg", decimals=2, in_layers=False),
    "rays": ResultColumn("photos that it is taken from", "", "u2"),
    "py": ResultColumn("RMS of its residuals, um", "um", decimals=2, in_layers=False),
    "reason": REASON,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class ByFileCameras(Method):
    """Points corrected through the cameras of their file, and the adjusted ones of a run of the same photos."""

    cameras: FileCameras
    run: AdjustedRun  # images ideal, about principal points of zero
    lenses: tuple[PixelLens, ...]  # adjusted
    rows: IntArray  # (n,) of the photos of the file in the run, -1 for none
    sigma: float  # mm, of an image of the matcher
    most: int  # rays of a point
    in_model: bool = False  # the points are in the coordinates of the model
    error: ClassVar[type[ProblemsError]] = DepthError
    of_records: ClassVar[bool] = False

    @property
    def columns(self) -> Mapping[str, ResultColumn]:
        """What is said of a point beside its places."""
        return _COLUMNS

    def placed_in(self, source: Path, stated: pyproj.CRS | None, crs: str | None, geoid: str | None) -> Self:
        """Return the method for the points of a file, those in the coordinates of the model as they are."""
        return self if self.in_model else super().placed_in(source, stated, crs, geoid)

    def rejection(self, tally: Tally) -> str:
        """Return why the result is of no use; empty where a point is corrected."""
        if tally.corrected:
            return ""
        return (
            "no point is corrected: are they in the system of the job? Those of the model itself need --crs model"
        )

    def corrected(self, points: FloatArray, covariance: FloatArray) -> CorrectedPoints:
        """Return what comes of finite points (n, 3); their own covariances have no part in it."""
        level, x = self._placed(points)
        count = len(points)
        true, values = np.full((count, 3), np.nan), {name: np.full(count, np.nan) for name in _COLUMNS}
        fault = np.full(count, Fault.NO_CAMERA, dtype=np.int64)
        row, photo, pixel = self.cameras.seen(x)
        gap = self.cameras.centre[photo] - x[row]
        kept = (self.rows[photo] >= 0) & spread_over(row, photo, np.arctan2(gap[:, 1], gap[:, 0]), self.most)
        row, photo = row[kept], photo[kept]
        xy = self.cameras.ideal(photo, pixel[kept], self.lenses)
        good = np.isfinite(xy).all(axis=1)
        row, photo, xy = row[good], self.rows[photo[good]], xy[good]
        enough = np.bincount(row, minlength=count) > 1
        rays = enough[row]
        number = np.cumsum(enough) - 1
        some, row = np.flatnonzero(enough), number[row[rays]]

        photo, xy = photo[rays], xy[rays]
        fault[some] = Fault.NO_CONVERGENCE

        def meet(part: IntArray) -> bool:
            of = np.isin(row, part)
            self._meet(some[part], np.searchsorted(part, row[of]), photo[of], xy[of], true, fault, values)
            return True

        for _ in in_parts(meet, np.arange(len(some))):  # those whose rays cannot be followed stay without
            pass
        corrected = fault == Fault.NONE
        values["dz"][corrected] = true[corrected, 2] - level[corrected, 2]
        true[corrected] = self.system.coordinates(true[corrected])
        return CorrectedPoints(true=true, fault=fault, values=values)

    def _placed(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points (n, 3) in level coordinates, and in those of the model."""
        if self.in_model:
            return self.cameras.placement.positions(points), points
        level = self.system.level(points)
        ellipsoid = self.cameras.placement.ellipsoid
        return level, self.cameras.in_model(level if ellipsoid is None else ellipsoid.geocentric(level))

    def _meet(
        self,
        rows: IntArray,
        point: IntArray,
        photo: IntArray,
        xy: FloatArray,
        true: FloatArray,
        fault: IntArray,
        values: dict[str, FloatArray],
    ) -> None:
        """Set where rays of points (k,) meet: `point` (r,) of them, on `photo` (r,) of the run, at xy (r, 2)."""
        count = len(rows)
        every, flagged = np.ones(len(point), dtype=bool), np.ones(count, dtype=bool)
        plates = PlateMeasurements(
            photo=photo, point=point, xy=xy, sigma=np.full(xy.shape, self.sigma), triangulated=~every
        )
        ids = np.arange(count).astype(np.str_)
        _, measured, state = network_of_plates(self.run, Points(ids=ids, bathymetric=flagged), plates)
        groups = group_points(measured.photo, measured.point, every, flagged)
        line, state = at_rest(measured, state, groups, flagged)
        network = measured.with_plates(measured.xy, line.wet)
        known = finite_rows(state.ground)
        fault[rows] = np.where(known, Fault.NONE, Fault.NO_CONVERGENCE)
        true[rows[known]] = network.frame.level(state.ground[known])
        covariances = covariances_in(self.run, network.pattern, network.border.size)
        for group in groups:
            for _, piece in pieces(network, state, group.part(known[group.point]), covariances):
                covariance, depth = covariances_with_depths(network, state, piece, covariances)
                at, variance = rows[piece.group.point], np.diagonal(covariance, axis1=1, axis2=2)
                values["sigma_h"][at] = np.sqrt(variance[:, :2].sum(axis=1))
                values["sigma_z"][at], values["sigma_depth"][at] = np.sqrt(variance[:, 2]), np.sqrt(depth)
        self._describe(network, state, groups, known, rows, values)

    def _describe(
        self,
        network: Network,
        state: State,
        groups: Sequence[PointGroup],
        known: BoolArray,
        rows: IntArray,
        values: dict[str, FloatArray],
    ) -> None:
        """Set depths, incidence, rays and residuals of points."""
        for group in groups:
            group = group.part(known[group.point])
            if not len(group.point):
                continue
            at, photo, m = rows[group.point], network.photo[group.rays], group.rays.shape[1]
            ground = np.repeat(state.ground[group.point][:, None], m, axis=1)
            tide, slope = state.tide[photo], network.slope(state.tilt)
            height = network.frame.height(state.ground[group.point])
            values["depth"][at] = water_heights(slope, tide, ground).mean(axis=1) - height
            _, air = straight_rays(network, state, group.rays)
            over = surface(network.frame, slope, tide, ground)
            angle = np.arccos(np.clip(-np.einsum("kmi,kmi->km", over.normal, air), -1.0, 1.0))
            values["incidence"][at] = angle.mean(axis=1) / DEGREE
            values["rays"][at] = m
            v = residuals(network, state, group.rays.reshape(-1)).reshape(len(at), -1)
            values["py"][at] = np.sqrt(np.mean(np.square(v), axis=1)) / MICROMETRE


def by_file_cameras(
    record: Path, job: Path, *, image_sigma: float | None, most: int, in_model: bool = False
) -> ByFileCameras:
    """Return the method of a run of an imported job. `image_sigma` in pixels; None: that of the run's plates.

    Raises `CompilationError`, `RecordError` and `DepthError` where the run does not go with the cameras.
    """
    cameras, run = cameras_of_job(job), of_record(record, ideal=True)
    tables = read_record(record, ("adjusted_parameters", "cameras", *run_tables.SYSTEM))
    rows, known = links(cameras.photos.tolist(), run.block.photos.ids.tolist())
    if not known.any():
        message = "none of its photos is one of the cameras of the job: it is the run of another job"
        raise DepthError([Problem(message=message, file=str(record))])
    block = run.block
    centred = replace(block.cameras, principal_point=np.zeros_like(block.cameras.principal_point))
    sigma = block.options.plate_sigma * run.unit_sigma if image_sigma is None else image_sigma * cameras.size
    return ByFileCameras(
        system=run_tables.job_system(tables),
        cameras=cameras,
        run=replace(run, block=replace(block, cameras=centred)),
        lenses=adjusted_lenses(tables, cameras),
        rows=rows,
        sigma=sigma,
        most=most,
        in_model=in_model,
    )
