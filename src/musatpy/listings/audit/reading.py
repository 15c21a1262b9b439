"""A listing -> structures: `read_listing` of a file, `listing_of` of its text."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from musatpy.errors import MusatError
from musatpy.listings.audit.analysis_tables import read_analysis
from musatpy.listings.audit.notes import Notes
from musatpy.listings.audit.plate_tables import read_plates
from musatpy.listings.audit.scan import WIDEST, Line, lines_of, standard_reports
from musatpy.listings.audit.structures import Listing
from musatpy.listings.audit.submerged_tables import read_submerged
from musatpy.listings.audit.untitled import note_untitled


def read_listing(path: Path | str) -> Listing:
    """Return what the standard reports of a listing say.

    Text that is not UTF-8 is read as Windows-1252. Raises `MusatError` where the file has none of the standard
    reports, `OSError` where it cannot be read.
    """
    path = Path(path)
    content = path.read_bytes()
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")
    return listing_of(text, str(path))


def listing_of(text: str, name: str) -> Listing:
    """Return what the text of a listing says; raises `MusatError` where it has none of the standard reports."""
    notes = Notes(name, text)
    # Not splitlines(): it parts lines at characters that editors, and so their line numbers, do not.
    rows = text.replace("\r\n", "\n").split("\n")
    for number, row in enumerate(map(str.rstrip, rows), start=1):
        if len(row) > WIDEST:
            notes.lost(Line(number, row[:WIDEST]), f"a row of {len(row)} characters: no listing has any")
    lines = lines_of(rows)
    reports = list(standard_reports(lines, notes.repairs))
    analyses = [read_analysis(report, notes) for report in reports if report.kind not in ("plates", "submerged")]
    listing = Listing(
        name=name,
        analyses=tuple(analysis for analysis in analyses if analysis),
        plates=tuple(read_plates(reports, notes)),
        submerged=tuple(read_submerged(reports, notes)),
        repairs=(),
        unreadable=(),
    )
    known = listing.rows | notes.titled | {problem.line or 0 for problem in notes.unreadable}
    note_untitled([line for line in lines if line.canonical], known, notes)
    if not (listing.analyses or listing.plates or listing.submerged or notes.unreadable):
        raise MusatError(f"{name}: no analysis, plate residuals or bathymetric points are in it")
    return replace(
        listing,
        repairs=tuple(sorted(notes.repairs, key=lambda repair: repair.line)),
        unreadable=tuple(sorted(notes.unreadable, key=lambda problem: problem.line or 0)),
    )
