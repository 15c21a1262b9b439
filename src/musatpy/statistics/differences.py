"""Differences of positions and what is said of a sample of them (ETL-0306, Tables 6-1 to 6-9).

The definitions are those that the tables of the report follow (docs/reports.md): mean = sum/N, signed; RMS =
sqrt(sum d^2/N); standard deviation from the mean = sqrt(sum (d - mean)^2/(N - 1)); maximum difference = the signed
difference of the largest magnitude.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import FloatArray, TextArray
from musatpy.model import Block, CoordinateSystem
from musatpy.model.tables import largest


@dataclass(frozen=True, kw_only=True, eq=False)
class DifferenceStatistics:
    """One sample of differences in numbers, in the unit of the sample; NaN where the sample is too small."""

    size: int
    sum: float
    mean: float
    rms: float
    deviation: float  # standard deviation from the mean, N - 1 in the denominator
    maximum: float  # signed
    maximum_id: str  # whose difference the maximum is; empty for an empty sample


@dataclass(frozen=True, kw_only=True, eq=False)
class Analysis:
    """The differences of three components, and the statistics of each.

    Rows are those of `ids`; a component that is not part of its sample is NaN.
    """

    components: tuple[str, str, str]
    units: tuple[str, str, str]  # "rad" or "m"
    ids: TextArray  # (n,)
    differences: FloatArray  # (n, 3)
    statistics: tuple[DifferenceStatistics, DifferenceStatistics, DifferenceStatistics]


def difference_statistics(differences: ArrayLike, ids: ArrayLike) -> DifferenceStatistics:
    """Return the statistics of `differences` (n,), whose rows are named `ids` (n,); NaN rows are left out."""
    sample, names = np.asarray(differences, dtype=float), np.asarray(ids, dtype=str)
    kept = ~np.isnan(sample)
    d, names = sample[kept], names[kept]
    N = len(d)
    if N == 0:
        nan = math.nan
        return DifferenceStatistics(size=0, sum=0.0, mean=nan, rms=nan, deviation=nan, maximum=nan, maximum_id="")
    total = math.fsum(d)
    mean = total / N
    worst = largest(np.abs(d))
    return DifferenceStatistics(
        size=N,
        sum=total,
        mean=mean,
        rms=math.sqrt(math.fsum(d**2) / N),
        deviation=math.sqrt(math.fsum((d - mean) ** 2) / (N - 1)) if N > 1 else math.nan,
        maximum=float(d[worst]),
        maximum_id=str(names[worst]),
    )


def analysis_of(components: dict[str, str], ids: TextArray, differences: FloatArray) -> Analysis:
    """Return the analysis of differences (n, 3) of three components, given by name and unit."""
    first, second, third = components
    x, y, z = (difference_statistics(column, ids) for column in differences.T)
    return Analysis(
        components=(first, second, third),
        units=(components[first], components[second], components[third]),
        ids=ids,
        differences=differences,
        statistics=(x, y, z),
    )


def position_components(block: Block) -> dict[str, str]:
    """Return component -> unit of positions in the job's system."""
    if block.options.system is CoordinateSystem.GEOGRAPHIC:
        return {"Latitude": "rad", "Longitude": "rad", "Elevation": "m"}
    return {"X": "m", "Y": "m", "Z": "m"}


def axes_of(system: str) -> tuple[str, str, str]:
    """Return the components of differences and sigmas in metres along the vertical and across it."""
    return ("X", "Y", "Z") if system == CoordinateSystem.LOCAL else ("East", "North", "Up")


def metric_components(block: Block) -> dict[str, str]:
    """Return component -> unit of these."""
    return dict.fromkeys(axes_of(block.options.system), "m")
