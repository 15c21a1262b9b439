"""A listing: what its standard reports say, whether they agree with themselves, and that in print."""

from __future__ import annotations

import dataclasses
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from musatpy.errors import MusatError, Problem
from musatpy.listings.audit import plates, submerged
from musatpy.listings.audit.analyses import LABELS, check_analysis, read_analysis
from musatpy.listings.audit.cells import Repair
from musatpy.listings.audit.report import Misprint, StandardReport, pages_joined
from musatpy.listings.audit.scan import Notes, excerpts_of, found, lines_of
from musatpy.listings.lines import PrintedLine, text_of

_LABELS = (*LABELS.values(), *plates.RMS_LABELS.values())
# Of reports that are no analyses: by the kind of the excerpt, and by name.
_READERS = {"plates": plates.read_plates, "submerged": submerged.read_submerged}
_CHECKS = {plates.NAME: plates.check_plates, submerged.NAME: submerged.check_submerged}
_NEAR = 15  # lines: rows no farther apart are of one report
_BROKEN = 5  # lines: a row so near to one that was read belongs to its report, which is not whole
# Possessive, because rows of blanks would be tried blank by blank else.
_TWO_CELLS = r"(?:-?[\d.]++(?:\s++|$)){2,}$"
_COORDINATES = re.compile(r"^\s*+(?:\S++\s++)?\**+\s*+[XYZ]\s++" + _TWO_CELLS)


@dataclass(frozen=True, kw_only=True)
class Listing:
    """All that was found in a listing, the repairs that it took, and the rows that cannot be read."""

    name: str
    reports: tuple[StandardReport, ...]
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
    reports = pages_joined(_READERS.get(one.kind, read_analysis)(one, notes) for one in excerpts_of(lines))
    _note_untitled(lines, notes)
    if not (reports or notes.unreadable):
        raise MusatError(f"{name}: no analysis, plate residuals or bathymetric points are in it")
    return Listing(
        name=name,
        reports=tuple(reports),
        repairs=tuple(sorted(notes.repairs, key=lambda repair: repair.line)),
        unreadable=tuple(sorted(notes.unreadable, key=lambda problem: problem.line or 0)),
    )


def _note_untitled(lines: Sequence[PrintedLine], notes: Notes) -> None:
    """Note the first row of each standard report that stands below no legible title, and so belongs to none."""
    last, used = -_NEAR, notes.used | {problem.line or 0 for problem in notes.unreadable}
    for line in lines:
        if not _is_row(line) or any(line.number - n in used for n in range(_BROKEN)):
            continue
        if line.number - last > _NEAR:
            notes.lost(line, f"a report without a legible title: '{line.text.strip()}'")
        last = line.number


def _is_row(line: PrintedLine) -> bool:
    if _COORDINATES.match(line.text):
        return True
    matches = (found(label, line) for label in _LABELS)
    return any(match is not None and re.match(_TWO_CELLS, match["rest"].strip()) for match in matches)


def audit(listing: Listing) -> list[Misprint]:
    """Return what contradicts in a listing, by line."""
    found = chain.from_iterable(_CHECKS.get(report.name, check_analysis)(report) for report in listing.reports)
    return sorted(found, key=lambda finding: finding.line)


def audit_text(listing: Listing, findings: Sequence[Misprint]) -> str:
    """Return the audit of a listing: what was found in it, repairs, rows that cannot be read, contradictions."""
    nouns = {name: (f"table of {name}", f"tables of {name}") for name in _CHECKS}
    counts = Counter(nouns.get(report.name, ("analysis", "analyses")) for report in listing.reports)
    contents = ", ".join(f"{count} {noun[count > 1]}" for noun, count in counts.items())
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
