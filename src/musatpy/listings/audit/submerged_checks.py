"""Bathymetric points: no column may leave the apparent position by much more than it does at the other points."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from statistics import median

from musatpy.listings.audit.misprints import Misprint, Suspect, text_like
from musatpy.listings.audit.structures import Listing, SubmergedPoint, SubmergedTable
from musatpy.listings.audit.submerged_tables import AXES, COLUMNS

FACTOR = 20.0  # on the median shift of the other points
FLOOR = 20.0  # m: a job of mostly dry or shallow points; refraction shifts a point of 60 m depth by as much
_FEW = 3  # other points that make a median


def check_submerged(listing: Listing) -> Iterator[Misprint]:
    """Yield coordinates that refraction cannot have put where they are."""
    for table in listing.submerged:
        for column in COLUMNS[1:]:
            for axis in AXES:
                yield from _outliers(table, column, axis)


def _shifts(table: SubmergedTable, column: str, axis: str) -> list[tuple[SubmergedPoint, float]]:
    return [
        (point, point.xyz[column, axis].value - point.xyz["none", axis].value)
        for point in table.points
        if (column, axis) in point.xyz and ("none", axis) in point.xyz
    ]


def _outliers(table: SubmergedTable, column: str, axis: str) -> Iterator[Misprint]:
    shifts = _shifts(table, column, axis)
    if len(shifts) <= _FEW:
        return
    sizes = sorted(abs(shift) for _, shift in shifts)
    for point, shift in shifts:
        limit = max(FLOOR, FACTOR * _median_without(sizes, abs(shift)))
        if abs(shift) <= limit:
            continue
        cell, straight = point.xyz[column, axis], point.xyz["none", axis]
        others = (size for other, size in shifts if other is not point)
        near = text_like(straight.value + median(others), cell)
        suspects = [Suspect.of(f"{axis}, {column}", cell, f"about {near}")]
        if _all_off(point, axis, limit):
            suspects.append(Suspect.of(f"{axis}, no refraction", straight))
        message = f"{axis}, {column}, is {abs(shift):.1f} m from where it seems to be: more than {limit:.0f} m"
        yield Misprint(cell.line, table.name, f"point {point.name}", message, tuple(suspects))


def _median_without(ordered: Sequence[float], value: float) -> float:
    """Return the median of numbers in their order without one of them."""
    rank, rest = bisect_left(ordered, value), len(ordered) - 1
    middle = (ordered[n + (n >= rank)] for n in ((rest - 1) // 2, rest // 2))
    return sum(middle) / 2.0


def _all_off(point: SubmergedPoint, axis: str, limit: float) -> bool:
    """Tell whether both other columns are as far away: the first column may then be the wrong one."""
    straight = point.xyz["none", axis].value
    cells = [point.xyz[column, axis].value for column in COLUMNS[1:] if (column, axis) in point.xyz]
    return all(abs(value - straight) > limit for value in cells)
