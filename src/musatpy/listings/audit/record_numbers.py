"""The record NAME.json of a run -> all that can be compared with a listing, in full precision."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from musatpy.listings.audit.analysis_tables import STATISTICS
from musatpy.listings.audit.listing_numbers import named_turns
from musatpy.listings.audit.plate_tables import AXES, GROUPS
from musatpy.listings.audit.quantities import LOCAL_VERTICAL, NATIVE, SAME, Key, Quantity
from musatpy.listings.audit.submerged_tables import COLUMNS
from musatpy.units import ARC_SECOND, MICROMETRE

Found = Iterator[tuple[Key, Quantity]]
Record = Mapping[str, Any]

# What can be compared of a record: whole fields, and of tables with more the fields that are used.
NEEDS = {
    **dict.fromkeys(("analyses", "plate_statistics", "bathymetric_points", "stated"), ()),
    "options": ("system", "refraction"),
    "solution": ("degrees_of_freedom", "sigma0"),
    "stations": ("photo", "position", "position_sigma", "attitude", "attitude_sigma"),
    "points": ("point", "bathymetric", "position", "sigma"),
    "control": ("point", "kind", "difference", "used", "adjusted_sigma"),
    "plates": ("photo", "point", "residual", "refraction"),
}
_KINDS = {
    "camera_station_position": "station position",
    "camera_station_attitude": "station attitude",
    "ground_point": "ground point",
    "check_point": "check point",
}
_ATTITUDE = ("X-Tilt", "Y-Tilt", "Heading")
_ATTITUDE_SIGMAS = ("Sigma X-T", "Sigma Y-T", "Sigma Hdg")
_POINT_FIELDS = ("no_refraction", "predicted", "refraction")
_DEPTH_FIELDS = {  # heading -> field, unit
    "Photos": ("photos", ""),
    "Incidence": ("incidence", "arcsec"),
    "Water level": ("water_level", "m"),
    "Depth, no refr.": ("depth_no_refraction", "m"),
    "Depth, predicted": ("depth_predicted", "m"),
    "Depth, refraction": ("depth", "m"),
    "Sigma": ("depth_sigma", "m"),
    "Height": ("height", "m"),
    "Residual": ("residual", "m"),
}
_JOB = ("triangulated", "not triangulated", "all")
_OF_SYSTEM = "SYST"  # sigmas of the coordinates of the answer
_MICROMETRES = 1.0 / MICROMETRE  # of a plate millimetre


def statistics_of_record(record: Record) -> dict[Key, Quantity]:
    """Return all that can be compared of the record of a run; `KeyError` and the like where it is none."""
    refracted = record["options"]["refraction"] != "NONE"
    return dict(
        chain(
            _solution(record["solution"]),
            *(_analyses(kind, refracted, record["analyses"][name]) for name, kind in _KINDS.items()),
            _plates(record["plate_statistics"], refracted),
            _bathymetric(record["bathymetric_points"], refracted),
            _own(record),
            _control(record),
            _residuals(record["plates"], {row["point"] for row in record["points"] if row["bathymetric"]}),
            _stated(record["stated"]) if record["stated"] is not None else (),
        )
    )


def _one(
    report: str,
    item: str,
    statistic: str,
    value: float | None,
    unit: str,
    *,
    words: str = "",
    refracted: bool | None = None,
) -> Found:
    """Yield a number where there is one, angles (rad) in arc seconds."""
    if value is not None:
        value = value / ARC_SECOND if unit == "arcsec" else value
        key = Key(report=report, refracted=refracted, item=item, statistic=statistic, words=words)
        yield key, Quantity(value=value, unit=unit, text="")


def _many(
    report: str, item: str, names: Sequence[str], values: Sequence[float | None] | None, units: str, words: str = ""
) -> Found:
    for name, value in zip(names, values or (), strict=False):
        yield from _one(report, item, name, value, units, words=words)


def _solution(row: Record) -> Found:
    yield from _one("solution", "all", "degrees of freedom", row["degrees_of_freedom"], "")
    yield from _one("solution", "all", "sigma0", row["sigma0"], "")


def _analyses(kind: str, refracted: bool, rows: Sequence[Record]) -> Found:
    report = f"{kind} analysis"
    for row in rows:
        item, unit = row["component"], "arcsec" if row["unit"] == "rad" else "m"
        if not any(other["size"] for other in rows):
            return  # nor does it print an analysis of nothing
        yield from _one(report, item, "size", row["size"], "", refracted=refracted)
        for statistic in STATISTICS:
            yield from _one(report, item, statistic, row[statistic], unit, refracted=refracted)
        if row["maximum_id"]:
            key = Key(report=report, refracted=refracted, item=item, statistic="maximum at")
            yield key, Quantity(value=None, unit="", text=row["maximum_id"])


def _plates(table: Record, refracted: bool) -> Found:
    report = "plate residuals"
    for frame in table["frames"]:
        for group, pair in zip(GROUPS, frame["rms"], strict=True):
            for axis, value in zip(AXES, pair, strict=True):
                # A listing prints .000 for none.
                yield from _one(report, frame["photo"], f"{group}, {axis}", value or 0.0, "mm", refracted=refracted)
    for group, photo in zip(GROUPS, table["largest"], strict=True):
        if photo is not None:
            key = Key(report=report, refracted=refracted, item=group, statistic="largest at")
            yield key, Quantity(value=None, unit="", text=photo)
    for name, count, pair in zip(_JOB, table["total_count"], table["total_rms"], strict=True):
        report = "plate residuals of the job"
        yield from _one(report, name, "Number", count, "")
        for axis, value in zip(AXES, pair, strict=True):
            yield from _one(report, name, f"RMS {axis}", value and value * _MICROMETRES, "um")


def _bathymetric(rows: Sequence[Record], refracted: bool) -> Found:
    # Without refraction: coordinates without it and predicted; rays, water level, and depths of both kinds.
    columns, depths = (3, len(_DEPTH_FIELDS)) if refracted else (2, 5)
    for row in rows:
        for column, field in zip(COLUMNS[:columns], _POINT_FIELDS[:columns], strict=True):
            names = [f"{axis}, {column}" for axis in "XYZ"]
            yield from _many("bathymetric points", row["point"], names, row[field], "m")
        for heading, (field, unit) in list(_DEPTH_FIELDS.items())[:depths]:
            yield from _one("depths", row["point"], heading, row.get(field), unit)


def _own(record: Record) -> Found:
    """Yield stations and points as the adjustment has them."""
    system = record["options"]["system"]
    words = NATIVE[system]
    names, units = ("X", "Y", "Z"), ("m", "m", "m")
    if system == "GEOG":
        names, units = ("Latitude", "Longitude", "Elevation"), ("arcsec", "arcsec", "m")
    sigmas, said = _metric(system), words if system == "LOCL" else ""
    for row in record["stations"]:
        item, report = row["photo"], "adjusted stations"
        for name, value, unit in zip(names, row["position"] or (), units, strict=False):
            yield from _one(report, item, name, value, unit, words=words)
        yield from _many(report, item, [f"Sigma {one}" for one in sigmas], row["position_sigma"], "m", said)
        yield from _many(report, item, _ATTITUDE, row["attitude"], "arcsec", LOCAL_VERTICAL)
        yield from _many(report, item, _ATTITUDE_SIGMAS, row["attitude_sigma"], "arcsec")
    for row in record["points"]:
        item, report = row["point"], "adjusted points"
        for name, value, unit in zip(names, row["position"] or (), units, strict=False):
            yield from _one(report, item, name, value, unit, words=words)
        yield from _many(report, item, [f"Sigma {one}" for one in sigmas], row["sigma"], "m", said)


def _metric(system: str) -> tuple[str, str, str]:
    return ("X", "Y", "Z") if system == "LOCL" else ("East", "North", "Up")


def _control(record: Record) -> Found:
    names = _metric(record["options"]["system"])
    for row in record["control"]:
        if row["kind"] == "check":
            yield from _many("check points", row["point"], names, row["difference"], "m")
            sigmas = [f"Sigma {name}" for name in names]
            yield from _many("check points", row["point"], sigmas, row["adjusted_sigma"], "m")
        else:
            used = [one if took else None for one, took in zip(row["difference"], row["used"], strict=True)]
            yield from _many("control residuals", row["point"], names, used, "m")


def _residuals(rows: Sequence[Record], submerged: set[str]) -> Found:
    """Yield residuals, and of submerged points what refraction does to them: a listing prints no others."""
    for row in rows:
        item = f"{row['photo']} {row['point']}"
        for name, field in (("Resid.", "residual"), ("Refr.", "refraction")):
            if field == "refraction" and row["point"] not in submerged:
                continue
            values = [value and value * _MICROMETRES for value in row[field]]
            yield from _many("plate measurements", item, [f"{name} {axis}" for axis in AXES], values, "um")


def _stated(stated: Record) -> Found:
    """Yield stations and points in the words of the SYS card."""
    answer = stated["answer"]
    places, turns, _ = answer["text"].split("; ")
    turns = named_turns(turns, places)
    names = [name.capitalize() if len(name) > 1 else name for name in answer["coordinates"]]
    names = [SAME.get(name, name) for name in names]
    printed = zip(names, answer["coordinate_units"], strict=True)
    units = ["arcsec" if name in ("Latitude", "Longitude") else unit for name, unit in printed]
    for report, rows, key in (
        ("adjusted stations", stated["stations"], "photo"),
        ("adjusted points", stated["points"], "point"),
    ):
        for row in rows:
            for name, unit, value in zip(names, units, row["position"] or (), strict=False):
                yield from _one(report, row[key], name, value, unit, words=places)
            if answer["sigmas"] == _OF_SYSTEM:
                yield from _stated_sigmas(report, row[key], names, units, row["covariance"], places, turns)
    for row in stated["stations"]:
        yield from _turned(row, turns)


def _stated_sigmas(
    report: str,
    item: str,
    names: Sequence[str],
    units: Sequence[str],
    covariance: Sequence[Sequence[float | None]] | None,
    places: str,
    turns: str,
) -> Found:
    """Yield the sigmas of coordinates and, of stations, attitudes, from the diagonal of their covariance."""
    variances = [(row or [None] * (n + 1))[n] for n, row in enumerate(covariance or ())]
    sigmas = [None if one is None else math.sqrt(max(one, 0.0)) for one in variances]
    short = {"Latitude": "Lat", "Longitude": "Long", "Elevation": "h"}
    for name, unit, sigma in zip(names, units, sigmas, strict=False):
        yield from _one(report, item, f"Sigma {short.get(name, name)}", sigma, unit, words=places)
    angles = [f"Sigma {name}" for name in _angles(turns)] or ["Sigma"] * 3
    yield from _many(report, item, angles, sigmas[3:], "arcsec", turns)


def _angles(turns: str) -> list[str]:
    """Return the names of the angles of attitudes in the words of a statement; none of matrices."""
    first, second, rest = [*turns.split(", "), "", ""][:3]
    return [one.capitalize() for one in (first, second, rest.split(" ")[0])] if second else []


def _turned(row: Record, turns: str) -> Found:
    names = _angles(turns)
    if names:
        names = [SAME.get(name, name) for name in names] if turns == LOCAL_VERTICAL else names
        yield from _many("adjusted stations", row["photo"], names, row["angles"], "arcsec", turns)
        return
    for number, line in enumerate(row["matrix"] or (), start=1):
        axes = ("First axis", "Second axis", "Third axis")
        yield from _many("adjusted stations", f"{row['photo']} {number}", axes, line, "", turns)
