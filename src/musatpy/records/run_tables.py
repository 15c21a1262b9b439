"""What the record of a run says, as the tables of the model: stations, cameras, water, points, images, covariances.

Of any job: in a record stations are latitude, longitude and ellipsoidal height, geocentric or local, whatever
system the deck and its answer are stated in, and tides are heights above the ellipsoid, or Z.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from musatpy import model
from musatpy.arrays import FloatArray, IntArray, rows_of
from musatpy.errors import RecordError
from musatpy.geometry.crs import LongitudeLatitude
from musatpy.geometry.geodesy import ellipsoid_by
from musatpy.geometry.systems import Geographic, System, geographic
from musatpy.model.solution import WAVE_VALUES
from musatpy.model.water import WAVE_SIGMAS, index_fault
from musatpy.records.tables import Tables, flags, numbers, part, texts
from musatpy.systems import statement_on
from musatpy.units import AngleUnit

SYSTEM = ("options", "ellipsoid", "stated")  # tables that tell the system of a job
STATIONS = (
    *SYSTEM,
    "water",
    "adjusted_water",
    "waves",
    "wave_origin",
    "cameras",
    "adjusted_parameters",
    "ports",
    "stations",
)
BLOCK = (*STATIONS, "points", "plates")
_INTERIOR = ("F", "XP", "YP")
COVARIANCES = ("station_pairs", "level_pairs", "water_precision")


def block_of(tables: Tables) -> model.Block:
    """Return the block of a run where it has put it: adjusted stations, tides and water.

    `tables` are those of `BLOCK`. It has no waves, no control, and no sigmas of stations and attitudes: NaN.
    """
    options, system = tables["options"], ellipsoid_spec(tables)
    return model.Block(
        titles=(),
        options=model.Options(
            program=model.Program(options["program"]),
            system=model.CoordinateSystem(options["system"]),
            refraction=model.Refraction.RIGOROUS,
            plate_sigma=options["plate_sigma"],
            submerged_factor=options["submerged_factor"],
            water_level=model.WaterLevel(options["water_level"]),
            water_tilt=model.Treatment(options["water_tilt"]),
            water_index=model.Treatment(options["water_index"]),
        ),
        ellipsoid=system,
        water=_water(tables),
        cameras=cameras_of(tables),
        lens_unknowns=_lens_unknowns(tables),
        photos=photos_of(tables),
        points=model.Points(
            ids=texts(tables["points"], "point"), bathymetric=flags(tables["points"], "bathymetric")
        ),
        plates=_plates(tables),
    )


def _lens_unknowns(tables: Tables) -> model.LensUnknowns:
    """Return the parameters of lenses that were adjusted, about ideal images."""
    cameras, adjusted = tables["cameras"], tables["adjusted_parameters"]
    lens = texts(adjusted, "kind") == model.ObservationKind.LENS.label
    nothing = np.full(np.count_nonzero(lens), np.nan)
    camera = rows_of(texts(cameras, "camera"), texts(adjusted, "of")[lens])
    return model.LensUnknowns(
        camera=camera, parameter=texts(adjusted, "parameter")[lens], value=nothing, sigma=nothing
    )


def _water(tables: Tables) -> model.Water | None:
    """Return the water of the deck, with index and tilt of the adjustment where there was one."""
    given, adjusted = tables["water"], tables["adjusted_water"]
    if given is None:
        return None
    water = model.Water(
        index=given["index"], sigma=given["sigma"], tilt_sigma=given["tilt_sigma"], liquid=given["liquid"]
    )
    if adjusted is None:
        return water
    east, north = adjusted["tilt"]
    return replace(water, index=adjusted["index"], tilt_east=float(east), tilt_north=float(north))


def water_fault(tables: Tables) -> str:
    """Return why the adjusted refractive index cannot be that of its water or liquid, empty where it can."""
    fault = index_fault(tables["adjusted_water"]["index"], (tables["water"] or {}).get("liquid", ""))
    return fault and f"{fault} on the card of its deck"


def lens_fault(tables: Tables) -> str:
    """Return why images of the run are not ideal, empty where they are."""
    adjusted = tables["adjusted_parameters"]
    lens = texts(adjusted, "kind") == model.ObservationKind.LENS.label
    bent = lens & ~np.isin(texts(adjusted, "parameter"), _INTERIOR)
    cameras = ", ".join(sorted(set(texts(adjusted, "of")[bent].tolist())))
    return (
        cameras and f"the distortion of camera {cameras} was adjusted: this command does not correct images for it"
    )


def port_fault(tables: Tables) -> str:
    """Return why images of the run are not those of cameras without port, empty where they are."""
    behind = ", ".join(texts(tables["ports"], "camera").tolist())
    return behind and f"camera {behind} is behind a port: this command does not trace images through it"


def cameras_of(tables: Tables) -> model.Cameras:
    """Return the cameras of a run, as adjusted, without distortion. Raises `RecordError` where one has a port."""
    if fault := port_fault(tables):
        raise RecordError.of(fault)
    cameras, adjusted = tables["cameras"], tables["adjusted_parameters"]
    lens = texts(adjusted, "kind") == model.ObservationKind.LENS.label
    ids, parameter = texts(cameras, "camera"), texts(adjusted, "parameter")[lens]
    focal_length, principal_point = numbers(cameras, "focal_length"), numbers(cameras, "principal_point", 2)
    row, value = rows_of(ids, texts(adjusted, "of")[lens]), numbers(adjusted, "adjusted")[lens]
    focal_length[row[parameter == "F"]] = value[parameter == "F"]
    for axis, name in enumerate(("XP", "YP")):
        principal_point[row[parameter == name], axis] = value[parameter == name]
    return model.Cameras(
        ids=ids,
        focal_length=focal_length,
        principal_point=principal_point,
        format_size=numbers(cameras, "format_size", 2),
    )


def photos_of(tables: Tables) -> model.Photos:
    """Return the photos at their adjusted stations and tides; sigmas are not known there: NaN."""
    stations, adjusted = tables["stations"], tables["adjusted_water"]
    ids = texts(stations, "photo")
    nothing = np.full((len(ids), 3), np.nan)
    return model.Photos(
        ids=ids,
        camera=rows_of(texts(tables["cameras"], "camera"), texts(stations, "camera")),
        position=numbers(stations, "position", 3),
        position_sigma=nothing,
        attitude=numbers(stations, "attitude", 3),
        attitude_sigma=nothing,
        tide=nothing[:, 0] if adjusted is None else numbers(adjusted, "tide"),
        tide_sigma=numbers(stations, "tide_sigma"),
        tide_group=texts(stations, "tide_group"),
        tide_day=texts(stations, "tide_day"),
        time=numbers(stations, "time"),
    )


def _plates(tables: Tables) -> model.PlateMeasurements:
    plates = tables["plates"]
    photo = rows_of(texts(tables["stations"], "photo"), texts(plates, "photo"))
    return model.PlateMeasurements(
        photo=photo,
        point=rows_of(texts(tables["points"], "point"), texts(plates, "point")),
        xy=numbers(plates, "xy", 2),
        sigma=numbers(plates, "sigma", 2),
        triangulated=np.zeros(len(photo), dtype=bool),
    )


def given_waves(tables: Tables) -> dict[str, Any]:
    """Return the waves of a block and their origin, as its deck gave them."""
    table, origin = tables["waves"], tables["wave_origin"]
    if not table["wave"] or origin is None:
        return {}
    given = {name: f"given_{name}" for name in ("period", "length", "speed")}
    same = {name: name for name in ("depth", "height", "azimuth", "crest", *WAVE_SIGMAS)}
    waves = model.Waves(
        ids=texts(table, "wave"),
        shape=np.array([model.WaveShape[shape.upper()] for shape in table["shape"]], dtype=np.str_),
        **{name: numbers(table, field) for name, field in (given | same).items()},
    )
    return {"waves": waves, "wave_origin": model.WaveOrigin(position=tuple(origin))}


def adjusted_waves(tables: Tables) -> FloatArray | None:
    """Return the parameters (k, 4) of waves that the run has adjusted, None where there are none."""
    waves = part(tables, "adjusted_water.waves.waves")
    return np.stack([numbers(waves, name) for name in WAVE_VALUES], axis=1) if waves else None


# --- covariances: of pairs of stations, of their levels, of the water ---


def station_pairs(tables: Tables) -> model.StationPairs:
    """Return the covariances (p, 6, 6) of pairs of stations."""
    pairs = tables["station_pairs"]
    return model.StationPairs(photo=_ends(tables, pairs), covariance=numbers(pairs, "covariance", 6, 6))


def level_pairs(tables: Tables) -> model.LevelPairs | None:
    """Return the covariances of pairs of stations with levels of their own, None where there are none."""
    pairs = tables["level_pairs"]
    if not pairs["photos"]:
        return None
    return model.LevelPairs(
        photo=_ends(tables, pairs),
        of_first=numbers(pairs, "of_first", 6),
        of_second=numbers(pairs, "of_second", 6),
        level=numbers(pairs, "level"),
    )


def _ends(tables: Tables, pairs: Tables) -> IntArray:
    """Return the rows (p, 2) of the stations of pairs of photos."""
    photos = np.array(pairs["photos"], dtype=np.str_).reshape(-1)
    return rows_of(texts(tables["stations"], "photo"), photos).reshape(-1, 2)


def water_precision(tables: Tables) -> model.WaterPrecision | None:
    """Return the covariances of the water, None where nothing of it was adjusted."""
    table = tables["water_precision"]
    names, stations = tuple(table["quantity"]), len(tables["stations"]["photo"])
    if not names:
        return None
    return model.WaterPrecision(
        names=names,
        covariance=numbers(table, "covariance", len(names)),
        stations=np.moveaxis(numbers(table, "stations", stations, 6), 0, -1),
        levels=np.array(table["levels"], dtype=float).reshape(len(names), -1).T,
    )


# --- the system of a job ---


def answer_spec(tables: Tables) -> model.SystemSpec | None:
    """Return how the answer of a run is stated, None where in the system of its job."""
    if tables.get("stated") is None:
        return None
    answer = tables["stated"]["answer"]
    origin, false = (answer[name] and tuple(answer[name]) for name in ("origin", "false_origin"))
    return model.SystemSpec(
        kind=answer["kind"],
        definition=answer["definition"] or "",
        geoid=answer["geoid"] or "",
        origin=origin,
        false=false,
        axes=answer["axes"],
        angles=answer["angles"],
        sigmas=answer["sigmas"],
        unit=AngleUnit(answer["unit"]),
    )


def ellipsoid_spec(tables: Tables) -> model.EllipsoidSpec | None:
    """Return the ellipsoid of a job, None of a local one."""
    given = tables.get("ellipsoid")
    return None if given is None else model.EllipsoidSpec(**{**given, "name": given["name"] or ""})


def job_system(tables: Tables) -> System:
    """Return the system in which a job gives its points: that of its answer; longitude and latitude in degrees.

    `tables` are those of `SYSTEM`. Raises `SystemsError` where it cannot be had again.
    """
    spec = answer_spec(tables) or model.SystemSpec(kind=tables["options"]["system"])
    system = statement_on(spec, ellipsoid_spec(tables)).system
    return LongitudeLatitude(system.ellipsoid) if isinstance(system, Geographic) else system


def level_positions(tables: Tables, positions: FloatArray) -> FloatArray:
    """Return positions (n, 3) of a record as latitude, longitude (rad) and height (m); of a local job X, Y, Z.

    Raises `SystemsError` where the ellipsoid of the job is unknown.
    """
    if tables["options"]["system"] != model.CoordinateSystem.GEOCENTRIC:
        return positions
    return geographic(ellipsoid_by(ellipsoid_spec(tables), model.CoordinateSystem.GEOCENTRIC), positions)
