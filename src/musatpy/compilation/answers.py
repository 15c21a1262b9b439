"""Compiled points in the system that the run states its answer in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.systems import Statement, own_statement, statement_of
from musatpy.systems.blocks import coordinates_of, level_of, rates_at
from musatpy.systems.solutions import reached

if TYPE_CHECKING:
    from musatpy.compilation.compiled import Compiled


@dataclass(frozen=True, kw_only=True, eq=False)
class StatedPoints:
    """k points in the words of a statement: position and apparent (k, 3), covariance (k, 3, 3) of the coordinates.

    Places that the system does not reach are NaN.
    """

    statement: Statement
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
        reached(statement, level_of(of_job, places))
        for places in (compiled.gathered("position"), compiled.apparent)
    )
    rates, unknown = rates_at(system, place), np.asarray(np.isnan(place).any(axis=1))
    covariance = rates @ compiled.gathered("covariance") @ np.swapaxes(rates, 1, 2)
    return StatedPoints(
        statement=statement,
        position=coordinates_of(system, place),
        covariance=np.where(unknown[:, None, None], np.nan, covariance),
        apparent=coordinates_of(system, apparent),
    )
