"""The JSON record of a job: the numbers of the listing at full precision, in metres, radians and plate millimetres.

`record.schema.json` beside this file names and explains every field, with its unit. Numbers that do not exist (NaN)
are null; the order of the keys is fixed; rows of tables stand one on a line.
"""

from __future__ import annotations

import dataclasses
import json

import musatpy
from musatpy.model import Block, ControlKind, Options, PointStatus, Solution
from musatpy.reports.encoding import Json, Rows, names, number, plain, rows
from musatpy.reports.quality_record import (
    adjusted_water,
    causes,
    dependence,
    findings,
    observations,
    tests,
    verdict,
)
from musatpy.reports.reduction_record import calibrations, reduction
from musatpy.reports.sea import origin_record, waves_record
from musatpy.reports.stated_record import stated
from musatpy.statistics import PLATE_KINDS, Analysis, Statistics
from musatpy.statistics.soundings import NOT_GIVEN, soundings

SCHEMA_VERSION = "1.7"


def record(solution: Solution) -> dict[str, Json]:
    """Return the record of a solution, as dictionaries, lists, texts and numbers."""
    return record_of(Statistics(solution))


def record_of(statistics: Statistics) -> dict[str, Json]:
    """Return `record` of a solution whose statistics exist already."""
    block = statistics.block
    return {
        "schema_version": SCHEMA_VERSION,
        "program": {"name": "musatpy", "version": musatpy.__version__},
        "units": {"length": "m", "angle": "rad", "plate": "mm"},
        "titles": list(block.titles),
        "options": _options(block.options),
        "ellipsoid": _ellipsoid(block),
        "water": None if block.water is None else dataclasses.asdict(block.water),
        "waves": waves_record(statistics),
        "wave_origin": origin_record(statistics),
        "verdict": verdict(statistics),
        "solution": _solution(statistics.solution),
        "iterations": _iterations(statistics.solution),
        "water_passes": _passes(statistics.solution),
        "analyses": _analyses(statistics),
        "plate_statistics": _plate_statistics(statistics),
        "cameras": _cameras(block),
        "distortion": _distortion(block),
        "fiducials": _fiducials(block),
        "stations": _stations(statistics),
        "points": _points(statistics),
        "stated": stated(statistics),
        "bathymetric_points": _bathymetric(statistics),
        "control": _control(statistics),
        "equal_elevations": _equal_elevations(statistics),
        "air_bases": _air_bases(statistics),
        "distances": _distances(statistics),
        "height_differences": _height_differences(statistics),
        "adjusted_water": adjusted_water(statistics),
        "tests": tests(statistics),
        "observations": observations(statistics),
        "dependence": dependence(statistics),
        "findings": findings(statistics.solution),
        "causes": causes(statistics.solution),
        "unedited": statistics.solution.unedited,
        "fiducial_measurements": _fiducial_measurements(statistics.read),
        "plates": _plates(statistics),
        **calibrations(statistics.read),
        "reduction": reduction(statistics),
    }


def dumps(record: dict[str, Json]) -> str:
    """Return the record as JSON text, one row of a table on a line."""
    return _layout(record, "\n") + "\n"


def _layout(value: Json, margin: str) -> str:
    """Spread tables, and what contains them, over lines that begin with `margin`."""
    inner = margin + "  "
    if _is_table(value):
        return "[" + ",".join(inner + _dump(row) for row in value) + margin + "]"
    if isinstance(value, dict) and any(_is_table(entry) or isinstance(entry, dict) for entry in value.values()):
        entries = (f"{inner}{_dump(key)}: {_layout(entry, inner)}" for key, entry in value.items())
        return "{" + ",".join(entries) + margin + "}"
    return _dump(value)


def _is_table(value: Json) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], dict)


# One encoder for all: json.dumps would make another for every row.
_dump = json.JSONEncoder(allow_nan=False).encode


