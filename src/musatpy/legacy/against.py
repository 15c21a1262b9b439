"""A listing beside a newer run, by meaning: the same statistic of the same id, whatever its page and column.

The newer run is a listing too, or the record NAME.json that `musat run` left.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from musatpy.errors import MusatError
from musatpy.legacy.analyses import STATISTICS
from musatpy.legacy.cross_checks import number
from musatpy.legacy.plates import AXES, GROUPS
from musatpy.legacy.read import read_listing
from musatpy.legacy.structures import Analysis, Listing, PlateTable, Table, run_name
from musatpy.legacy.submerged import COLUMNS
from musatpy.units import ARC_SECOND

_KINDS = {
    "camera_station_position": "station position",
    "camera_station_attitude": "station attitude",
    "ground_point": "ground point",
    "check_point": "check point",
}
_ATTITUDE = ("X-Tilt", "Y-Tilt", "Heading")
_POSITION = {"GEOG": ("Latitude", "Longitude", "Elevation")}
# Title of a table of our listings, the name of its report here, the key of its rows.
_TABLES = (
    ("Adjusted Exposure Stations: Positions", "adjusted stations", "Photo"),
    ("Adjusted Exposure Stations: Attitudes", "adjusted stations", "Photo"),
    ("Adjusted Ground Points", "adjusted points", "Point"),
)


@dataclass(frozen=True, kw_only=True)
class Key:
    """What a number is: the report, whose, and which."""

    report: str  # "ground point analysis"
    refracted: bool | None
    item: str  # component, frame, point
    statistic: str

    @property
    def heading(self) -> str:
        """The report with its run."""
        return f"{self.report}{run_name(self.refracted)}"


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A number in arc seconds, metres or plate millimetres, or an id."""

    value: float | None  # None for ids
    unit: str
    text: str  # as printed; empty where it comes from a record
    half: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Pair:
    """The same statistic in both."""

    key: Key
    old: Quantity
    new: Quantity

    @property
    def difference(self) -> float | None:
        """New minus old; None for ids."""
        if self.old.value is None or self.new.value is None:
            return None
        return self.new.value - self.old.value

    @property
    def alike(self) -> bool:
        """True where both are the same id, or the same number within the rounding of both prints."""
        if self.difference is None:
            return self.old.text == self.new.text
        return abs(self.difference) <= (self.old.half + self.new.half) * (1.0 + 1e-9)


@dataclass(frozen=True, kw_only=True)
class SideBySide:
    """Two runs by meaning."""

    pairs: tuple[Pair, ...]
    only_old: tuple[Key, ...]
    only_new: tuple[Key, ...]


def side_by_side(old: Listing, path: Path | str) -> SideBySide:
    """Return a listing beside the listing or record of a newer run.

    Raises `MusatError` where the file has nothing to compare with, `OSError` where it cannot be read.
    """
    first, second = statistics_of(old), _statistics_in(Path(path))
    runs = {key.refracted for key in second if key.refracted is not None}
    if len(runs) == 1:
        first = _of_run(first, next(iter(runs)))
    common = [key for key in first if key in second]
    if not common:
        raise MusatError(f"{path}: has no statistic that is in {old.name} too")
    return SideBySide(
        pairs=tuple(Pair(key=key, old=first[key], new=second[key]) for key in common),
        only_old=tuple(key for key in first if key not in second),
        only_new=tuple(key for key in second if key not in first),
    )


def _of_run(statistics: dict[Key, Quantity], refracted: bool) -> dict[Key, Quantity]:
    """Return statistics of reports that do not say their run, as those of the only run there is."""
    if any(key.refracted is not None for key in statistics):
        return statistics
    return {
        Key(
            report=key.report,
            refracted=None if key.report.startswith(("bathymetric", "adjusted")) else refracted,
            item=key.item,
            statistic=key.statistic,
        ): quantity
        for key, quantity in statistics.items()
    }


def _statistics_in(path: Path) -> dict[Key, Quantity]:
    if path.suffix.lower() != ".json":
        return statistics_of(read_listing(path))
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        return statistics_of_record(record)
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise MusatError(f"{path}: is no record of a run ({type(error).__name__}: {error})") from error


def statistics_of(listing: Listing) -> dict[Key, Quantity]:
    """Return all that can be compared of a listing."""
    found: dict[Key, Quantity] = {}
    for analysis in listing.analyses:
        found.update(_analysis(analysis))
    for table in listing.plates:
        found.update(_plates(table))
    for submerged in listing.submerged:
        for point in submerged.points:
            for (column, axis), cell in point.xyz.items():
                key = Key(report=submerged.name, refracted=None, item=point.name, statistic=f"{axis}, {column}")
                found[key] = Quantity(value=cell.value, unit="m", text=cell.text, half=cell.half)
    for title, report, name in _TABLES:
        ruled = listing.table(title)
        if ruled is not None and not listing.stated:
            found.update(_ruled(ruled, report, name))
    return found


