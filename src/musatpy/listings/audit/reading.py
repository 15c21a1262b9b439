"""A listing: what its standard reports say, whether they agree with themselves, and that in print."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from musatpy.errors import MusatError, Problem
from musatpy.listings.audit.analyses import LABELS, check_analyses, read_analysis
from musatpy.listings.audit.cells import Repair
from musatpy.listings.audit.plates import RMS_LABELS, check_plates, read_plates
from musatpy.listings.audit.report import Misprint, Report
from musatpy.listings.audit.scan import Notes, excerpts_of, found, lines_of
from musatpy.listings.audit.submerged import check_submerged, read_submerged
from musatpy.listings.lines import Line, text_of

_LABELS = (*LABELS.values(), *RMS_LABELS.values())
_NEAR = 15  # lines: rows no farther apart are of one report
_BROKEN = 5  # lines: a row so near to one that was read belongs to its report, which is not whole
# Possessive, because rows of blanks would be tried blank by blank else.
_TWO_CELLS = r"(?:-?[\d.]++(?:\s++|$)){2,}$"
_COORDINATES = re.compile(r"^\s*+(?:\S++\s++)?\**+\s*+[XYZ]\s++" + _TWO_CELLS)


@dataclass(frozen=True, kw_only=True)
class Listing:
    """All that was found in a listing, the repairs that it took, and the rows that cannot be read."""

    name: str
    analyses: tuple[Report, ...]
    plates: tuple[Report, ...]
    submerged: tuple[Report, ...]
    repairs: tuple[Repair, ...]
    unreadable: tuple[Problem, ...]


def read_listing(path: Path | str) -> Listing:
    """Return what the standard reports of a listing say.

    Raises `MusatError` where the file is no text, or has none of the standard reports, `OSError` where it cannot be
    read.
    """
    path = Path(path)
    return listing_of(text_of(path.read_bytes(), str(path)), str(path))


def listing_of(text: str, name: str) -> Listing:
    """Return what the text of a listing says; raises `MusatError` where it has none of the standard reports."""
    notes = Notes(name, text)
    lines = lines_of(text, notes)
    excerpts = list(excerpts_of(lines))
    analyses = [read_analysis(one, notes) for one in excerpts if one.kind not in ("plates", "submerged")]
    plates = tuple(read_plates(excerpts, notes))
    submerged = tuple(read_submerged(excerpts, notes))
    _note_untitled(lines, notes)
    if not (any(analyses) or plates or submerged or notes.unreadable):
        raise MusatError(f"{name}: no analysis, plate residuals or bathymetric points are in it")
    return Listing(
        name=name,
        analyses=tuple(analysis for analysis in analyses if analysis),
        plates=plates,
        submerged=submerged,
        repairs=tuple(sorted(notes.repairs, key=lambda repair: repair.line)),
        unreadable=tuple(sorted(notes.unreadable, key=lambda problem: problem.line or 0)),
    )


def _note_untitled(lines: Sequence[Line], notes: Notes) -> None:
    """Note the first row of each standard report that stands below no legible title, and so belongs to none."""
    last, used = -_NEAR, notes.used | {problem.line or 0 for problem in notes.unreadable}
    for line in lines:
        if not _is_row(line) or any(line.number - n in used for n in range(_BROKEN)):
            continue
        if line.number - last > _NEAR:
            notes.lost(line, f"a report without a legible title: '{line.text.strip()}'")
        last = line.number


def _is_row(line: Line) -> bool:
    if _COORDINATES.match(line.text):
        return True
    matches = (found(label, line) for label in _LABELS)
    return any(match is not None and re.match(_TWO_CELLS, match["rest"].strip()) for match in matches)


def audit(listing: Listing) -> list[Misprint]:
    """Return what contradicts in a listing, by line."""
    checks = check_analyses(listing.analyses), check_plates(listing.plates), check_submerged(listing.submerged)
    return sorted(chain.from_iterable(checks), key=lambda finding: finding.line)


def audit_text(listing: Listing, findings: Sequence[Misprint]) -> str:
    """Return the audit of a listing: what was found in it, repairs, rows that cannot be read, contradictions."""
    counts = (
        (len(listing.analyses), "analysis", "analyses"),
        (len(listing.plates), "table of plate residuals", "tables of plate residuals"),
        (len(listing.submerged), "table of bathymetric points", "tables of bathymetric points"),
    )
    contents = ", ".join(f"{count} {one if count == 1 else several}" for count, one, several in counts if count)
    lines = [f"{listing.name}: {contents or 'nothing'}"]
    if listing.repairs:
        lines += ["", f"Repairs of the text: {len(listing.repairs)}"]
    for repair in listing.repairs:
        outcome = f"read as '{repair.read}'" if repair.read else "left out"
        lines.append(f"{listing.name}:{repair.line}: {repair.kind.value}: '{repair.found}' {outcome}")
    if listing.unreadable:
        lines += ["", f"Rows that cannot be read: {len(listing.unreadable)}"]
        lines += [problem.headline() for problem in listing.unreadable]
    if findings:
        lines += ["", f"Contradictions: {len(findings)}"]
    for finding in findings:
        lines += finding.lines(listing.name)
    state = "inconsistent" if findings else "consistent, as far as it can be read" if listing.unreadable else ""
    return "\n".join([*lines, "", state or "consistent"]) + "\n"


def audit_record(listing: Listing, findings: Sequence[Misprint]) -> dict[str, Any]:
    """Return the same for JSON, a dictionary of lists."""
    return {
        "listing": listing.name,
        "consistent": not findings and not listing.unreadable,
        "repairs": [dataclasses.asdict(repair) for repair in listing.repairs],
        "unreadable": [{"line": problem.line, "message": problem.headline()} for problem in listing.unreadable],
        "contradictions": [dataclasses.asdict(finding) for finding in findings],
    }
