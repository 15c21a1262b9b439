"""A standard report: its cells, numbers within what their print allows, and misprints among them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple


class PrintedNumber(NamedTuple):
    """A cell as printed: its number, half a unit of its last digit, its text; an id has no number."""

    value: float  # NaN of ids
    half: float
    text: str  # empty where the number comes from a record
    line: int = 0  # 1-based
    unit: str = ""  # "arcsec", "m", "mm", nothing of counts and ids

    @property
    def low(self) -> float:
        """Smallest number that rounds to the printed one."""
        return self.value - self.half

    @property
    def high(self) -> float:
        """Largest number that rounds to the printed one."""
        return self.value + self.half


@dataclass(frozen=True, kw_only=True)
class StandardReport:
    """The cells of a standard report."""

    name: str  # "ground point analysis", "plate residuals", "bathymetric points"
    refracted: bool | None  # None where the title does not say
    line: int  # of the title
    cells: dict[tuple[str, str], PrintedNumber]  # (component, frame or point; what of it) -> cell

    @property
    def title(self) -> str:
        """How messages call it."""
        return self.name + run_name(self.refracted)

    @property
    def items(self) -> list[str]:
        """The components, frames or points, in their order."""
        return list(dict.fromkeys(item for item, _ in self.cells))


def pages_joined(pages: Iterable[StandardReport | None]) -> list[StandardReport]:
    """Return reports, None for what is between: tables that go over pages have no number on two of them."""
    tables: list[StandardReport] = []
    last: StandardReport | None = None
    for page in pages:
        goes_on = page and last and page.title == last.title and not page.name.endswith("analysis")
        if page and last and goes_on and page.cells.keys().isdisjoint(last.cells):
            tables[-1] = page = replace(last, cells=last.cells | page.cells)
        elif page:
            tables.append(page)
        last = page
    return tables


def run_name(refracted: bool | None) -> str:
    """Return `, no refraction`, `, refraction` or nothing."""
    return {None: "", False: ", no refraction", True: ", refraction"}[refracted]


def printed(text: str, line: int, unit: str = "") -> PrintedNumber:
    """Return the number of a cell: seconds of `-0 8 46.908`, or the number itself, with half its last digit."""
    parts = text.split()
    value, decimals = float(parts[-1]), len(parts[-1].partition(".")[2])
    if len(parts) == 3:
        value = abs(int(parts[0])) * 3600.0 + int(parts[1]) * 60.0 + value
        value = -value if parts[0].startswith("-") else value
    return PrintedNumber(value, 0.5 * 10.0**-decimals, text, line, unit)


def printed_id(text: str, line: int = 0) -> PrintedNumber:
    """Return an id as a cell."""
    return PrintedNumber(math.nan, 0.0, text, line)


def text_like(value: float, like: str) -> str:
    """Return a number in the form of a cell: degrees, minutes, seconds, or with its decimals."""
    places = len(like.partition(".")[2])
    fields = []
    if len(like.split()) == 3:
        ticks = round(abs(value) * 10**places)
        minutes, rest = divmod(ticks, 60 * 10**places)
        degrees, minutes = divmod(minutes, 60)
        fields = [f"{'-' if value < 0.0 and ticks else ''}{degrees}", str(minutes)]
        value = rest / 10**places
    number = f"{value:.{places}f}"
    if not number.strip("-.0"):
        number = number.removeprefix("-")
    return " ".join([*fields, number.replace("0.", ".", 1) if number.lstrip("-").startswith("0.") else number])


def range_like(low: float, high: float, like: str) -> str:
    """Return a range in the form of a cell: one number where both ends print the same."""
    first, last = text_like(low, like), text_like(high, like)
    return first if first == last else f"{first} to {last}"


@dataclass(frozen=True)
class Suspect:
    """A cell that, were it another number, would leave no contradiction."""

    item: str
    line: int
    found: str
    expected: str = ""  # a number, `A to B`, or empty where the others do not tell


@dataclass(frozen=True)
class Misprint:
    """One contradiction in a listing, and the cells one of which must be wrong."""

    line: int
    table: str
    item: str
    message: str
    suspects: tuple[Suspect, ...] = ()

    def lines(self, listing: str) -> list[str]:
        """Return the finding in print, a line for each suspect below it."""
        text = [f"{listing}:{self.line}: {self.table}: {self.item}: {self.message}"]
        for number, suspect in enumerate(self.suspects):
            expected = f", expected {suspect.expected}" if suspect.expected else ""
            lead = "    either" if number == 0 and len(self.suspects) > 1 else "    or    " if number else "   "
            text.append(f"{lead} {suspect.item} {suspect.found}{expected} (line {suspect.line})")
        return text
