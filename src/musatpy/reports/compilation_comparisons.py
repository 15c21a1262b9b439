"""Compiled points beside those of the run: AS-11 less MUSAT, in the layout of Table 6-7 (`as11 compare-points`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.reports import analyses
from musatpy.reports.fields import Document, Each, Field, Rows, flag, identity, within
from musatpy.reports.pages import Section, labelled, print_titled
from musatpy.reports.table import Report
from musatpy.statistics.differences import DifferenceStatistics, analysis_of

if TYPE_CHECKING:  # a reader of listings knows the tables by their statements alone
    from musatpy.compilation.against_run import AgainstRun
    from musatpy.compilation.compiled import Compiled
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from musatpy.compilation.contoured import ContourArea, ContourDistance, Contoured


RUN_POINTS: Rows[tuple[Compiled, list[AgainstRun]], tuple[Compiled, list[AgainstRun]]] = Rows(
    "against_run",
    "one row per point that the run has too",
    (
        identity("model", lambda s: _models_of(s)),
        identity("point", lambda s: _points_of(s)),
        flag("shared", "its readings are those of the run", "Same", "S", lambda s: _of(s, "shared")),
        Field("difference", "3 number", "compiled minus run, east, north, up", lambda s: _of(s, "difference"),
              ("East\nm", "North\nm", "Up\nm"), "F7.4"),
        Field("length", "number", "of that", lambda s: _of(s, "length"), "Length\nm", "F8.4"),
        Field("sigma", "3 number?", "of the difference; null where not known", lambda s: _of(s, "sigma"),
              [f"Sigma {axis}\nm" for axis in ("E", "N", "U")], "F7.4"),
        Field("test", "number?", "root of the mean square over its covariance", lambda s: _of(s, "test"), "Test",
              "F6.2"),
        Field("stages", "2x2 number", "read minus predicted, left and right", lambda s: _of(s, "stages"),
              [f"{side} {axis}\num" for side in ("Left", "Right") for axis in "xy"], "F7.2"),
    ),
)  # fmt: skip
ANALYSIS: Each[tuple[Compiled, list[AgainstRun]], tuple[str, DifferenceStatistics]] = Each(
    "analysis",
    "differences of compiled points from the run in numbers, east, north, up",
    of=lambda s: _statistics(s[1]),
    fields=(
        Field("component", "string", "East, North, Up", lambda d: d[0]),
        *within(lambda d: d[1], analyses.differences("m", "point")),
    ),
)
CAUTION: Field[tuple[Compiled, list[AgainstRun]]] = Field(
    "caution", "string?", "what is to be known of the run, on every page", lambda s: s[0].run.caution or None
)
RECORD = (RUN_POINTS, ANALYSIS)
RUN_TABLE = Report("Comparison With The Run", RUN_POINTS, worst=lambda t: t["length"])
_ANALYSIS_TABLE = Report(
    "Ground Point Analysis",
    ANALYSIS,
    ("component size", ANALYSIS.column("maximum_id", "Point with Max. Difference", "A8")),
)
AGAINST_RUN: Document[tuple[Compiled, list[AgainstRun]]] = Document(
    name="point_comparison_version",
    version="2.0",
    title="musatpy comparison of compiled points",
    about="Compiled points beside those of the run, in metres and millimetres of the stages.",
    nodes=(CAUTION, *RECORD),
)


def point_listing(compiled: Compiled, against: list[AgainstRun]) -> str:
    """Return the listing of a comparison, on pages of 60 lines of 132 columns."""
    title = compiled.deck.titles[0] if compiled.deck.titles else ""
    heading = f"MUSATPY  COMPARISON OF POINTS  {title:<60.60}"
    return print_titled(heading, sections_of(compiled, against), compiled.run.caution)


def sections_of(compiled: Compiled, against: list[AgainstRun]) -> list[Section]:
    """Return what the listing says, nothing where no point is one of the run."""
    shown = [part for part in against if len(part.rows)]
    if not shown:
        return []
    return [RUN_TABLE.section((compiled, against), new_page=True), *_analysis(compiled, shown)]


def vectors(against: list[AgainstRun]) -> tuple[float, float, float]:
    """Return the least, the mean and the largest length of the differences, m."""
    length = np.concatenate([part.length for part in against])
    return float(length.min()), float(length.mean()), float(length.max())


def _statistics(against: list[AgainstRun]) -> list[tuple[str, DifferenceStatistics]]:
    """Return the components of the differences with their statistics, none where there are no differences."""
    if not sum(len(part.rows) for part in against):
        return []
    analysis = analysis_of(
        dict.fromkeys(("East", "North", "Up"), "m"),
        np.concatenate([part.model.readings.ids[part.rows] for part in against]),
        np.concatenate([part.difference for part in against]),
    )
    return list(zip(analysis.components, analysis.statistics, strict=True))


def _analysis(compiled: Compiled, against: list[AgainstRun]) -> list[Section]:
    """Return the differences from the run in the layout of Table 6-7, and the lengths of their vectors."""
    values = _ANALYSIS_TABLE.values((compiled, against))
    lengths = ", ".join(f"{length:.4f}" for length in vectors(against))
    lines = {"Least, mean and largest vector, m": lengths}
    tests = np.concatenate([part.test for part in against])
    if np.isfinite(tests).any():
        lines["Tests, root of the mean square"] = f"{np.sqrt(np.nanmean(np.square(tests))):.2f}"
    run = f"Compiled Less MUSAT-{compiled.run.block.options.program}"
    water = "No Refraction Correction" if compiled.run.block.water is None else "Refraction Correction Applied"
    return [
        analyses.laid_out(_ANALYSIS_TABLE, values, (run, water), {"m": "F16.4"}),
        Section(title="Comparison With The Run: Vectors And Tests", lines=labelled(lines)),
    ]


def _of(source: tuple[Compiled, list[AgainstRun]], name: str) -> Any:
    return np.concatenate([getattr(part, name) for part in source[1]])


def _points_of(source: tuple[Compiled, list[AgainstRun]]) -> Any:
    compiled, against = source
    parts = zip(compiled.models, against, strict=True)
    return np.concatenate([model.readings.ids[part.rows] for model, part in parts])


def _models_of(source: tuple[Compiled, list[AgainstRun]]) -> Any:
    compiled, against = source
    return np.repeat([model.name for model in compiled.models], [len(part.rows) for part in against])


DISTANCES: Each[Contoured, ContourDistance] = Each(
    "distances",
    "one row per depth of a surface and source: its contours, sampled every metre, from those of the other",
    of=lambda c: c.distances,
    fields=(
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
    "areas",
    "one row per depth of a surface",
    of=lambda c: c.areas,
    fields=(
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
    return print_titled(
        f"MUSATPY  CONTOURS  {title:<60.60}", [table.section(compared) for table in STATED], caution
    )
