"""What a listing says: numbers with their rounding, analyses, plate tables, coordinates, other tables; repairs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from musatpy.errors import Problem

if TYPE_CHECKING:
    from musatpy.listings.audit.columns import Cells  # whose numbers are printed ones


class RepairKind(StrEnum):
    """The repairs of scanned text that are allowed; nothing else is changed, and each one made is reported."""

    STRAY = "stray character"  # punctuation or mark-up that belongs to no number
    BORDER = "border of the table"  # a 1, l, |, [ or ] at the edge of a row, left of the ruling
    BULLET = "point read as bullet"  # `•281` is .281
    HYPHEN = "point read as hyphen"  # `903378-8` is 903378.8
    ONE = "1 read as letter"  # l, I, |, !
    ZERO = "0 read as letter"  # O, o
    SPLIT = "split number"  # `84 6` is 846
    JOINED = "fields run together"  # `00.454` is 0 0 .454
    POINT = "lost point"  # `66` where the column has two decimals is .66
    LABEL = "axis by its place"  # the X, Y or Z of a row is not legible


@dataclass(frozen=True)
class Repair:
    """One repair: what stood in the text, and what was read."""

    line: int  # 1-based
    kind: RepairKind
    found: str
    read: str


class Printed(NamedTuple):
    """A number as printed: its value, half a unit of its last digit, its text."""

    value: float  # arc seconds, or the unit of the table
    half: float
    text: str
    line: int  # 1-based

    @property
    def low(self) -> float:
        """Smallest number that rounds to the printed one."""
        return self.value - self.half

    @property
    def high(self) -> float:
        """Largest number that rounds to the printed one."""
        return self.value + self.half


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
    line: int  # of the title
    components: tuple[Component, ...]
    lines: dict[str, int]  # statistic -> line

    @property
    def name(self) -> str:
        """How messages call it."""
        return f"{self.kind} analysis{run_name(self.refracted)}"


@dataclass(frozen=True, kw_only=True)
class PlateTable:
    """RMS plate residuals per frame, mm (ETL-0306, Tables 6-4 and 6-8)."""

    refracted: bool | None
    line: int
    frames: tuple[str, ...]
    rms: dict[tuple[str, str], dict[str, Printed]]  # (trig, nontrig or all; x or y) -> frame -> mm
    stars: dict[str, tuple[tuple[str, int], ...]]  # trig, nontrig, all -> starred frames, with their lines

    @property
    def name(self) -> str:
        """How messages call it."""
        return f"plate residuals{run_name(self.refracted)}"


@dataclass(frozen=True, kw_only=True)
class SubmergedPoint:
    """One point of Table 6-9: `*` not triangulated, `**` vertical control."""

    name: str
    mark: str
    xyz: dict[tuple[str, str], Printed]  # (none, predicted or refraction; X, Y or Z) -> m


@dataclass(frozen=True, kw_only=True)
class SubmergedTable:
    """Computed coordinates of submerged points, m (ETL-0306, Table 6-9)."""

    line: int
    points: tuple[SubmergedPoint, ...]
    name: str = "bathymetric points"


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table whose columns are shown by a rule of dashes: stations, points, residuals, and whatever else."""

    title: str
    line: int
    headings: tuple[str, ...]
    units: tuple[str, ...]  # their lower lines
    lines: Sequence[int]  # of the rows
    columns: dict[str, Cells]  # by heading, of all rows
    illegible_cells: dict[int, frozenset[str]]  # line -> headings, where there are any

    @property
    def name(self) -> str:
        """How messages call it."""
        return self.title.partition(": Adjusted Minus")[0].lower()

    def rows(self) -> Iterator[tuple[int, dict[str, str]]]:
        """Yield the line and the cells of each row by heading: of large tables, `columns` are at hand sooner."""
        for line, row in zip(self.lines, zip(*self.columns.values(), strict=True), strict=True):
            yield line, dict(zip(self.columns, row, strict=True))

    @cached_property
    def illegible(self) -> frozenset[str]:
        """Headings of columns that have cells which are not legible."""
        return frozenset(heading for headings in self.illegible_cells.values() for heading in headings)


@dataclass(frozen=True, kw_only=True)
class Listing:
    """All that was found in a listing, the repairs that it took, and the rows that cannot be read."""

    name: str
    options: dict[str, str]  # "Initial values" -> "GIVEN  station and attitude cards"
    analyses: tuple[Analysis, ...]
    plates: tuple[PlateTable, ...]
    submerged: tuple[SubmergedTable, ...]
    tables: tuple[Table, ...]
    undetermined: tuple[str, ...]  # points said to have no position
    repairs: tuple[Repair, ...]
    unreadable: tuple[Problem, ...]
    cut: bool = False  # tables that a brief listing has cut to their worst rows are left out
    parts: tuple[Listing, ...] = ()  # its runs, where it has several; repairs and problems are of the whole alone

    @property
    def runs(self) -> tuple[Listing, ...]:
        """What belongs together: its runs, or itself."""
        return self.parts or (self,)

    @property
    def rows(self) -> set[int]:
        """Lines of the rows of the standard reports."""
        numbers = {line for analysis in self.analyses for line in analysis.lines.values()}
        numbers |= {cell.line for table in self.plates for row in table.rms.values() for cell in row.values()}
        points = (point for table in self.submerged for point in table.points)
        return numbers | {cell.line for point in points for cell in point.xyz.values()}

    @property
    def stated(self) -> bool:
        """True where tables of coordinates are in another system or other angles than the analyses."""
        return any(name.startswith(("Input, ", "Answer, ")) for name in self.options)

    def table(self, title: str) -> Table | None:
        """Return the ruled table whose title starts with `title`."""
        return next((table for table in self.tables if table.title.startswith(title)), None)

    def tables_titled(self, *titles: str) -> list[Table]:
        """Return the ruled tables of several titles, as far as the listing has them."""
        return [table for title in titles if (table := self.table(title))]


def run_name(refracted: bool | None) -> str:
    """Return `, no refraction`, `, refraction` or nothing."""
    return {None: "", False: ", no refraction", True: ", refraction"}[refracted]
