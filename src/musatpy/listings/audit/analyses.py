"""Analyses of stations, ground points and check points: read, and do the statistics of each column agree?"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from musatpy.listings.audit.cells import Kind, Misprint, Printed, Suspect, printed, range_like, read_cells
from musatpy.listings.audit.samples import Interval, consistent, implied, sizes_implied
from musatpy.listings.audit.scan import Line, Notes, StandardReport, rows_of

SIZE, MAXIMUM_ID = "size", "maximum_id"
# Statistic -> its label. The row of the id is looked for first: its label contains that of another.
LABELS = {
    MAXIMUM_ID: "|".join(
        f"{what} with {most} Difference" for what in ("Camera", "Point") for most in ("Max", "Maximum")
    ),
    SIZE: "Sample Size",
    "sum": "Sum of Differences",
    "mean": "Mean Value of Differences",
    "rms": "RMS of Differences",
    "deviation": "Standard Deviation from Mean",
    "maximum": "Maximum Difference",
}
# Statistic -> what messages call it.
STATISTICS = {"sum": "sum", "mean": "mean", "rms": "RMS", "deviation": "standard deviation", "maximum": "maximum"}
_GEOGRAPHIC = (("Latitude", "arcsec"), ("Longitude", "arcsec"), ("Elevation", "m"))
_ATTITUDE = (("X-Tilt", "arcsec"), ("Y-Tilt", "arcsec"), ("Heading", "arcsec"))
_METRIC = re.compile(r"\b(East|North|Up|Elev|X|Y|Z)\b\.?\s*\(M\)", re.I)
_FULL = {"Elev": "Elevation"}


@dataclass(frozen=True, kw_only=True)
class Component:
    """One column of an analysis; None where nothing is printed or legible."""

    name: str  # Latitude, Longitude, Elevation, X-Tilt, ..., X, Y, Z, East, North, Up
    unit: str  # "arcsec" or "m"
    size: int | None
    statistics: dict[str, Printed]  # sum, mean, rms, deviation, maximum
    maximum_id: str


@dataclass(frozen=True, kw_only=True)
class Analysis:
    """An analysis of differences (ETL-0306, Tables 6-1 to 6-3 and 6-5 to 6-7)."""

    kind: str  # station position, station attitude, ground point, check point
    refracted: bool | None  # None where the title does not say
    components: tuple[Component, ...]
    lines: dict[str, int]  # statistic -> line

    @property
    def name(self) -> str:
        """How messages call it."""
        return f"{self.kind} analysis{run_name(self.refracted)}"


def run_name(refracted: bool | None) -> str:
    """Return `, no refraction`, `, refraction` or nothing."""
    return {None: "", False: ", no refraction", True: ", refraction"}[refracted]


def read_analysis(report: StandardReport, notes: Notes) -> Analysis | None:
    """Return the analysis of a report; None where no row of one is below the title, or no column has a name."""
    rows = rows_of(report, LABELS, notes)
    names = _components(report)
    if not rows or names is None:
        if rows:
            wanted = "Latitude, Longitude, Elevation or X, Y, Z or East, North, Up (M)"
            notes.lost(report.lines[0], f"no row '{wanted}' is legible below")
        return None
    sizes: list[int | None] = [None] * 3
    if SIZE in rows:
        sizes = [int(text) for text in notes.cells(*rows[SIZE], ["count"] * 3, LABELS[SIZE])] or sizes
    columns: list[dict[str, Printed]] = [{}, {}, {}]
    for statistic in STATISTICS:
        present = _filled(sizes, 2 if statistic == "deviation" else 1)
        if statistic in rows and present:
            kinds: list[Kind] = ["angle" if names[n][1] == "arcsec" else "number" for n in present]
            line, text = rows[statistic]
            cells = notes.cells(line, text, kinds, statistic, _places(rows, kinds))
            for n, cell in zip(present, cells, strict=False):
                columns[n][statistic] = printed(cell, line.number)
    ids = _maximum_ids(rows, sizes, columns, notes)
    return Analysis(
        kind=report.kind,
        refracted=report.refracted,
        components=tuple(
            Component(name=name, unit=unit, size=size, statistics=column, maximum_id=maximum_id)
            for (name, unit), size, column, maximum_id in zip(names, sizes, columns, ids, strict=True)
        ),
        lines={statistic: line.number for statistic, (line, _) in rows.items()},
    )


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


def _filled(sizes: Sequence[int | None], least: int) -> list[int]:
    """Return the columns whose sample is large enough for a number to be printed."""
    return [column for column, size in enumerate(sizes) if size is None or size >= least]


def _places(rows: dict[str, tuple[Line, str]], kinds: list[Kind]) -> list[int | None]:
    """Return how many decimals the cells of each column have, by most of the rows."""
    columns: list[Counter[int]] = [Counter() for _ in kinds]
    for _, text in (rows[statistic] for statistic in STATISTICS if statistic in rows):
        reading = read_cells(text, kinds)
        for column, cell in zip(columns, reading.texts if reading else (), strict=False):
            column[len(cell.partition(".")[2])] += 1
    return [column.most_common(1)[0][0] if column else None for column in columns]


def _maximum_ids(
    rows: dict[str, tuple[Line, str]],
    sizes: Sequence[int | None],
    columns: Sequence[dict[str, Printed]],
    notes: Notes,
) -> list[str]:
    """Return whose the maxima are; where a maximum prints as zero, the listing names no one."""
    ids = ["", "", ""]
    maxima = [column.get("maximum") for column in columns]
    named = [n for n in _filled(sizes, 1) if (maximum := maxima[n]) is None or maximum.value]
    if MAXIMUM_ID in rows and named:
        cells = notes.cells(*rows[MAXIMUM_ID], ["id"] * len(named), "with Max. Difference")
        for n, text in zip(named, cells, strict=False):
            ids[n] = text
    return ids


def check_analyses(analyses: Sequence[Analysis]) -> Iterator[Misprint]:
    """Yield what contradicts in the analyses of a listing."""
    for analysis in analyses:
        for component in analysis.components:
            yield from _fields(analysis, component)
            yield from _column(analysis, component)
        yield from _sizes(analysis)


def _fields(analysis: Analysis, component: Component) -> Iterator[Misprint]:
    """Yield angles with 60 minutes or seconds and more."""
    for name, cell in component.statistics.items():
        parts = cell.text.split()
        if len(parts) == 3 and (int(parts[1]) >= 60 or float(parts[2]) >= 60.0):
            suspects = (Suspect.of(STATISTICS[name], cell),)
            message = "no angle in degrees, minutes, seconds"
            yield Misprint(cell.line, analysis.name, component.name, message, suspects)


def _column(analysis: Analysis, component: Component) -> Iterator[Misprint]:
    """Yield the contradiction within one column, with every cell that alone could be the cause."""
    N, cells = component.size, {name: (cell.low, cell.high) for name, cell in component.statistics.items()}
    if not N or consistent(N, cells):
        return
    suspects = []
    for name, cell in component.statistics.items():
        if consistent(N, {key: value for key, value in cells.items() if key != name}):
            bounds = implied(N, name, cells)
            expected = range_like(*bounds, cell.text) if bounds and math.isfinite(bounds[1]) else ""
            suspects.append(Suspect.of(STATISTICS[name], cell, expected))
    for other in sizes_implied(cells):
        if consistent(other, cells) and (other > 1 or "deviation" not in cells):
            suspects.append(Suspect("sample size", analysis.lines[SIZE], str(N), str(other)))
    line = suspects[0].line if suspects else analysis.lines[SIZE]
    yield Misprint(line, analysis.name, component.name, _contradiction(N, cells), tuple(suspects))


def _contradiction(N: int, cells: dict[str, Interval]) -> str:
    """Return what the smallest contradicting group of statistics is."""
    groups = (("sum", "mean"), ("rms", "mean", "deviation"), ("sum", "rms", "deviation"), ("rms", "maximum"))
    contradicting = (
        group for group in groups if not consistent(N, {name: cells[name] for name in group if name in cells})
    )
    *names, last = (STATISTICS[name] for name in next(contradicting, cells))
    return f"{', '.join(names)} and {last} contradict one another"


def _sizes(analysis: Analysis) -> Iterator[Misprint]:
    """Yield samples of unequal size that must be the same: of all stations, of latitude and longitude."""
    alike = analysis.components if analysis.kind.startswith("station") else analysis.components[:2]
    sizes = [component.size for component in alike]
    if analysis.kind != "check point" and None not in sizes and len(set(sizes)) > 1:
        message = f"samples of {', '.join(map(str, sizes))} that should be of one size"
        item = ", ".join(component.name for component in alike)
        yield Misprint(analysis.lines[SIZE], analysis.name, item, message)
