"""Is a listing consistent with itself? Every check, in the order of the lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from musatpy.listings.audit.analysis_checks import check_analyses
from musatpy.listings.audit.misprints import Misprint
from musatpy.listings.audit.plate_checks import check_plates
from musatpy.listings.audit.structures import Listing
from musatpy.listings.audit.submerged_checks import check_submerged

CHECKS: tuple[Callable[[Listing], Iterator[Misprint]], ...] = (check_analyses, check_plates, check_submerged)


def audit(listing: Listing) -> list[Misprint]:
    """Return what contradicts in a listing, by line."""
    misprints = (finding for check in CHECKS for finding in check(listing))
    return sorted(misprints, key=lambda finding: finding.line)
