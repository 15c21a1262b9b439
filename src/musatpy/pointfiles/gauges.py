"""Readings of a gauge, the water between them, and times as files write them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, tzinfo
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import ProblemsError
from musatpy.pointfiles.columns import FileColumn, Wanted, number
from musatpy.pointfiles.point_tables import PointTable, read_table

GAP = 1800.0  # s, the longest between readings: beyond it the water may have done anything
_LEAST = 3  # readings: one is left out to see what a gap is worth
_TRIALS = 4  # of a gap in all of the file, each begun some readings later
_YEAR = 3e7  # s: smaller times are of no date
_DAY = 86400.0  # s
_FARTHEST = 1e11  # s, beyond all dates: numbers in other units are no times
_DATED = re.compile(r"((?:19|20)\d\d)[:/-](\d\d)[:/-](\d\d)[ T]", re.ASCII)
_TIME = FileColumn(name="time", kind="text", aliases=("t", "date time", "datetime"), expected="a time")
_DATE = FileColumn(name="date", kind="text", aliases=("day",), expected="a day")
_WHEN = (("date", "time"), ("time",), ("date",))
_READINGS = Wanted(
    columns=(
        _TIME,
        _DATE,
        FileColumn(
            name="level",
            unit="m",
            aliases=("water level", "sea level", "verified", "height", "tide", "water", "z", "value"),
            blank=True,
            least=-1e4,
            most=1e4,
        ),
        FileColumn(name="sigma", unit="m", required=False, blank=True, least=0.0, expected="0 or more"),
    ),
    forms=_WHEN,
)
_EXPOSURES = Wanted(
    columns=(
        FileColumn(name="photo", aliases=("id", "name", "image"), kind="text", unique=True, expected="a photo"),
        _TIME,
        _DATE,
    ),
    forms=_WHEN,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tide:
    """n readings of a gauge, by time."""

    file: str
    time: FloatArray  # (n,) s, ascending; of UTC since 1970 where the file has dates
    level: FloatArray  # (n,) m
    sigma: FloatArray  # (n,) m, of a reading

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return levels and their sigmas (k,) m at times; NaN beyond the readings and in gaps above 30 minutes.

        Levels are those of monotone cubics (PCHIP). Their error is measured: readings in gaps as long as that of a
        photo are left out all over the file, and compared with what the others give for them. Where there are none
        in such gaps G, longer ones H count with (G/H)^2. The RMS in the middle of gaps, less the noise of readings,
        is the sigma there, and 4 u (1 - u) of it at the part u of a gap. Errors of readings are taken to be common,
        as those of a gauge's zero are: between two they are as large as at these.
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
        reading = (1.0 - part) * self.sigma[place] + part * self.sigma[place + 1]
        return level, np.where(good, np.hypot(reading, 4.0 * part * (1.0 - part) * missed), np.nan)

    def lacking(self, time: float) -> str:
        """Return why there is no level at a time; empty where there is one."""
        first, last = self.time[[0, -1]].tolist()
        if not np.isfinite(time):
            return "it has no time of exposure, or one of no zone"
        if time // _DAY not in self.time // _DAY:
            return f"{stamp(time)}: the tide is of another day, {stamp(first)} to {stamp(last)}"
        if not first <= time <= last:
            return f"{stamp(time)}: readings are from {stamp(first)} to {stamp(last)}, and go no further"
        place = int(np.searchsorted(self.time, time))
        before, after = self.time[place - 1 : place + 1].tolist()
        if time in (before, after) or after - before <= GAP:
            return ""
        gap = f"no reading for more than {GAP / 60.0:g} minutes, from {stamp(before)} to {stamp(after)}"
        return f"{stamp(time)}: {gap}"

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


def read_tide(path: Path, error: type[ProblemsError], zone: str = "", sigma: float = np.nan) -> Tide:
    """Return the readings of a table: time (or date and time), level and, where it has it, sigma.

    Rows without a level are no readings. `zone` is that of times that state none, nor have it above them as UTC or
    GMT, `sigma` (m) that of readings without one. Raises `error` with line and column; `OSError`.
    """
    table = read_table(path, _READINGS)
    level = table.numbers("level")
    for row in np.flatnonzero(np.isnan(level)).tolist() if table.has("level") else ():
        if (text := table.texts("level")[row]).lower() == "nan":
            table.refuse(f"'{text}' is not a number", row, "level")
    table.require(error, "there are no readings")
    texts, at = _times(table, zone_of(zone, error))
    given = table.numbers("sigma")
    given = np.where(np.isnan(given), sigma, given)
    rows = np.flatnonzero(np.isfinite(level))
    if np.isnan(given[rows]).any():
        table.refuse("readings have no sigma; expected: a column sigma, or a sigma of all readings")
    order = rows[np.argsort(at[rows], kind="stable")]
    for row in order[1:][np.diff(at[order]) == 0.0].tolist():
        table.refuse(f"'{texts[row]}' stands there twice", row, _when(table))
    if len(rows) < _LEAST:
        table.refuse(f"{len(rows)} readings do not say how well they are interpolated; expected: {_LEAST} or more")
    table.require(error)
    return Tide(file=str(path), time=at[order], level=level[order], sigma=given[order])


def read_exposures(path: Path, error: type[ProblemsError], zone: str = "") -> dict[str, float]:
    """Return the times (s) of a table of `photo` and `time`, by photo; zones and what it raises as `read_tide`."""
    table = read_table(path, _EXPOSURES)
    table.require(error, "no photos")
    _, time = _times(table, zone_of(zone, error))
    table.require(error)
    return dict(zip(table.texts("photo"), time.tolist(), strict=True))


def moment(text: str, zone: tzinfo | None) -> float:
    """Return a time in seconds: a number as it is, a date and time since 1970 in UTC. Raises `ValueError`."""
    if abs(value := number(text)) < _FARTHEST:
        return value
    time = parsed_time(text)
    if time is None:
        raise ValueError("is no date and time YYYY-MM-DD hh:mm, nor seconds")
    if time.tzinfo is None and zone is None:
        raise ValueError("states no time zone; expected: Z or +hh:mm, or --zone, --tide-zone")
    return (time if time.tzinfo else time.replace(tzinfo=zone)).timestamp()


def _when(table: PointTable) -> str:
    """Return the column of a table that has the times of day."""
    return "time" if table.has("time") else "date"


def _times(table: PointTable, zone: tzinfo | None) -> tuple[list[str], FloatArray]:
    """Return the times of a table as they stand there, and in seconds (n,); NaN for those that are refused."""
    name = _when(table)
    above = table.layout.units[table.layout.place(name)].upper()
    zone = zone or (UTC if above in ("UTC", "GMT") else None)
    parts = zip(*(table.texts(part) for part in ("date", "time") if table.has(part)), strict=True)
    texts, out = [" ".join(part) for part in parts], np.full(len(table.rows), np.nan)
    for row, text in enumerate(texts):
        try:
            out[row] = moment(text, zone)
        except ValueError as why:
            table.refuse(f"'{text}' {why}", row, name)
    return texts, out


def parsed_time(text: str) -> datetime | None:
    """Return a date and time of day, with its offset where it states one; None where it is none."""
    iso, dates = _DATED.subn(
        r"\1-\2-\3T", text.strip().replace("UTC", "Z").replace(" Z", "Z").replace(",", "."), count=1
    )
    try:
        return datetime.fromisoformat(iso) if dates and iso[10] == "T" and iso.isascii() else None
    except ValueError:
        return None


def fixed_offset(text: str) -> tzinfo | None:
    """Return the zone of an offset +hh:mm, or Z, None where it is none."""
    time = parsed_time(f"2000-01-01T00:00:00{text.strip()}")
    return None if time is None else time.tzinfo


def zone_of(text: str, error: type[ProblemsError]) -> tzinfo | None:
    """Return the time zone of a name (Europe/Berlin) or an offset (+02:00), None without a text. Raises `error`."""
    zone = fixed_offset(text)
    try:
        return zone or (ZoneInfo(text) if text else None)
    except (KeyError, ValueError, OSError):
        raise error.of(f"'{text}' is no time zone: +hh:mm, or a name such as Europe/Berlin") from None


def seconds(times: Sequence[datetime | None]) -> FloatArray:
    """Return seconds (n,) since 1970 of times, of those without a zone as if it were UTC; NaN for none."""
    zoned = [time if time is None or time.tzinfo else time.replace(tzinfo=UTC) for time in times]
    return np.array([np.nan if time is None else time.timestamp() for time in zoned], dtype=float)


def stamp(time: float) -> str:
    """Return seconds as they are read: 300 s, or since 1970, 2024-05-17 12:00:00 UTC."""
    return f"{time:g} s" if abs(time) < _YEAR else f"{datetime.fromtimestamp(time, UTC):%Y-%m-%d %H:%M:%S} UTC"
