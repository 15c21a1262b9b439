"""A triangulation as compilation needs it: of a solution, a record, a punched deck or a table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from pathlib import Path

import numpy as np

from musatpy import model
from musatpy.adjustment.considered import extended
from musatpy.adjustment.iteration import LEVEL, initial_state, is_considered, water_knowledge
from musatpy.adjustment.job import build_network
from musatpy.adjustment.network import job_frame, participation
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.sparse import Pattern
from musatpy.adjustment.wavy_water import Sea, sea_of
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import AdjustmentError, CompilationError, Problem
from musatpy.geometry.collinearity import attitude_from_matrix
from musatpy.geometry.geodesy import Ellipsoid, Frame, GeocentricFrame, GeographicFrame
from musatpy.geometry.systems import Geocentric, Geographic, System
from musatpy.model.tables import empty
from musatpy.records import run_tables
from musatpy.records.json_files import read_record
from musatpy.records.tables import Tables, flags, numbers

UNCONVERGED = "the run has not converged"
PUNCHED = "from a punched deck: sigmas are those of stages and water alone"
_CONTROL = ("control", "equal_elevations", "distances", "height_differences")
TABLES = (*run_tables.BLOCK, *run_tables.COVARIANCES, "solution", "verdict", *_CONTROL)  # of a record that it takes
_NO_POINTS = {name: {"point": (), "points": (), "kind": ()} for name in ("points", "plates", *_CONTROL)}


@dataclass(frozen=True, kw_only=True, eq=False)
class AdjustedRun:
    """n photos of a run, where it has put them.

    The block has the photos at their adjusted stations and tides, the adjusted water, and the points and plate
    measurements of the run. `given` (n, 3) are the stations of the deck, about which the axes of covariances stand
    and the water tilts, NaN where there were none. position (p, 3) in the system of the job and covariance (p, 3,
    3) of its points, NaN where not determined; triangulated (m,) measurements, points of control (p,). covariance
    (n, 6, 6) of stations, with those of pairs, of levels of single photos and of the water; `unit_sigma` is the a
    posteriori sigma of unit weight, with its degrees of `freedom`, infinite where it is a priori. `caution` is what
    every page of what comes of it must say, and `because` says more of it. `sea` are the waves on the water, at
    their adjusted parameters, None where it is level.
    """

    block: model.Block
    given: FloatArray
    covariance: FloatArray
    pairs: model.StationPairs
    levels: model.LevelPairs | None
    water: model.WaterPrecision | None
    position: FloatArray
    point_covariance: FloatArray
    triangulated: BoolArray
    control: BoolArray
    unit_sigma: float
    freedom: float = np.inf
    sea: Sea | None = None
    stated: model.SystemSpec | None = None  # how the answer of the run is stated; None: in the system of the job
    caution: str = ""
    because: str = ""

    @cached_property
    def frame(self) -> Frame:
        """The working frame of the run."""
        photos = self.block.photos
        known = np.isfinite(self.given).all()
        return job_frame(replace(self.block, photos=replace(photos, position=self.given)) if known else self.block)

    @property
    def map_system(self) -> System | None:
        """The system of its positions on an ellipsoid, None of a local job."""
        if not isinstance(self.frame, GeocentricFrame):
            return None
        kind = Geographic if isinstance(self.frame, GeographicFrame) else Geocentric
        return kind(self.frame.ellipsoid)

    @property
    def ellipsoid(self) -> Ellipsoid | None:
        """That of the job, None of a local one."""
        return None if self.map_system is None else self.map_system.ellipsoid

    @cached_property
    def considered(self) -> bool:
        """True where water that is known has errors that are allowed for."""
        waves = self.sea is not None and self.sea.considered
        return waves or is_considered(self.block, water_knowledge(self.block))

    @property
    def without_errors(self) -> AdjustedRun:
        """The same with stations and water without error: sigmas of what is compiled are those of pointing."""
        pairs = replace(self.pairs, covariance=np.zeros_like(self.pairs.covariance))
        return replace(self, covariance=np.zeros_like(self.covariance), pairs=pairs, levels=None, water=None)

    def photo(self, name: str) -> int:
        """Return the row of a photo. Raises `CompilationError` where the run has none of this name."""
        rows = np.flatnonzero(self.block.photos.ids == name)
        if not len(rows):
            raise CompilationError.of(f"the run has no photo {name}")
        return int(rows[0])


def waves_of_run(block: model.Block, adjusted: FloatArray | None, given: Sea | None = None) -> Sea | None:
    """Return the waves on the water of a block, or those `given` beside it, with `adjusted` (k, 4) parameters.

    Raises `CompilationError` where they are not known.
    """
    try:
        sea = sea_of(block, given)
    except AdjustmentError as error:
        raise CompilationError(error.problems) from error
    if adjusted is None:
        return sea
    if sea is None:
        message = "its waves were given beside its deck, and must be so again (`of_solution` takes them)"
        raise CompilationError.of(message)
    return replace(sea, surface=sea.trains.with_values(adjusted).surface)


def of_record(path: Path, anyway: bool = False, ideal: bool = False) -> AdjustedRun:
    """Return the triangulation of the record of a run; `anyway` also of one that has not converged.

    Images are `ideal`: the caller sees to a distortion that was adjusted, and needs no points of the run.

    Raises `RecordError` where it is none, `CompilationError` where it cannot be compiled from, and `OSError`.
    """
    try:
        tables = read_record(path, tuple(name for name in TABLES if not ideal or name not in _NO_POINTS))
        return of_tables(_NO_POINTS | tables, anyway, ideal=ideal)
    except CompilationError as error:
        raise CompilationError([replace(problem, file=str(path)) for problem in error.problems]) from error


def of_tables(tables: Tables, anyway: bool = False, sea: Sea | None = None, ideal: bool = False) -> AdjustedRun:
    """Return the triangulation of the `TABLES` of a record, with the waves that were given beside its deck, if any.

    Raises `CompilationError` where it cannot be compiled from; `anyway` also takes one that has not converged.
    """
    solution, stations, points = (tables[name] for name in ("solution", "stations", "points"))
    unconverged = "" if solution["converged"] else str(solution["reason"])
    faults = [f"{UNCONVERGED}: {unconverged} (--anyway compiles from it)"] if unconverged and not anyway else []
    if not faults and tables["adjusted_water"] is not None and (fault := run_tables.water_fault(tables)):
        faults = [fault]
    if not (faults or ideal) and (fault := run_tables.lens_fault(tables)):
        faults = [fault]
    if faults:
        raise CompilationError([Problem(message=fault) for fault in faults])
    block = run_tables.block_of(tables)
    given = replace(block, **run_tables.given_waves(tables))
    caution, because = (UNCONVERGED, unconverged) if unconverged else _doubts(tables)
    control = tables["control"]
    held = [point for point, kind in zip(control["point"], control["kind"], strict=True) if kind != "check"]
    tied = chain.from_iterable(chain.from_iterable(tables[name]["points"] for name in _CONTROL[1:]))
    return AdjustedRun(
        block=block,
        given=numbers(stations, "given_position", 3),
        covariance=numbers(stations, "covariance", 6, 6),
        pairs=run_tables.station_pairs(tables),
        levels=run_tables.level_pairs(tables),
        water=run_tables.water_precision(tables),
        position=numbers(points, "position", 3),
        point_covariance=numbers(points, "covariance", 3, 3),
        triangulated=flags(tables["plates"], "triangulated"),
        control=np.isin(block.points.ids, [*held, *tied]),  # of which something is known
        unit_sigma=float(solution["unit_sigma"] or 1.0),
        freedom=float(max(solution["degrees_of_freedom"], 0)) or np.inf,
        sea=waves_of_run(given, run_tables.adjusted_waves(tables), sea),
        stated=run_tables.answer_spec(tables),
        caution=caution,
        because=because,
    )


def _doubts(tables: Tables) -> tuple[str, str]:
    """Return what the verdict on a run that has converged says against it, and why; nothing of one accepted."""
    verdict = tables["verdict"]
    if model.Grade(verdict["grade"]) is model.Grade.ACCEPTED:
        return "", ""
    return f"the run is {verdict['grade'].lower()}", "; ".join(reason["text"] for reason in verdict["reasons"])


def of_block(block: model.Block) -> AdjustedRun:
    """Return the triangulation of a punched deck: stations and control as they stand there, without error.

    So does its water, whose sigmas on the cards are those of errors that are not adjusted (`considered`). Raises
    `CompilationError` with every photo that has no position or attitude.
    """
    block = _with_known_water(block)
    photos, sea, faults = block.photos, None, []
    try:
        sea = waves_of_run(block, None)
    except CompilationError as error:
        faults += [problem.message for problem in error.problems]
    for values, what in ((photos.position, "position"), (photos.attitude, "attitude")):
        rows = np.flatnonzero(~np.isfinite(values).all(axis=1))
        faults += [f"photo {name} has no {what}" for name in photos.ids[rows].tolist()]
    if faults:
        raise CompilationError([Problem(message=fault) for fault in faults])
    count, known = len(block.points.ids), np.isfinite(block.control.position).all(axis=1)
    position = np.full((count, 3), np.nan)
    position[block.control.point[known]] = block.control.position[known]
    return AdjustedRun(
        block=model.Block(  # what compilation needs of it
            titles=(),
            options=block.options,
            ellipsoid=block.ellipsoid,
            water=block.water,
            cameras=block.cameras,
            photos=photos,
            points=block.points,
            plates=replace(block.plates, sigma=block.plate_sigmas),
        ),
        given=photos.position,
        covariance=np.zeros((len(photos.ids), 6, 6)),
        pairs=model.StationPairs(photo=np.empty((0, 2), dtype=np.int64), covariance=np.empty((0, 6, 6))),
        levels=None,
        water=_water_of_cards(block, sea),
        position=position,
        point_covariance=np.full((count, 3, 3), np.nan),
        triangulated=block.plates.triangulated,
        control=np.ones(count, dtype=bool),
        unit_sigma=1.0,
        sea=sea,
        stated=block.answer_in,
        caution=PUNCHED,
    )


def of_stations(
    names: tuple[str, ...], position: FloatArray, rotation: FloatArray, camera: FloatArray, tide: FloatArray,
    sigma: FloatArray, water: model.Water,
) -> AdjustedRun:  # fmt: skip
    """Return k stations of a table as a triangulation, their errors independent of each other.

    position (k, 3) m, Z up; rotation (k, 3, 3) ground to photo; camera (k, 3) mm: focal length, width, height of
    the format; tide (k,) m; sigma (k, 7): of the position (m), omega, phi, kappa (rad) and the tide (m). Raises
    `CompilationError`.
    """
    count, nothing = len(names), np.full(position.shape, np.nan)
    block = model.Block(
        titles=(),
        options=model.Options(program=model.Program.IIIA, system=model.CoordinateSystem.LOCAL),
        water=water,
        cameras=model.Cameras(
            ids=np.array(names),
            focal_length=camera[:, 0],
            principal_point=np.zeros((count, 2)),
            format_size=camera[:, 1:],
        ),
        photos=model.Photos(
            ids=np.array(names),
            camera=np.arange(count),
            position=position,
            position_sigma=nothing,
            attitude=attitude_from_matrix(rotation),
            attitude_sigma=nothing,
            tide=tide,
            tide_sigma=sigma[:, 6],
        ),
        points=empty(model.Points),
    )
    diagonal = np.square(sigma[:, :6, None]) * np.eye(6)
    pairs = model.StationPairs(photo=np.empty((0, 2), dtype=np.int64), covariance=np.empty((0, 6, 6)))
    return replace(of_block(block), covariance=diagonal, pairs=pairs)


def _with_known_water(block: model.Block) -> model.Block:
    """Return a block that adjusts no water; tides that had a correction in common have an error in common."""
    options, photos = block.options, block.photos
    nothing = np.full(len(photos.ids), "")
    group, day = {
        model.WaterLevel.ONE: (np.full(len(photos.ids), "ONE"), nothing),
        model.WaterLevel.DAY: (nothing, photos.tide_day),
        model.WaterLevel.GROUP: (photos.tide_group, nothing),
        model.WaterLevel.PHOTO: (nothing, nothing),
    }.get(options.water_level, (photos.tide_group, photos.tide_day))
    return replace(
        block,
        photos=replace(photos, tide_group=group, tide_day=day),
        options=replace(
            options,
            program=model.Program.IIA,
            refraction=model.Refraction.RIGOROUS,
            water_level=model.WaterLevel.KNOWN,
            water_tilt=model.Treatment.KNOWN,
            water_index=model.Treatment.KNOWN,
        ),
    )


def _water_of_cards(block: model.Block, sea: Sea | None) -> model.WaterPrecision | None:
    """Return the variances of the water of a block that adjusts none of it, by the sigmas on its cards."""
    network = build_network(block, job_frame(block), participation(block), sea)
    wide = extended(block, network, initial_state(network))
    count = len(wide.sigma)
    if not count:
        return None
    return model.WaterPrecision(
        names=tuple(wide.names),
        covariance=np.diag(np.square(wide.sigma)),
        stations=np.zeros((len(block.photos.ids), 6, count)),
        levels=np.empty((0, count)),
    )


def covariances_in(run: AdjustedRun, pattern: Pattern, size: int) -> Cofactors:
    """Return the covariances of stations that meet in a pattern, and of `size` quantities of the water."""
    q = pattern.size
    blocks = np.zeros((len(pattern.pairs), q, q))
    blocks[pattern.diagonal, :6, :6] = run.covariance
    row, at = _where(pattern, run.pairs.photo)
    blocks[at, :6, :6] = run.pairs.covariance[row]
    if run.levels is not None and q > LEVEL:
        row, at = _where(pattern, run.levels.photo)
        blocks[at, :6, LEVEL], blocks[at, LEVEL, :6] = run.levels.of_first[row], run.levels.of_second[row]
        blocks[at, LEVEL, LEVEL] = run.levels.level[row]
    border, corner = np.zeros((pattern.count, q, size)), np.zeros((size, size))
    if run.water is not None:
        border[:, :6], corner[:] = run.water.stations, run.water.covariance
        if q > LEVEL and len(run.water.levels):
            border[:, LEVEL] = run.water.levels
    return Cofactors(pattern=pattern, blocks=blocks, border=border.reshape(pattern.order, size), corner=corner)


def _where(pattern: Pattern, pairs: IntArray) -> tuple[IntArray, IntArray]:
    """Return which pairs (k, 2) of photos a pattern has, and where."""
    row = np.flatnonzero(np.isin(pairs[:, 0] * pattern.count + pairs[:, 1], pattern.keys))
    return row, pattern.find(*pairs[row].T)
