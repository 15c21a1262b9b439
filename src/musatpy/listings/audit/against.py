"""A listing beside a newer run, by meaning: the same statistic of the same id, whatever its page and column.

The newer run is a listing too, or the record NAME.json that `musat run` left.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

from musatpy.errors import MusatError
from musatpy.listings.audit.analyses import MAXIMUM_ID, SIZE, STATISTICS
from musatpy.listings.audit.plates import AXES, GROUPS
from musatpy.listings.audit.plates import NAME as PLATES
from musatpy.listings.audit.reading import Listing, read_listing
from musatpy.listings.audit.report import PrintedNumber, printed_id, run_name, text_like
from musatpy.listings.audit.submerged import COLUMNS
from musatpy.listings.audit.submerged import NAME as SUBMERGED
from musatpy.records.json_files import read_record
from musatpy.units import ARC_SECOND

_FULL_CIRCLE = 360.0 * 3600.0  # arc seconds
_ANALYSES = ("camera_station_position", "camera_station_attitude", "ground_point", "check_point")
_POSITIONS = ("no_refraction", "predicted", "refraction")  # of a submerged point, as COLUMNS
_TABLES = ("options", "analyses", "plate_statistics", "bathymetric_points")  # of a record that are compared
_COLUMNS = "{:<10}  {:<13}  {:>13}  {:>13}  {:>15}"


@dataclass(frozen=True)
class Key:
    """What a number is, not where it stood: the report, whose, and which."""

    report: str  # "ground point analysis"
    refracted: bool | None
    item: str  # component, frame, point
    statistic: str


@dataclass(frozen=True, kw_only=True)
class StatisticPair:
    """The same statistic in both."""

    key: Key
    old: PrintedNumber
    new: PrintedNumber

    @property
    def difference(self) -> float | None:
        """New minus old, of angles the smaller way round; None for ids."""
        difference = self.new.value - self.old.value
        if math.isnan(difference):
            return None
        return difference - (_FULL_CIRCLE * round(difference / _FULL_CIRCLE) if self.old.unit == "arcsec" else 0.0)

    @property
    def alike(self) -> bool:
        """True where both are the same id, or the same number within the rounding of both prints."""
        if self.difference is None:
            return self.old.text == self.new.text
        return abs(self.difference) <= (self.old.half + self.new.half) * (1.0 + 1e-9)


@dataclass(frozen=True, kw_only=True)
class SideBySide:
    """Two runs by meaning."""

    pairs: tuple[StatisticPair, ...]
    only_old: tuple[Key, ...]
    only_new: tuple[Key, ...]
    several: tuple[Key, ...]  # more than once in one of them, and not the same there: not compared


def side_by_side(old: Listing, path: Path | str) -> SideBySide:
    """Return a listing beside the listing or record of a newer run.

    Raises `MusatError` where the file has nothing to compare with, `OSError` where it cannot be read.
    """
    first, several = numbers_of(old)
    if Path(path).suffix.lower() == ".json":
        second = dict(_numbers_of_record(read_record(Path(path), _TABLES)))
    else:
        second, several_new = numbers_of(read_listing(path))
        several = several | several_new
    runs = {key.refracted for key in second if key.refracted is not None}
    if len(runs) == 1 and all(key.refracted is None for key in first):
        # Reports that do not say their run are of the only one there is.
        (run,) = runs
        first = {key if key.report == SUBMERGED else replace(key, refracted=run): one for key, one in first.items()}
    common = [key for key in first if key in second]
    if not common:
        raise MusatError(f"{path}: has no statistic that is in {old.name} too")
    return SideBySide(
        pairs=tuple(StatisticPair(key=key, old=first[key], new=second[key]) for key in common),
        only_old=tuple(key for key in first if key not in second and key not in several),
        only_new=tuple(key for key in second if key not in first and key not in several),
        several=tuple(sorted(several, key=str)),
    )


def numbers_of(listing: Listing) -> tuple[dict[Key, PrintedNumber], set[Key]]:
    """Return all that can be compared of a listing, and what stands there more than once with different numbers.

    The latter, of two runs with refraction, say, is not compared.
    """
    numbers: dict[Key, PrintedNumber] = {}
    several: set[Key] = set()
    for report in listing.reports:
        for place, cell in report.cells.items():
            key = Key(report.name, report.refracted, *place)
            if numbers.setdefault(key, cell).text != cell.text:
                several.add(key)
    return {key: cell for key, cell in numbers.items() if key not in several}, several


def _numbers_of_record(record: Mapping[str, Any]) -> Iterator[tuple[Key, PrintedNumber]]:
    """Yield all that can be compared of the record of a run, in full precision."""
    refracted = record["options"]["refraction"] != "NONE"
    for name in _ANALYSES:
        report, rows = f"{name.removeprefix('camera_').replace('_', ' ')} analysis", record["analyses"][name]
        for row in rows if any(row["size"] for row in rows) else ():  # an analysis of nothing is not printed
            of = report, refracted, row["component"]
            unit, factor = ("arcsec", 1.0 / ARC_SECOND) if row["unit"] == "rad" else ("m", 1.0)
            yield Key(*of, SIZE), PrintedNumber(row["size"], 0.0, "")
            values = ((what, row[what]) for what in STATISTICS if row[what] is not None)
            yield from (
                (Key(*of, what), PrintedNumber(value * factor, 0.0, "", unit=unit)) for what, value in values
            )
            if row["maximum_id"]:
                yield Key(*of, MAXIMUM_ID), printed_id(row["maximum_id"])
    frames = record["plate_statistics"]["frames"]
    for photo, pairs in zip(frames["photo"], frames["rms"], strict=True):
        for group, pair in zip(GROUPS, pairs, strict=True):
            for axis, value in zip(AXES, pair, strict=True):
                # A listing prints .000 for none.
                yield (
                    Key(PLATES, refracted, photo, f"{group}, {axis}"),
                    PrintedNumber(value or 0.0, 0.0, "", unit="mm"),
                )
    points = record["bathymetric_points"]
    columns = list(zip(COLUMNS, _POSITIONS, strict=True))[: 3 if refracted else 2]
    for column, position in columns:
        for point, xyz in zip(points["point"], points[position], strict=True):
            for axis, value in zip("XYZ", xyz or (), strict=False):
                if value is not None:
                    yield Key(SUBMERGED, None, point, f"{axis}, {column}"), PrintedNumber(value, 0.0, "", unit="m")


def side_text(beside: SideBySide, listed: int) -> str:
    """Return the statistics side by side, those that differ beyond their print marked.

    Of a report with more rows than `listed`, those that differ most are shown.
    """
    lines: list[str] = []
    for (report, refracted), group in groupby(beside.pairs, key=lambda pair: (pair.key.report, pair.key.refracted)):
        pairs = list(group)
        # An id that differs comes first.
        ranked = sorted(pairs, key=lambda pair: -abs(pair.difference or 0.0))
        ranked.sort(key=lambda pair: pair.difference is not None or pair.alike)
        lines += ["", f"{report}{run_name(refracted)}", ""]
        lines.append(_COLUMNS.format("item", "statistic", "listing", "new", "difference"))
        lines += [_row(pair) for pair in pairs if pair in ranked[:listed]]
        if len(pairs) > listed:
            lines.append(f"... and {len(pairs) - listed} that differ less")
    differ = sum(not pair.alike for pair in beside.pairs)
    lines += ["", f"{len(beside.pairs)} compared, {differ} differ by more than their rounding (*)"]
    lines.append(f"{len(beside.only_old)} only in the listing, {len(beside.only_new)} only in the new run")
    if beside.several:
        lines.append(f"{len(beside.several)} more than once in one of them, with different numbers: not compared")
    return "\n".join(lines[1:]) + "\n"


def _row(pair: StatisticPair) -> str:
    if pair.difference is None or not pair.old.unit:
        new = pair.new.text or f"{pair.new.value:.0f}"
        size = f"{pair.difference:.0f}" if pair.difference is not None else ""
    else:
        new = pair.new.text or text_like(pair.new.value, pair.old.text)
        size = f"{text_like(pair.difference, pair.old.text.split()[-1])} {pair.old.unit}"
    mark = "" if pair.alike else "  *"
    return (_COLUMNS.format(pair.key.item, pair.key.statistic, pair.old.text, new, size) + mark).rstrip()


def side_record(beside: SideBySide) -> dict[str, Any]:
    """Return the same for JSON, a dictionary of lists."""
    keys = {"only_listing": beside.only_old, "only_new": beside.only_new, "several": beside.several}
    return {
        "compared": [
            {
                **dataclasses.asdict(pair.key),
                "unit": pair.old.unit,
                "listing": pair.old.text if math.isnan(pair.old.value) else pair.old.value,
                "new": pair.new.text if math.isnan(pair.new.value) else pair.new.value,
                "difference": pair.difference,
                "alike": pair.alike,
            }
            for pair in beside.pairs
        ],
        **{name: [dataclasses.asdict(key) for key in of] for name, of in keys.items()},
    }
