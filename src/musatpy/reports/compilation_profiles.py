"""Profiles of a compilation, as tables and as lines in a file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.reports.csv_files import as_text
from musatpy.reports.fields import Each, Field
from musatpy.reports.origin import Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key

if TYPE_CHECKING:
    from musatpy.compilation.datums import Datum
    from musatpy.compilation.file_places import FilePlaces
    from musatpy.compilation.profiles import CompiledProfile, ProfileScan

PROFILES: Each[list[CompiledProfile], CompiledProfile] = Each(
    "profiles",
    "one row per profile, of scans per line",
    lambda profiles: profiles,
    (
        Field("model", "string", "model id", lambda p: p.model),
        Field("profile", "string", "profile id", lambda p: p.name),
        Field("line", "integer", "number in a scan, 1 of a single one, 0 of what is on none", lambda p: p.line),
        Field("readings", "integer", "with a position", lambda p: len(p.rows)),
        Field("spikes", "integer", "readings beside the median of seven", lambda p: _number(p, "spike")),
        Field("needed", "integer", "readings that thinning keeps", lambda p: _number(p, "kept")),
        Field("length", "number?", "from the first to the last reading", lambda p: _of_stations(p), "m"),
        Field("least", "number?", "depth below the datum", lambda p: _of_values(p, np.min), "m"),
        Field("greatest", "number?", "depth below the datum", lambda p: _of_values(p, np.max), "m"),
        Field("timed", "integer", "readings with a time", lambda p: _timed(p)),
        Field("duration", "number?", "from the first time to the last", lambda p: p.pace[0], "s"),
        Field("speed", "number?", "mean, of the faster stage", lambda p: p.pace[1], "mm/s"),
        Field("fastest", "number?", "speed of a stage between two readings", lambda p: p.pace[2], "mm/s"),
        Field("turns", "integer", "times that the mark went back along the line", lambda p: p.turns),
        Field("reason", "string", "why there is none; empty where there is", lambda p: p.reason),
    ),
)
SCANS: Each[list[ProfileScan], ProfileScan] = Each(
    "scans",
    "one row per profile of several lines",
    lambda scans: scans,
    (
        Field("model", "string", "model id", lambda s: s.model),
        Field("profile", "string", "profile id", lambda s: s.name),
        Field("along", "string", "axis of the model", lambda s: s.scan),
        Field("lines", "integer", "number", lambda s: len(s.lines)),
        Field("spacing", "number", "of the lines", lambda s: s.spacing, "m"),
        Field("readings", "integer", "on the lines", lambda s: sum(len(line.rows) for line in s.lines)),
        Field("zigzag", "boolean", "every other line was read from its end", lambda s: s.zigzag),
        Field("lag", "number?", "of the mark behind the bottom", lambda s: s.lag.length if s.lag else np.nan, "m"),
        Field("lag_sigma", "number?", "of that", lambda s: s.lag.sigma if s.lag else np.nan, "m"),
        Field("lag_time", "number?", "the same, at the speed of the readings", lambda s: s.lag_time, "s"),
    ),
)
RECORD = (PROFILES, SCANS)


def _number(part: CompiledProfile, name: str) -> int:
    return 0 if part.profile is None else int(getattr(part.profile, name).sum())


def _of_stations(part: CompiledProfile) -> float:
    return np.nan if part.profile is None else float(np.ptp(part.profile.station))


def _of_values(part: CompiledProfile, of: Any) -> float:
    values = np.zeros(0) if part.profile is None else part.profile.value[~part.profile.spike]
    return float(of(values)) if len(values) else np.nan


def _timed(part: CompiledProfile) -> int:
    return int(np.isfinite(part.time).sum())


def _paced(profiles: list[CompiledProfile]) -> IntArray:
    return np.flatnonzero([_timed(part) > 0 for part in profiles])


_NAMES: tuple[Column[Any], ...] = (key("Model", "A8", "model"), key("Profile", "A8", "profile"))
_LINE: Column[Any] = key("Line", "I4", "line")
PROFILE_TABLE: Report[Any] = Report(
    title="Profile Compilation",
    table=PROFILES,
    columns=(
        *_NAMES,
        _LINE,
        Column("Readings", "I8", shows="readings"),
        Column("Spikes", "I6", shows="spikes"),
        Column("Needed", "I6", shows="needed"),
        Column("Length\nm", "F10.2", shows="length"),
        Column("Least depth\nm", "F11.3", shows="least"),
        Column("Greatest depth\nm", "F14.3", shows="greatest"),
        Column("Without, because", "A38", shows="reason"),
    ),
)
PACE_TABLE: Report[Any] = Report(
    title="Pace Of Profiles",
    table=PROFILES,
    rows=lambda profiles: _paced(profiles),
    columns=(
        *_NAMES,
        _LINE,
        Column("Timed", "I6", shows="timed"),
        Column("Time\ns", "F9.2", shows="duration"),
        Column("Mean speed\nmm/s", "F10.3", shows="speed"),
        Column("Largest\nmm/s", "F8.3", shows="fastest"),
        Column("Turns", "I5", shows="turns"),
    ),
)
SCAN_TABLE: Report[Any] = Report(
    title="Scans By Profiles Side By Side",
    table=SCANS,
    columns=(
        *_NAMES,
        Column("Along", "A5", shows="along"),
        Column("Lines", "I5", shows="lines"),
        Column("Spacing\nm", "F8.1", shows="spacing"),
        Column("Readings", "I8", shows="readings"),
        Column("Zigzag", "A6", shows=Origin(field="zigzag", true="yes")),
        Column("Lag\nm", "F8.2", shows="lag"),
        Column("Sigma\nm", "F7.2", shows="lag_sigma"),
        Column("Lag\ns", "F8.3", shows="lag_time"),
    ),
)
STATED = (PROFILE_TABLE, PACE_TABLE, SCAN_TABLE)


def sections_of(profiles: list[CompiledProfile], scans: list[ProfileScan]) -> list[Section]:
    """Return the tables, and the spikes; nothing without profiles."""
    if not profiles:
        return []
    spikes = [
        f"Model {part.model}, profile {_named(part)}, station {station:.2f} m: depth {value:.3f} m"
        for part in profiles
        if part.profile is not None
        for station, value in zip(
            part.profile.station[part.profile.spike], part.profile.value[part.profile.spike], strict=True
        )
    ]
    return [
        PROFILE_TABLE.section(profiles, new_page=True),
        *([PACE_TABLE.section(profiles)] if len(_paced(profiles)) else []),
        *([SCAN_TABLE.section(scans)] if scans else []),
        *([Section(title="Spikes Of Profiles", lines=spikes)] if spikes else []),
    ]


def _named(part: CompiledProfile) -> str:
    return part.name if part.line == 1 else f"{part.name}, line {part.line}"


def profiles_csv(profiles: list[CompiledProfile], places: FilePlaces, datum: Datum) -> str:
    """Return the readings of profiles, and the depths at even steps, as comma-separated values.

    What a row is stands first: a reading, a spike, a reading that thinning does not need, or a post.
    """
    lines = [f"row,model,profile,line,station,offset,depth,sigma,{places.heading}"]

    def add(part: CompiledProfile, names: list[str], numbers: Any, position: FloatArray) -> None:
        head = f"{as_text(part.model)},{as_text(part.name)},{part.line}"
        rows = zip(names, np.column_stack(numbers).tolist(), places.texts(position), strict=True)
        lines.extend(
            f"{name},{head},{','.join(f'{value:.3f}' for value in values)},{text}" for name, values, text in rows
        )

    for part in profiles:
        done = part.profile
        if done is None:
            continue
        names = np.where(done.spike, "spike", np.where(done.kept, "reading", "not needed"))
        add(part, names.tolist(), (done.station, done.offset, done.value, part.sigma), part.position)
        stations, depths, sigmas, position = part.posts(datum)
        add(part, ["post"] * len(stations), (stations, np.zeros(len(stations)), depths, sigmas), position)
    return "\n".join(lines) + "\n"
