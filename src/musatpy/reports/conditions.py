"""Equal elevation groups with their adjusted levels, air bases, distances and height differences."""

from __future__ import annotations

from musatpy.reports import result_record
from musatpy.reports.origin import Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key
from musatpy.statistics import Statistics


def _measured(title: str, table: result_record.Table, names: str, heading: str, what: str) -> Report[Statistics]:
    """Return the table of what was measured between two photos or points, given and adjusted."""
    return Report(
        title=title,
        table=table,
        columns=(
            key(heading, "A8", f"{names}[0]"),
            key(heading, "A8", f"{names}[1]"),
            Column("Given\nm", "F13.4", shows=f"given_{what}"),
            Column("Adjusted\nm", "F13.4", shows=what),
            Column("Adjusted minus given\nm", "F10.4", shows=Origin(field=what, minus=f"given_{what}")),
            Column("Sigma given\nm", "F9.4", shows="given_sigma"),
        ),
    )


STATED: tuple[Report[Statistics], ...] = (
    Report(
        title="Equal Elevation Levels",
        table=result_record.EQUAL_ELEVATIONS,
        columns=(
            key("Group", "A8", "group"),
            Column("Points", "I6", shows=Origin(field="points", count=True)),
            Column("Level\nm", "F11.4", shows="level"),
            Column("Sigma\nm", "F9.4", shows="level_sigma"),
        ),
    ),
    Report(
        title="Equal Elevation Points",
        table=result_record.EQUAL_ELEVATIONS,
        rows=lambda s: s.block.equal_elevations.group,
        expand=("points", "difference"),
        columns=(
            key("Group", "A8", "group"),
            key("Point", "A8", "points", lambda s: s.block.points.ids[s.block.equal_elevations.point]),
            Column("Point minus level\nm", "F11.4", lambda s: s.level_differences, "difference"),
            Column("Sigma given\nm", "F9.4", shows="given_sigma"),
        ),
    ),
    _measured("Air Bases", result_record.AIR_BASES, "photos", "Photo", "length"),
    _measured("Distances", result_record.DISTANCES, "points", "Point", "length"),
    _measured("Height Differences", result_record.HEIGHT_DIFFERENCES, "points", "Point", "difference"),
)


def sections(statistics: Statistics) -> list[Section]:
    """Return levels, members, bases, distances and height differences, as far as there are any."""
    return [section for report in STATED if (section := report.section(statistics)).lines]
