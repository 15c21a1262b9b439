"""Compiled points beside those of the run: AS-11 less MUSAT, in the layout of Table 6-7 (`as11 compare-points`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.reports import analyses
from musatpy.reports.compilation_points import ENU_SIGMAS, CompilationReport
from musatpy.reports.fields import Document, Each, Field, Rows, flag, identity, within
from musatpy.reports.pages import Section, labelled, print_titled
from musatpy.reports.table import Report
from musatpy.statistics.analyses import DifferenceStatistics, analysis_of

if TYPE_CHECKING:  # a reader of listings knows the tables by their statements alone
    from musatpy.compilation.other_bottoms import ContourArea, ContourDistance, Contoured


def _all(name: str) -> Any:
    """Return what takes the values of all models, one after the other."""
    return lambda done: np.concatenate([getattr(part, name) for part in done.against])


RUN_POINTS: Rows[CompilationReport, CompilationReport] = Rows(
    "against_run", "one row per point that the run has too", (
        identity("model", lambda c: np.concatenate([[part.model.name] * len(part.rows) for part in c.against])),
        identity("point", lambda c: _points_of(c)),
        flag("shared", "its readings are those of the run", "Same", "S", _all("shared")),
        Field("difference", "3 number", "compiled minus run, east, north, up", _all("difference"),
              ("East\nm", "North\nm", "Up\nm"), "F7.4"),
        Field("length", "number", "of that", _all("length"), "Length\nm", "F8.4"),
        Field("sigma", "3 number?", "of the difference; null where not known", _all("sigma"), ENU_SIGMAS, "F7.4"),
        Field("test", "number?", "root of the mean square over its covariance", _all("test"), "Test", "F6.2"),
        Field("stages", "2x2 number", "read minus predicted, left and right", _all("stages"),
              [f"{side} {axis}\num" for side in ("Left", "Right") for axis in "xy"], "F7.2"),
    ),
)  # fmt: skip
ANALYSIS: Each[CompilationReport, tuple[str, DifferenceStatistics]] = Each(
    "analysis",
    "differences of compiled points from the run in numbers, east, north, up",
    of=lambda c: _statistics(c),
    fields=(
        Field("component", "string", "East, North, Up", lambda d: d[0]),
        *within(lambda d: d[1], analyses.differences("m", "point")),
    ),
)
CAUTION: Field[CompilationReport] = Field(
    "caution", "string?", "what is to be known of the run, on every page", lambda c: c.compiled.run.caution or None
)
RECORD = (RUN_POINTS, ANALYSIS)
RUN_TABLE = Report("Comparison With The Run", RUN_POINTS, worst=lambda t: t["length"])
_ANALYSIS_TABLE = Report(
    "Ground Point Analysis",
    ANALYSIS,
    ("component size", ANALYSIS.column("maximum_id", "Point with Max. Difference", "A8")),
)
AGAINST_RUN: Document[CompilationReport] = Document(
    name="point_comparison_version",
    version="2.0",
    title="musatpy comparison of compiled points",
    about="Compiled points beside those of the run, in metres and millimetres of the stages.",
    nodes=(CAUTION, *RECORD),
)


def point_listing(done: CompilationReport) -> str:
    """Return the listing of a comparison, on pages of 60 lines of 132 columns."""
    title, caution = "".join(done.compiled.deck.titles[:1]), done.compiled.run.caution
    return print_titled("COMPARISON OF POINTS", title, sections_of(done), caution)


def sections_of(done: CompilationReport) -> list[Section]:
    """Return the differences, in the layout of Table 6-7 too; nothing where no point is one of the run."""
    if not any(len(part.rows) for part in done.against):
        return []
    lengths = ", ".join(f"{length:.4f}" for length in vectors(done))
    lines = {"Least, mean and largest vector, m": lengths}
    tests = _all("test")(done)
    if np.isfinite(tests).any():
        lines["Tests, root of the mean square"] = f"{np.sqrt(np.nanmean(np.square(tests))):.2f}"
    block = done.compiled.run.block
    water = "No Refraction Correction" if block.water is None else "Refraction Correction Applied"
    runs = f"Compiled Less MUSAT-{block.options.program}", water
    return [
        RUN_TABLE.section(done, new_page=True),
        analyses.laid_out(_ANALYSIS_TABLE, _ANALYSIS_TABLE.values(done), runs, {"m": "F16.4"}),
        Section(title="Comparison With The Run: Vectors And Tests", lines=labelled(lines)),
    ]


def vectors(done: CompilationReport) -> tuple[float, float, float]:
    """Return the least, the mean and the largest length of the differences, m."""
    length = _all("length")(done)
    return float(length.min()), float(length.mean()), float(length.max())


def _statistics(done: CompilationReport) -> list[tuple[str, DifferenceStatistics]]:
    """Return the components of the differences with their statistics, none where there are no differences."""
    if not any(len(part.rows) for part in done.against):
        return []
    units = dict.fromkeys(("East", "North", "Up"), "m")
    analysis = analysis_of(units, _points_of(done), _all("difference")(done))
    return list(zip(analysis.components, analysis.statistics, strict=True))


def _points_of(done: CompilationReport) -> Any:
    return np.concatenate([part.model.readings.ids[part.rows] for part in done.against])


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
STATED: tuple[Report[Any], ...] = (
    Report("Comparison Of Contours: Distances And Depths By The Slope", DISTANCES),
    Report("Areas Between Contours", AREAS),
)
CONTOURS: Document[Contoured] = Document(
    name="contour_comparison_version",
    version="1.0",
    title="musatpy contour comparison",
    about="Compiled contours beside those of another source, metres. What does not exist is null",
    nodes=(DISTANCES, AREAS),
)


def contour_listing(compared: Contoured, title: str, caution: str = "") -> str:
    """Return the listing of a comparison, on pages of 60 lines of 132 columns."""
    return print_titled("CONTOURS", title, [table.section(compared) for table in STATED], caution)
