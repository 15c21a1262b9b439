"""Equal elevation groups with their adjusted levels, and air bases."""

from __future__ import annotations

from musatpy.reports.columns import photo_column
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


def sections(statistics: Statistics) -> list[Section]:
    """Return levels, members and air bases, as far as there are any."""
    tables = (
        ("Equal Elevation Levels", LEVELS, len(statistics.block.equal_elevations.ids)),
        ("Equal Elevation Points", MEMBERS, len(statistics.block.equal_elevations.point)),
        ("Air Bases", AIR_BASES, len(statistics.block.air_bases.length)),
    )
    return [
        Section(title=title, head=Table(columns).head(), lines=Table(columns).lines(statistics))
        for title, columns, rows in tables
        if rows
    ]
