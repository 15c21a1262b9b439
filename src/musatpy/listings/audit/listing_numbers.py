"""A listing -> all that can be compared with another run: statistics, stations, points, residuals, depths."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from musatpy.listings.audit.columns import number
from musatpy.listings.audit.headings import AUDITED, MATRIX_AXES, OWN_SIGMAS, PLACES, TURNS, Audited
from musatpy.listings.audit.job_options import FREEDOM, SIGMA0
from musatpy.listings.audit.quantities import LOCAL_VERTICAL, NATIVE, SAME, Key, Quantity
from musatpy.listings.audit.structures import Analysis, Listing, PlateTable, Printed, SubmergedTable, Table
from musatpy.units import ARC_SECOND, DEGREE, GON

Quantities = Iterator[tuple[Key, Quantity]]
# Arc seconds in what the lower line of a heading calls the unit of angles.
_ANGLES = {
    "deg": DEGREE / ARC_SECOND,
    "degrees": DEGREE / ARC_SECOND,
    "gon": GON / ARC_SECOND,
    "rad": 1.0 / ARC_SECOND,
    "arc sec": 1.0,
}
_SEXAGESIMAL = "D  M"


_NUMBERS = {FREEDOM: "degrees of freedom", SIGMA0: "sigma0"}


def numbers_of(listing: Listing) -> tuple[dict[Key, Quantity], set[Key]]:
    """Return all that can be compared of a listing, and what stands there more than once with different numbers.

    The latter, of two runs with refraction, say, is not compared.
    """
    quantities: dict[Key, Quantity] = {}
    several: set[Key] = set()
    for run in listing.runs:
        for key, quantity in _numbers(run):
            if quantities.setdefault(key, quantity).text != quantity.text:
                several.add(key)
    return {key: quantity for key, quantity in quantities.items() if key not in several}, several


def _numbers(listing: Listing) -> Quantities:
    """Yield all that can be compared of a run."""
    for analysis in listing.analyses:
        yield from _analysis(analysis)
    for table in listing.plates:
        yield from _plates(table)
    for submerged in listing.submerged:
        yield from _submerged(submerged)
    output = OutputSystem.of(listing)
    for audited in AUDITED:
        printed = listing.table(audited.title)
        if printed is not None and audited.report:
            yield from _ruled(printed, audited, output)
    for label, name in _NUMBERS.items():
        cell = number(listing.options.get(label, ""), 0)
        if cell is not None:
            yield Key("solution", None, "all", name), Quantity(cell.value, "", cell.text, _half(cell))


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


@dataclass(frozen=True)
class OutputSystem:
    """The system in which a listing has coordinates and attitudes."""

    places: str
    turns: str

    @classmethod
    def of(cls, listing: Listing) -> OutputSystem:
        """Return those of its options: of the SYS card, or of the adjustment."""
        system = listing.options.get("Coordinate system", "")[:4]
        return cls(
            listing.options.get("Answer, coordinates", NATIVE.get(system, "")),
            listing.options.get("Answer, attitudes", LOCAL_VERTICAL),
        )

    def name_of(self, heading: str) -> tuple[str, str]:
        """Return the name of a column, and the words it is in."""
        bare = heading.removeprefix("Sigma ")
        turn = bare in TURNS or bare in MATRIX_AXES
        if turn:
            words = named_turns(self.turns, self.places)
            heading = heading if heading != bare or words != LOCAL_VERTICAL else SAME.get(bare, bare)
            return heading, words
        if heading in PLACES:
            return SAME.get(heading, heading), self.places
        of_adjustment = bare in OWN_SIGMAS or not heading.startswith("Sigma ")
        return heading, "" if of_adjustment else self.places


def named_turns(turns: str, places: str) -> str:
    """Return the words of attitudes; those along the axes of a system are of this system."""
    return turns.replace("the axes of the system", f"the axes of {places}")


def _ruled(table: Table, audited: Audited, output: OutputSystem) -> Quantities:
    """Yield the numbers of the columns of a table that can be compared, in arc seconds where they are angles."""
    units = dict(zip(table.headings, table.units, strict=True))
    for line, cells in table.rows():
        item = " ".join(cells[name] for name in audited.key if cells.get(name))
        for heading in (name for name in audited.compared if name in units):
            cell = number(cells[heading], line)
            if cell is None or not item:
                continue
            name, system = output.name_of(heading) if audited.stated else (heading, "")
            unit = units[heading]
            factor = 1.0 if unit.startswith(_SEXAGESIMAL) else _ANGLES.get(unit)
            unit, factor = (unit, 1.0) if factor is None else ("arcsec", factor)
            key = Key(audited.report, None, item, name, system)
            yield key, Quantity(cell.value * factor, unit, cell.text, _half(cell) * factor)


def _half(cell: Printed) -> float:
    """Return the rounding of a number, none of a count."""
    return cell.half if "." in cell.text else 0.0
