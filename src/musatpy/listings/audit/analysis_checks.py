"""Analyses: do the statistics of each column agree, do the samples, do the ids exist?"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from musatpy.listings.audit.analysis_tables import MAXIMUM_ID, SIZE
from musatpy.listings.audit.misprints import Misprint, Suspect, range_like
from musatpy.listings.audit.samples import Interval, consistent, implied, sizes_implied
from musatpy.listings.audit.structures import Analysis, Component, Listing

NAMES = {"sum": "sum", "mean": "mean", "rms": "RMS", "deviation": "standard deviation", "maximum": "maximum"}
_FEW = 4  # ids that must agree before one is doubted for its width


def check_analyses(listing: Listing) -> Iterator[Misprint]:
    """Yield what contradicts in the analyses of a listing."""
    for analysis in listing.analyses:
        for component in analysis.components:
            yield from _fields(analysis, component)
            yield from _column(analysis, component)
        yield from _sizes(analysis)
    yield from _ids(listing)


def _fields(analysis: Analysis, component: Component) -> Iterator[Misprint]:
    """Yield angles with 60 minutes or seconds and more."""
    for name, cell in component.statistics.items():
        parts = cell.text.split()
        if len(parts) == 3 and (int(parts[1]) >= 60 or float(parts[2]) >= 60.0):
            message = "no angle in degrees, minutes, seconds"
            yield Misprint(cell.line, analysis.name, component.name, message, (Suspect.of(NAMES[name], cell),))


def _column(analysis: Analysis, component: Component) -> Iterator[Misprint]:
    """Yield the contradiction within one column, with every cell that alone could be the cause."""
    N, cells = component.size, {name: (cell.low, cell.high) for name, cell in component.statistics.items()}
    if not N or consistent(N, cells):
        return
    suspects = []
    for name, cell in component.statistics.items():
        if consistent(N, {key: value for key, value in cells.items() if key != name}):
            bounds = implied(N, name, cells)
            expected = range_like(*bounds, cell) if bounds and math.isfinite(bounds[1]) else ""
            suspects.append(Suspect.of(NAMES[name], cell, expected))
    for other in sizes_implied(cells):
        if consistent(other, cells) and (other > 1 or "deviation" not in cells):
            line = analysis.lines.get(SIZE, analysis.line)
            suspects.append(Suspect("sample size", line, str(N), str(other)))
    line = suspects[0].line if suspects else analysis.line
    yield Misprint(line, analysis.name, component.name, _contradiction(N, cells), tuple(suspects))


def _contradiction(N: int, cells: dict[str, Interval]) -> str:
    """Return what the smallest contradicting group of statistics is."""
    groups = (("sum", "mean"), ("rms", "mean", "deviation"), ("sum", "rms", "deviation"), ("rms", "maximum"))
    contradicting = (
        group for group in groups if not consistent(N, {name: cells[name] for name in group if name in cells})
    )
    *names, last = (NAMES[name] for name in next(contradicting, cells))
    return f"{', '.join(names)} and {last} contradict one another"


def _sizes(analysis: Analysis) -> Iterator[Misprint]:
    """Yield samples of unequal size that must be the same: of all stations, of latitude and longitude."""
    alike = analysis.components if analysis.kind.startswith("station") else analysis.components[:2]
    if analysis.kind == "check point":
        return
    sizes = [component.size for component in alike]
    if None in sizes or len(set(sizes)) == 1:
        return
    item = ", ".join(component.name for component in alike)
    message = f"samples of {', '.join(map(str, sizes))} that should be of one size"
    yield Misprint(analysis.lines[SIZE], analysis.name, item, message)


def _ids(listing: Listing) -> Iterator[Misprint]:
    """Yield ids of maxima that the listing does not know, or that look unlike all others."""
    frames = {frame for table in listing.plates for frame in table.frames}
    for analysis in listing.analyses:
        known = frames if analysis.kind.startswith("station") else set()
        for component in analysis.components:
            name, message = component.maximum_id, ""
            if name and known and name not in known:
                message = f"the maximum is at {name}, which is not in the listing"
            elif name and not known:
                message = _odd_width(listing, analysis, name)
            if message:
                yield Misprint(analysis.lines[MAXIMUM_ID], analysis.name, component.name, message)


def _odd_width(listing: Listing, analysis: Analysis, name: str) -> str:
    """Return a doubt about an id that is longer or shorter than all others."""
    if analysis.kind.startswith("station"):
        return ""
    ids = [
        component.maximum_id
        for of_points in listing.analyses
        if not of_points.kind.startswith("station")
        for component in of_points.components
    ]
    ids += [point.name for table in listing.submerged for point in table.points]
    others = [other for other in ids if other not in ("", name)]
    widths = {len(other) for other in others}
    if len(others) < _FEW or len(widths) > 1 or len(name) in widths:
        return ""
    if not re.fullmatch(r"\d+", name + "".join(others)):
        return ""
    return f"point {name} is doubtful: all others have {widths.pop()} digits"
