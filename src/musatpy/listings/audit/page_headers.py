"""Page headers of our listings: are all pages there, and each of them once? Rows that no page has room for."""

from __future__ import annotations

from collections.abc import Sequence

from musatpy.listings.audit.cells import read_cells
from musatpy.listings.audit.notes import Notes
from musatpy.listings.audit.scan import PAGE_HEADER, WIDEST, Line
from musatpy.listings.audit.spelling import canonical

_OURS = canonical("MUSATPY")


def note_pages(rows: Sequence[str], notes: Notes) -> None:
    """Note pages that are missing, there twice or not in their order, and rows that are too wide.

    A page 1 begins another run.
    Headers of other programs tell nothing: their pages need not be numbered so.
    """
    before: int | None = None
    wide = enumerate(rows, start=1) if max(map(len, rows)) > WIDEST else ()
    for number, row in wide:
        if len(row := row.rstrip()) > WIDEST:
            notes.lost(Line(number, row[:WIDEST]), f"a row of {len(row)} characters: no listing has any")
    for line, page in _pages(rows, notes):
        if page not in (1, (before or 0) + 1):
            notes.lost(line, _message(before or 0, page))
        before = page


def _pages(rows: Sequence[str], notes: Notes) -> list[tuple[Line, int]]:
    pages = []
    for number, row in [(number, row.rstrip()) for number, row in enumerate(rows, start=1) if "PAGE" in row]:
        header = PAGE_HEADER.search(row) if len(row) <= WIDEST else None
        # Column 1 may have a form feed or a carriage control character.
        if header is None or not canonical(row[:20]).removeprefix("1").startswith(_OURS):
            continue
        reading = read_cells([header["page"]], ["count"])
        if reading is not None:
            notes.repairs.extend(reading.repairs(number))
            pages.append((Line(number, row.strip()), int(reading.texts[0])))
    return pages


def _message(before: int, page: int) -> str:
    if page == before:
        return f"page {page} is there twice: the listing is not whole"
    if page < before:
        return f"page {page} stands after page {before}: the listing is not whole"
    missing = f"page {before + 1} is" if page == before + 2 else f"pages {before + 1} to {page - 1} are"
    return f"{missing} missing before page {page}: the listing is not whole"
