"""A listing -> all that can be compared with another run: statistics, plate residuals, submerged points."""

from __future__ import annotations

from collections.abc import Iterator

from musatpy.listings.audit.quantities import Key, Quantity
from musatpy.listings.audit.structures import Analysis, Listing, PlateTable, SubmergedTable

Quantities = Iterator[tuple[Key, Quantity]]


def numbers_of(listing: Listing) -> tuple[dict[Key, Quantity], set[Key]]:
    """Return all that can be compared of a listing, and what stands there more than once with different numbers.

    The latter, of two runs with refraction, say, is not compared.
    """
    quantities: dict[Key, Quantity] = {}
    several: set[Key] = set()
    for key, quantity in _numbers(listing):
        if quantities.setdefault(key, quantity).text != quantity.text:
            several.add(key)
    return {key: quantity for key, quantity in quantities.items() if key not in several}, several


def _numbers(listing: Listing) -> Quantities:
    """Yield all that can be compared."""
    for analysis in listing.analyses:
        yield from _analysis(analysis)
    for table in listing.plates:
        yield from _plates(table)
    for submerged in listing.submerged:
        yield from _submerged(submerged)


def _analysis(analysis: Analysis) -> Quantities:
    for component in analysis.components:
        place = f"{analysis.kind} analysis", analysis.refracted, component.name
        if component.size is not None:
            yield Key(*place, "size"), Quantity(component.size, "", str(component.size))
        for statistic, cell in component.statistics.items():
            yield Key(*place, statistic), Quantity.printed(cell, component.unit)
        if component.maximum_id:
            yield Key(*place, "maximum at"), Quantity(None, "", component.maximum_id)


def _plates(table: PlateTable) -> Quantities:
    report = "plate residuals", table.refracted
    for (group, axis), row in table.rms.items():
        for frame, cell in row.items():
            yield Key(*report, frame, f"{group}, {axis}"), Quantity.printed(cell, "mm")
    for group, stars in table.stars.items():
        if len(stars) == 1:
            yield Key(*report, group, "largest at"), Quantity(None, "", stars[0][0])


def _submerged(table: SubmergedTable) -> Quantities:
    for point in table.points:
        for (column, axis), cell in point.xyz.items():
            yield Key(table.name, None, point.name, f"{axis}, {column}"), Quantity.printed(cell, "m")
