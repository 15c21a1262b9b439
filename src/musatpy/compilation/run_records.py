"""The triangulation of the record of a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.triangulation import UNCONVERGED, Triangulation, adjusted_water, fault_of_run, waves_of_run
from musatpy.errors import CompilationError, Problem, RecordError
from musatpy.json_files import read_record
from musatpy.model import (
    Block,
    Cameras,
    CoordinateSystem,
    EllipsoidSpec,
    LevelPairs,
    Options,
    Photos,
    PlateMeasurements,
    Points,
    Program,
    Refraction,
    StationPairs,
    Treatment,
    Water,
    WaterLevel,
    WaterPrecision,
    WaveOrigin,
    Waves,
)
from musatpy.model.adjusted_waves import PARAMETERS
from musatpy.model.tables import empty
from musatpy.model.waves import SIGMAS

_NEEDS = {
    "solution": ("converged", "reason", "unit_sigma"),
    "options": ("program", "system", "plate_sigma", "submerged_factor", "water_level", "water_tilt", "water_index"),
    "ellipsoid": (),
    "water": (),
    "waves": (
        "wave", "shape", "depth", "given_period", "given_length", "given_speed", "height", "azimuth", "crest",
        "height_sigma", "length_sigma", "azimuth_sigma", "crest_sigma",
    ),
    "wave_origin": (),
    "cameras": ("camera", "focal_length", "principal_point", "format_size"),
    "stations": (
        "photo", "camera", "position", "attitude", "covariance", "given_position",
        "tide_sigma", "tide_group", "tide_day", "time",
    ),
    "points": ("point", "bathymetric", "position", "covariance"),
    "plates": ("photo", "point", "xy", "sigma", "triangulated"),
    "adjusted_water": ("tide", "tilt", "index", "waves"),
    "station_pairs": ("photos", "covariance"),
    "control": ("point", "kind"),
    "equal_elevations": ("points",),
    "distances": ("points",),
    "height_differences": ("points",),
    "water_precision": ("quantity", "covariance", "stations"),
}  # fmt: skip

_OF_LATER = {"level_pairs": ("photos", "of_first", "of_second", "level")}  # fields of records from 1.10 on


def of_record(path: Path, anyway: bool = False) -> Triangulation:
    """Return the triangulation of the record of a run; `anyway` also of one that has not converged.

    Raises `CompilationError` where it is none that can be compiled from, and `OSError`.
    """
    try:
        record = read_record(path, _NEEDS, _OF_LATER)
    except RecordError as error:
        raise CompilationError(error.problems) from error
    solution, water = record["solution"], record["adjusted_water"]
    unconverged = "" if solution["converged"] else str(solution["reason"])
    if faults := fault_of_run("" if anyway else unconverged):
        raise CompilationError([Problem(file=str(path), message=fault) for fault in faults])
    stations, points = record["stations"], record["points"]
    count, block = (
        len(stations),
        _block(record, None if water is None else (water["index"], np.array(water["tilt"]))),
    )
    try:
        sea = waves_of_run(replace(block, **_waves(record)), _adjusted_waves(water))
    except CompilationError as error:
        raise CompilationError([replace(problem, file=str(path)) for problem in error.problems]) from error
    return Triangulation(
        block=block,
        given=_array([row["given_position"] for row in stations], 3),
        covariance=_array([row["covariance"] for row in stations], 6, 6),
        pairs=_pairs(record),
        levels=_level_pairs(record),
        water=_water_precision(record["water_precision"], count),
        position=_array([row["position"] or [None] * 3 for row in points], 3),
        point_covariance=_array([row["covariance"] or [[None] * 3] * 3 for row in points], 3, 3),
        triangulated=np.array([row["triangulated"] for row in record["plates"]], dtype=bool),
        control=np.isin([row["point"] for row in points], _known_of(record)),
        unit_sigma=float(solution["unit_sigma"] or 1.0),
        sea=sea,
        caution=UNCONVERGED if unconverged else "",
        because=unconverged,
    )


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
        water=adjusted_water(deck, water),
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
            time=_array([row["time"] for row in stations]),
        ),
        points=Points(
            ids=np.array([row["point"] for row in record["points"]], dtype=np.str_),
            bathymetric=np.array([row["bathymetric"] for row in record["points"]], dtype=bool),
        ),
        plates=_plates(record),
    )


def _waves(record: Any) -> dict[str, Any]:
    """Return the waves of a block and their origin, as its deck gave them."""
    rows, origin = record["waves"], record["wave_origin"]
    if not rows or origin is None:
        return {}
    from musatpy.sea.deck_waves import SHAPES  # most runs have none

    code = {str(shape): letters for letters, shape in SHAPES.items()}
    given = {name: f"given_{name}" for name in ("period", "length", "speed")}
    same = ("depth", "height", "azimuth", "crest", *SIGMAS)
    waves = Waves(
        ids=np.array([row["wave"] for row in rows], dtype=np.str_),
        shape=np.array([code[row["shape"]] for row in rows], dtype=np.str_),
        **{
            name: _array([row[field] for row in rows])
            for name, field in (given | dict(zip(same, same, strict=True))).items()
        },
    )
    return {"waves": waves, "wave_origin": WaveOrigin(position=tuple(origin))}


def _adjusted_waves(water: Any) -> FloatArray | None:
    """Return the parameters (k, 4) of waves that the run has adjusted, None where there are none."""
    if water is None or water["waves"] is None:
        return None
    return _array([[row[name] for name in PARAMETERS] for row in water["waves"]["waves"]], 4)


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


def _level_pairs(record: Any) -> LevelPairs | None:
    rows = record.get("level_pairs")
    if not rows:
        return None
    number = {row["photo"]: place for place, row in enumerate(record["stations"])}
    return LevelPairs(
        photo=np.array([[number[name] for name in row["photos"]] for row in rows], dtype=np.int64),
        of_first=_array([row["of_first"] for row in rows], 6),
        of_second=_array([row["of_second"] for row in rows], 6),
        level=_array([row["level"] for row in rows]),
    )


def _water_precision(rows: Any, stations: int) -> WaterPrecision | None:
    if not rows:
        return None
    return WaterPrecision(
        names=tuple(row["quantity"] for row in rows),
        covariance=_array([row["covariance"] for row in rows], len(rows)),
        stations=np.moveaxis(_array([row["stations"] for row in rows], stations, 6), 0, -1),
        levels=_array([row.get("levels", []) for row in rows], -1).T,
    )
