"""Equal elevation groups with their adjusted levels, air bases, distances and height differences."""

from __future__ import annotations

from musatpy.reports.columns import photo_column, point_column
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Table
from musatpy.statistics import Statistics

LEVELS: tuple[Column[Statistics], ...] = (
    Column("Group", "A8", lambda s: s.block.equal_elevations.ids),
    Column("Points", "I6", lambda s: s.group_sizes),
    Column("Level\nm", "F11.4", lambda s: s.solution.levels),
    Column("Sigma\nm", "F9.4", lambda s: s.solution.level_sigmas),
)
MEMBERS: tuple[Column[Statistics], ...] = (
    Column("Group", "A8", lambda s: s.block.equal_elevations.ids[s.block.equal_elevations.group]),
    Column("Point", "A8", lambda s: s.block.points.ids[s.block.equal_elevations.point]),
    Column("Point minus level\nm", "F11.4", lambda s: s.level_differences),
    Column("Sigma given\nm", "F9.4", lambda s: s.block.equal_elevations.sigma[s.block.equal_elevations.group]),
)
AIR_BASES: tuple[Column[Statistics], ...] = (
    photo_column(lambda s: s.block.air_bases.photo[:, 0]),
    photo_column(lambda s: s.block.air_bases.photo[:, 1]),
    Column("Given\nm", "F13.4", lambda s: s.block.air_bases.length),
    Column("Adjusted\nm", "F13.4", lambda s: s.solution.base_lengths),
    Column("Adjusted minus given\nm", "F10.4", lambda s: s.solution.base_lengths - s.block.air_bases.length),
    Column("Sigma given\nm", "F9.4", lambda s: s.block.air_bases.sigma),
)


DISTANCES: tuple[Column[Statistics], ...] = (
    point_column(lambda s: s.block.distances.point[:, 0]),
    point_column(lambda s: s.block.distances.point[:, 1]),
    Column("Given\nm", "F13.4", lambda s: s.block.distances.length),
    Column("Adjusted\nm", "F13.4", lambda s: s.solution.distances),
    Column("Adjusted minus given\nm", "F10.4", lambda s: s.solution.distances - s.block.distances.length),
    Column("Sigma given\nm", "F9.4", lambda s: s.block.distances.sigma),
)
HEIGHT_DIFFERENCES: tuple[Column[Statistics], ...] = (
    point_column(lambda s: s.block.height_differences.point[:, 0]),
    point_column(lambda s: s.block.height_differences.point[:, 1]),
    Column("Given\nm", "F13.4", lambda s: s.block.height_differences.difference),
    Column("Adjusted\nm", "F13.4", lambda s: s.solution.height_differences),
    Column(
        "Adjusted minus given\nm",
        "F10.4",
        lambda s: s.solution.height_differences - s.block.height_differences.difference,
    ),
    Column("Sigma given\nm", "F9.4", lambda s: s.block.height_differences.sigma),
)


def sections(statistics: Statistics) -> list[Section]:
    """Return levels, members, bases, distances and height differences, as far as there are any."""
    tables = (
        ("Equal Elevation Levels", LEVELS, len(statistics.block.equal_elevations.ids)),
        ("Equal Elevation Points", MEMBERS, len(statistics.block.equal_elevations.point)),
        ("Air Bases", AIR_BASES, len(statistics.block.air_bases.length)),
        ("Distances", DISTANCES, len(statistics.block.distances.length)),
        ("Height Differences", HEIGHT_DIFFERENCES, len(statistics.block.height_differences.difference)),
    )
    return [
        Section(title=title, head=Table(columns).head(), lines=Table(columns).lines(statistics))
        for title, columns, rows in tables
        if rows
    ]
