"""A listing -> structures: `read_listing` of a file, `listing_of` of its text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from musatpy.errors import MusatError
from musatpy.listings.audit.analysis_tables import read_analysis
from musatpy.listings.audit.headings import Title, audited_tables
from musatpy.listings.audit.job_options import MEASUREMENT_COUNT, missing_in, options_of, undetermined_in
from musatpy.listings.audit.notes import Notes
from musatpy.listings.audit.page_headers import note_pages
from musatpy.listings.audit.plate_tables import read_plates
from musatpy.listings.audit.ruled import JOB_HEADING, JOB_ROWS, tables_of, whole_tables
from musatpy.listings.audit.scan import Line, lines_of, runs_of, standard_reports, starts_ours
from musatpy.listings.audit.spelling import canonical
from musatpy.listings.audit.structures import Listing
from musatpy.listings.audit.submerged_tables import read_submerged
from musatpy.listings.audit.untitled import note_untitled

_BRIEF = canonical("Brief Listing")  # a title: residuals are left out, and tables cut
_WHOLE = (Title.POSITIONS, Title.ATTITUDES, Title.POINTS, Title.RESIDUALS)  # tables of each whole listing


def read_listing(path: Path | str) -> Listing:
    """Return what a listing says.

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
    notes = Notes(name)
    # Not splitlines(): it parts lines at characters that editors, and so their line numbers, do not.
    rows = text.replace("\r\n", "\n").split("\n")
    note_pages(rows, notes)
    runs = [_run(lines, notes) for lines in runs_of(lines_of(rows))]
    if not any(run.analyses or run.plates or run.submerged or _known(run) for run in runs) and not notes.unreadable:
        raise MusatError(f"{name}: no analysis, plate residuals or bathymetric points are in it")
    return replace(
        _together(runs),
        repairs=tuple(sorted(notes.repairs, key=lambda repair: repair.line)),
        unreadable=tuple(sorted(notes.unreadable, key=lambda problem: problem.line or 0)),
    )


def _known(run: Listing) -> bool:
    """Tell whether tables of ours are in a run that has none of the standard reports, as in those of `as11`."""
    from musatpy.reports.statements import table_titles  # a listing is read before it is known to be ours

    return any(table.title.startswith(table_titles()) for table in run.tables)


def _run(lines: Sequence[Line], notes: Notes) -> Listing:
    """Return what one run says; its repairs and problems are noted."""
    notes.ids.clear()
    worded = [line for line in lines if line.canonical]
    tables = tables_of(lines, notes)  # first: it knows the ids
    reports = list(standard_reports(lines, notes.repairs))
    analyses = [read_analysis(report, notes) for report in reports if report.kind not in ("plates", "submerged")]
    plates = read_plates([report for report in reports if report.kind == "plates"], notes)
    submerged = read_submerged([report for report in reports if report.kind == "submerged"], notes)
    whole = whole_tables(tables, worded)
    listing = Listing(
        name=notes.file,
        options=options_of(lines, notes),
        analyses=tuple(analysis for analysis in analyses if analysis),
        plates=tuple(plates),
        submerged=tuple(submerged),
        tables=whole,
        undetermined=undetermined_in(worded),
        repairs=(),
        unreadable=(),
        cut=len(whole) < len(tables),
    )
    known = listing.rows | notes.titled | {problem.line or 0 for problem in notes.unreadable}
    note_untitled(worded, known, notes)
    _note_missing(listing, lines, notes)
    return listing


def _together(runs: Sequence[Listing]) -> Listing:
    """Return the runs of a listing as one: all that they have, and the options of the first."""
    if len(runs) == 1:
        return runs[0]
    lists = ("analyses", "plates", "submerged", "tables", "undetermined")
    joined: dict[str, Any] = {name: tuple(entry for run in runs for entry in getattr(run, name)) for name in lists}
    return replace(runs[0], parts=tuple(runs), **joined)


def _note_missing(listing: Listing, lines: Sequence[Line], notes: Notes) -> None:
    """Note the rows and tables that each listing of ours has, and this one has not."""
    if MEASUREMENT_COUNT not in listing.options and not starts_ours(lines[0]):
        return
    for name in missing_in(listing.options):
        notes.missing(lines[0].number, name)
    job = listing.table(Title.JOB)
    for name in JOB_ROWS if job else ():
        if job and name not in job.columns.get(JOB_HEADING, ()):
            notes.missing(job.line, name)
    if any(line.canonical == _BRIEF for line in lines):
        return
    for title, table in audited_tables().items():
        if table.title in _WHOLE and listing.table(title) is None:
            notes.lost(lines[-1], f"the table '{title}' is missing: the listing is not whole")
