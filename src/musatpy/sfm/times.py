"""Times and positions of exposures by a CSV of exiftool: no image is opened.

    exiftool -csv -n -r -XMP:all -EXIF:all FOLDER > exposures.csv

Names of columns may have their groups (`-G`, `-G1`): `XMP-drone-dji:RtkFlag`.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.errors import Problem
from musatpy.pointfiles.columns import FileColumn, Wanted
from musatpy.pointfiles.gauges import fixed_offset, parsed_time, seconds, zone_of
from musatpy.pointfiles.point_tables import PointTable, read_table
from musatpy.sfm.model import ModelError, refused, spread
from musatpy.units import DEGREE

SOURCES = ("", "UTCAtExposure", "GPS date and time", "DateTimeOriginal and offset", "DateTimeOriginal in its zone")
FIXED = 50  # RtkFlag of a fixed solution
PLAN_SIGMA, HEIGHT_SIGMA = 5.0, 10.0  # m, of positions without RTK
_SLOW, _QUARTER = 5.0, 900.0  # s: by how much a clock may be off beside whole quarter hours
_MOST_PAIRED, _APART = 1000, 60.0  # photos whose pairs make the drift, and their least time from each other, s
_TIMES = ("utcatexposure", "gpsdatestamp", "gpstimestamp", "datetimeoriginal", "offsettimeoriginal")
_TEXTS = (*_TIMES, "subsectimeoriginal", "gpslatituderef", "gpslongituderef")
_ANGLES = {"gpslatitude": 90.0, "gpslongitude": 180.0}
_NUMBERS = ("absolutealtitude", "gpsaltitude", "gpsaltituderef", "rtkflag", "rtkstdlon", "rtkstdlat", "rtkstdhgt")
_GROUPS = ("xmp", "composite", "")  # whose columns go before those of others


@dataclass(frozen=True, kw_only=True, eq=False)
class Exposures:
    """n photos of a CSV of exiftool. Times are seconds of UTC since 1970; NaN for what is not there."""

    photos: TextArray  # (n,) as SourceFile has them
    time: FloatArray  # (n,)
    source: IntArray  # (n,) of the times, numbers of `SOURCES`
    clock: FloatArray  # (n,) of the camera, less its offset where that stands beside it
    satellite: FloatArray  # (n,) by GPS
    position: FloatArray  # (n, 3) latitude, longitude (rad), height (m)
    sigma: FloatArray  # (n, 3) m, east, north, up; NaN: not observed
    rtk: BoolArray  # (n,) a fixed solution with its standard deviations

    @classmethod
    def stated(cls, photos: TextArray, position: FloatArray, *, heights: bool) -> Exposures:
        """Return the positions (n, 3) that a model states of its photos, as those without RTK; it has no times."""
        none = np.full(len(photos), np.nan)
        return cls(
            photos=photos,
            time=none,
            source=np.zeros(len(photos), dtype=np.int64),
            clock=none,
            satellite=none,
            position=position,
            sigma=np.where(np.isnan(position), np.nan, blind_sigma(heights)),
            rtk=np.zeros(len(photos), dtype=bool),
        )

    def of(self, names: Sequence[str], file: str) -> Exposures:
        """Return those of photos of a model. Raises `ModelError` that names photos of which none is certain."""
        rows = matched(names, self.photos.tolist())
        wrong = unmatched(names, rows, self.photos)
        if (rows == -1).all():
            wrong = {"": f"it has none of the photos of the model, as {names[0]}; its first is {self.photos[0]}"}
        refused([Problem(message=message, file=file) for message in wrong.values()])
        of = {field.name: getattr(self, field.name)[rows] for field in fields(self)}
        return Exposures(**of | {"photos": np.array(names, dtype=np.str_)})


@dataclass(frozen=True, kw_only=True, eq=False)
class ClockOffset:
    """The camera's clock minus GPS time, as a robust line. NaN for what too few photos say."""

    photos: int
    offset: float  # s, in the middle of the photos' times
    drift: float  # s a day
    scatter: float  # s, of one photo about the line
    apart: TextArray  # photos farther from the line than five seconds and five times the scatter

    @property
    def beside(self) -> float:
        """Offset beside whole quarter hours, which are a time zone."""
        return self.offset - _QUARTER * round(self.offset / _QUARTER) if np.isfinite(self.offset) else np.nan

    def warnings(self) -> list[str]:
        """Return what is to be warned of."""
        texts, names = [], self.apart.tolist()
        if abs(self.beside) > _SLOW:
            off = f"{self.offset:+.1f} s off GPS time, {self.beside:+.1f} s beside whole quarter hours"
            texts.append(f"the camera's clock is {off}: times without GPS are off by as much")
        if names:
            texts.append(f"clock and GPS time do not go together on {len(names)} photos: {' '.join(names)}")
        return texts


