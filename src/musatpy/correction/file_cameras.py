"""Points of a cloud through the cameras of its file: to their pixels, and from there along rays through water.

A cloud of a program that knew of no water is where straight rays of its cameras meet, and these have bent to the
water. So each point goes back through these cameras to its pixels; from there refracted rays of the adjusted ones
meet, each at the water of its own photo. Dry points go the same way in air: there is no step at the shore.

Heights decide what is wet, within areas of water where these are given. Nearer to the water than three sigmas they
do not, nor do residuals: such a point is undecided, and its sigmas cover where it would be wet and where dry.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import pyproj

from musatpy.adjustment.iteration import State
from musatpy.adjustment.network import RAYS, Network, PointGroup, parts_of
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.propagation import covariances_with_depths, pieces
from musatpy.adjustment.sightings import residuals, straight_rays
from musatpy.adjustment.waterline import every_ray_wet
from musatpy.arrays import BoolArray, FloatArray, IntArray, in_parts
from musatpy.compilation.triangulation import AdjustedRun, covariances_in, of_record
from musatpy.compilation.true_points import at_rest, nearest_to_rays, network_of_plates, settled
from musatpy.correction.methods import REASON, S44, CorrectedPoints, Method, ResultColumn, Tally
from musatpy.depth.cameras import system_of_points
from musatpy.errors import AdjustmentError, DepthError, ProblemsError, count_of
from musatpy.geometry.geodesy import surface, water_heights
from musatpy.model import PlateMeasurements, Points
from musatpy.model.tables import finite_rows, taken
from musatpy.records import run_tables
from musatpy.records.tables import numbers
from musatpy.reduction.displacements import EARTH_RADIUS
from musatpy.reduction.pixel_lens import PixelLens
from musatpy.refraction.apparent import Fault
from musatpy.sfm.export import adjusted_lenses, read_run
from musatpy.sfm.model import links, spread
from musatpy.sfm.source import FileCameras, cameras_of_job, spread_over
from musatpy.sfm.wet import LIMIT, METRE, NOTHING, WaterArea, Wet, Wetness, read_water, wetness
from musatpy.soundings.s44 import orders_by_sigmas
from musatpy.units import DEGREE, MICROMETRE

_SHORE = 2.0  # m, from a shore to where heights decide: without water in its bundle a cloud is off in plan
MODEL = "model"  # the system of points in the coordinates of the model itself
_BESIDE, _COMPARED = 1.0, 2000  # m in plan, to adjusted points, and points of a part of a file that are compared
_STEP, _SLOPE = 0.1, 0.5  # m, and of the distance, that heights of these may differ by
_AS_HIGH = tuple(f"{words} adjusted points within a metre" for words in ("as high as", "higher than", "lower than"))
_LEAST, _SHARE = 10, 1 / 3  # points, and share of those compared, that are no chance and no trees
_COLUMNS = {
    "depth": ResultColumn("below the water of its photos, m"),
    "sigma_depth": ResultColumn("m"),
    "sigma_z": ResultColumn("of the height, m"),
    "sigma_h": ResultColumn("of the position in plan, m"),
    "dz": ResultColumn("true minus apparent height, m"),
    "incidence": ResultColumn("mean angle in air, degrees", "deg", decimals=2, in_layers=False),
    "rays": ResultColumn("photos that it is taken from", "", "u2", decimals=0),
    "py": ResultColumn("RMS of its residuals, um", "um", decimals=2, in_layers=False),
    "s44": S44,
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
    water: WaterArea | None = None  # outside of which all is dry
    adjusted: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))  # (p, 3) level, of the points of the run
    error: ClassVar[type[ProblemsError]] = DepthError
    of_records: ClassVar[bool] = False

    @property
    def columns(self) -> Mapping[str, ResultColumn]:
        """What is said of a point beside its places."""
        return _COLUMNS

    def placed_in(self, source: Path, stated: pyproj.CRS | None, crs: str | None, geoid: str | None) -> Self:
        """Return the method for the points of a file, those in the coordinates of the model as they are."""
        if self.in_model:
            return self
        named = crs or (None if stated is None else stated.to_wkt())
        return replace(self, system=system_of_points(source, self.system, named, geoid))

    def rejection(self, tally: Tally) -> str:
        """Return why the result is of no use; empty where a point is corrected."""
        if tally.corrected:
            return ""
        return (
            "no point is corrected: are they in the system of the job? Those of the model itself need --crs model"
        )

    def doubts(self, tally: Tally) -> list[str]:
        """Return what speaks against the result: the verdict on the run, and heights of its own points."""
        doubts = [": ".join(part for part in (self.run.caution, self.run.because) if part)] * bool(self.run.caution)
        for kind in ("wet", "dry"):
            level, higher, lower = (tally.taken[f"{kind}, {words}"] for words in _AS_HIGH)
            if higher + lower > max(_LEAST, _SHARE * (level + higher + lower)):
                doubts.append(
                    f"{higher} {kind} points are higher, {lower} lower, {level} as high as adjusted points beside "
                    "them: is the cloud of another model, was it corrected before, or is its datum another one?"
                )
        return doubts

    def lines(self, tally: Tally) -> list[str]:
        """Return what has come of points in words, and what said that they are wet or dry."""
        return [
            *super().lines(tally),
            *(f"{count_of(number, 'point')} {words}" for words, number in tally.taken.items()),
        ]

    def corrected(self, points: FloatArray, covariance: FloatArray, classes: IntArray) -> CorrectedPoints:
        """Return what comes of finite points (n, 3) of `classes` (n,); their covariances have no part in it."""
        level, x = self._placed(points)
        count = len(points)
        true, values = np.full((count, 3), np.nan), {name: np.full(count, np.nan) for name in _COLUMNS}
        fault = np.full(count, Fault.NO_CAMERA, dtype=np.int64)
        row, photo, pixel = self.cameras.seen(x)
        gap = self.cameras.centre[photo] - x[row]
        seen = np.bincount(row, minlength=count)
        kept = (self.rows[photo] >= 0) & spread_over(row, photo, np.arctan2(gap[:, 1], gap[:, 0]), self.most)
        row, photo = row[kept], photo[kept]
        xy = self.cameras.ideal(photo, pixel[kept], self.lenses)
        sigma = self.sigma * self.cameras.stretch(photo, pixel[kept])
        good = np.isfinite(xy).all(axis=1)
        row, photo, xy, sigma = row[good], self.rows[photo[good]], xy[good], sigma[good]
        enough = np.bincount(row, minlength=count) > 1
        rays = enough[row]
        number = np.cumsum(enough) - 1
        some, row = np.flatnonzero(enough), number[row[rays]]

        photo, xy = photo[rays], xy[rays]
        fault[some] = Fault.NO_CONVERGENCE
        taken = Counter[str]()

        areas = np.full(count, NOTHING)
        if self.water is not None:
            plan, metre = level[:, :2], 1.0
            if self.cameras.placement.ellipsoid is not None:
                plan, metre = np.degrees(level[:, 1::-1]), METRE
            areas = self.water.codes(plan, _SHORE * metre)

        every = PlateMeasurements(
            photo=photo,
            point=row,
            xy=xy,
            sigma=sigma[rays],
            triangulated=np.zeros(len(row), bool),
        )

        def meet(part: IntArray) -> bool:
            at = some[part]
            stated = partial(wetness, areas=areas[at], classes=classes[at])
            taken.update(self._meet(at, _of_points(every, part), stated, seen[at], level, true, fault, values))
            return True

        for _ in in_parts(meet, np.arange(len(some)), AdjustmentError):
            pass  # those whose rays cannot be followed stay without
        sure = fault == Fault.NONE
        taken += self._compared(true[sure], values["depth"][sure], values["sigma_z"][sure])
        corrected = np.isin(fault, (Fault.NONE, Fault.UNDECIDED))
        values["dz"][corrected] = true[corrected, 2] - level[corrected, 2]
        true[corrected] = self.system.coordinates(true[corrected])
        return CorrectedPoints(true=true, fault=fault, values=values, taken=taken)

    @cached_property
    def _adjusted(self) -> Any:
        """The adjusted points in plan, m, to be asked for the nearest."""
        from scipy.spatial import KDTree  # it takes long to load

        return KDTree(self.adjusted[:, :2] * self._metres)

    @cached_property
    def _metres(self) -> FloatArray:
        """(2,) m of a unit of level coordinates in plan."""
        if self.cameras.placement.ellipsoid is None:
            return np.ones(2)
        return EARTH_RADIUS * np.array([1.0, np.cos(self.adjusted[:, 0].mean())])

    def _compared(self, true: FloatArray, depth: FloatArray, sigma: FloatArray) -> Counter[str]:
        """Return how many corrected points (k, 3) are as high as adjusted ones beside them, higher, or lower.

        depth, sigma: (k,) m, of their heights. Those of the run have come from other images, by another way.
        """
        rows = spread(len(true), _COMPARED)
        if not len(rows) or not len(self.adjusted):
            return Counter()
        away, nearest = self._adjusted.query(true[rows, :2] * self._metres, distance_upper_bound=_BESIDE)
        rows, away, nearest = (values[np.isfinite(away)] for values in (rows, away, nearest))
        gap = true[rows, 2] - self.adjusted[nearest, 2]
        side = np.where(np.abs(gap) > _STEP + _SLOPE * away + LIMIT * sigma[rows], np.sign(gap), 0.0)
        kinds = np.where(depth[rows] > 0.0, "wet", "dry").tolist()
        return Counter(f"{kind}, {_AS_HIGH[int(of)]}" for kind, of in zip(kinds, side.tolist(), strict=True))

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
        plates: PlateMeasurements,
        stated: Callable[..., Wetness],
        seen: IntArray,
        level: FloatArray,
        true: FloatArray,
        fault: IntArray,
        values: dict[str, FloatArray],
    ) -> Counter[str]:
        """Set where rays of points (k,) meet, and return how many were taken as what, by what.

        They are dry unless they are below the water, and nothing that is `stated` of them speaks against it.
        """
        zeros = np.zeros(len(rows))
        flagged = stated(zeros - np.inf, zeros, zeros, zeros).code == Wet.WET
        network, state, groups = self._at_rest(plates, flagged)
        state = self._near_cloud(network, state, groups, network.frame.from_level(level[rows]))
        known = finite_rows(state.ground)
        covariances = covariances_in(self.run, network.pattern, network.border.size)
        sigma, squares = self._sigmas(network, state, groups, seen, covariances)
        self._describe(network, state, groups, known, rows, squares, values)
        dry = self.run.block.water is None
        taken = stated(zeros + np.inf if dry else -values["depth"][rows], sigma[:, 2], zeros, zeros)
        near = known & (taken.code == Wet.UNDECIDED)
        larger, off = sigma.copy(), np.zeros(len(rows))
        for side in (False, True):  # of those that have rays on the other one
            others = np.flatnonzero(near & (np.bincount(network.point, network.refracted != side, len(rows)) > 0))
            if not len(others):
                continue
            held = np.full(len(others), side)
            of, at, parts = self._at_rest(_of_points(plates, others), held, held=True)
            height = network.frame.height(state.ground[others])
            off[others] = np.maximum(off[others], np.abs(of.frame.height(at.ground) - height))
            larger[others] = np.maximum(larger[others], self._sigmas(of, at, parts, seen[others], covariances)[0])
        sigma[near, 0] = larger[near, 0]
        sigma[near, 1:] = np.hypot(larger[near, 1:], off[near, None])
        fault[rows] = np.where(known, np.where(near, Fault.UNDECIDED, Fault.NONE), Fault.NO_CONVERGENCE)
        true[rows[known]] = network.frame.level(state.ground[known])
        for name, column in zip(("sigma_h", "sigma_z", "sigma_depth"), sigma.T, strict=True):
            values[name][rows] = column
        values["s44"][rows] = orders_by_sigmas(np.where(flagged, values["depth"][rows], np.nan), *sigma.T[:2])
        against = Counter({"wet or dry against their heights": int(np.count_nonzero(taken.against & known))})
        return taken.counts(known) + against

    def _at_rest(
        self, plates: PlateMeasurements, flagged: BoolArray, held: bool = False
    ) -> tuple[Network, State, Sequence[PointGroup]]:
        """Return rays and points where these meet; `held`: all rays of those `flagged` (k,) are wet, wherever."""
        ids = np.arange(len(flagged)).astype(np.str_)
        _, measured, state = network_of_plates(self.run, Points(ids=ids, bathymetric=flagged), plates)
        keys = ((*measured.photo[group.rays].T, flagged[group.point]) for group in measured.left_out)
        order = map(np.lexsort, keys)  # wet ones together, and of these those in the same photos
        groups = parts_of(map(PointGroup.part, measured.left_out, order), RAYS)
        ideal = replace(measured, parameters={})  # lenses are adjusted: their errors count in the sigmas alone
        if held:
            line = every_ray_wet(ideal, flagged)
            state = settled(ideal, line, nearest_to_rays(ideal, state, groups), groups)
        else:
            line, state = at_rest(ideal, state, groups, flagged)
        return measured.with_plates(measured.xy, line.wet), state, groups

    def _near_cloud(
        self, network: Network, state: State, groups: Sequence[PointGroup], apparent: FloatArray
    ) -> State:
        """Return the state without points that are farther from where the cloud has them than from a camera.

        Those are not of this job: rays to the other side of the earth meet somewhere too.
        """
        ground = state.ground.copy()
        for group in groups:
            X, camera = ground[group.point], state.position[network.photo[group.rays[:, 0]]]
            away = np.linalg.norm(X - apparent[group.point], axis=1) > np.linalg.norm(X - camera, axis=1)
            ground[group.point[away]] = np.nan
        return replace(state, ground=ground)

    def _sigmas(
        self,
        network: Network,
        state: State,
        groups: Sequence[PointGroup],
        seen: IntArray,
        covariances: Cofactors,
    ) -> tuple[FloatArray, FloatArray]:
        """Return sigmas (k, 3) m in plan, in height and of depths, and sums (k,) mm2 of squared residuals.

        NaN where there is no point. The images of all photos that have `seen` (k,) a point made it. What straight
        rays of the file miss in each cancels among all; of fewer it counts as noise, by the share of those missing.
        """
        rays = np.bincount(network.point, minlength=len(seen))
        squares = np.full(len(seen), np.nan)
        for group in groups:
            squares[group.point] = np.square(residuals(network, state, group.rays)).sum(axis=(1, 2))
        missed = (1.0 - rays / seen) * squares / (2 * rays - 3)
        network = replace(network, weight=network.weight / (1.0 + network.weight * missed[network.point, None]))
        known, out = finite_rows(state.ground), np.full((len(state.ground), 3), np.nan)
        for group in groups:
            for _, piece in pieces(network, state, group.part(known[group.point]), covariances):
                covariance, depth = covariances_with_depths(network, state, piece, covariances)
                east, north, up = np.diagonal(covariance, axis1=1, axis2=2).T
                out[piece.group.point] = np.sqrt(np.column_stack([east + north, up, depth]))
        return out, squares

    def _describe(
        self,
        network: Network,
        state: State,
        groups: Sequence[PointGroup],
        known: BoolArray,
        rows: IntArray,
        squares: FloatArray,
        values: dict[str, FloatArray],
    ) -> None:
        """Set depths, incidence, rays and residuals of points, which have `squares` (k,) mm2 in sum."""
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
            values["py"][at] = np.sqrt(squares[group.point] / (2 * m)) / MICROMETRE


def _of_points(plates: PlateMeasurements, points: IntArray) -> PlateMeasurements:
    """Return the images of some points (k,), ascending, which are numbered anew."""
    some = taken(plates, np.isin(plates.point, points))
    return replace(some, point=np.searchsorted(points, some.point))


def by_file_cameras(
    record: Path,
    job: Path,
    *,
    image_sigma: float | None,
    most: int,
    in_model: bool = False,
    water: Path | None = None,
    side: str = "",
) -> ByFileCameras:
    """Return the method of a run of an imported job. `image_sigma` in pixels; None: that of the run's plates.

    `water` are areas of water, or shorelines with the water on one `side`.

    Raises `CompilationError`, `RecordError`, `ModelError`, `DepthError` where the run does not go with the cameras.
    """
    cameras, run = cameras_of_job(job), of_record(record, ideal=True)
    tables = read_run(record, ("adjusted_parameters", "cameras", "points", *run_tables.SYSTEM))
    rows, known = links(cameras.photos.tolist(), run.block.photos.ids.tolist())
    if not known.any():
        message = "none of its photos is one of the cameras of the job: it is the run of another job"
        raise DepthError.of(message, record)
    block, position = run.block, numbers(tables["points"], "position", 3)
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
        adjusted=run_tables.level_positions(tables, position[finite_rows(position)]),
        water=None
        if water is None
        else read_water(
            water,
            side,
            geographic=cameras.placement.ellipsoid is not None,
            stations=cameras.placement.positions(cameras.centre),
        ),
    )
