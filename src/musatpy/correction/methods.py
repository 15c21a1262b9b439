"""What corrects points, and what is said of a corrected one: its columns, for tables, clouds, rasters and layers.

A point that cannot be corrected keeps its apparent place, has no true place, and has a reason, in any format.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
import pyproj

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import Problem, ProblemsError, SeaError, SystemsError
from musatpy.geometry.crs import system_of
from musatpy.geometry.systems import System
from musatpy.pointfiles.columns import AXES
from musatpy.pointfiles.point_tables import quoted
from musatpy.refraction.apparent import REASONS, Fault
from musatpy.soundings.s44 import order_names

TRUE = tuple(f"true_{axis}" for axis in AXES)
APPARENT = tuple(f"apparent_{axis}" for axis in AXES)


@dataclass(frozen=True)
class ResultColumn:
    """What a column means, in the 32 characters of a cloud, its unit, its type in a cloud, decimals in a table."""

    meaning: str
    unit: str = "m"
    kind: str = "f4"
    decimals: int = 4
    in_table: bool = True
    in_layers: bool = True  # of GIS, and in rasters


REASON = ResultColumn("0 corrected, else why not", "", "u1")
S44 = ResultColumn("1 Exclusive to 4 Order 2, 5 none", "", "u1")
SIGMAS = dict.fromkeys(("sigma_east", "sigma_north", "sigma_height"), ResultColumn("of the true place, m"))


@dataclass(frozen=True, kw_only=True, eq=False)
class CorrectedPoints:
    """What comes of n points: true places (n, 3), NaN where lost, why (n,), values (n,) by columns, NaN where lost.

    seen (n, k): which cameras see them; lacking: how many have no sigmas of their own; taken: how many as what.
    """

    true: FloatArray
    fault: IntArray
    values: Mapping[str, FloatArray | IntArray]
    seen: BoolArray | None = None
    lacking: int = 0
    taken: Counter[str] = field(default_factory=Counter)

    @property
    def good(self) -> BoolArray:
        """(n,) which points are corrected."""
        return np.isin(self.fault, (Fault.NONE, Fault.UNDECIDED))

    def kept(self, apparent: FloatArray) -> FloatArray:
        """Return the true places (n, 3), of lost points the apparent ones."""
        return np.where(self.good[:, None], self.true, apparent)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tally:
    """What came of points: how many by their reasons, '' of corrected ones, and how many a camera sees.

    sums: of the values of corrected points by column, (3,) their sum, that of squares, and the largest.
    """

    counts: Counter[str] = field(default_factory=Counter)
    seen: int = 0
    lacking: int = 0
    taken: Counter[str] = field(default_factory=Counter)
    sums: Mapping[str, FloatArray] = field(default_factory=dict)

    @classmethod
    def of(cls, points: CorrectedPoints, reasons: Mapping[int, str]) -> Tally:
        """Return the tally of some points."""
        numbers, counts = np.unique(points.fault, return_counts=True)
        good = {name: values[points.good] for name, values in points.values.items()}
        return cls(
            counts=Counter(
                {reasons[number]: n for number, n in zip(numbers.tolist(), counts.tolist(), strict=True)}
            ),
            seen=0 if points.seen is None else int(np.count_nonzero(points.seen.any(axis=1))),
            lacking=points.lacking,
            taken=points.taken,
            sums={name: np.array([v.sum(), np.square(v).sum(), v.max()]) for name, v in good.items() if len(v)},
        )

    def __add__(self, other: Tally) -> Tally:
        sums = dict(self.sums)
        for name, (total, squares, largest) in other.sums.items():
            before = sums.get(name, np.array([0.0, 0.0, -np.inf]))
            sums[name] = np.array([before[0] + total, before[1] + squares, max(before[2], largest)])
        return Tally(
            counts=self.counts + other.counts,
            seen=self.seen + other.seen,
            lacking=self.lacking + other.lacking,
            taken=self.taken + other.taken,
            sums=sums,
        )

    @property
    def corrected(self) -> int:
        """How many points have a true place."""
        return self.counts[""] + self.counts[REASONS[Fault.UNDECIDED]]

    def mean(self, name: str) -> float:
        """Return the mean of a column."""
        return float(self.sums[name][0]) / self.corrected

    def rms(self, name: str) -> float:
        """Return the root mean square of a column, 0 where no point is corrected."""
        return float(self.sums[name][1] / self.corrected) ** 0.5 if name in self.sums else 0.0

    def largest(self, name: str) -> float:
        """Return the largest of a column, -inf where no point is corrected."""
        return float(self.sums[name][2]) if name in self.sums else -np.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class Method:
    """What corrects points of a system."""

    system: System
    error: ClassVar[type[ProblemsError]] = SeaError
    blank: ClassVar[bool] = False  # whether a coordinate may be missing in a table
    of_records: ClassVar[bool] = True  # whether a file .json is the record of a run, and no GeoJSON
    inputs: ClassVar[tuple[str, ...]] = ()  # columns of sigmas that a table may have

    @property
    def columns(self) -> Mapping[str, ResultColumn]:
        """What is said of a point beside its places, in the order of a cloud."""
        raise NotImplementedError

    @property
    def in_table(self) -> list[str]:
        """The columns of a table."""
        return [name for name, column in self.columns.items() if column.in_table]

    @property
    def in_layers(self) -> dict[str, str]:
        """The columns of layers of GIS, and bands of a raster, with their units."""
        return {name: column.unit for name, column in self.columns.items() if column.in_layers}

    @property
    def reasons(self) -> Mapping[int, str]:
        """Why points are not corrected."""
        return REASONS

    def corrected(self, points: FloatArray, covariance: FloatArray, classes: IntArray) -> CorrectedPoints:
        """Return what comes of finite points (n, 3) with covariances (n, 3, 3) m2, NaN where there are none.

        `classes` (n,) are those of LAS, 0 where there are none.
        """
        raise NotImplementedError

    def __call__(
        self,
        source: str,
        points: FloatArray,
        covariance: FloatArray | None = None,
        classes: IntArray | None = None,
    ) -> CorrectedPoints | Problem:
        """Return what comes of points (n, 3) of a file, or the problem of a file with points out of reach."""
        n, known = len(points), np.isfinite(points).all(axis=1)
        covariance = np.full((n, 3, 3), np.nan) if covariance is None else covariance
        classes = np.zeros(n, dtype=np.int64) if classes is None else classes
        try:
            some = self.corrected(points[known], covariance[known], classes[known])
        except SystemsError as error:  # errors do not leave a process
            return Problem(file=source, message=f"{error}: are the points in this system?")
        true, fault = np.full((n, 3), np.nan), np.full(n, Fault.NOT_FINITE, dtype=np.int64)
        true[known], fault[known] = some.true, some.fault
        values: dict[str, FloatArray | IntArray] = {name: np.full(n, np.nan) for name in some.values}
        for name, column in some.values.items():
            values[name][known] = column
        return replace(some, true=true, fault=fault, values=values | {"reason": fault})

    def without_sigmas(self, source: str, points: FloatArray) -> CorrectedPoints | Problem:
        """Return what comes of points (n, 3), of sigmas nothing."""
        return self(source, points)

    def placed_in(self, source: Path, stated: pyproj.CRS | None, crs: str | None, geoid: str | None) -> Self:
        """Return the method for the points of a file, which may state their system; `crs` is the one that is named.

        Raises `SystemsError` and `DepthError` for a system that cannot be used.
        """
        ellipsoid = self.system.ellipsoid
        if crs or stated is None or ellipsoid is None:
            return self
        return replace(self, system=system_of(stated.to_wkt(), ellipsoid))

    def in_words(self, name: str, points: CorrectedPoints) -> Sequence[str]:
        """Return the texts (n,) of a column in a table."""
        if name == "reason":
            return [quoted(self.reasons[number]) for number in points.fault.tolist()]
        if name == "s44":
            orders = ["", *order_names()]
            return [orders[int(number)] for number in np.nan_to_num(points.values[name]).tolist()]
        form, values = f"%.{self.columns[name].decimals}f", points.values[name].tolist()
        return ["" if value != value else form % value for value in values]

    def texts(self, points: CorrectedPoints) -> Iterator[tuple[str, ...]]:
        """Yield what a table gets of each point."""
        forms = (f"%.{places}f" for places in self.system.decimals)
        places = (
            ["" if value != value else form % value for value in column.tolist()]
            for form, column in zip(forms, points.true.T, strict=True)
        )
        return zip(*places, *(self.in_words(name, points) for name in self.in_table), strict=True)

    def require_use(self, source: Path, tally: Tally, apparent: FloatArray) -> None:
        """Raise the error of the method where nothing can come of the points of a file, of which some are given."""

    def lines(self, tally: Tally) -> list[str]:
        """Return what has come of points in words."""
        every = dict.fromkeys((*self.reasons.values(), *tally.counts))
        lost = [
            f"{tally.counts[reason]} {'' if reason == REASONS[Fault.UNDECIDED] else 'not corrected: '}{reason}"
            for reason in every
            if reason and tally.counts[reason]
        ]
        return [f"{tally.counts.total()} points, {tally.corrected} corrected", *lost]
