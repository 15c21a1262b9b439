"""What a listing says: numbers with their rounding, analyses, plate tables, coordinates; repairs."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from musatpy.errors import Problem


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
class Listing:
    """All that was found in a listing, the repairs that it took, and the rows that cannot be read."""

    name: str
    analyses: tuple[Analysis, ...]
    plates: tuple[PlateTable, ...]
    submerged: tuple[SubmergedTable, ...]
    repairs: tuple[Repair, ...]
    unreadable: tuple[Problem, ...]

    @property
    def rows(self) -> set[int]:
        """Lines of the rows of the standard reports."""
        numbers = {line for analysis in self.analyses for line in analysis.lines.values()}
        numbers |= {cell.line for table in self.plates for row in table.rms.values() for cell in row.values()}
        points = (point for table in self.submerged for point in table.points)
        return numbers | {cell.line for point in points for cell in point.xyz.values()}


def run_name(refracted: bool | None) -> str:
    """Return `, no refraction`, `, refraction` or nothing."""
    return {None: "", False: ", no refraction", True: ", refraction"}[refracted]
