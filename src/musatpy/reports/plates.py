"""The pages of the plate reduction, in jobs of raw plates."""

from __future__ import annotations

from musatpy.reports import reduction
from musatpy.reports.pages import Section
from musatpy.statistics import Statistics

STATED = reduction.STATED


def sections(statistics: Statistics) -> list[Section]:
    """Return the pages of the reduction; nothing where the plates came refined."""
    reduced = statistics.solution.reduced
    if reduced is None:
        return []
    return reduction.sections(reduced)
