"""The record NAME.json of a run -> all that can be compared with a listing, in full precision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

from musatpy.listings.audit.analysis_tables import STATISTICS
from musatpy.listings.audit.listing_numbers import Quantities
from musatpy.listings.audit.plate_tables import AXES, GROUPS
from musatpy.listings.audit.quantities import Key, Quantity
from musatpy.listings.audit.submerged_tables import COLUMNS
from musatpy.units import ARC_SECOND

Record = Mapping[str, Any]

_ANALYSES = ("camera_station_position", "camera_station_attitude", "ground_point", "check_point")
_POINT_FIELDS = ("no_refraction", "predicted", "refraction")
# The fields that a record is compared by, whole where no field of them is named.
NEEDS = {
    "options": ("refraction",),
    "analyses": (),
    "plate_statistics": (),
    "bathymetric_points": ("point", *_POINT_FIELDS),
}


def statistics_of_record(record: Record) -> dict[Key, Quantity]:
    """Return all that can be compared of the record of a run; `KeyError` and the like where it is none."""
    refracted = record["options"]["refraction"] != "NONE"
    return dict(
        chain(
            *(_analysis(name, refracted, record["analyses"][name]) for name in _ANALYSES),
            _plates(record["plate_statistics"], refracted),
            _bathymetric(record["bathymetric_points"], refracted),
        )
    )


def _analysis(name: str, refracted: bool, rows: Sequence[Record]) -> Quantities:
    report = f"{name.removeprefix('camera_').replace('_', ' ')} analysis"
    for row in rows if any(row["size"] for row in rows) else ():  # an analysis of nothing is not printed
        is_angle = row["unit"] == "rad"
        yield Key(report, refracted, row["component"], "size"), Quantity(row["size"], "", "")
        for statistic in STATISTICS:
            if (value := row[statistic]) is not None:
                number = Quantity(value / ARC_SECOND, "arcsec", "") if is_angle else Quantity(value, "m", "")
                yield Key(report, refracted, row["component"], statistic), number
        if row["maximum_id"]:
            yield Key(report, refracted, row["component"], "maximum at"), Quantity(None, "", row["maximum_id"])


def _plates(table: Record, refracted: bool) -> Quantities:
    report = "plate residuals"
    for photo, pairs in zip(table["frames"]["photo"], table["frames"]["rms"], strict=True):
        for group, pair in zip(GROUPS, pairs, strict=True):
            for axis, value in zip(AXES, pair, strict=True):
                # A listing prints .000 for none.
                yield Key(report, refracted, photo, f"{group}, {axis}"), Quantity(value or 0.0, "mm", "")
    for group, photo in zip(GROUPS, table["largest"], strict=True):
        if photo is not None:
            yield Key(report, refracted, group, "largest at"), Quantity(None, "", photo)


def _bathymetric(table: Record, refracted: bool) -> Quantities:
    columns = 3 if refracted else 2  # coordinates without refraction, predicted, with it
    for column, field in zip(COLUMNS[:columns], _POINT_FIELDS[:columns], strict=True):
        for point, position in zip(table["point"], table[field], strict=True):
            for axis, value in zip("XYZ", position or (), strict=False):
                if value is not None:
                    yield Key("bathymetric points", None, point, f"{axis}, {column}"), Quantity(value, "m", "")
