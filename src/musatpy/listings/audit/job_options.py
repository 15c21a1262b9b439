"""Options, size and summary of our listings: rows `name ..... value`, those that the audit uses under noise too."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from musatpy.listings.audit.cells import Kind, read_cells
from musatpy.listings.audit.notes import Notes
from musatpy.listings.audit.scan import Line
from musatpy.listings.audit.spelling import canonical, respelt

PHOTO_COUNT, POINT_COUNT, MEASUREMENT_COUNT = "Photos", "Ground points", "Plate measurements"
CONTROL_COUNT = "Control points, check points included"
FREEDOM, SIGMA0 = "Degrees of freedom", "Sigma0 (standard deviation of unit weight)"
SYSTEM, INITIAL = "Coordinate system", "Initial values"
_OF_ADJUSTMENT = f"{SYSTEM} of the adjustment"  # in place of the other where the answer is in a third system
_NUMBERS: dict[str, Kind] = {
    **dict.fromkeys((PHOTO_COUNT, POINT_COUNT, MEASUREMENT_COUNT, CONTROL_COUNT, FREEDOM), "count"),
    SIGMA0: "number",
}
# Rows that say whether tables and analyses may be compared: the code that their values begin with.
_CODES = {
    SYSTEM: ("GEOG", "GEOC", "LOCL"),
    _OF_ADJUSTMENT: ("GEOG", "GEOC", "LOCL"),
    INITIAL: ("GIVEN", "COMPUTE", "CHECK"),
}
_KNOWN = {canonical(name): name for name in (*_NUMBERS, *_CODES)}
_BEGINNINGS = tuple(_KNOWN)
_ROW = re.compile(r"^(?P<name>\w.*?) \.{2,} (?P<value>\S.*)$")
_NOISY_ROW = re.compile(r"^\W*(?P<name>\w.*?)[^\w()]{4,}(?P<value>\S.*)$")
_EMPTY_ROW = re.compile(r"^(?P<name>\w.*?) \.{2,}$")
_PRINTED = re.compile(r"-\d+|\*+|[-+.\d]+E[-+]\d+")  # no count or number as it should be, and no noise
_CONTINUED = re.compile(r"^ {40,}\S")
_UNDETERMINED = re.compile(r"^(?P<name>\S{1,8}) +not determined  ")


def options_of(lines: Sequence[Line], notes: Notes) -> dict[str, str]:
    """Return names and values, with the lines that continue a value; noise in those that are used is noted."""
    options: dict[str, str] = {}
    name = ""
    for line in lines:
        if not line.canonical and not name:
            continue
        text = line.text.expandtabs() if "\t" in line.text else line.text
        dotted = " .." in text and bool(line.canonical)
        row = _ROW.match(text) if dotted else None
        if row is None and line.canonical.startswith(_BEGINNINGS):
            noisy = _NOISY_ROW.match(text)
            row = noisy if noisy and canonical(noisy["name"]) in _KNOWN else None
        empty = _EMPTY_ROW.match(text) if dotted and not row else None
        if empty:
            name = empty["name"]
            options[name] = ""
        elif row:
            name = _KNOWN.get(canonical(row["name"]), row["name"])
            if name in _KNOWN.values():
                notes.repairs.extend(respelt(line.number, row["name"], name))
                options[name] = _value(line, name, row["value"].strip(), notes)
            else:
                options[name] = row["value"]
        elif name and _CONTINUED.match(text):
            options[name] += " " + text.strip()
        else:
            name = ""
    return options


def _value(line: Line, name: str, text: str, notes: Notes) -> str:
    """Return the value of a known row, its noise noted; nothing, and that noted, where it is not legible."""
    if name in _NUMBERS:
        if _PRINTED.fullmatch(text):
            return text
        reading = read_cells(text.split(), [_NUMBERS[name]])
        if reading is not None:
            notes.repairs.extend(reading.repairs(line.number))
            return reading.texts[0]
    else:
        word, *rest = text.split()
        for code in _CODES[name]:
            if canonical(word) == canonical(code):
                notes.repairs.extend(respelt(line.number, word, code))
                return " ".join([code, *rest])
    notes.lost(line, f"'{text}' is no value of '{name}'")
    return ""


def missing_in(options: dict[str, str]) -> Iterator[str]:
    """Yield the rows that each listing of ours has and this one has not."""
    if not {SYSTEM, _OF_ADJUSTMENT} & options.keys():
        yield SYSTEM
    yield from (name for name in (INITIAL, *_NUMBERS) if name not in options)


def undetermined_in(worded: Sequence[Line]) -> tuple[str, ...]:
    """Return the points that a listing says to have no position."""
    matches = (_UNDETERMINED.match(line.text) for line in worded if "not determined" in line.text)
    return tuple(match["name"] for match in matches if match)
