"""The triangulation of the record of a run, and what says that a deck is none that a run has punched."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.compilation.triangulation import (
    UNCONVERGED,
    AdjustedRun,
    adjusted_water,
    fault_of_run,
    freedom_of,
    of_block,
    waves_of_run,
)
from musatpy.compilation.true_points import Readings, true_points
from musatpy.errors import CompilationError, Problem, RecordError
from musatpy.json_files import read_record
from musatpy.model import (
    Block,
    Cameras,
    CoordinateSystem,
    EllipsoidSpec,
    Grade,
    LevelPairs,
    Options,
    Photos,
    PlateMeasurements,
    Points,
    Program,
    Refraction,
    StationPairs,
    SystemSpec,
    Treatment,
    Water,
    WaterLevel,
    WaterPrecision,
    WaveOrigin,
    Waves,
)
from musatpy.model.compilation import RECOVERABLE
from musatpy.model.solution import WAVE_VALUES
from musatpy.model.tables import empty
from musatpy.model.water import WAVE_SIGMAS, index_fault
from musatpy.reduction.readings_job import reduce
from musatpy.units import AngleUnit

_PAIRS = 10  # of photos that are looked at
_MISFIT = 6.0  # plate sigmas that half the y-parallaxes of adjusted photos are well below
_NEEDS = {
    "solution": ("converged", "reason", "unit_sigma", "degrees_of_freedom"),
    "options": ("program", "system", "plate_sigma", "submerged_factor", "water_level", "water_tilt", "water_index"),
    "ellipsoid": (),
    "water": ("index", "sigma", "tilt_sigma"),
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
    "stated": ("answer",),
}  # fmt: skip

_OF_LATER = {  # fields that older records lack
    "water": ("liquid",),
    "level_pairs": ("photos", "of_first", "of_second", "level"),
    "verdict": ("grade", "reasons"),
}


def of_record(path: Path, anyway: bool = False) -> AdjustedRun:
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
    if water is not None and (fault := index_fault(water["index"], (record["water"] or {}).get("liquid", ""))):
        raise CompilationError([Problem(file=str(path), message=f"{fault} on the card of its deck")])
    block = _block(record, None if water is None else (water["index"], np.array(water["tilt"])))
    try:
        sea = waves_of_run(replace(block, **_waves(record)), _adjusted_waves(water))
    except CompilationError as error:
        raise CompilationError([replace(problem, file=str(path)) for problem in error.problems]) from error
    caution, because = (UNCONVERGED, unconverged) if unconverged else _doubts(record)
    return AdjustedRun(
        block=block,
        given=_array(stations["given_position"], 3),
        covariance=_array(stations["covariance"], 6, 6),
        pairs=_pairs(record),
        levels=_level_pairs(record),
        water=_water_precision(record["water_precision"], len(stations["photo"])),
        position=_array([place or [None] * 3 for place in points["position"]], 3),
        point_covariance=_array([entry or [[None] * 3] * 3 for entry in points["covariance"]], 3, 3),
        triangulated=np.array(record["plates"]["triangulated"], dtype=bool),
        control=np.isin(points["point"], _known_of(record)),
        unit_sigma=float(solution["unit_sigma"] or 1.0),
        freedom=freedom_of(solution["degrees_of_freedom"]),
        sea=sea,
        stated=_stated(record["stated"]),
        caution=caution,
        because=because,
    )


def _doubts(record: dict[str, Any]) -> tuple[str, str]:
    """Return what the verdict on a run that has converged says against it, and why; nothing of one accepted."""
    verdict = record.get("verdict")
    if verdict is None or Grade(verdict["grade"]) is Grade.ACCEPTED:
        return "", ""
    return f"the run is {verdict['grade'].lower()}", "; ".join(reason["text"] for reason in verdict["reasons"])


def _stated(stated: Any) -> SystemSpec | None:
    """Return how the answer is stated."""
    if stated is None:
        return None
    words = stated["answer"]
    origin, false = (words[name] and tuple(words[name]) for name in ("origin", "false_origin"))
    return SystemSpec(
        kind=words["kind"],
        definition=words["definition"] or "",
        geoid=words["geoid"] or "",
        origin=origin,
        false=false,
        axes=words["axes"],
        angles=words["angles"],
        sigmas=words["sigmas"],
        unit=AngleUnit(words["unit"]),
    )


def _known_of(record: Any) -> list[str]:
    """Return the ids of the points that something is known of."""
    control = record["control"]
    held = [point for point, kind in zip(control["point"], control["kind"], strict=True) if kind != "check"]
    ends = (record[name]["points"] for name in ("equal_elevations", "distances", "height_differences"))
    return held + list(chain.from_iterable(chain.from_iterable(ends)))


def _array(column: list[Any], *shape: int) -> FloatArray:
    """Return a column of numbers as an array (n, *shape), NaN for null."""
    return np.array(column, dtype=float).reshape(len(column), *shape)


def _block(record: Any, water: tuple[float, FloatArray] | None) -> Block:
    stations, cameras, options = record["stations"], record["cameras"], record["options"]
    ids = np.array(cameras["camera"], dtype=np.str_)
    number = _numbers(cameras["camera"])
    given, ellipsoid = record["water"], record["ellipsoid"]
    tides = [None] * len(stations["photo"]) if water is None else record["adjusted_water"]["tide"]
    nothing = np.full((len(stations["photo"]), 3), np.nan)
    deck = None
    if given is not None:
        known = {key: given[key] for key in ("index", "sigma", "tilt_sigma")}
        deck = Water(**known, liquid=given.get("liquid", ""))
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
            focal_length=_array(cameras["focal_length"]),
            principal_point=_array(cameras["principal_point"], 2),
            format_size=_array(cameras["format_size"], 2),
        ),
        photos=Photos(
            ids=np.array(stations["photo"], dtype=np.str_),
            camera=np.array([number[name] for name in stations["camera"]]),
            position=_array(stations["position"], 3),
            position_sigma=nothing,
            attitude=_array(stations["attitude"], 3),
            attitude_sigma=nothing,
            tide=_array(tides),
            tide_sigma=_array(stations["tide_sigma"]),
            tide_group=np.array(stations["tide_group"], dtype=np.str_),
            tide_day=np.array(stations["tide_day"], dtype=np.str_),
            time=_array(stations["time"]),
        ),
        points=Points(
            ids=np.array(record["points"]["point"], dtype=np.str_),
            bathymetric=np.array(record["points"]["bathymetric"], dtype=bool),
        ),
        plates=_plates(record),
    )


def _waves(record: Any) -> dict[str, Any]:
    """Return the waves of a block and their origin, as its deck gave them."""
    table, origin = record["waves"], record["wave_origin"]
    if not table["wave"] or origin is None:
        return {}
    from musatpy.sea.deck_waves import SHAPES  # most runs have none

    code = {str(shape): letters for letters, shape in SHAPES.items()}
    given = {name: f"given_{name}" for name in ("period", "length", "speed")}
    same = ("depth", "height", "azimuth", "crest", *WAVE_SIGMAS)
    waves = Waves(
        ids=np.array(table["wave"], dtype=np.str_),
        shape=np.array([code[shape] for shape in table["shape"]], dtype=np.str_),
        **{name: _array(table[field]) for name, field in (given | dict(zip(same, same, strict=True))).items()},
    )
    return {"waves": waves, "wave_origin": WaveOrigin(position=tuple(origin))}


def _adjusted_waves(water: Any) -> FloatArray | None:
    """Return the parameters (k, 4) of waves that the run has adjusted, None where there are none."""
    if water is None or water["waves"] is None:
        return None
    return np.stack([_array(water["waves"]["waves"][name]) for name in WAVE_VALUES], axis=1)


def _plates(record: Any) -> PlateMeasurements:
    plates = record["plates"]
    if not plates["photo"]:
        return empty(PlateMeasurements)
    photo, point = _numbers(record["stations"]["photo"]), _numbers(record["points"]["point"])
    return PlateMeasurements(
        photo=np.array([photo[name] for name in plates["photo"]]),
        point=np.array([point[name] for name in plates["point"]]),
        xy=_array(plates["xy"], 2),
        sigma=_array(plates["sigma"], 2),
        triangulated=np.zeros(len(plates["photo"]), dtype=bool),
    )


def _numbers(ids: list[str]) -> dict[str, int]:
    """Return the rows of ids."""
    return {name: row for row, name in enumerate(ids)}


def _ends(record: Any, name: str) -> IntArray:
    """Return the rows (p, 2) of the stations of the pairs of photos of a table."""
    number = _numbers(record["stations"]["photo"])
    ends = [number[photo] for photo in chain.from_iterable(record[name]["photos"])]
    return np.array(ends, dtype=np.int64).reshape(-1, 2)


def _pairs(record: Any) -> StationPairs:
    return StationPairs(
        photo=_ends(record, "station_pairs"),
        covariance=_array(record["station_pairs"]["covariance"], 6, 6),
    )


def _level_pairs(record: Any) -> LevelPairs | None:
    pairs = record.get("level_pairs")
    if pairs is None or not pairs["photos"]:
        return None
    return LevelPairs(
        photo=_ends(record, "level_pairs"),
        of_first=_array(pairs["of_first"], 6),
        of_second=_array(pairs["of_second"], 6),
        level=_array(pairs["level"]),
    )


def _water_precision(table: Any, stations: int) -> WaterPrecision | None:
    names = table["quantity"]
    if not names:
        return None
    return WaterPrecision(
        names=tuple(names),
        covariance=_array(table["covariance"], len(names)),
        stations=np.moveaxis(_array(table["stations"], stations, 6), 0, -1),
        levels=_array(table.get("levels", [[]] * len(names)), -1).T,
    )


def unadjusted(run: AdjustedRun) -> str:
    """Return what says that the stations of a deck are not those of its plates; empty where nothing does.

    A punched deck may have no plate measurements. Raises `DeckError` as `reduction.readings_job.reduce` where they
    are raw.
    """
    if run.block.raw:
        run = of_block(reduce(run.block)[0])
    last = len(run.block.photos.ids) - 2
    first = np.unique(np.linspace(0, max(last, 0), _PAIRS).astype(np.int64))[: max(last + 1, 0)]
    off = np.concatenate([np.zeros(0), *(np.abs(_y_parallaxes(run, left)) for left in first.tolist())])
    known = off[np.isfinite(off)]
    limit = max(RECOVERABLE, _MISFIT * run.block.options.plate_sigma)
    if not len(known) or np.median(known) <= limit:
        return ""
    half = f"half have y-parallaxes over {1e3 * np.median(known):.0f} um (expected: below {1e3 * limit:.0f} um)"
    return (
        f"its stations do not fit its plate measurements: of {len(known)} points that neighbouring photos share, "
        f"{half}. It is the deck of a run that is still to be adjusted: give the record of the run, NAME.json, or "
        "the deck that it punched, NAME.pun (--anyway compiles from it)"
    )


def _y_parallaxes(run: AdjustedRun, left: int) -> FloatArray:
    """Return the y-parallaxes (k,) mm of the points that a photo shares with the next one, NaN where unknown."""
    block, plates = run.block, run.block.plates
    one, other = (np.flatnonzero((plates.photo == photo) & plates.triangulated) for photo in (left, left + 1))
    common, here, there = np.intersect1d(plates.point[one], plates.point[other], return_indices=True)
    at = np.stack([one[here], other[there]], axis=1)
    readings = Readings(
        ids=block.points.ids[common],
        submerged=block.points.bathymetric[common] & np.isfinite(block.photos.tide[[left, left + 1]]).all(),
        xy=plates.xy[at],
        sigma=np.full((len(common), 2, 2), block.options.plate_sigma),
    )
    return true_points(run.without_errors, (left, left + 1), readings).y_parallax