def clock_offset(exposures: Exposures) -> ClockOffset:
    """Return offset and drift of the camera's clock: the median slope of all pairs (Theil 1950, Sen 1968)."""
    both = np.flatnonzero(np.isfinite(exposures.clock) & np.isfinite(exposures.satellite))
    if not len(both):
        return ClockOffset(photos=0, offset=np.nan, drift=np.nan, scatter=np.nan, apart=exposures.photos[both])
    t, d = exposures.satellite[both], exposures.clock[both] - exposures.satellite[both]
    t = t - np.median(t)
    some = np.argsort(t, kind="stable")[spread(len(t), _MOST_PAIRED)]
    pairs = some[np.stack(np.triu_indices(len(some), 1))]
    step, change = np.diff(t[pairs], axis=0)[0], np.diff(d[pairs], axis=0)[0]
    far = step > _APART
    slope = float(np.median(change[far] / step[far])) if far.any() else np.nan
    level = d - np.nan_to_num(slope) * t
    offset = float(np.median(level))
    scatter = 1.4826 * float(np.median(np.abs(level - offset)))
    return ClockOffset(
        photos=len(both),
        offset=offset,
        drift=86400.0 * slope,
        scatter=scatter if len(both) > 2 else np.nan,
        apart=exposures.photos[both][np.abs(level - offset) > max(_SLOW, 5.0 * scatter)],
    )


def read_exposures(path: Path, zone: str = "", *, heights: bool = False) -> Exposures:
    """Return what a CSV of exiftool says; `zone` is that of clocks without an offset, `heights` takes all heights.

    Sigmas of positions are RtkStdLon, RtkStdLat, RtkStdHgt of a fixed solution (RtkFlag 50), else 5 m in plan, and
    10 m of heights that are asked for. Raises `ModelError` with line and column; `OSError`.
    """
    source = FileColumn(name="sourcefile", kind="text", unique=True, expected="the name of a photo")
    table = read_table(path, Wanted(columns=(source,)))
    chosen = _chosen(table.layout.names)
    wanted = [source]
    for tag, heading in chosen.items():
        column = FileColumn(name=heading.lower(), aliases=(), required=False, blank=True, several=True)
        most = _ANGLES.get(tag, 1e5)
        expected = f"a number from {-most:g} to {most:g}, as 'exiftool -n' prints it"
        numeric = replace(column, least=-most, most=most, expected=expected)
        wanted.append(replace(column, kind="text") if tag in _TEXTS else numeric)
    table = read_table(path, Wanted(columns=tuple(wanted)))
    table.require(ModelError, "there are no photos")
    tags = _Tags(table=table, heading={tag: heading.lower() for tag, heading in chosen.items()})
    local = zone_of(zone, ModelError)
    count = len(table.rows)
    utc = seconds(tags.times("utcatexposure", tags.texts("utcatexposure")))
    satellite, (clock, offset) = tags.satellite(), tags.clock()
    stated = np.where(np.isnan(offset), np.nan, clock - offset)
    zoned = tags.zoned(clock, local, needed=np.isnan(utc) & np.isnan(satellite) & np.isnan(stated))
    time, by = np.full(count, np.nan), np.zeros(count, dtype=np.int64)
    for number, values in enumerate((utc, satellite, stated, zoned), 1):
        fresh = np.isnan(time) & np.isfinite(values)
        time[fresh], by[fresh] = values[fresh], number
    position, sigma, rtk = tags.positions(heights)
    table.require(ModelError)
    return Exposures(
        photos=np.array(table.texts("sourcefile"), dtype=np.str_),
        time=time,
        source=by,
        clock=np.where(np.isnan(offset), clock, clock - offset),
        satellite=np.where(np.isnan(utc), satellite, utc),
        position=position,
        sigma=sigma,
        rtk=rtk,
    )


