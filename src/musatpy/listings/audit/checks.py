"""Is a listing consistent with itself? Every check, in the order of the lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from musatpy.listings.audit.analysis_checks import check_analyses
from musatpy.listings.audit.count_checks import check_counts
from musatpy.listings.audit.cross_checks import check_against_tables
from musatpy.listings.audit.misprints import Misprint
from musatpy.listings.audit.plate_checks import check_plates
from musatpy.listings.audit.structures import Listing
from musatpy.listings.audit.submerged_checks import check_submerged

CHECKS: tuple[Callable[[Listing], Iterator[Misprint]], ...] = (
    check_analyses,
    check_plates,
    check_submerged,
    check_against_tables,
    check_counts,
)


def audit(listing: Listing) -> list[Misprint]:
    """Return what contradicts in a listing, by line; each of its runs is held against itself alone."""
    misprints = (finding for run in listing.runs for check in CHECKS for finding in check(run))
    return sorted(misprints, key=lambda finding: finding.line)
