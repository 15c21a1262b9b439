"""Profiles, surfaces and contours of a compilation, as tables and as lines in files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.model import CoordinateSystem
from musatpy.reports.fields import Each, Field
from musatpy.reports.origin import Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key
from musatpy.surfaces.contours import bounds
from musatpy.units import DEGREE

if TYPE_CHECKING:
    from musatpy.compilation.bottom import Bottom
    from musatpy.compilation.profiles import CompiledProfile

Level = tuple[str, float, bool, int, float, float]

SURFACES: Each[list[Bottom], Bottom] = Each(
    "surfaces",
    "one row per model whose bottom was asked for",
    lambda bottoms: bottoms,
    (
        Field("model", "string", "model id", lambda b: b.model.name),
        Field("points", "integer", "of the surface", lambda b: 0 if b.tin is None else len(b.tin.z)),
        Field("merged", "integer", "points in the places of others", lambda b: b.tin.merged if b.tin else 0),
        Field("area", "number?", "in plan", lambda b: b.tin.area if b.tin else np.nan, "m2"),
        Field("least", "number?", "depth below the datum", lambda b: _depth(b, np.min), "m"),
        Field("greatest", "number?", "depth below the datum", lambda b: _depth(b, np.max), "m"),
        Field("dropped", "integer", "pieces of contours that were too short", lambda b: b.lines.dropped),
        Field("reason", "string", "why there is no surface; empty where there is", lambda b: b.surface.reason),
    ),
)
CONTOURS: Each[list[Bottom], Level] = Each(
    "contours",
    "one row per depth of a model",
    lambda bottoms: _levels(bottoms),
    (
        Field("model", "string", "model id", lambda c: c[0]),
        Field("depth", "number", "below the datum", lambda c: c[1], "m"),
        Field("index", "boolean", "drawn thick", lambda c: c[2]),
        Field("lines", "integer", "pieces", lambda c: c[3]),
        Field("length", "number", "in plan", lambda c: c[4], "m"),
        Field("area", "number", "enclosed by closed lines", lambda c: c[5], "m2"),
    ),
)
PROFILES: Each[list[CompiledProfile], CompiledProfile] = Each(
    "profiles",
    "one row per profile",
    lambda profiles: profiles,
    (
        Field("model", "string", "model id", lambda p: p.model),
        Field("profile", "string", "profile id", lambda p: p.name),
        Field("readings", "integer", "with a position", lambda p: len(p.rows)),
        Field("spikes", "integer", "readings beside the median of seven", lambda p: _number(p, "spike")),
        Field("needed", "integer", "readings that thinning keeps", lambda p: _number(p, "kept")),
        Field("length", "number?", "from the first to the last reading", lambda p: _of_stations(p), "m"),
        Field("least", "number?", "depth below the datum", lambda p: _of_values(p, np.min), "m"),
        Field("greatest", "number?", "depth below the datum", lambda p: _of_values(p, np.max), "m"),
        Field("reason", "string", "why there is none; empty where there is", lambda p: p.reason),
    ),
)
RECORD = (SURFACES, CONTOURS)


def _number(part: CompiledProfile, name: str) -> int:
    return 0 if part.profile is None else int(getattr(part.profile, name).sum())


def _of_stations(part: CompiledProfile) -> float:
    return np.nan if part.profile is None else float(np.ptp(part.profile.station))


def _of_values(part: CompiledProfile, of: Any) -> float:
    values = np.zeros(0) if part.profile is None else part.profile.value[~part.profile.spike]
    return float(of(values)) if len(values) else np.nan


def _depth(bottom: Bottom, of: Any) -> float:
    return np.nan if bottom.tin is None else float(of(bottom.tin.z))


def _levels(bottoms: list[Bottom]) -> list[Level]:
    rows: list[Level] = []
    for bottom in bottoms:
        thick = {line.level for line in bottom.lines.lines if line.index}
        rows += [
            (bottom.model.name, level, level in thick, number, length, area)
            for level, number, length, area in bounds(bottom.lines.lines)
        ]
    return rows


SURFACE_TABLE: Report[Any] = Report(
    title="Surfaces Of The Bottom",
    table=SURFACES,
    columns=(
        key("Model", "A8", "model"),
        Column("Points", "I6", shows="points"),
        Column("Merged", "I6", shows="merged"),
        Column("Area\nm2", "F14.1", shows="area"),
        Column("Least depth\nm", "F11.3", shows="least"),
        Column("Greatest depth\nm", "F14.3", shows="greatest"),
        Column("Dropped", "I7", shows="dropped"),
        Column("Without a surface, because", "A50", shows="reason"),
    ),
)
CONTOUR_TABLE: Report[Any] = Report(
    title="Contours",
    table=CONTOURS,
    columns=(
        key("Model", "A8", "model"),
        key("Depth\nm", "F9.3", "depth"),
        Column("Index", "A5", shows=Origin(field="index", true="index")),
        Column("Lines", "I5", shows="lines"),
        Column("Length\nm", "F12.1", shows="length"),
        Column("Enclosed area\nm2", "F14.1", shows="area"),
    ),
)
PROFILE_TABLE: Report[Any] = Report(
    title="Profile Compilation",
    table=PROFILES,
    columns=(
        key("Model", "A8", "model"),
        key("Profile", "A8", "profile"),
        Column("Readings", "I8", shows="readings"),
        Column("Spikes", "I6", shows="spikes"),
        Column("Needed", "I6", shows="needed"),
        Column("Length\nm", "F10.2", shows="length"),
        Column("Least depth\nm", "F11.3", shows="least"),
        Column("Greatest depth\nm", "F14.3", shows="greatest"),
        Column("Without, because", "A44", shows="reason"),
    ),
)
STATED = (PROFILE_TABLE, SURFACE_TABLE, CONTOUR_TABLE)


def sections_of(bottoms: list[Bottom], profiles: list[CompiledProfile]) -> list[Section]:
    """Return the tables, and the spikes of profiles; nothing of what was not asked for."""
    sections = [PROFILE_TABLE.section(profiles, new_page=True)] if profiles else []
    spikes = [
        f"Model {part.model}, profile {part.name}, station {station:.2f} m: depth {value:.3f} m"
        for part in profiles
        if part.profile is not None
        for station, value in zip(
            part.profile.station[part.profile.spike], part.profile.value[part.profile.spike], strict=True
        )
    ]
    if spikes:
        sections.append(Section(title="Spikes Of Profiles", lines=spikes))
    if not bottoms:
        return sections
    return [*sections, SURFACE_TABLE.section(bottoms, new_page=True), CONTOUR_TABLE.section(bottoms)]


def contours_csv(bottoms: list[Bottom], datum: float) -> str:
    """Return the contours as comma-separated values, a vertex a line, in the system of the job (degrees, m)."""
    lines: list[str] = []
    number = 0
    for bottom in bottoms:
        system = bottom.model.stereo.run.block.options.system
        angular = system == CoordinateSystem.GEOGRAPHIC
        if not lines:
            lines.append(f"line,model,depth,index,closed,{'latitude,longitude,height' if angular else 'X,Y,Z'}")
        unit, decimals = (np.array([DEGREE, DEGREE, 1.0]), (10, 10, 4)) if angular else (np.ones(3), (4, 4, 4))
        for line in bottom.lines.lines:
            number += 1
            head = f"{number},{bottom.model.name},{line.level:g},{int(line.index)},{int(line.closed)},"
            for vertex in bottom.surface.coordinates(line.xy, np.full(len(line.xy), datum - line.level)) / unit:
                lines.append(head + ",".join(f"{v:.{d}f}" for v, d in zip(vertex, decimals, strict=True)))
    return "\n".join(lines) + "\n"


def profiles_csv(profiles: list[CompiledProfile], angular: bool) -> str:
    """Return the readings of profiles, and the depths at even steps, as comma-separated values (degrees, m).

    What a row is stands first: a reading, a spike, a reading that thinning does not need, or a post.
    """
    lines = [f"row,model,profile,station,offset,depth,sigma,{'latitude,longitude,height' if angular else 'X,Y,Z'}"]
    unit, decimals = (np.array([DEGREE, DEGREE, 1.0]), (10, 10, 4)) if angular else (np.ones(3), (4, 4, 4))
    for part in profiles:
        done = part.profile
        if done is None:
            continue
        names = np.where(done.spike, "spike", np.where(done.kept, "reading", "not needed"))
        for row, name in enumerate(names.tolist()):
            place = ",".join(f"{v:.{d}f}" for v, d in zip(part.position[row] / unit, decimals, strict=True))
            numbers = (done.station[row], done.offset[row], done.value[row], part.sigma[row])
            texts = ",".join(f"{number:.3f}" for number in numbers)
            lines.append(f"{name},{part.model},{part.name},{texts},{place}")
        stations, depths = done.at_steps(part.step)
        lines += [
            f"post,{part.model},{part.name},{station:.3f},0.000,{depth:.3f},,,,"
            for station, depth in zip(stations, depths, strict=True)
        ]
    return "\n".join(lines) + "\n"
