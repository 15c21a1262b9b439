"""The coordinates of files for people: those of the answer of the run, or of the job."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.compiled import Compiled
from musatpy.model import CoordinateSystem
from musatpy.units import DEGREE

_ANGULAR, _PLANE = (10, 10, 4), (4, 4, 4)  # decimals


@dataclass(frozen=True, kw_only=True, eq=False)
class FilePlaces:
    """The names of three coordinates, their decimals, and what they are of positions (k, 3) of the job."""

    names: tuple[str, str, str]
    decimals: tuple[int, int, int]
    of: Callable[[FloatArray], FloatArray]

    @property
    def heading(self) -> str:
        """The names, with commas between."""
        return ",".join(self.names)

    def texts(self, position: FloatArray) -> list[str]:
        """Return positions (k, 3) as texts with commas between; empty ones where the system does not reach."""
        rows = self.of(position).tolist()
        return [
            ",".join("" if np.isnan(v) else f"{v:.{d}f}" for v, d in zip(row, self.decimals, strict=True))
            for row in rows
        ]


def places_of(compiled: Compiled) -> FilePlaces:
    """Return the coordinates of the files of a compilation: degrees, or the unit of the system; heights in m."""
    job = compiled.run.block.options.system
    if compiled.run.stated is None:
        angular = job is CoordinateSystem.GEOGRAPHIC
        return FilePlaces(
            names=("latitude", "longitude", "height") if angular else ("X", "Y", "Z"),
            decimals=_ANGULAR if angular else _PLANE,
            of=_in_degrees if angular else np.asarray,
        )
    from musatpy.systems import own_statement, statement_of
    from musatpy.systems.blocks import coordinates_of, level_of
    from musatpy.systems.solutions import reached

    spec, block = compiled.run.stated, compiled.run.block
    statement, of_job = statement_of(spec, block), own_statement(block).system
    angular = spec.kind == CoordinateSystem.GEOGRAPHIC

    def of(position: FloatArray) -> FloatArray:
        there = coordinates_of(statement.system, reached(statement, level_of(of_job, position)))
        return _in_degrees(there) if angular else there

    return FilePlaces(names=statement.system.names, decimals=_ANGULAR if angular else _PLANE, of=of)


def _in_degrees(position: FloatArray) -> FloatArray:
    return position / np.array([DEGREE, DEGREE, 1.0])
