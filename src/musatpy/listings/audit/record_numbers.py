"""The record NAME.json of a run -> all that can be compared with a listing, in full precision."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from musatpy.listings.audit.analysis_tables import STATISTICS
from musatpy.listings.audit.headings import AUDITED, MATRIX_AXES, Audited
from musatpy.listings.audit.listing_numbers import OutputSystem, Quantities, named_turns
from musatpy.listings.audit.plate_tables import AXES, GROUPS
from musatpy.listings.audit.quantities import LOCAL_VERTICAL, NATIVE, SAME, Key, Quantity
from musatpy.listings.audit.submerged_tables import COLUMNS
from musatpy.listings.recorded import entries_of, mapped_of, value_of
from musatpy.listings.sections import columns_of
from musatpy.reports.origin import Origin
from musatpy.reports.statements import statements
from musatpy.reports.table import PRINTED, Report, Table
from musatpy.units import ARC_SECOND

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
_ANGLES = ("arc sec", "degrees")  # units of headings
_ANALYSES = ("camera_station_position", "camera_station_attitude", "ground_point", "check_point")
_POINT_FIELDS = ("no_refraction", "predicted", "refraction")
_REFRACTED = ("depth", "depth_sigma", "height", "residual")  # that a listing without refraction does not print
_OF_SYSTEM = "SYST"  # sigmas of the coordinates of the answer


def statistics_of_record(record: Record) -> dict[Key, Quantity]:
    """Return all that can be compared of the record of a run; `KeyError` and the like where it is none."""
    refracted = record["options"]["refraction"] != "NONE"
    return dict(
        chain(
            _number("solution", "all", "degrees of freedom", record["solution"]["degrees_of_freedom"], ""),
            _number("solution", "all", "sigma0", record["solution"]["sigma0"], ""),
            *(_analysis(name, refracted, record["analyses"][name]) for name in _ANALYSES),
            _plates(record["plate_statistics"], refracted),
            _bathymetric(record["bathymetric_points"], refracted),
            *(_ruled(table, record) for table in AUDITED if table.report),
            _stated(record["stated"]) if record["stated"] is not None else (),
        )
    )


def _number(
    report: str, item: str, statistic: str, value: Any, unit: str, words: str = "", refracted: bool | None = None
) -> Quantities:
    """Yield a number where there is one, angles (rad) in arc seconds."""
    if value is not None:
        if unit == "arcsec":
            value /= ARC_SECOND
        elif unit in PRINTED:
            value *= 1.0 / PRINTED[unit]
        yield Key(report, refracted, item, statistic, words), Quantity(value, unit, "")


def _numbers(
    report: str, item: str, names: Sequence[str], values: Sequence[float | None] | None, units: str, words: str = ""
) -> Quantities:
    for name, value in zip(names, values or (), strict=False):
        yield from _number(report, item, name, value, units, words=words)


def _analysis(name: str, refracted: bool, rows: Sequence[Record]) -> Quantities:
    report = f"{name.removeprefix('camera_').replace('_', ' ')} analysis"
    for row in rows if any(row["size"] for row in rows) else ():  # an analysis of nothing is not printed
        item, unit = row["component"], "arcsec" if row["unit"] == "rad" else "m"
        yield from _number(report, item, "size", row["size"], "", refracted=refracted)
        for statistic in STATISTICS:
            yield from _number(report, item, statistic, row[statistic], unit, refracted=refracted)
        if row["maximum_id"]:
            yield Key(report, refracted, item, "maximum at"), Quantity(None, "", row["maximum_id"])


def _plates(table: Record, refracted: bool) -> Quantities:
    report = "plate residuals"
    frames = table["frames"]
    for photo, pairs in _zipped(frames, "photo", "rms"):
        for group, pair in zip(GROUPS, pairs, strict=True):
            for axis, value in zip(AXES, pair, strict=True):
                # A listing prints .000 for none.
                yield from _number(report, photo, f"{group}, {axis}", value or 0.0, "mm", refracted=refracted)
    for group, photo in zip(GROUPS, table["largest"], strict=True):
        if photo is not None:
            yield Key(report, refracted, group, "largest at"), Quantity(None, "", photo)


def _bathymetric(table: Record, refracted: bool) -> Quantities:
    columns = 3 if refracted else 2  # coordinates without refraction, predicted, with it
    for column, field in zip(COLUMNS[:columns], _POINT_FIELDS[:columns], strict=True):
        names = [f"{axis}, {column}" for axis in "XYZ"]
        for point, position in _zipped(table, "point", field):
            yield from _numbers("bathymetric points", point, names, position, "m")


def _ruled(audited: Audited, record: Record) -> Quantities:
    """Yield the numbers of a ruled table, in the words of the adjustment, from where the reports state them."""
    system, refracted = record["options"]["system"], record["options"]["refraction"] != "NONE"
    reports = (statement for statement in statements() if isinstance(statement, Report))
    report = next(report for report in reports if report.title.startswith(audited.title))
    columns = list(_columns(report, system, audited))
    output = OutputSystem(NATIVE[system], LOCAL_VERTICAL)
    submerged = {name for name, wet in _zipped(record["points"], "point", "bathymetric") if wet}
    for ids, fields in entries_of(mapped_of(report), record):
        item = " ".join(ids[: len(audited.key)])
        for heading, unit, origin in columns:
            is_dry = origin.blank and fields["point"] not in submerged
            if not (is_dry or (origin.field in _REFRACTED and not refracted)):
                name, system_words = output.name_of(heading) if audited.stated else (heading, "")
                yield from _number(audited.report, item, name, value_of(origin, fields), unit, words=system_words)


def _columns(report: Report[Any], system: str, audited: Audited) -> Iterator[tuple[str, str, Origin]]:
    """Yield heading, unit and origin of the columns of a job that can be compared."""
    layouts = report.layouts()
    columns = [
        last if system == "LOCL" or (system == "GEOC" and str(first.shows).startswith("position")) else first
        for first, last in zip(layouts[0], layouts[-1], strict=True)
    ]
    for heading, column in zip(columns_of(Table(tuple(columns)).head()), columns, strict=True):
        if heading.name in audited.compared and column.origin:
            unit = column.origin.unit or heading.unit
            yield heading.name, "arcsec" if heading.angle or unit in _ANGLES else unit, column.origin


def _stated(stated: Record) -> Quantities:
    """Yield stations and points in the words of the SYS card."""
    answer = stated["answer"]
    places, turns, _ = answer["text"].split("; ")
    turns = named_turns(turns, places)
    names = [name.capitalize() if len(name) > 1 else name for name in answer["coordinates"]]
    names = [SAME.get(name, name) for name in names]
    printed = zip(names, answer["coordinate_units"], strict=True)
    units = ["arcsec" if name in ("Latitude", "Longitude") else unit for name, unit in printed]
    for report, table, key in (
        ("adjusted stations", stated["stations"], "photo"),
        ("adjusted points", stated["points"], "point"),
    ):
        for item, position, covariance in _zipped(table, key, "position", "covariance"):
            for name, unit, value in zip(names, units, position or (), strict=False):
                yield from _number(report, item, name, value, unit, words=places)
            if answer["sigmas"] == _OF_SYSTEM:
                yield from _stated_sigmas(report, item, names, units, covariance, places, turns)
    for photo, angles, matrix in _zipped(stated["stations"], "photo", "angles", "matrix"):
        yield from _turned(photo, angles, matrix, turns)


def _zipped(table: Record, *fields: str) -> Iterator[tuple[Any, ...]]:
    """Yield the values of some fields of each row of a table."""
    return zip(*(table[field] for field in fields), strict=True)


def _stated_sigmas(
    report: str,
    item: str,
    names: Sequence[str],
    units: Sequence[str],
    covariance: Sequence[Sequence[float | None]] | None,
    places: str,
    turns: str,
) -> Quantities:
    """Yield the sigmas of coordinates and, of stations, attitudes, from the diagonal of their covariance."""
    variances = [(row or [None] * (n + 1))[n] for n, row in enumerate(covariance or ())]
    sigmas = [None if variance is None else math.sqrt(max(variance, 0.0)) for variance in variances]
    short = {"Latitude": "Lat", "Longitude": "Long", "Elevation": "h"}
    for name, unit, sigma in zip(names, units, sigmas, strict=False):
        yield from _number(report, item, f"Sigma {short.get(name, name)}", sigma, unit, words=places)
    angles = [f"Sigma {name}" for name in _angles(turns)] or ["Sigma"] * 3
    yield from _numbers(report, item, angles, sigmas[3:], "arcsec", turns)


def _angles(turns: str) -> list[str]:
    """Return the names of the angles of attitudes in the words of a statement; none of matrices."""
    first, second, rest = [*turns.split(", "), "", ""][:3]
    return [angle.capitalize() for angle in (first, second, rest.split(" ")[0])] if second else []


def _turned(
    photo: str, angles: Sequence[float | None] | None, matrix: Sequence[Sequence[float]] | None, turns: str
) -> Quantities:
    names = _angles(turns)
    if names:
        names = [SAME.get(name, name) for name in names] if turns == LOCAL_VERTICAL else names
        yield from _numbers("adjusted stations", photo, names, angles, "arcsec", turns)
        return
    for number, line in enumerate(matrix or (), start=1):
        yield from _numbers("adjusted stations", f"{photo} {number}", MATRIX_AXES, line, "", turns)
