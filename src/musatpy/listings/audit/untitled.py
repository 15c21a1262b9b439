"""Rows of the standard reports that stand below no legible title, and so belong to no report."""

from __future__ import annotations

import re
from collections.abc import Sequence

from musatpy.listings.audit.analysis_tables import LABELS
from musatpy.listings.audit.notes import Notes, labelled
from musatpy.listings.audit.plate_tables import RMS_LABELS
from musatpy.listings.audit.scan import Line
from musatpy.listings.audit.spelling import any_of, required
from musatpy.listings.audit.submerged_tables import AXES

_NEAR = 15  # lines: rows no farther apart are of one report
_BROKEN = 5  # lines: a row so near to one that was read belongs to its report, which is not whole
# Possessive, because rows of blanks would be tried blank by blank else.
_CELLS = r"(?:-?[\d.]++(?:\s++|$)){%d,}$"
_COORDINATES = re.compile(r"^\s*+(?:\S++\s++)?\**+\s*+[XYZ]\s++" + _CELLS % 2)

_LABELS = (*LABELS.values(), *RMS_LABELS.values())
_HAS_LABEL = any_of(map(required, _LABELS))
_DIGIT, _LETTERS = re.compile(r"\d"), re.compile("[A-Za-z]{2}")


def note_untitled(worded: Sequence[Line], used: set[int], notes: Notes) -> None:
    """Note the first row of each report that is below no title; `used` are the rows of the others."""
    last = -_NEAR
    for line in worded:
        if line.number in used or not _is_row(line) or any(line.number - n in used for n in range(1, _BROKEN)):
            continue
        if line.number - last > _NEAR:
            notes.lost(line, f"a report without a legible title: '{line.text.strip()}'")
        last = line.number


def _is_row(line: Line) -> bool:
    has_label = _HAS_LABEL(line.canonical)
    if not (has_label or any(axis in line.text for axis in AXES)) or not _DIGIT.search(line.text):
        return False
    if _COORDINATES.match(line.text):
        return True
    if not has_label or not _LETTERS.search(line.text):
        return False
    matches = (labelled(label, line)[0] for label in _LABELS)
    return any(match is not None and re.match(_CELLS % 2, match["rest"].strip()) for match in matches)
