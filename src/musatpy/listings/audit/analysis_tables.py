"""The analyses of stations, ground points and check points, from the rows below their titles."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from musatpy.listings.audit.cells import Kind, printed, read_cells, words_of
from musatpy.listings.audit.notes import Notes
from musatpy.listings.audit.scan import Line, StandardReport
from musatpy.listings.audit.spelling import required
from musatpy.listings.audit.structures import Analysis, Component, Printed

SIZE, MAXIMUM_ID = "size", "maximum_id"
# Statistic -> its label. The row of the id is looked for first: its label contains that of another.
LABELS = {
    MAXIMUM_ID: "(?:Camera|Point) with Max(?:imum)? Difference",
    SIZE: "Sample Size",
    "sum": "Sum of Differences",
    "mean": "Mean Value of Differences",
    "rms": "RMS of Differences",
    "deviation": "Standard Deviation from Mean",
    "maximum": "Maximum Difference",
}
STATISTICS = ("sum", "mean", "rms", "deviation", "maximum")
_GEOGRAPHIC = (("Latitude", "arcsec"), ("Longitude", "arcsec"), ("Elevation", "m"))
_ATTITUDE = (("X-Tilt", "arcsec"), ("Y-Tilt", "arcsec"), ("Heading", "arcsec"))
_METRIC = re.compile(r"\b(East|North|Up|Elev|X|Y|Z)\b\.?\s*\(M\)", re.I)
_FULL = {"Elev": "Elevation"}


def read_analysis(report: StandardReport, notes: Notes) -> Analysis | None:
    """Return the analysis of a report; None where no row of one is below the title."""
    rows = _rows(report, notes)
    if not rows:
        return None
    for statistic in LABELS:
        if statistic not in rows:
            notes.missing(report.line, statistic)
    names = _components(report)
    if names is None:
        notes.titled.update(line.number for line, _ in rows.values())
        notes.missing(report.line, "Latitude, Longitude, Elevation or X, Y, Z or East, North, Up (M)")
        return None
    sizes = _sizes(rows, notes)
    columns: list[dict[str, Printed]] = [{}, {}, {}]
    for statistic in STATISTICS:
        _read_statistic(rows, statistic, names, sizes, columns, notes)
    ids = _ids(rows, sizes, columns, notes)
    components = tuple(
        Component(name=name, unit=unit, size=size, statistics=column, maximum_id=maximum_id)
        for (name, unit), size, column, maximum_id in zip(names, sizes, columns, ids, strict=True)
    )
    lines = {statistic: line.number for statistic, (line, _) in rows.items()}
    return Analysis(
        kind=report.kind, refracted=report.refracted, line=report.line, components=components, lines=lines
    )


def _rows(report: StandardReport, notes: Notes) -> dict[str, tuple[Line, str]]:
    """Return statistic -> its line and what stands right of the label."""
    rows: dict[str, tuple[Line, str]] = {}
    for line in report.lines:
        for statistic, label in LABELS.items():
            rest = notes.after(label, line) if required(label) in line.canonical else None
            if rest is None:
                continue
            if statistic in rows:
                return rows  # of a report whose title is not legible
            rows[statistic] = (line, rest)
            break
    return rows


def _components(report: StandardReport) -> Sequence[tuple[str, str]] | None:
    """Return name and unit of each column; None where neither the title nor the headings tell."""
    if report.kind == "station attitude":
        return _ATTITUDE
    if report.sexagesimal:
        return _GEOGRAPHIC
    for line in report.lines:
        if {"latitude", "longitude"} <= set(re.findall(r"[a-z]+", line.text.lower())):
            return _GEOGRAPHIC
        headings = [match.capitalize() for match in _METRIC.findall(line.text)]
        if len(headings) == 3:
            return [(_FULL.get(name, name), "m") for name in headings]
    return None


def _sizes(rows: dict[str, tuple[Line, str]], notes: Notes) -> list[int | None]:
    if SIZE not in rows:
        return [None] * 3
    line, rest = rows[SIZE]
    reading = notes.cells(line, rest, ["count"] * 3, "Sample Size")
    return [int(text) for text in reading.texts] if reading else [None] * 3


def _filled(sizes: Sequence[int | None], least: int) -> list[int]:
    """Return the columns whose sample is large enough for a number to be printed."""
    return [column for column, size in enumerate(sizes) if size is None or size >= least]


def _read_statistic(
    rows: dict[str, tuple[Line, str]],
    statistic: str,
    names: Sequence[tuple[str, str]],
    sizes: Sequence[int | None],
    columns: list[dict[str, Printed]],
    notes: Notes,
) -> None:
    """Put the cells of one row into the columns."""
    present = _filled(sizes, 2 if statistic == "deviation" else 1)
    if statistic not in rows or not present:
        return
    line, rest = rows[statistic]
    kinds: list[Kind] = ["angle" if names[column][1] == "arcsec" else "number" for column in present]
    reading = notes.cells(line, rest, kinds, statistic, *_decimals(rows, kinds))
    if reading is not None:
        for column, text in zip(present, reading.texts, strict=True):
            columns[column][statistic] = printed(text, line.number)


def _decimals(rows: dict[str, tuple[Line, str]], kinds: list[Kind]) -> tuple[int | None, list[int | None]]:
    """Return how many decimals the numbers of the table have, by most of the rows that need no such help; and how
    many the cells of each column, by most of the rows that take no repair."""
    numbers: Counter[int] = Counter()
    columns: list[Counter[int]] = [Counter() for _ in kinds]
    for statistic in STATISTICS:
        reading = read_cells(words_of(rows[statistic][1]), kinds) if statistic in rows else None
        places = [len(text.partition(".")[2]) for text in reading.texts] if reading else []
        numbers.update(place for place, kind in zip(places, kinds, strict=False) if kind == "number")
        if reading and not reading.repairs(0):
            for column, place in zip(columns, places, strict=True):
                column[place] += 1
    most, *by_column = (counts.most_common(1)[0][0] if counts else None for counts in (numbers, *columns))
    return most, by_column


def _ids(
    rows: dict[str, tuple[Line, str]],
    sizes: Sequence[int | None],
    columns: Sequence[dict[str, Printed]],
    notes: Notes,
) -> list[str]:
    """Return whose the maxima are; where a maximum prints as zero, the listing names no one."""
    ids = ["", "", ""]
    maxima = [column.get("maximum") for column in columns]
    named = [n for n in _filled(sizes, 1) if (maximum := maxima[n]) is None or maximum.value]
    if MAXIMUM_ID not in rows or not named:
        return ids
    line, rest = rows[MAXIMUM_ID]
    reading = notes.cells(line, rest, ["id"] * len(named), "with Max. Difference")
    if reading is not None:
        for column, text in zip(named, reading.texts, strict=True):
            ids[column] = text
    return ids
