"""Every table of the listing as it is stated, page by page: what readers of listings go by."""

from __future__ import annotations

from functools import cache
from typing import Any

from musatpy.reports import (
    answer,
    compilation,
    compilation_bottom,
    compilation_points,
    compilation_profiles,
    compilation_setup,
    contour_comparison,
    listing,
    orientation,
    orientation_strip,
    soundings,
)
from musatpy.reports.labels import Labels, Texts
from musatpy.reports.table import Report

_OF_AS11 = (
    compilation,
    compilation_bottom,
    compilation_points,
    compilation_profiles,
    compilation_setup,
    contour_comparison,
    soundings,
)


@cache
def statements() -> tuple[Report[Any] | Labels | Texts, ...]:
    """Return the tables of all pages, and what else has numbers of the record, the answer first."""
    return tuple(
        table
        for page in (answer, *listing.REPORTS, orientation, orientation_strip, *_OF_AS11)
        for table in getattr(page, "STATED", ())
    )
