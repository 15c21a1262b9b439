"""Equal elevation groups with their adjusted levels, air bases, distances and height differences."""

from __future__ import annotations

from musatpy.reports import result_record
from musatpy.reports.origin import Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key
from musatpy.statistics import Statistics

# What is measured between two photos or points: title, table of the record, its ends, their heading, what it is.
BETWEEN = (
    ("Air Bases", result_record.AIR_BASES, "photos", "Photo", "length"),
    ("Distances", result_record.DISTANCES, "points", "Point", "length"),
    ("Height Differences", result_record.HEIGHT_DIFFERENCES, "points", "Point", "difference"),
)


def between(
    title: str, table: result_record.Table, ends: str, heading: str, *columns: Column[Statistics]
) -> Report[Statistics]:
    """Return a table of what is measured between two photos or points."""
    names: tuple[Column[Statistics], ...] = tuple(key(heading, "A8", f"{ends}[{end}]") for end in (0, 1))
    return Report(title=title, table=table, columns=(*names, *columns))


def _adjusted(title: str, table: result_record.Table, ends: str, heading: str, what: str) -> Report[Statistics]:
    return between(
        title,
        table,
        ends,
        heading,
        Column("Given\nm", "F13.4", shows=f"given_{what}"),
        Column("Adjusted\nm", "F13.4", shows=what),
        Column("Adjusted minus given\nm", "F10.4", shows=Origin(field=what, minus=f"given_{what}")),
        Column("Sigma given\nm", "F9.4", shows="given_sigma"),
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
    *(_adjusted(*kind) for kind in BETWEEN),
)


def sections(statistics: Statistics) -> list[Section]:
    """Return levels, members, bases, distances and height differences, as far as there are any."""
    return [section for report in STATED if (section := report.section(statistics)).lines]