def _options(options: Options) -> dict[str, Json]:
    return {
        "program": options.program.value,
        "system": options.system.value,
        "initial": options.initial.value,
        "refraction": options.refraction.value,
        "weights": options.weights.value,
        "max_iterations": options.max_iterations,
        "max_passes": options.max_passes,
        "rotation_limit": options.rotation_limit,
        "translation_limit": options.translation_limit,
        "water_limit": options.water_limit,
        "plate_sigma": options.plate_sigma,
        "submerged_factor": options.submerged_factor,
        "water_level": options.water_level.value,
        "water_tilt": options.water_tilt.value,
        "water_index": options.water_index.value,
        "datum": options.datum.value,
        "editing": options.editing.value,
        "order": options.order.value,
        "plate_sigma_is": options.plate_sigma_is.value,
        "sigma0_limit": options.sigma0_limit,
        "station_limit": options.station_limit,
    }


def _ellipsoid(block: Block) -> dict[str, Json] | None:
    spec = block.ellipsoid
    if spec is None:
        return None
    return {
        "name": spec.name or None,
        "semi_major_axis": spec.semi_major_axis,
        "inverse_flattening": spec.inverse_flattening,
    }


def _solution(solution: Solution) -> dict[str, Json]:
    return {
        "converged": solution.converged,
        "reason": solution.reason,
        "warnings": list(solution.warnings),
        "sigma0": number(solution.sigma0),
        "unit_sigma": number(solution.unit_sigma),
        "degrees_of_freedom": solution.degrees_of_freedom,
        "sum_of_squares": number(solution.sum_of_squares),
        "observations": {kind: int(count) for kind, count in solution.observations.items()},
        "unknowns": {kind: int(count) for kind, count in solution.unknowns.items()},
    }


def _iterations(solution: Solution) -> Rows:
    photos = solution.block.photos.ids
    return [
        {
            "pass": i.outer_pass,
            "number": i.number,
            "rotation": number(i.rotation),
            "rotation_photo": str(photos[i.rotation_photo]),
            "translation": number(i.translation),
            "translation_photo": str(photos[i.translation_photo]),
            "sum_of_squares": number(i.sum_of_squares),
            "damping": number(i.damping),
        }
        for i in solution.iterations
    ]


def _passes(solution: Solution) -> Rows:
    return [
        {
            "number": p.number,
            "movement": number(p.movement),
            "point": str(solution.block.points.ids[p.point]),
            "rms_movement": number(p.rms_movement),
            "rms_residual": number(p.rms_residual),
        }
        for p in solution.passes
    ]


def _analyses(statistics: Statistics) -> dict[str, Json]:
    return {
        "camera_station_position": _analysis(statistics.station_positions),
        "camera_station_attitude": _analysis(statistics.station_attitudes),
        "ground_point": _analysis(statistics.ground_points),
        "check_point": _analysis(statistics.check_points),
    }


def _analysis(analysis: Analysis) -> Rows:
    return [
        {
            "component": component,
            "unit": unit,
            "size": d.size,
            "sum": number(d.sum),
            "mean": number(d.mean),
            "rms": number(d.rms),
            "deviation": number(d.deviation),
            "maximum": number(d.maximum),
            "maximum_id": d.maximum_id or None,
        }
        for component, unit, d in zip(analysis.components, analysis.units, analysis.statistics, strict=True)
    ]


def _plate_statistics(statistics: Statistics) -> dict[str, Json]:
    plates, ids = statistics.plates, statistics.block.photos.ids
    return {
        "kinds": list(PLATE_KINDS),
        "frames": rows(photo=ids, count=plates.count, rms=plates.rms),
        "largest": [str(ids[photo]) if photo >= 0 else None for photo in plates.largest],
        "total_count": plain(plates.total_count),
        "total_rms": plain(plates.total_rms),
    }


def _cameras(block: Block) -> Rows:
    cameras = block.cameras
    return rows(
        camera=cameras.ids,
        focal_length=cameras.focal_length,
        principal_point=cameras.principal_point,
        format_size=cameras.format_size,
    )


def _distortion(block: Block) -> Rows:
    distortion = block.distortion
    return rows(camera=block.cameras.ids[distortion.camera], kind=distortion.kind, values=distortion.values)


def _fiducials(block: Block) -> Rows:
    marks = block.fiducials
    return rows(camera=block.cameras.ids[marks.camera], mark=marks.ids, xy=marks.xy, sigma=marks.sigma)


def _fiducial_measurements(block: Block) -> Rows:
    marks = block.fiducial_measurements
    return rows(photo=block.photos.ids[marks.photo], mark=marks.ids, xy=marks.xy, sigma=marks.sigma)


