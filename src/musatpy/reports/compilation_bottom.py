"""Surfaces and contours of a compilation, as tables and as lines in files, and beside those of another source."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from musatpy.reports.compilation_points import CompilationReport, extremes
from musatpy.reports.fields import Document, Each, Field, flag, identity
from musatpy.reports.pages import Section, print_titled, wrapped
from musatpy.reports.table import Report, filled
from musatpy.surfaces.contours import bounds

if TYPE_CHECKING:
    from musatpy.compilation.answers import FilePlaces
    from musatpy.compilation.bottom import Bottom, PostGrid
    from musatpy.compilation.compiled import DepthDatum
    from musatpy.compilation.joined_surfaces import EdgeMatch, JoinedSurface
    from musatpy.compilation.other_bottoms import ContourArea, ContourDistance, Contoured

Level = tuple[str, float, bool, int, float, float]

SURFACES: Each[CompilationReport, tuple[str, JoinedSurface, Bottom]] = Each(
    "surfaces", "one row per surface of models that overlap, where depths or heights were asked for",
    of=lambda c: [(name, surface, bottom) for bottom in c.bottoms for name, surface in bottom.named], fields=(
        Field("surface", "string", "number, behind an H of heights", lambda s: s[0], "Surface", "A7", is_id=True),
        Field("of", "enum", "what it has at its points", lambda s: s[2].of, "Of", "A6",
              choices=("depth", "height")),
        Field("models", "* string", "model ids", lambda s: s[1].models),
        Field("points", "integer", "of the surface", lambda s: len(s[1].tin.z) if s[1].tin else 0, "Points", "I6"),
        Field("merged", "integer", "points in the places of others", lambda s: s[1].tin.merged if s[1].tin else 0,
              "Merged", "I6"),
        Field("left_out", "integer", "points beyond the middles of overlaps", lambda s: s[1].left_out, "Left out",
              "I8"),
        Field("area", "number?", "in plan", lambda s: s[1].tin.area if s[1].tin else np.nan, "Area\nm2", "F14.1",
              unit="m2"),
        *extremes(lambda s: s[1].tin.z if s[1].tin else np.zeros(0), "depth below the datum, or height", noun=""),
        Field("dropped", "integer", "pieces of contours that were too short", lambda s: s[2].dropped(s[1]),
              "Dropped", "I7"),
        Field("reason", "string", "why there is no surface; empty where there is", lambda s: s[1].reason,
              "Without a surface, because", "A42"),
    ),
)  # fmt: skip
EDGES: Each[CompilationReport, tuple[Bottom, EdgeMatch]] = Each(
    "edge_match", "one row per pair of models that overlap: values of the first less those of the second",
    of=lambda c: [(bottom, edge) for bottom in c.bottoms for edge in bottom.edges], fields=(
        Field("models", "2 string", "model ids", lambda e: e[1].models, ("First", "Second"), "A8", is_id=True),
        Field("of", "enum", "what is compared", lambda e: e[0].of, "Of", "A6", choices=("depth", "height"),
              is_id=True),
        Field("points", "integer", "of either model, on the surface of the other", lambda e: len(e[1].names),
              "Points", "I6"),
        Field("mean", "number", "of the differences", lambda e: e[1].difference.mean(), "Mean\nm", "F8.3"),
        Field("rms", "number", "root mean square", lambda e: e[1].rms, "RMS\nm", "F8.3"),
        Field("expected", "number", "by the sigmas, as if the models had nothing in common",
              lambda e: e[1].expected, "Expected\nm", "F8.3"),
        Field("largest", "number", "signed difference of the largest magnitude",
              lambda e: e[1].difference[e[1].largest], "Largest\nm", "F8.3"),
        Field("point", "string", "of the largest", lambda e: e[1].names[e[1].largest], "at Point", "A8"),
    ),
)  # fmt: skip
GRIDS: Each[CompilationReport, PostGrid] = Each(
    "grids", "one row per grid of posts", of=lambda c: [grid for bottom in c.bottoms for grid in bottom.grids],
    fields=(
        identity("grid", "name", text="name"),
        Field("spacing", "number", "of the posts", heading="Spacing\nm", edit="F9.2"),
        Field("posts", "2 integer", "rows and columns", "depth.shape", ("Rows", "Columns"), "I7"),
        Field("empty", "integer", "posts without a surface", heading="Empty", edit="I9"),
        *extremes(lambda g: g.depth),
        Field("collocated", "boolean", "predicted, not read off triangles", lambda g: g.validation is not None),
        Field("left_out_rms", "number?", "of points that were left out and predicted; null of triangles",
              lambda g: g.validation.rms if g.validation else np.nan, "RMS\nm", "F8.3"),
        Field("left_out_test", "number?", "the same over their sigmas: 1 where these are honest",
              lambda g: g.validation.standardised_rms if g.validation else np.nan, "over sigma", "F10.2"),
        Field("mean_sigma", "number?", "of the posts",
              lambda g: np.nanmean(g.sigma) if np.isfinite(g.sigma).any() else np.nan, "Mean sigma of posts\nm",
              "F19.3"),
    ),
)  # fmt: skip
_DRAWN: tuple[Field[Level], ...] = (
    flag("index", "drawn thick", "Index", "index", lambda c: c[2]),
    Field("lines", "integer", "pieces", lambda c: c[3], "Lines", "I5"),
    Field("length", "number", "in plan", lambda c: c[4], "Length\nm", "F12.1"),
    Field("area", "number", "enclosed by closed lines", lambda c: c[5], "Enclosed area\nm2", "F14.1", unit="m2"),
)  # fmt: skip
CONTOURS: Each[CompilationReport, Level] = Each(
    "contours", "one row per depth of a surface or grid", of=lambda c: _levels(c, "depth"), fields=(
        Field("contour", "string", "surface or grid, and depth", lambda c: f"{c[0]}:{c[1]:.3f}", "Contour", "A18",
              is_id=True),
        Field("surface", "string", "number, or name of a grid", lambda c: c[0]),
        Field("depth", "number", "below the datum", lambda c: c[1], "Depth\nm", "F9.3"),
        flag("drying", "above the datum", "Drying", "drying", lambda c: c[1] < 0.0),
        *_DRAWN,
    ),
)  # fmt: skip
HEIGHT_CONTOURS: Each[CompilationReport, Level] = Each(
    "height_contours", "one row per height of a surface", of=lambda c: _levels(c, "height"), fields=(
        Field("contour", "string", "surface and height", lambda c: f"{c[0]}:{c[1]:.3f}", "Contour", "A18",
              is_id=True),
        Field("surface", "string", "number", lambda c: c[0]),
        Field("height", "number", "of the job", lambda c: c[1], "Height\nm", "F9.3"),
        *_DRAWN,
    ),
)  # fmt: skip
RECORD = (SURFACES, EDGES, CONTOURS, HEIGHT_CONTOURS, GRIDS)


def _levels(done: CompilationReport, of: str) -> list[Level]:
    rows: list[Level] = []
    for sheet in (sheet for bottom in done.bottoms if bottom.of == of for sheet in bottom.sheets):
        thick = {line.level for line in sheet.contours.lines if line.index}
        rows += [(sheet.name, row[0], row[0] in thick, *row[1:]) for row in bounds(sheet.contours.lines)]
    return rows


SURFACE_TABLE = Report("Surfaces", SURFACES)
GRID_TABLE = Report("Grids Of Posts", GRIDS, "grid spacing posts empty least greatest")
COLLOCATED_TABLE = Report(
    "Grids By Collocation: Points Left Out And Predicted",
    GRIDS,
    "grid left_out_rms left_out_test mean_sigma",
    which=lambda t: np.flatnonzero(t["collocated"]),
)
EDGE_TABLE = Report("Edge Match: The First Model Less The Second", EDGES)
CONTOUR_TABLE = Report("Contours", CONTOURS)
HEIGHT_TABLE = Report("Contours Of Height", HEIGHT_CONTOURS)
BOTTOM_TABLES = (SURFACE_TABLE, EDGE_TABLE, CONTOUR_TABLE, HEIGHT_TABLE, GRID_TABLE, COLLOCATED_TABLE)


def sections_of(done: CompilationReport) -> list[Section]:
    """Return the tables; nothing of what was not asked for."""
    if not done.bottoms:
        return []
    named = (pair for bottom in done.bottoms for pair in bottom.named)
    names = (f"{name}: models {', '.join(surface.models)}" for name, surface in named)
    return [
        SURFACE_TABLE.section(done, new_page=True),
        Section(title="Surfaces And Their Models", lines=wrapped(names)),
        *filled(BOTTOM_TABLES[1:], done),
    ]


def grid_csv(grid: PostGrid, places: FilePlaces, datum: DepthDatum) -> str:
    """Return the posts of a grid that have a depth as comma-separated values."""
    known = np.isfinite(grid.depth).ravel()
    texts = places.texts(grid.coordinates(datum)[known])
    depths, sigmas = grid.depth.ravel()[known].tolist(), grid.sigma.ravel()[known].tolist()
    rows = zip(texts, depths, sigmas, strict=True)
    lines = [f"{places.heading},depth,sigma", *(f"{text},{depth:.3f},{sigma:.3f}" for text, depth, sigma in rows)]
    return "\n".join(lines) + "\n"


def contours_csv(bottom: Bottom, places: FilePlaces, datum: DepthDatum) -> str:
    """Return the contours as comma-separated values, a vertex a line."""
    lines = [f"line,surface,{'depth' if bottom.of == 'depth' else 'level'},index,closed,{places.heading}"]
    number = 0
    for sheet in bottom.sheets:
        for line in sheet.contours.lines:
            number += 1
            head = f"{number},{sheet.name},{line.level:g},{int(line.index)},{int(line.closed)},"
            lines += [head + text for text in places.texts(bottom.vertices(sheet, line, datum))]
    return "\n".join(lines) + "\n"


DISTANCES: Each[Contoured, ContourDistance] = Each(
    "distances",
    "one row per depth of a surface and source: its contours, sampled every metre, from those of the other",
    of=lambda c: c.distances, fields=(
        Field("surface", "integer", "number, as in the record of a compilation", heading="Surface", edit="I7",
              is_id=True),
        Field("depth", "number", "below the datum", heading="Depth\nm", edit="F8.3", is_id=True),
        Field("of", "string", "source whose contours are sampled", heading="From", edit="A8", is_id=True),
        Field("length", "number", "of the contours", heading="Length\nm", edit="F10.1"),
        Field("beyond", "number", "length past open ends of the other or too far, left out", heading="Left out\nm",
              edit="F10.1"),
        Field("mean", "number", "of the distances", heading="Mean\nm", edit="F8.2"),
        Field("rms", "number", "of the distances", heading="RMS\nm", edit="F8.2"),
        Field("most", "number", "distance that 95 % do not exceed", heading="95 %\nm", edit="F8.2"),
        Field("mean_depth", "number?", "compiled less the other, by the slope", heading="Mean depth\nm",
              edit="F10.3"),
        Field("rms_depth", "number?", "of these", heading="RMS depth\nm", edit="F10.3"),
        Field("most_depth", "number?", "magnitude that 95 % of these do not exceed", heading="95 % depth\nm",
              edit="F10.3"),
    ),
)  # fmt: skip
AREAS: Each[Contoured, ContourArea] = Each(
    "areas", "one row per depth of a surface", of=lambda c: c.areas, fields=(
        Field("surface", "integer", "number, as in the record of a compilation", heading="Surface", edit="I7",
              is_id=True),
        Field("depth", "number", "below the datum", heading="Depth\nm", edit="F8.3", is_id=True),
        Field("area", "number?", "between the contours", heading="Area\nm2", edit="F14.1", unit="m2"),
        Field("width", "number?", "of that, by the mean of both lengths", heading="Mean width\nm", edit="F10.2"),
        Field("reason", "string", "why there is none; empty where there is", heading="Without, because",
              edit="A60"),
    ),
)  # fmt: skip
COMPARED = (
    Report("Comparison Of Contours: Distances And Depths By The Slope", DISTANCES),
    Report("Areas Between Contours", AREAS),
)
STATED = (*BOTTOM_TABLES, *COMPARED)
COMPARED_CONTOURS: Document[Contoured] = Document(
    name="contour_comparison_version",
    version="1.0",
    title="musatpy contour comparison",
    about="Compiled contours beside those of another source, metres. What does not exist is null",
    nodes=(DISTANCES, AREAS),
)


def contour_listing(compared: Contoured, title: str, caution: str = "") -> str:
    """Return the listing of a comparison, on pages of 60 lines of 132 columns."""
    return print_titled("CONTOURS", title, [table.section(compared) for table in COMPARED], caution)
