"""Equal elevation groups with their adjusted levels, air bases, distances and height differences."""

from __future__ import annotations

from musatpy.reports import result_record
from musatpy.reports.fields import Field
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.statistics import Statistics

# What is measured between two photos or points: title, table of the record, its ends, what it is.
BETWEEN = (
    ("Air Bases", result_record.AIR_BASES, "photos", "length"),
    ("Distances", result_record.DISTANCES, "points", "length"),
    ("Height Differences", result_record.HEIGHT_DIFFERENCES, "points", "difference"),
)


_COUNT: Field[Statistics] = Field(
    "count", heading="Points", edit="I6", shown=lambda t: [len(points) for points in t["points"]]
)


def _adjusted(title: str, table: result_record.Table, ends: str, what: str) -> Report[Statistics]:
    change: Field[Statistics] = Field(
        "change", heading="Adjusted minus given\nm", edit="F10.4", shown=lambda t: t[what] - t[f"given_{what}"]
    )
    return Report(title=title, table=table, columns=(ends, f"given_{what}", what, change, "given_sigma"))


STATED: tuple[Report[Statistics], ...] = (
    Report(
        title="Equal Elevation Levels",
        table=result_record.EQUAL_ELEVATIONS,
        columns=("group", _COUNT, "level", "level_sigma"),
    ),
    Report(
        title="Equal Elevation Points",
        table=result_record.EQUAL_ELEVATIONS,
        expand=("points", "difference"),
        columns=("group", "points", "difference", "given_sigma"),
    ),
    *(_adjusted(*kind) for kind in BETWEEN),
)


def sections(statistics: Statistics) -> list[Section]:
    """Return levels, members, bases, distances and height differences, as far as there are any."""
    return [section for report in STATED if (section := report.section(statistics)).lines]
