"""The listing and the record of contours beside those of another source (`musat as11 compare-contours`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from musatpy.reports.fields import Document, Each, Field, Node
from musatpy.reports.pages import print_titled
from musatpy.reports.table import Report

if TYPE_CHECKING:
    from musatpy.compilation.contoured import ContourArea, ContourDistance, Contoured

_VERSION = "1.0"

DISTANCES: Each[Contoured, ContourDistance] = Each(
    "distances",
    "one row per depth of a surface and source: its contours, sampled every metre, from those of the other",
    lambda c: c.distances,
    (
        Field("surface", "integer", "number, as in the record of a compilation", heading="Surface", edit="I7",
              is_id=True),
        Field("depth", "number", "below the datum", unit="m", heading="Depth\nm", edit="F8.3", is_id=True),
        Field("of", "string", "source whose contours are sampled", heading="From", edit="A8", is_id=True),
        Field("length", "number", "of the contours", unit="m", heading="Length\nm", edit="F10.1"),
        Field("beyond", "number", "length past open ends of the other or too far, left out", unit="m",
              heading="Left out\nm", edit="F10.1"),
        Field("mean", "number", "of the distances", unit="m", heading="Mean\nm", edit="F8.2"),
        Field("rms", "number", "of the distances", unit="m", heading="RMS\nm", edit="F8.2"),
        Field("most", "number", "distance that 95 % do not exceed", unit="m", heading="95 %\nm", edit="F8.2"),
        Field("mean_depth", "number?", "compiled less the other, by the slope", unit="m", heading="Mean depth\nm",
              edit="F10.3"),
        Field("rms_depth", "number?", "of these", unit="m", heading="RMS depth\nm", edit="F10.3"),
        Field("most_depth", "number?", "magnitude that 95 % of these do not exceed", unit="m",
              heading="95 % depth\nm", edit="F10.3"),
    ),
)  # fmt: skip
AREAS: Each[Contoured, ContourArea] = Each(
    "areas",
    "one row per depth of a surface",
    lambda c: c.areas,
    (
        Field("surface", "integer", "number, as in the record of a compilation", heading="Surface", edit="I7",
              is_id=True),
        Field("depth", "number", "below the datum", unit="m", heading="Depth\nm", edit="F8.3", is_id=True),
        Field("area", "number?", "between the contours", unit="m2", heading="Area\nm2", edit="F14.1"),
        Field("width", "number?", "of that, by the mean of both lengths", unit="m", heading="Mean width\nm",
              edit="F10.2"),
        Field("reason", "string", "why there is none; empty where there is", heading="Without, because",
              edit="A60"),
    ),
)  # fmt: skip
RECORD: tuple[Node[Contoured], ...] = (DISTANCES, AREAS)

DISTANCE_TABLE: Report[Any] = Report(
    title="Comparison Of Contours: Distances And Depths By The Slope",
    table=DISTANCES,
    columns=(
        *("surface", "depth", "of", "length", "beyond", "mean"),
        *("rms", "most", "mean_depth", "rms_depth", "most_depth"),
    ),
)
AREA_TABLE: Report[Any] = Report(
    title="Areas Between Contours",
    table=AREAS,
    columns=("surface", "depth", "area", "width", "reason"),
)
STATED = (DISTANCE_TABLE, AREA_TABLE)
DOCUMENT: Document[Contoured] = Document(
    name="contour_comparison_version",
    version=_VERSION,
    title="musatpy contour comparison",
    about="Compiled contours beside those of another source, metres. What does not exist is null",
    nodes=RECORD,
)


def listing_of(compared: Contoured, title: str, caution: str = "") -> str:
    """Return the listing of a comparison, on pages of 60 lines of 132 columns."""
    sections = [table.section(compared) for table in STATED]
    return print_titled(f"MUSATPY  CONTOURS  {title:<60.60}", sections, caution)
