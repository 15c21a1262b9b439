"""The water level at exposures: readings of a gauge, interpolated in time, or one level that is given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.errors import Problem
from musatpy.formats.job_folder import read_job
from musatpy.geometry.projected import Geoid
from musatpy.model import ObservationKind, Solution
from musatpy.pointfiles.columns import FileColumn, Wanted, number
from musatpy.pointfiles.point_tables import read_table
from musatpy.sfm.model import ModelError, links, refused
from musatpy.sfm.times import parsed_time, seconds, zone_of
from musatpy.sfm.wet import LIMIT

GAP = 1800.0  # s, the longest between readings, and between photos of a flight
_LEAST = 5  # readings that say how well they are interpolated
_TRIALS = 4  # of a gap in all of the file, each begun some readings later
_COLUMNS = (
    FileColumn(name="time", kind="text", aliases=("t", "date time", "datetime"), expected="a time"),
    FileColumn(name="date", kind="text", aliases=("day",), required=False, expected="a day"),
    FileColumn(
        name="level",
        unit="m",
        aliases=("water level", "sea level", "verified", "height", "tide", "z", "value"),
        blank=True,
        least=-1e4,
        most=1e4,
    ),
    FileColumn(name="sigma", unit="m", required=False, blank=True, least=0.0, expected="0 or more"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tide:
    """n readings of a gauge, by time."""

    file: str
    time: FloatArray  # (n,) s of UTC since 1970, ascending
    level: FloatArray  # (n,) m
    sigma: FloatArray  # (n,) m, of a reading

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return levels and their sigmas (k,) m at times; NaN beyond the readings and in gaps above 30 minutes.

        Levels are those of monotone cubics (PCHIP). Their error is measured: readings in gaps as long as that of a
        photo are left out all over the file, and compared with what the others give for them. Where there are none
        in such gaps G, longer ones H count with (G/H)^2. The RMS in the middle of gaps, less the noise of readings,
        is the sigma there, and 4 u (1 - u) of it at the part u of a gap.
        """
        from scipy.interpolate import PchipInterpolator

        place = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        first, gap = self.time[place], np.diff(self.time)[place]
        within = (time >= self.time[0]) & (time <= self.time[-1])
        part = np.where(within, (time - first) / gap, 0.0)
        good = within & ((gap <= GAP) | (part == 0.0) | (part == 1.0))
        level = np.full(len(time), np.nan)
        level[good] = PchipInterpolator(self.time, self.level)(time[good])
        lengths, number = np.unique(np.round(gap), return_inverse=True)
        missed = np.array([self._missed(length) if length <= GAP else 0.0 for length in lengths.tolist()])[number]
        reading = np.hypot((1.0 - part) * self.sigma[place], part * self.sigma[place + 1])
        return level, np.where(good, np.hypot(reading, 4.0 * part * (1.0 - part) * missed), np.nan)

    def _missed(self, gap: float) -> float:
        """Return the RMS error of interpolation in the middle of a gap of so many seconds."""
        from scipy.interpolate import PchipInterpolator

        count, squares = len(self.time), list[FloatArray]()
        ends = np.searchsorted(self.time, self.time + gap * (1.0 - 1e-9))
        ends = np.maximum(ends, np.arange(count) + 2)
        ends[0] = min(ends[0], count - 1)  # a file that is shorter is one gap
        for start in range(0, int(ends[0]), max(1, int(ends[0]) // _TRIALS)):
            rows = [start]
            while rows[-1] < count and ends[rows[-1]] < count:
                rows += [int(ends[rows[-1]]), int(ends[rows[-1]]) + 1]
            a, b = np.array(rows[: len(rows) - 1]).reshape(-1, 2).T
            if not len(a):
                continue
            out = (np.cumsum(np.bincount(a + 1, minlength=count + 1) - np.bincount(b, minlength=count + 1)) > 0)[
                :-1
            ]
            middle = np.clip(np.searchsorted(self.time, 0.5 * (self.time[a] + self.time[b])), a + 1, b - 1)
            off = PchipInterpolator(self.time[~out], self.level[~out])(self.time[middle]) - self.level[middle]
            noise = self.sigma[middle] ** 2 + 0.25 * (self.sigma[a] ** 2 + self.sigma[b] ** 2)
            squares.append((off**2 - noise) * np.minimum(1.0, gap / (self.time[b] - self.time[a])) ** 4)
        return float(np.sqrt(max(np.concatenate(squares).mean(), 0.0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class PhotoLevels:
    """The water at n exposures, as the tables of a block have it."""

    level: FloatArray  # (n,) m
    sigma: FloatArray  # (n,) m
    group: TextArray  # (n,) photos with a common error: flights
    tide: Tide | None = None  # from which they are, its levels as those of the photos

    def kept(self, time: FloatArray) -> dict[str, Any]:
        """Return what is kept of a tide in a job folder, with the mean times of flights by those of photos (n,)."""
        if self.tide is None:
            return {}
        names, number = np.unique(self.group, return_inverse=True)
        return {
            "tide": np.column_stack([self.tide.time, self.tide.level, self.tide.sigma]),
            "flights": names,
            "flight_times": np.bincount(number, time) / np.bincount(number),
        }


def read_tide(path: Path, zone: str = "", sigma: float = np.nan) -> Tide:
    """Return the readings of a table: time (or date and time), level and, where it has it, sigma.

    Rows without a level are no readings. `zone` is that of times that state none, nor have it above them as UTC or
    GMT, `sigma` (m) that of readings without one. Raises `ModelError` with line
    and column; `OSError`.
    """
    table = read_table(path, Wanted(columns=_COLUMNS))
    level = table.numbers("level")
    for row in np.flatnonzero(np.isnan(level)).tolist() if table.has("level") else ():
        if (text := table.texts("level")[row]).lower() == "nan":
            table.refuse(f"'{text}' is not a number", row, "level")
    table.require(ModelError, "there are no readings")
    above = table.layout.units[table.layout.place("time")].upper()
    zone = zone or (above if above in ("UTC", "GMT") else "")
    local = zone_of(zone) if zone else None
    texts, given = table.texts("time"), table.numbers("sigma")
    if table.has("date"):
        texts = [f"{day} {hour}" for day, hour in zip(table.texts("date"), texts, strict=True)]
    times = [parsed_time(text) for text in texts]
    for row, (text, time) in enumerate(zip(texts, times, strict=True)):
        if time is None:
            table.refuse(f"'{text}' is no date and time YYYY-MM-DD hh:mm", row, "time")
        elif time.tzinfo is None and local is None:
            table.refuse(f"'{text}' states no time zone; expected: Z or +hh:mm, or --tide-zone", row, "time")
        elif time.tzinfo is None:
            times[row] = time.replace(tzinfo=local)
    given = np.where(np.isnan(given), sigma, given)
    rows = np.flatnonzero(np.isfinite(level))
    if np.isnan(given[rows]).any():
        table.refuse("readings have no sigma; expected: a column sigma, or a sigma of all readings")
    at = seconds(times)
    order = rows[np.argsort(at[rows], kind="stable")]
    for row in order[1:][np.diff(at[order]) == 0.0].tolist():
        table.refuse(f"'{texts[row]}' stands there twice", row, "time")
    if len(rows) < _LEAST:
        table.refuse(f"{len(rows)} readings do not say how well they are interpolated; expected: {_LEAST} or more")
    table.require(ModelError)
    return Tide(file=str(path), time=at[order], level=level[order], sigma=given[order])


def datum_heights(statement: str, position: FloatArray) -> FloatArray:
    """Return the heights (n,) m of the zero of a tide at positions (n, 3), latitude and longitude in radians.

    The statement is one height, or a grid of heights above the ellipsoid that PROJ reads. Raises `ModelError` for
    what is neither, `SystemsError` for a grid that is none or does not reach a position.
    """
    height = number(statement)
    if np.isfinite(height):
        return np.full(len(position), height)
    if not Path(statement).suffix:
        message = f"the datum '{statement}' is neither a height in metres nor a grid of heights (.gtx, .tif)"
        raise ModelError([Problem(message=message)])
    return Geoid(statement).reached(position)


def tide_levels(tide: Tide, photos: Sequence[str], time: FloatArray, datum: FloatArray) -> PhotoLevels:
    """Return the levels at n exposures; `datum` (n,) m is the height of the tide's zero.

    Raises `ModelError` that names every photo beyond the readings or in a gap of them.
    """
    level, sigma = tide.at(time)
    first, last = tide.time[0], tide.time[-1]
    days = np.unique(tide.time // 86400.0)
    problems = []
    for row in np.flatnonzero(np.isnan(level)).tolist():
        at = float(time[row])
        if not np.isfinite(at):
            why = "it has no time in UTC: --time-zone"
        elif at // 86400.0 not in days:
            why = f"{utc(at)}: the tide is of another day, {utc(first)} to {utc(last)}"
        elif first <= at <= last:
            place = int(np.searchsorted(tide.time, at))
            before, after = (utc(float(of)) for of in tide.time[place - 1 : place + 1])
            why = f"{utc(at)}: no reading for more than {GAP / 60.0:g} minutes, from {before} to {after}"
        else:
            why = f"{utc(at)}: readings are from {utc(first)} to {utc(last)}, and go no further"
        problems.append(Problem(file=tide.file, message=f"photo {photos[row]}, {why}"))
    refused(problems)
    tide = replace(tide, level=tide.level + datum.mean())
    return PhotoLevels(level=level + datum, sigma=sigma, group=flights(time), tide=tide)


def given_levels(level: float, sigma: float, time: FloatArray) -> PhotoLevels:
    """Return one level and its sigma (m) at n exposures; those without times (NaN) are one flight."""
    count = len(time)
    return PhotoLevels(level=np.full(count, level), sigma=np.full(count, sigma), group=flights(time))


def flights(time: FloatArray, gap: float = GAP) -> TextArray:
    """Return the flight (n,) of each exposure: FLIGHT1, ... by time, another one after each gap (s)."""
    order = np.argsort(time, kind="stable")
    numbers = np.empty(len(time), dtype=np.int64)
    numbers[order] = 1 + np.cumsum(np.diff(time[order], prepend=time[order][:1]) > gap)
    return np.array([f"FLIGHT{flight}" for flight in numbers.tolist()], dtype=np.str_)


def fitting_hours(tide: Tide, time: FloatArray, level: FloatArray, sigma: FloatArray) -> list[int]:
    """Return the whole hours, -14 to 14, by which a tide must be later to fit levels at k times, the least first.

    `sigma` (k,) m is that of each level. Within three sigmas all fit; none where they do as it is.
    """
    hours = sorted(range(-14, 15), key=lambda hour: (abs(hour), hour))
    fitting = []
    for hour in hours:
        at, doubt = tide.at(time + 3600.0 * hour)
        if (np.abs(level - at) <= LIMIT * np.hypot(sigma, doubt)).all():
            fitting.append(hour)
    return [] if 0 in fitting else fitting


def clock_note(job: Path, solution: Solution) -> str:
    """Return which clock may be in a wrong zone by the adjusted levels of an imported job; empty where none may."""
    of, water = solution.observed, solution.water
    if of is None or water is None:
        return ""
    rows = np.flatnonzero((of.kind == ObservationKind.WATER_LEVEL) & (of.redundancy > 0.0))
    share = of.redundancy[rows]
    error, sigma = -of.residual[rows] / share, of.sigma[rows] / np.sqrt(share)  # what images alone say
    source = read_job(job).source if (np.abs(error) > LIMIT * sigma).any() else {}
    if "tide" not in source:
        return ""
    flight, known = links(water.correction_ids[of.row[rows]].tolist(), source["flights"].tolist())
    time, level, reading = source["tide"].T
    tide, at = Tide(file=str(job), time=time, level=level, sigma=reading), source["flight_times"][flight]
    hours = fitting_hours(tide, at, tide.at(at)[0] - error, sigma) if known.all() else []
    if not hours:
        return ""
    fitting = ", ".join(f"{hour:+d}" for hour in hours)
    return f"the water level of the images is that of the tide {fitting} hours off: is the zone of a clock wrong?"


def utc(time: float) -> str:
    """Return seconds since 1970 as they are read: 2024-05-17 12:00:00 UTC."""
    return f"{datetime.fromtimestamp(time, UTC):%Y-%m-%d %H:%M:%S} UTC"
