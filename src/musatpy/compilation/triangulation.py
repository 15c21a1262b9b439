"""A triangulation as compilation needs it: stations, water and their covariances, from a solution or its record."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.adjustment.network import job_frame
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import CompilationError, Problem, RecordError
from musatpy.geometry.frames import Frame, GeocentricFrame, GeographicFrame
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.systems import Geocentric, Geographic, System
from musatpy.json_files import read_record
from musatpy.model import (
    Block,
    Cameras,
    CoordinateSystem,
    EllipsoidSpec,
    Options,
    Photos,
    PlateMeasurements,
    Points,
    Program,
    Refraction,
    Solution,
    StationPairs,
    Treatment,
    Water,
    WaterLevel,
    WaterPrecision,
)
from musatpy.model.tables import empty

_NEEDS = {
    "solution": ("converged", "reason", "unit_sigma"),
    "options": ("program", "system", "plate_sigma", "submerged_factor", "water_level", "water_tilt", "water_index"),
    "ellipsoid": (),
    "water": (),
    "waves": ("wave",),
    "cameras": ("camera", "focal_length", "principal_point", "format_size"),
    "stations": (
        "photo", "camera", "position", "attitude", "covariance", "given_position",
        "tide_sigma", "tide_group", "tide_day",
    ),
    "points": ("point", "bathymetric", "position", "covariance"),
    "plates": ("photo", "point", "xy", "sigma", "triangulated"),
    "adjusted_water": ("tide", "tilt", "index"),
    "station_pairs": ("photos", "covariance"),
    "control": ("point", "kind"),
    "equal_elevations": ("points",),
    "distances": ("points",),
    "height_differences": ("points",),
    "water_precision": ("quantity", "covariance", "stations"),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Triangulation:
    """n photos of a run, where it has put them.

    The block has the photos at their adjusted stations and tides, the adjusted water, and the points and plate
    measurements of the run. `given` (n, 3) are the stations of the deck, about which the axes of covariances stand
    and the water tilts, NaN where there were none. position (p, 3) in the system of the job and covariance (p, 3,
    3) of its points, NaN where not determined; triangulated (m,) measurements, points of
    control (p,). covariance (n, 6, 6) of stations,
    with those of pairs and of the water; `unit_sigma` is the a posteriori sigma of unit weight.
    """

    block: Block
    given: FloatArray
    covariance: FloatArray
    pairs: StationPairs
    water: WaterPrecision | None
    position: FloatArray
    point_covariance: FloatArray
    triangulated: BoolArray
    control: BoolArray
    unit_sigma: float

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

    def photo(self, name: str) -> int:
        """Return the row of a photo. Raises `CompilationError` where the run has none of this name."""
        rows = np.flatnonzero(self.block.photos.ids == name)
        if not len(rows):
            raise CompilationError([Problem(message=f"the run has no photo {name}")])
        return int(rows[0])


def of_solution(solution: Solution) -> Triangulation:
    """Return the triangulation of a solution. Raises `CompilationError` where it cannot be compiled from."""
    block, water = solution.block, solution.water
    faults = [] if solution.converged else [f"the run has not converged: {solution.reason}"]
    if len(block.waves.ids) or (water is not None and water.waves is not None):
        faults.append("the water of the run has waves, and compilation is through still water")
    if solution.pairs is None:
        faults.append("the solution has no covariances of its stations")
    if faults or solution.pairs is None:
        raise CompilationError([Problem(message=fault) for fault in faults])
    stations = solution.stations
    adjusted = block.photos if water is None else replace(block.photos, tide=water.tide)
    return Triangulation(
        block=Block(
            titles=(),
            options=block.options,
            ellipsoid=block.ellipsoid,
            water=_adjusted(block.water, None if water is None else (water.index, water.tilt)),
            cameras=block.cameras,
            photos=replace(adjusted, position=stations.position, attitude=stations.attitude),
            points=block.points,
            plates=replace(block.plates, sigma=block.plate_sigmas),
        ),
        given=block.photos.position,
        covariance=stations.covariance,
        pairs=solution.pairs,
        water=solution.water_precision,
        position=solution.points.position,
        point_covariance=solution.points.covariance,
        triangulated=block.plates.triangulated,
        control=np.isin(np.arange(len(block.points.ids)), _known(block)),
        unit_sigma=solution.unit_sigma,
    )


def of_record(path: Path) -> Triangulation:
    """Return the triangulation of the record of a run.

    Raises `CompilationError` where it is none that can be compiled from, and `OSError`.
    """
    try:
        record = read_record(path, _NEEDS)
    except RecordError as error:
        raise CompilationError(error.problems) from error
    solution, water = record["solution"], record["adjusted_water"]
    faults = [] if solution["converged"] else [f"the run has not converged: {solution['reason']}"]
    if record["waves"]:
        faults.append("the water of the run has waves, and compilation is through still water")
    if faults:
        raise CompilationError([Problem(file=str(path), message=fault) for fault in faults])
    stations, points = record["stations"], record["points"]
    count = len(stations)
    return Triangulation(
        block=_block(record, None if water is None else (water["index"], np.array(water["tilt"]))),
        given=_array([row["given_position"] for row in stations], 3),
        covariance=_array([row["covariance"] for row in stations], 6, 6),
        pairs=_pairs(record),
        water=_water_precision(record["water_precision"], count),
        position=_array([row["position"] or [None] * 3 for row in points], 3),
        point_covariance=_array([row["covariance"] or [[None] * 3] * 3 for row in points], 3, 3),
        triangulated=np.array([row["triangulated"] for row in record["plates"]], dtype=bool),
        control=np.isin([row["point"] for row in points], _known_of(record)),
        unit_sigma=float(solution["unit_sigma"] or 1.0),
    )


def _known(block: Block) -> IntArray:
    """Return the points that control or a group of equal elevations holds."""
    held = block.control.point[block.control.known.any(axis=1)]
    measured = [table.point.reshape(-1) for table in (block.distances, block.height_differences)]
    return np.concatenate([held, block.equal_elevations.point, *measured])


def _known_of(record: Any) -> list[str]:
    """Return the ids of these points."""
    held = [row["point"] for row in record["control"] if row["kind"] != "check"]
    held += [point for row in record["equal_elevations"] for point in row["points"]]
    return held + [
        point for name in ("distances", "height_differences") for row in record[name] for point in row["points"]
    ]


def _array(rows: list[Any], *shape: int) -> FloatArray:
    """Return rows of numbers as an array (n, *shape), NaN for null."""
    return np.array(rows, dtype=float).reshape(len(rows), *shape)


def _block(record: Any, water: tuple[float, FloatArray] | None) -> Block:
    stations, cameras, options = record["stations"], record["cameras"], record["options"]
    ids = np.array([row["camera"] for row in cameras], dtype=np.str_)
    number = {str(name): row for row, name in enumerate(ids)}
    given, ellipsoid = record["water"], record["ellipsoid"]
    tides = [None] * len(stations) if water is None else record["adjusted_water"]["tide"]
    nothing = np.full((len(stations), 3), np.nan)
    deck = None if given is None else Water(**{key: given[key] for key in ("index", "sigma", "tilt_sigma")})
    return Block(
        titles=(),
        options=Options(
            program=Program(options["program"]),
            system=CoordinateSystem(options["system"]),
            refraction=Refraction.RIGOROUS,
            plate_sigma=options["plate_sigma"],
            submerged_factor=options["submerged_factor"],
            water_level=WaterLevel(options["water_level"]),
            water_tilt=Treatment(options["water_tilt"]),
            water_index=Treatment(options["water_index"]),
        ),
        ellipsoid=None if ellipsoid is None else EllipsoidSpec(**{**ellipsoid, "name": ellipsoid["name"] or ""}),
        water=_adjusted(deck, water),
        cameras=Cameras(
            ids=ids,
            focal_length=_array([row["focal_length"] for row in cameras]),
            principal_point=_array([row["principal_point"] for row in cameras], 2),
            format_size=_array([row["format_size"] for row in cameras], 2),
        ),
        photos=Photos(
            ids=np.array([row["photo"] for row in stations], dtype=np.str_),
            camera=np.array([number[row["camera"]] for row in stations]),
            position=_array([row["position"] for row in stations], 3),
            position_sigma=nothing,
            attitude=_array([row["attitude"] for row in stations], 3),
            attitude_sigma=nothing,
            tide=_array(tides),
            tide_sigma=_array([row["tide_sigma"] for row in stations]),
            tide_group=np.array([row["tide_group"] for row in stations], dtype=np.str_),
            tide_day=np.array([row["tide_day"] for row in stations], dtype=np.str_),
        ),
        points=Points(
            ids=np.array([row["point"] for row in record["points"]], dtype=np.str_),
            bathymetric=np.array([row["bathymetric"] for row in record["points"]], dtype=bool),
        ),
        plates=_plates(record),
    )


def _adjusted(given: Water | None, found: tuple[float, FloatArray] | None) -> Water | None:
    """Return the water of a card with the index and the tilt of an adjustment."""
    if given is None or found is None:
        return given
    index, tilt = found
    return replace(given, index=index, tilt_east=float(tilt[0]), tilt_north=float(tilt[1]))


def _plates(record: Any) -> PlateMeasurements:
    rows = record["plates"]
    if not rows:
        return empty(PlateMeasurements)
    photo = {row["photo"]: number for number, row in enumerate(record["stations"])}
    point = {row["point"]: number for number, row in enumerate(record["points"])}
    return PlateMeasurements(
        photo=np.array([photo[row["photo"]] for row in rows]),
        point=np.array([point[row["point"]] for row in rows]),
        xy=_array([row["xy"] for row in rows], 2),
        sigma=_array([row["sigma"] for row in rows], 2),
        triangulated=np.zeros(len(rows), dtype=bool),
    )


def _pairs(record: Any) -> StationPairs:
    rows = record["station_pairs"]
    number = {row["photo"]: place for place, row in enumerate(record["stations"])}
    photo = [[number[name] for name in row["photos"]] for row in rows]
    return StationPairs(
        photo=np.array(photo, dtype=np.int64).reshape(-1, 2),
        covariance=_array([row["covariance"] for row in rows], 6, 6),
    )


def _water_precision(rows: Any, stations: int) -> WaterPrecision | None:
    if not rows:
        return None
    return WaterPrecision(
        names=tuple(row["quantity"] for row in rows),
        covariance=_array([row["covariance"] for row in rows], len(rows)),
        stations=np.moveaxis(_array([row["stations"] for row in rows], stations, 6), 0, -1),
    )
