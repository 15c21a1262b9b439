"""Submerged points whose height is given: control soundings and check points, beside the adjusted depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.model import ControlKind, Solution
from musatpy.statistics.analyses import elevations

NOT_GIVEN = -1


@dataclass(frozen=True, kw_only=True, eq=False)
class Soundings:
    """What is given of s submerged points, in the rows of `BathymetricPoints`."""

    kind: IntArray  # (s,) ControlKind, or `NOT_GIVEN` where no height is
    residual: FloatArray  # (s,) m, adjusted minus given depth, NaN where no height is given


def soundings(solution: Solution) -> Soundings:
    """Return the given heights of submerged points beside the adjusted ones."""
    control, p = solution.block.control, len(solution.block.points.ids)
    given, kind = np.full(p, np.nan), np.full(p, NOT_GIVEN)
    rows = control.kind != ControlKind.HORIZONTAL
    given[control.point[rows]] = elevations(solution.block, control.position[rows])
    kind[control.point[rows]] = control.kind[rows]
    point = solution.bathymetric.point
    height = given[point]
    return Soundings(
        kind=np.where(np.isnan(height), NOT_GIVEN, kind[point]),
        residual=height - elevations(solution.block, solution.points.position[point]),
    )