def _chosen(headings: Sequence[str]) -> dict[str, str]:
    """Return the heading of each tag, of those of several groups the one that is signed and to most digits."""
    every: dict[str, list[tuple[int, str]]] = defaultdict(list)
    for heading in headings:
        group, _, tag = heading.rpartition(":")
        tag = {"gpslongtitude": "gpslongitude"}.get(tag.lower(), tag.lower())  # as DJI writes it
        if tag in (*_TEXTS, *_ANGLES, *_NUMBERS):
            of = group.lower().partition("-")[0]
            every[tag].append((_GROUPS.index(of) if of in _GROUPS else len(_GROUPS), heading))
    return {tag: min(of)[1] for tag, of in every.items()}


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tags:
    """The values of a table by the names of their tags."""

    table: PointTable
    heading: dict[str, str]

    def texts(self, tag: str) -> list[str]:
        if tag not in self.heading:
            return [""] * len(self.table.rows)
        return ["" if text == "-" else text for text in self.table.texts(self.heading[tag])]

    def numbers(self, tag: str) -> FloatArray:
        return self.table.numbers(self.heading.get(tag, tag))

    def times(self, tag: str, texts: Sequence[str]) -> list[datetime | None]:
        """Return the times (n,) of texts, with the offsets that they have; none of zeros."""
        times = [parsed_time(text) for text in texts]
        for row, (text, time) in enumerate(zip(texts, times, strict=True)):
            if time is None and text.strip(" 0:."):
                self.wrong(row, tag, f"'{text}' is no date and time YYYY:MM:DD hh:mm:ss")
        return times

    def satellite(self) -> FloatArray:
        """Return times (n,) by GPS, where date and time of day are both there."""
        stamps = zip(self.texts("gpsdatestamp"), self.texts("gpstimestamp"), strict=True)
        texts = [f"{day} {hour}" if day and hour else "" for day, hour in stamps]
        return seconds(self.times("gpstimestamp", texts))

    def clock(self) -> tuple[FloatArray, FloatArray]:
        """Return what the camera's clock shows (n,) as if it were UTC, and its offset (n,) s, NaN without one."""
        times = self.times("datetimeoriginal", self.texts("datetimeoriginal"))
        shown = seconds([time and time.replace(tzinfo=UTC) for time in times])
        offset = np.full(len(shown), np.nan)
        for row, digits in enumerate(self.texts("subsectimeoriginal")):
            if digits and not (digits.isascii() and digits.isdigit()):
                self.wrong(row, "subsectimeoriginal", f"'{digits}' is no part of a second")
            elif digits and shown[row] % 1.0 == 0.0:
                shown[row] += float(f"0.{digits}")
        for row, (time, text) in enumerate(zip(times, self.texts("offsettimeoriginal"), strict=True)):
            zone = time.tzinfo if time and time.tzinfo else fixed_offset(text)
            if text and fixed_offset(text) is None:
                self.wrong(row, "offsettimeoriginal", f"'{text}' is no offset +hh:mm")
            elif zone is not None:
                offset[row] = (zone.utcoffset(None) or timedelta()).total_seconds()
        return shown, offset

    def zoned(self, clock: FloatArray, zone: tzinfo | None, needed: BoolArray) -> FloatArray:
        """Return the UTC (n,) of a clock in a time zone, where it is needed."""
        out = np.full(len(clock), np.nan)
        for row in np.flatnonzero(needed & np.isfinite(clock)).tolist() if zone is not None else ():
            local = datetime.fromtimestamp(clock[row], UTC).replace(tzinfo=zone)
            if local.utcoffset() != local.replace(fold=1).utcoffset():
                text = f"'{self.texts('datetimeoriginal')[row]}' is of the hour at which clocks change in {zone}"
                self.wrong(row, "datetimeoriginal", f"{text}: give the offset +hh:mm")
            out[row] = local.timestamp()
        return out

    def positions(self, heights: bool) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return positions and sigmas (n, 3), and which are of RTK."""
        angles = np.column_stack([self._angle("gpslatitude", "S"), self._angle("gpslongitude", "W")])
        angles[~angles.any(axis=1) | np.isnan(angles).any(axis=1)] = np.nan  # zeros: a receiver without a position
        below = np.where(self.numbers("gpsaltituderef") % 2 == 1, -1.0, 1.0)  # 1, 3: below sea, below the ellipsoid
        height = self.numbers("absolutealtitude")
        height = np.where(np.isnan(height), below * np.abs(self.numbers("gpsaltitude")), height)
        given = np.column_stack([self.numbers(f"rtkstd{axis}") for axis in ("lon", "lat", "hgt")])
        position = np.column_stack([angles * DEGREE, height])
        rtk = (self.numbers("rtkflag") == FIXED) & (given > 0.0).all(axis=1)
        sigma = np.where(rtk[:, None], given, blind_sigma(heights))
        return position, np.where(np.isnan(position), np.nan, sigma), rtk

    def _angle(self, tag: str, negative: str) -> FloatArray:
        """Return degrees (n,), negative by their sign or by the hemisphere beside them."""
        values = self.numbers(tag).copy()
        for row, hemisphere in enumerate(self.texts(f"{tag}ref")):
            if hemisphere[:1].upper() == negative:
                values[row] = -abs(values[row])
            elif hemisphere and values[row] < 0.0:
                self.wrong(row, tag, f"{values[row]:g} degrees stand beside '{hemisphere}'")
        group = self.heading.get(tag, "").partition(":")[0].lower()
        if group in ("exif", "gps") and f"{tag}ref" not in self.heading and np.isfinite(values).any():
            self.table.refuse(f"column {self.heading[tag]} has no sign: a column {tag}ref is missing")
        return values

    def wrong(self, row: int, tag: str, message: str) -> None:
        self.table.refuse(message, row, self.heading[tag])


def blind_sigma(heights: bool) -> FloatArray:
    """Return the sigmas (3,) m, east, north, up, of positions without RTK; NaN up unless heights are taken."""
    return np.array([PLAN_SIGMA, PLAN_SIGMA, HEIGHT_SIGMA if heights else np.nan])


def matched(names: Sequence[str], files: Sequence[str]) -> IntArray:
    """Return the files (n,) of photos: of the whole path, else the only one of which one is the tail of the other.

    Tails are whole folders; cases do not count, nor suffixes where one of both has none. -1: none, -2: several.
    """
    whole, tails = defaultdict[str, set[int]](set), defaultdict[str, set[int]](set)
    for row, file in enumerate(files):
        for number, tail in enumerate(_tails(file)):
            for key in {tail, _bare(tail)}:
                tails[key].add(row)
                if not number:
                    whole[key].add(row)
    without = {row for row, file in enumerate(files) if _bare(file) == file}

    def fitting(name: str) -> set[int]:
        first, *others = _tails(name)
        longer = (whole[tail] for tail in others if tail in whole)
        return whole.get(first) or tails.get(first) or next(longer, set())

    rows = []
    for name in names:
        fits = fitting(name) or fitting(_bare(name)) & without
        rows.append(min(fits) if len(fits) == 1 else -1 - (len(fits) > 1))
    return np.array(rows, dtype=np.int64)


def unmatched(names: Sequence[str], rows: IntArray, files: TextArray) -> dict[str, str]:
    """Return the names to which no file, or several belong by `matched`, or that of another name, and why."""
    wrong, taken = {}, dict[int, str]()
    for name, row in zip(names, rows.tolist(), strict=True):
        other = taken.setdefault(row, name)
        if row < 0:
            wrong[name] = f"photo {name}: {'several fit: folders are needed' if row < -1 else 'no row fits'}"
        elif other != name:
            wrong[name] = f"photos {other} and {name} would both be {files[row]}"
    return wrong


def _bare(name: str) -> str:
    """Return a name without its suffix."""
    return re.sub(r"\.\w+$", "", name)


def _tails(name: str) -> list[str]:
    """Return a path and its tails, the longest first."""
    parts = [part for part in name.replace("\\", "/").casefold().split("/") if part not in ("", ".")]
    return ["/".join(parts[first:]) for first in range(len(parts))] or [""]