def _analysis(analysis: Analysis) -> Iterator[tuple[Key, Quantity]]:
    report = f"{analysis.kind} analysis"
    for component in analysis.components:

        def key(statistic: str, item: str = component.name) -> Key:
            return Key(report=report, refracted=analysis.refracted, item=item, statistic=statistic)

        if component.size is not None:
            yield key("size"), Quantity(value=component.size, unit="", text=str(component.size))
        for statistic, cell in component.statistics.items():
            yield (
                key(statistic),
                Quantity(value=cell.value, unit=component.unit, text=cell.text, half=cell.half),
            )
        if component.maximum_id:
            yield key("maximum at"), Quantity(value=None, unit="", text=component.maximum_id)


def _plates(table: PlateTable) -> Iterator[tuple[Key, Quantity]]:
    for (group, axis), row in table.rms.items():
        for frame, cell in row.items():
            key = Key(report="plate residuals", refracted=table.refracted, item=frame, statistic=f"{group}, {axis}")
            yield key, Quantity(value=cell.value, unit="mm", text=cell.text, half=cell.half)
    for group, stars in table.stars.items():
        if len(stars) == 1:
            key = Key(report="plate residuals", refracted=table.refracted, item=group, statistic="largest at")
            yield key, Quantity(value=None, unit="", text=stars[0][0])


def _ruled(table: Table, report: str, name: str) -> Iterator[tuple[Key, Quantity]]:
    """Yield the coordinates and angles of stations or points; sigmas and counts are no matter of meaning here."""
    for row in table.rows:
        for heading in ("Latitude", "Longitude", "Elevation", "X", "Y", "Z", *_ATTITUDE):
            cell = number(row.cells.get(heading, ""), row.line)
            if cell is not None:
                unit = "arcsec" if len(cell.text.split()) == 3 else "m"
                key = Key(report=report, refracted=None, item=row.cells[name], statistic=heading)
                yield key, Quantity(value=cell.value, unit=unit, text=cell.text, half=cell.half)


def statistics_of_record(record: Mapping[str, Any]) -> dict[Key, Quantity]:
    """Return all that can be compared of the record of a run; `KeyError` and the like where it is none."""
    refracted = record["options"]["refraction"] != "NONE"
    found: dict[Key, Quantity] = {}
    for name, kind in _KINDS.items():
        for row in record["analyses"][name]:
            found.update(_analysis_row(kind, refracted, row))
    for frame in record["plate_statistics"]["frames"]:
        for group, pair in zip(GROUPS, frame["rms"], strict=True):
            for axis, value in zip(AXES, pair, strict=True):
                key = Key(
                    report="plate residuals", refracted=refracted, item=frame["photo"], statistic=f"{group}, {axis}"
                )
                found[key] = Quantity(value=value or 0.0, unit="mm", text="")  # a listing prints .000 for none
    for group, photo in zip(GROUPS, record["plate_statistics"]["largest"], strict=True):
        if photo is not None:
            key = Key(report="plate residuals", refracted=refracted, item=group, statistic="largest at")
            found[key] = Quantity(value=None, unit="", text=photo)
    found.update(_coordinates(record))
    return found


def _analysis_row(kind: str, refracted: bool, row: Mapping[str, Any]) -> Iterator[tuple[Key, Quantity]]:
    report, item = f"{kind} analysis", row["component"]
    unit, factor = ("arcsec", 1.0 / ARC_SECOND) if row["unit"] == "rad" else ("m", 1.0)
    yield (
        Key(report=report, refracted=refracted, item=item, statistic="size"),
        Quantity(value=row["size"], unit="", text=""),
    )
    for statistic in STATISTICS:
        if row[statistic] is not None:
            key = Key(report=report, refracted=refracted, item=item, statistic=statistic)
            yield key, Quantity(value=row[statistic] * factor, unit=unit, text="")
    if row["maximum_id"]:
        key = Key(report=report, refracted=refracted, item=item, statistic="maximum at")
        yield key, Quantity(value=None, unit="", text=row["maximum_id"])


def _coordinates(record: Mapping[str, Any]) -> Iterator[tuple[Key, Quantity]]:
    names = _POSITION.get(record["options"]["system"], ("X", "Y", "Z"))
    for row in record["bathymetric_points"]:
        for column, field in zip(COLUMNS, ("no_refraction", "predicted", "refraction"), strict=True):
            for axis, value in zip("XYZ", row[field], strict=True):
                yield from _coordinate("bathymetric points", row["point"], f"{axis}, {column}", value, "m")
    for report, table, key in (("stations", "stations", "photo"), ("points", "points", "point")):
        for row in record[table]:
            fields = [*zip(names, row["position"] or (), strict=False)]
            fields += zip(_ATTITUDE, row.get("attitude") or (), strict=False)
            for name, value in fields:
                unit = "arcsec" if name in ("Latitude", "Longitude", *_ATTITUDE) else "m"
                yield from _coordinate(f"adjusted {report}", row[key], name, value, unit)


def _coordinate(
    report: str, item: str, statistic: str, value: float | None, unit: str
) -> Iterator[tuple[Key, Quantity]]:
    if value is not None:
        value = value / ARC_SECOND if unit == "arcsec" else value
        key = Key(report=report, refracted=None, item=item, statistic=statistic)
        yield key, Quantity(value=value, unit=unit, text="")
