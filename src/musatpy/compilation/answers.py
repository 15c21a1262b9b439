"""Compiled points, and coordinates of files, in the system that the run states its answer in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.compiled import Compiled
from musatpy.model import CoordinateSystem
from musatpy.systems import own_statement, statement_of
from musatpy.systems.blocks import coordinates_of, level_of, rates_at, reached
from musatpy.units import DEGREE

_ANGULAR, _PLANE = (10, 10, 4), (4, 4, 4)  # decimals


@dataclass(frozen=True, kw_only=True, eq=False)
class StatedPoints:
    """k points as the run states its answer: position and apparent (k, 3), covariance (k, 3, 3) of the coordinates.

    Places that the system does not reach are NaN.
    """

    position: FloatArray
    covariance: FloatArray
    apparent: FloatArray


def stated_points(compiled: Compiled) -> StatedPoints | None:
    """Return the points as the answer of the run is stated, None where that is in the system of the job."""
    spec, block = compiled.run.stated, compiled.run.block
    if spec is None:
        return None
    statement = statement_of(spec, block)
    of_job, system = own_statement(block).system, statement.system
    place, apparent = (
        reached(statement, level_of(of_job, places)) for places in (compiled.points.position, compiled.apparent)
    )
    rates, unknown = rates_at(system, place), np.asarray(np.isnan(place).any(axis=1))
    covariance = rates @ compiled.points.covariance @ np.swapaxes(rates, 1, 2)
    return StatedPoints(
        position=coordinates_of(system, place),
        covariance=np.where(unknown[:, None, None], np.nan, covariance),
        apparent=coordinates_of(system, apparent),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class FilePlaces:
    """The names of three coordinates, whether two are angles, and what they are of positions (k, 3) of the job."""

    names: tuple[str, str, str]
    angular: bool
    of: Callable[[FloatArray], FloatArray]

    @property
    def heading(self) -> str:
        """The names, with commas between."""
        return ",".join(self.names)

    def texts(self, position: FloatArray) -> list[str]:
        """Return positions (k, 3) as texts with commas between; empty ones where the system does not reach."""
        unit, decimals = ([DEGREE, DEGREE, 1.0], _ANGULAR) if self.angular else (np.ones(3), _PLANE)
        rows = (self.of(position) / unit).tolist()
        return [
            ",".join("" if np.isnan(v) else f"{v:.{d}f}" for v, d in zip(row, decimals, strict=True))
            for row in rows
        ]


def places_of(compiled: Compiled) -> FilePlaces:
    """Return the coordinates of the files of a compilation: degrees, or the unit of the system; heights in m."""
    spec, block = compiled.run.stated, compiled.run.block
    if spec is None:
        angular = block.options.system is CoordinateSystem.GEOGRAPHIC
        names = ("latitude", "longitude", "height") if angular else ("X", "Y", "Z")
        return FilePlaces(names=names, angular=angular, of=np.asarray)
    statement, of_job = statement_of(spec, block), own_statement(block).system

    def of(position: FloatArray) -> FloatArray:
        return coordinates_of(statement.system, reached(statement, level_of(of_job, position)))

    return FilePlaces(names=statement.system.names, angular=spec.kind == CoordinateSystem.GEOGRAPHIC, of=of)
