"""Profiles, surfaces and contours of a compilation, as tables and as lines in files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.reports.columns import vector
from musatpy.reports.fields import Each, Field
from musatpy.reports.origin import Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key
from musatpy.reports.text import wrapped
from musatpy.surfaces.contours import bounds
from musatpy.units import DEGREE

if TYPE_CHECKING:
    from musatpy.compilation.bottom import Bottom
    from musatpy.compilation.grids import PostGrid
    from musatpy.compilation.joined_surfaces import EdgeMatch, Surface
    from musatpy.compilation.profiles import CompiledProfile
    from musatpy.surfaces.contours import Contours

Level = tuple[int, float, bool, int, float, float]

SURFACES: Each[Bottom, tuple[int, Surface, Contours]] = Each(
    "surfaces",
    "one row per surface of models that overlap, where the bottom was asked for",
    lambda bottom: _numbered(bottom),
    (
        Field("surface", "integer", "number", lambda s: s[0]),
        Field("models", "* string", "model ids", lambda s: s[1].models),
        Field("points", "integer", "of the surface", lambda s: len(s[1].tin.z) if s[1].tin else 0),
        Field("merged", "integer", "points in the places of others", lambda s: s[1].tin.merged if s[1].tin else 0),
        Field("left_out", "integer", "points beyond the middles of overlaps", lambda s: s[1].left_out),
        Field("area", "number?", "in plan", lambda s: s[1].tin.area if s[1].tin else np.nan, "m2"),
        Field("least", "number?", "depth below the datum", lambda s: _depth(s[1], np.min), "m"),
        Field("greatest", "number?", "depth below the datum", lambda s: _depth(s[1], np.max), "m"),
        Field("dropped", "integer", "pieces of contours that were too short", lambda s: s[2].dropped),
        Field("reason", "string", "why there is no surface; empty where there is", lambda s: s[1].reason),
    ),
)
EDGES: Each[Bottom, EdgeMatch] = Each(
    "edge_match",
    "one row per pair of models that overlap: depths of the first less those of the second",
    lambda bottom: bottom.edges,
    (
        Field("models", "2 string", "model ids", lambda e: e.models),
        Field("points", "integer", "of either model, on the surface of the other", lambda e: len(e.names)),
        Field("mean", "number", "of the differences", lambda e: e.difference.mean(), "m"),
        Field("rms", "number", "root mean square", lambda e: e.rms, "m"),
        Field("expected", "number", "by the sigmas, as if the models had nothing in common", unit="m"),
        Field(
            "largest",
            "number",
            "signed difference of the largest magnitude",
            lambda e: e.difference[e.largest],
            "m",
        ),
        Field("point", "string", "of the largest", lambda e: e.names[e.largest]),
    ),
)
GRIDS: Each[Bottom, PostGrid] = Each(
    "grids",
    "one row per grid of posts",
    lambda bottom: bottom.grids,
    (
        Field("grid", "string", "name", lambda g: g.name),
        Field("spacing", "number", "of the posts", unit="m"),
        Field("posts", "2 integer", "rows and columns", lambda g: g.depth.shape),
        Field("empty", "integer", "posts without a surface"),
        Field("least", "number?", "depth below the datum", lambda g: _least(g.depth, np.nanmin), "m"),
        Field("greatest", "number?", "depth below the datum", lambda g: _least(g.depth, np.nanmax), "m"),
        Field("collocated", "boolean", "predicted, not read off triangles", lambda g: g.validation is not None),
        Field(
            "left_out_rms", "number?", "of points that were left out and predicted; null of triangles",
            lambda g: g.validation.rms if g.validation else np.nan, "m",
        ),
        Field(
            "left_out_test", "number?", "the same over their sigmas: 1 where these are honest",
            lambda g: g.validation.standardised_rms if g.validation else np.nan,
        ),
        Field("mean_sigma", "number?", "of the posts", lambda g: _least(g.sigma, np.nanmean), "m"),
    ),
)  # fmt: skip
CONTOURS: Each[Bottom, Level] = Each(
    "contours",
    "one row per depth of a surface",
    lambda bottom: _levels(bottom),
    (
        Field("surface", "integer", "number", lambda c: c[0]),
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
RECORD = (SURFACES, EDGES, CONTOURS, GRIDS)


def _numbered(bottom: Bottom) -> list[tuple[int, Surface, Contours]]:
    return [(row, *pair) for row, pair in enumerate(zip(bottom.surfaces, bottom.lines, strict=True), 1)]


def _number(part: CompiledProfile, name: str) -> int:
    return 0 if part.profile is None else int(getattr(part.profile, name).sum())


def _of_stations(part: CompiledProfile) -> float:
    return np.nan if part.profile is None else float(np.ptp(part.profile.station))


def _of_values(part: CompiledProfile, of: Any) -> float:
    values = np.zeros(0) if part.profile is None else part.profile.value[~part.profile.spike]
    return float(of(values)) if len(values) else np.nan


def _depth(surface: Surface, of: Any) -> float:
    return np.nan if surface.tin is None else float(of(surface.tin.z))


def _least(depth: FloatArray, of: Any) -> float:
    return float(of(depth)) if np.isfinite(depth).any() else np.nan


def _collocated(bottom: Bottom) -> IntArray:
    return np.flatnonzero([grid.validation is not None for grid in bottom.grids])


def _levels(bottom: Bottom) -> list[Level]:
    rows: list[Level] = []
    for number, _, drawn in _numbered(bottom):
        thick = {line.level for line in drawn.lines if line.index}
        rows += [
            (number, level, level in thick, lines, length, area)
            for level, lines, length, area in bounds(drawn.lines)
        ]
    return rows


SURFACE_TABLE: Report[Any] = Report(
    title="Surfaces Of The Bottom",
    table=SURFACES,
    columns=(
        key("Surface", "I7", "surface"),
        Column("Points", "I6", shows="points"),
        Column("Merged", "I6", shows="merged"),
        Column("Left out", "I8", shows="left_out"),
        Column("Area\nm2", "F14.1", shows="area"),
        Column("Least depth\nm", "F11.3", shows="least"),
        Column("Greatest depth\nm", "F14.3", shows="greatest"),
        Column("Dropped", "I7", shows="dropped"),
        Column("Without a surface, because", "A42", shows="reason"),
    ),
)
GRID_TABLE: Report[Any] = Report(
    title="Grids Of Posts",
    table=GRIDS,
    columns=(
        key("Grid", "A8", "grid"),
        Column("Spacing\nm", "F9.2", shows="spacing"),
        *vector(("Rows", "Columns"), ("I7", "I7"), shows="posts"),
        Column("Empty", "I9", shows="empty"),
        Column("Least depth\nm", "F11.3", shows="least"),
        Column("Greatest depth\nm", "F14.3", shows="greatest"),
    ),
)
COLLOCATED_TABLE: Report[Any] = Report(
    title="Grids By Collocation: Points Left Out And Predicted",
    table=GRIDS,
    rows=lambda bottom: _collocated(bottom),
    columns=(
        key("Grid", "A8", "grid"),
        Column("RMS\nm", "F8.3", shows="left_out_rms"),
        Column("over sigma", "F10.2", shows="left_out_test"),
        Column("Mean sigma of posts\nm", "F19.3", shows="mean_sigma"),
    ),
)
EDGE_TABLE: Report[Any] = Report(
    title="Edge Match: Depths Of The First Model Less Those Of The Second",
    table=EDGES,
    columns=(
        *(key(name, "A8", f"models[{row}]") for row, name in enumerate(("First", "Second"))),
        Column("Points", "I6", shows="points"),
        Column("Mean\nm", "F8.3", shows="mean"),
        Column("RMS\nm", "F8.3", shows="rms"),
        Column("Expected\nm", "F8.3", shows="expected"),
        Column("Largest\nm", "F8.3", shows="largest"),
        Column("at Point", "A8", shows="point"),
    ),
)
CONTOUR_TABLE: Report[Any] = Report(
    title="Contours",
    table=CONTOURS,
    columns=(
        key("Surface", "I7", "surface"),
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
STATED = (PROFILE_TABLE, SURFACE_TABLE, EDGE_TABLE, CONTOUR_TABLE, GRID_TABLE, COLLOCATED_TABLE)


def sections_of(bottom: Bottom | None, profiles: list[CompiledProfile]) -> list[Section]:
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
    if bottom is None:
        return sections
    names = (f"{number}: models {', '.join(surface.models)}" for number, surface, _ in _numbered(bottom))
    return [
        *sections,
        SURFACE_TABLE.section(bottom, new_page=True),
        Section(title="Surfaces And Their Models", lines=wrapped(names)),
        *([EDGE_TABLE.section(bottom)] if bottom.edges else []),
        *([CONTOUR_TABLE.section(bottom)] if any(drawn.lines for drawn in bottom.lines) else []),
        *([GRID_TABLE.section(bottom)] if bottom.grids else []),
        *([COLLOCATED_TABLE.section(bottom)] if len(_collocated(bottom)) else []),
    ]


def grid_csv(grid: PostGrid, angular: bool, datum: float) -> str:
    """Return the posts of a grid that have a depth as comma-separated values, in the system of the job."""
    unit, decimals = _printed(angular)
    lines = [f"{'latitude,longitude,height' if angular else 'X,Y,Z'},depth,sigma"]
    known = np.isfinite(grid.depth).ravel()
    places = (grid.coordinates(datum) / unit)[known].tolist()
    depths, sigmas = grid.depth.ravel()[known].tolist(), grid.sigma.ravel()[known].tolist()
    for place, depth, sigma in zip(places, depths, sigmas, strict=True):
        text = ",".join(f"{v:.{d}f}" for v, d in zip(place, decimals, strict=True))
        lines.append(f"{text},{depth:.3f},{sigma:.3f}")
    return "\n".join(lines) + "\n"


def contours_csv(bottom: Bottom, angular: bool, datum: float) -> str:
    """Return the contours as comma-separated values, a vertex a line, in the system of the job (degrees, m)."""
    lines = [f"line,surface,depth,index,closed,{'latitude,longitude,height' if angular else 'X,Y,Z'}"]
    number = 0
    unit, decimals = _printed(angular)
    for row, surface, drawn in _numbered(bottom):
        for line in drawn.lines:
            number += 1
            head = f"{number},{row},{line.level:g},{int(line.index)},{int(line.closed)},"
            for vertex in surface.coordinates(line.xy, np.full(len(line.xy), datum - line.level)) / unit:
                lines.append(head + ",".join(f"{v:.{d}f}" for v, d in zip(vertex, decimals, strict=True)))
    return "\n".join(lines) + "\n"


def _printed(angular: bool) -> tuple[FloatArray, tuple[int, int, int]]:
    """Return the units (3,) of coordinates in files, and their decimals."""
    return (np.array([DEGREE, DEGREE, 1.0]), (10, 10, 4)) if angular else (np.ones(3), (4, 4, 4))


def profiles_csv(profiles: list[CompiledProfile], angular: bool) -> str:
    """Return the readings of profiles, and the depths at even steps, as comma-separated values (degrees, m).

    What a row is stands first: a reading, a spike, a reading that thinning does not need, or a post.
    """
    lines = [f"row,model,profile,station,offset,depth,sigma,{'latitude,longitude,height' if angular else 'X,Y,Z'}"]
    unit, decimals = _printed(angular)
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
