"""Soundings from a LAS file, or one of comma-separated values under a line of names, in any order and case.

Places are `lat` and `lon` (degrees), or `x` and `y` (m); the value is `depth`, positive down, or `height`; `sigma`
of it, `name` and `date` may be given.
"""

from __future__ import annotations

import csv
import datetime
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.arrays import DateArray, FloatArray, TextArray
from musatpy.errors import Problem, SoundingError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.projected import crs_of
from musatpy.interchange import las
from musatpy.pointfiles.csv_tables import common_name, number, separator_faults
from musatpy.pointfiles.las_files import SUFFIXES
from musatpy.soundings.job_places import job_places
from musatpy.units import DEGREE

if TYPE_CHECKING:
    import pyproj

_PLACES = (("lat", "lon"), ("x", "y"))
_VALUES = ("depth", "height")
_DATE = "date"
NO_DATES = "no column date, by which soundings could be left out"
_DEGREES = {"lat": 90.0, "lon": 360.0}


@dataclass(frozen=True, kw_only=True, eq=False)
class Soundings:
    """n soundings: place (n, 2), latitude and longitude (rad) where `angular`, else m; depth (n,) m, positive down.

    sigma (n,) m of the depth, NaN where the file gives none, date (n,) NaT where it gives none. Values that are
    heights have the opposite sign here. crs: the system that the file says, None for none.
    """

    names: TextArray
    place: FloatArray
    angular: bool
    depth: FloatArray
    sigma: FloatArray
    date: DateArray
    crs: pyproj.CRS | None = None


def read_soundings(source: Path, job: Ellipsoid | None = None, *, crs: str = "", dated: bool = False) -> Soundings:
    """Return the soundings of a file, places in the coordinates of a job: None for those of a local one.

    `crs` is the system of x and y that a file does not say, `dated` asks for dates. Raises `SoundingError` with
    every line that cannot be used, `InterchangeError` for a LAS file that cannot, and `OSError`.
    """
    soundings = _of_las(source, dated) if source.suffix.lower() in SUFFIXES else _of_csv(source, dated)
    system = soundings.crs or (crs_of(crs) if crs else None)
    if soundings.angular or system is None:
        return soundings
    return replace(soundings, place=job_places(source, soundings.place, system, job), angular=True)


def _of_las(source: Path, dated: bool) -> Soundings:
    """Return the points of a LAS file: depths by their extra bytes `depth`, or else heights."""
    points = las.read(source)
    if dated:
        raise SoundingError([Problem(file=str(source), message=NO_DATES)])
    columns = {common_name(name): column.values.astype(float) for name, column in points.columns.items()}
    depth = columns.get("depth", -points.xyz[:, 2])
    lost = np.flatnonzero(~np.isfinite(depth))
    if len(lost):
        message = f"{len(lost)} points have no depth, point {lost[0] + 1} first"
        raise SoundingError([Problem(file=str(source), message=message)])
    return Soundings(
        names=np.arange(1, len(depth) + 1).astype(np.str_),
        place=points.xyz[:, :2],
        angular=False,
        depth=depth,
        sigma=columns.get("sigma", np.full(len(depth), np.nan)),
        date=np.full(len(depth), "NaT", dtype="datetime64[D]"),
        crs=points.crs,
    )


def _of_csv(source: Path, dated: bool) -> Soundings:
    with source.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        records = list(_records(csv.reader(file)))
    if not records:
        raise SoundingError([Problem(file=str(source), message="the file is empty")])
    first, header = records[0]
    names = [common_name(name) for name in header]
    wanted, faults = _columns(names)
    if dated and _DATE not in names:
        faults.append(NO_DATES)
    if faults:
        raise SoundingError([Problem(file=str(source), line=first, message=fault) for fault in faults])
    place = {name: names.index(name) for name in (*wanted, "name", *([_DATE] if dated else [])) if name in names}
    rows, problems, texts, dates = [], [], [], []
    for line, cells in records[1:]:
        row = {name: cells[column].strip() if column < len(cells) else "" for name, column in place.items()}
        values = [number(row[name]) for name in wanted]
        for name, value in zip(wanted, values, strict=True):
            if expected := _expected(name, value, row[name]):
                problems.append(
                    Problem(file=str(source), line=line, field=name, found=row[name], expected=expected)
                )
        try:
            dates.append(_date(row.get(_DATE, "")))
        except ValueError:
            problems.append(
                Problem(file=str(source), line=line, field=_DATE, found=row[_DATE], expected="a date YYYY-MM-DD")
            )
        rows.append(values)
        texts.append(row.get("name", str(line)))
    if not rows:
        problems.append(Problem(file=str(source), message="no sounding"))
    if problems:
        raise SoundingError(problems)
    table, angular = np.array(rows), wanted[0] == "lat"
    return Soundings(
        names=np.array(texts, dtype=np.str_),
        place=table[:, :2] * (DEGREE if angular else 1.0),
        angular=angular,
        depth=table[:, 2] * (1.0 if wanted[2] == "depth" else -1.0),
        sigma=table[:, 3] if len(wanted) > 3 else np.full(len(table), np.nan),
        date=np.array(dates, dtype="datetime64[D]"),
    )


def _records(reader: Any) -> Iterator[tuple[int, list[str]]]:
    """Yield the records of a file that have something in them, with the lines on which they begin."""
    line = 1
    for cells in reader:
        if any(cells):
            yield line, cells
        line = reader.line_num + 1


def _date(cell: str) -> np.datetime64:
    """Return the day that a cell says, no day for a blank one. Raises `ValueError`."""
    return np.datetime64(datetime.date.fromisoformat(cell) if cell else "NaT", "D")


def _expected(name: str, value: float, cell: str) -> str:
    """Return what should stand in a cell, empty where it does: a sigma may be blank."""
    if name == "sigma":
        return "" if not cell or value >= 0.0 else "a number of 0 or more, or nothing"
    if not np.isfinite(value):
        return "a number"
    largest = _DEGREES.get(name, np.inf)
    return "" if abs(value) <= largest else f"{-largest:g} to {largest:g} degrees"


def _columns(names: list[str]) -> tuple[list[str], list[str]]:
    """Return the columns to be read, two of the place, the value, and its sigma if any; and what is missing."""
    if faults := separator_faults(names):
        return [], faults
    twice = [name for name in (*sum(_PLACES, ()), *_VALUES, "sigma", "name", _DATE) if names.count(name) > 1]
    both = [" and ".join(pair) for pair in (_VALUES, ("lat", "x")) if set(pair) <= set(names)]
    if twice or both:
        return [], [f"more than one column {name}" for name in twice] + [
            f"columns {pair}: one is meant" for pair in both
        ]
    place = next((pair for pair in _PLACES if set(pair) <= set(names)), None)
    value = next((name for name in _VALUES if name in names), None)
    among = f"among {', '.join(names)}"
    faults = [] if place else [f"no columns lat and lon, or x and y, {among}"]
    faults += [] if value else [f"no column depth or height {among}"]
    if place is None or value is None:
        return [], faults
    return [*place, value, *(["sigma"] if "sigma" in names else [])], []