def _stations(statistics: Statistics) -> Rows:
    photos, stations = statistics.block.photos, statistics.solution.stations
    return rows(
        photo=photos.ids,
        camera=statistics.block.cameras.ids[photos.camera],
        position=stations.position,
        position_sigma=statistics.station_sigmas[:, :3],
        attitude=stations.attitude,
        attitude_sigma=statistics.station_sigmas[:, 3:],
        covariance=stations.covariance,
        given_position=photos.position,
        given_position_sigma=photos.position_sigma,
        given_attitude=photos.attitude,
        given_attitude_sigma=photos.attitude_sigma,
        tide=photos.tide,
        tide_sigma=photos.tide_sigma,
        tide_group=photos.tide_group,
        tide_day=photos.tide_day,
        time=photos.time,
    )


def _points(statistics: Statistics) -> Rows:
    points, block = statistics.solution.points, statistics.block
    return rows(
        point=block.points.ids,
        bathymetric=block.points.bathymetric,
        status=names(PointStatus, points.status),
        reason=[points.reasons.get(row) for row in range(len(block.points.ids))],
        rays=points.rays,
        position=points.position,
        sigma=statistics.point_sigmas,
        covariance=points.covariance,
    )


def _bathymetric(statistics: Statistics) -> Rows:
    points, given = statistics.solution.bathymetric, soundings(statistics.solution)
    xyz = statistics.bathymetric_xyz
    return rows(
        point=statistics.block.points.ids[points.point],
        no_refraction=xyz[:, 0],
        predicted=xyz[:, 1],
        refraction=xyz[:, 2],
        photos=statistics.solution.points.rays[points.point],
        incidence=points.incidence,
        water_level=points.water_level,
        depth_no_refraction=points.apparent_depth,
        depth_predicted=points.predicted_depth,
        depth=points.depth,
        depth_sigma=points.depth_sigma,
        height=points.height,
        control=[None if kind == NOT_GIVEN else ControlKind(kind).name.lower() for kind in given.kind.tolist()],
        residual=given.residual,
    )


def _control(statistics: Statistics) -> Rows:
    control = statistics.block.control
    return rows(
        point=statistics.block.points.ids[control.point],
        kind=names(ControlKind, control.kind),
        fixed=control.fixed,
        given_position=control.position,
        given_sigma=control.sigma,
        difference=statistics.control.difference,
        used=statistics.control.used,
        adjusted_sigma=statistics.control.adjusted_sigma,
        test=statistics.control_tests,
    )


def _equal_elevations(statistics: Statistics) -> Rows:
    groups, solution = statistics.block.equal_elevations, statistics.solution
    ids, differences = statistics.block.points.ids[groups.point], statistics.level_differences
    members = [groups.group == group for group in range(len(groups.ids))]
    return rows(
        group=groups.ids,
        given_sigma=groups.sigma,
        level=solution.levels,
        level_sigma=solution.level_sigmas,
        points=[ids[member].tolist() for member in members],
        difference=[plain(differences[member]) for member in members],
    )


def _air_bases(statistics: Statistics) -> Rows:
    bases = statistics.block.air_bases
    return rows(
        photos=statistics.block.photos.ids[bases.photo],
        given_length=bases.length,
        given_sigma=bases.sigma,
        length=statistics.solution.base_lengths,
    )


def _distances(statistics: Statistics) -> Rows:
    distances = statistics.block.distances
    return rows(
        points=statistics.block.points.ids[distances.point],
        given_length=distances.length,
        given_sigma=distances.sigma,
        length=statistics.solution.distances,
    )


def _height_differences(statistics: Statistics) -> Rows:
    heights = statistics.block.height_differences
    return rows(
        points=statistics.block.points.ids[heights.point],
        given_difference=heights.difference,
        given_sigma=heights.sigma,
        difference=statistics.solution.height_differences,
    )


def _plates(statistics: Statistics) -> Rows:
    plates, residuals = statistics.block.plates, statistics.solution.plates
    return rows(
        photo=statistics.block.photos.ids[plates.photo],
        point=statistics.block.points.ids[plates.point],
        xy=plates.xy,
        sigma=statistics.plate_sigmas,
        triangulated=residuals.triangulated,
        residual=residuals.residual,
        refraction=residuals.correction,
    )
