"""Analyses: do the statistics of each column agree, do the samples, do the ids exist?"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from musatpy.listings.audit.analysis_tables import MAXIMUM_ID, SIZE
from musatpy.listings.audit.headings import Title
from musatpy.listings.audit.misprints import Misprint, Suspect, range_like
from musatpy.listings.audit.samples import Interval, consistent, implied, sizes_implied
from musatpy.listings.audit.structures import Analysis, Component, Listing, Printed

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
            suspect = Suspect(item=NAMES[name], line=cell.line, found=cell.text, expected="")
            yield Misprint(
                line=cell.line,
                table=analysis.name,
                item=component.name,
                message="no angle in degrees, minutes, seconds",
                suspects=(suspect,),
            )


def _column(analysis: Analysis, component: Component) -> Iterator[Misprint]:
    """Yield the contradiction within one column, with every cell that alone could be the cause."""
    N, cells = component.size, {name: _interval(cell) for name, cell in component.statistics.items()}
    if not N or consistent(N, cells):
        return
    suspects = []
    for name, cell in component.statistics.items():
        if consistent(N, {key: value for key, value in cells.items() if key != name}):
            bounds = implied(N, name, cells)
            expected = range_like(*bounds, cell) if bounds and math.isfinite(bounds[1]) else ""
            suspects.append(Suspect(item=NAMES[name], line=cell.line, found=cell.text, expected=expected))
    for other in sizes_implied(cells):
        if consistent(other, cells) and (other > 1 or "deviation" not in cells):
            line = analysis.lines.get(SIZE, analysis.line)
            suspects.append(Suspect(item="sample size", line=line, found=str(N), expected=str(other)))
    yield Misprint(
        line=suspects[0].line if suspects else analysis.line,
        table=analysis.name,
        item=component.name,
        message=_contradiction(N, cells),
        suspects=tuple(suspects),
    )


def _interval(cell: Printed) -> Interval:
    return cell.low, cell.high


def _contradiction(N: int, cells: dict[str, Interval]) -> str:
    """Return what the smallest contradicting group of statistics is."""
    groups = (("sum", "mean"), ("rms", "mean", "deviation"), ("sum", "rms", "deviation"), ("rms", "maximum"))
    for group in groups:
        if not consistent(N, {name: cells[name] for name in group if name in cells}):
            return f"{_list([NAMES[name] for name in group])} contradict one another"
    return f"{_list([NAMES[name] for name in cells])} contradict one another"


def _list(names: list[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _sizes(analysis: Analysis) -> Iterator[Misprint]:
    """Yield samples of unequal size that must be the same: of all stations, of latitude and longitude."""
    alike = analysis.components if analysis.kind.startswith("station") else analysis.components[:2]
    if analysis.kind == "check point":
        return
    sizes = [component.size for component in alike]
    if None in sizes or len(set(sizes)) == 1:
        return
    yield Misprint(
        line=analysis.lines[SIZE],
        table=analysis.name,
        item=", ".join(component.name for component in alike),
        message=f"samples of {', '.join(map(str, sizes))} that should be of one size",
    )


def _ids(listing: Listing) -> Iterator[Misprint]:
    """Yield ids of maxima that the listing does not know, or that look unlike all others."""
    frames = {frame for table in listing.plates for frame in table.frames}
    points = _points(listing)
    for analysis in listing.analyses:
        known = frames if analysis.kind.startswith("station") else points
        for component in analysis.components:
            name = component.maximum_id
            if not name:
                continue
            message = ""
            if known and name not in known:
                message = f"the maximum is at {name}, which is not in the listing"
            elif not known:
                message = _odd_width(listing, analysis, name)
            if message:
                yield Misprint(
                    line=analysis.lines[MAXIMUM_ID], table=analysis.name, item=component.name, message=message
                )


def _points(listing: Listing) -> set[str]:
    table = listing.table(Title.POINTS)
    return set(table.columns.get("Point", ())) if table else set()


def _odd_width(listing: Listing, analysis: Analysis, name: str) -> str:
    """Return a doubt about an id that is longer or shorter than all others of a listing without a point table."""
    if analysis.kind.startswith("station") or listing.cut:
        return ""
    others = [
        component.maximum_id
        for one in listing.analyses
        if not one.kind.startswith("station")
        for component in one.components
        if component.maximum_id and component.maximum_id != name
    ]
    others += [point.name for table in listing.submerged for point in table.points if point.name != name]
    widths = {len(other) for other in others}
    if len(others) < _FEW or len(widths) > 1 or len(name) in widths:
        return ""
    if not all(re.fullmatch(r"\d+", one) for one in [name, *others]):
        return ""
    return f"point {name} is doubtful: all others have {widths.pop()} digits"
