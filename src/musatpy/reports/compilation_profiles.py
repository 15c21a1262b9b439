"""Profiles of a compilation, as tables and as lines in a file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.reports.csv_files import as_text
from musatpy.reports.fields import Each, Field
from musatpy.reports.pages import Section
from musatpy.reports.table import Report

if TYPE_CHECKING:
    from musatpy.compilation.datums import Datum
    from musatpy.compilation.file_places import FilePlaces
    from musatpy.compilation.profiles import CompiledProfile, ProfileScan

PROFILES: Each[list[CompiledProfile], CompiledProfile] = Each(
    "profiles",
    "one row per profile, of scans per line",
    lambda profiles: profiles,
    (
        Field("model", "string", "model id", lambda p: p.model, heading="Model", edit="A8", is_id=True),
        Field("profile", "string", "profile id", lambda p: p.name, heading="Profile", edit="A8", is_id=True),
        Field("line", "integer", "number in a scan, 1 of a single one, 0 of what is on none", lambda p: p.line,
              heading="Line", edit="I4", is_id=True),
        Field("readings", "integer", "with a position", lambda p: len(p.rows), heading="Readings", edit="I8"),
        Field("spikes", "integer", "readings beside the median of seven", lambda p: _number(p, "spike"),
              heading="Spikes", edit="I6"),
        Field("needed", "integer", "readings that thinning keeps", lambda p: _number(p, "kept"), heading="Needed",
              edit="I6"),
        Field("length", "number?", "from the first to the last reading", lambda p: _of_stations(p), "m",
              heading="Length\nm", edit="F10.2"),
        Field("least", "number?", "depth below the datum", lambda p: _of_values(p, np.min), "m",
              heading="Least depth\nm", edit="F11.3"),
        Field("greatest", "number?", "depth below the datum", lambda p: _of_values(p, np.max), "m",
              heading="Greatest depth\nm", edit="F14.3"),
        Field("timed", "integer", "readings with a time", lambda p: _timed(p), heading="Timed", edit="I6"),
        Field("duration", "number?", "from the first time to the last", lambda p: p.pace[0], "s", heading="Time\ns",
              edit="F9.2"),
        Field("speed", "number?", "mean, of the faster stage", lambda p: p.pace[1], "mm/s",
              heading="Mean speed\nmm/s", edit="F10.3"),
        Field("fastest", "number?", "speed of a stage between two readings", lambda p: p.pace[2], "mm/s",
              heading="Largest\nmm/s", edit="F8.3"),
        Field("turns", "integer", "times that the mark went back along the line", lambda p: p.turns,
              heading="Turns", edit="I5"),
        Field("reason", "string", "why there is none; empty where there is", lambda p: p.reason,
              heading="Without, because", edit="A38"),
    ),
)  # fmt: skip
SCANS: Each[list[ProfileScan], ProfileScan] = Each(
    "scans",
    "one row per profile of several lines",
    lambda scans: scans,
    (
        Field("model", "string", "model id", lambda s: s.model, heading="Model", edit="A8", is_id=True),
        Field("profile", "string", "profile id", lambda s: s.name, heading="Profile", edit="A8", is_id=True),
        Field("along", "string", "axis of the model", lambda s: s.scan, heading="Along", edit="A5"),
        Field("lines", "integer", "number", lambda s: len(s.lines), heading="Lines", edit="I5"),
        Field("spacing", "number", "of the lines", lambda s: s.spacing, "m", heading="Spacing\nm", edit="F8.1"),
        Field("readings", "integer", "on the lines", lambda s: sum(len(line.rows) for line in s.lines),
              heading="Readings", edit="I8"),
    ),
)  # fmt: skip
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


PROFILE_TABLE: Report[Any] = Report(
    title="Profile Compilation",
    table=PROFILES,
    columns=("model", "profile", "line", "readings", "spikes", "needed", "length", "least", "greatest", "reason"),
)
PACE_TABLE: Report[Any] = Report(
    title="Pace Of Profiles",
    table=PROFILES,
    which=lambda t: np.flatnonzero(t["timed"] > 0),
    columns=("model", "profile", "line", "timed", "duration", "speed", "fastest", "turns"),
)
SCAN_TABLE: Report[Any] = Report(
    title="Scans By Profiles Side By Side",
    table=SCANS,
    columns=("model", "profile", "along", "lines", "spacing", "readings"),
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
        *([PACE_TABLE.section(profiles)] if any(map(_timed, profiles)) else []),
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
