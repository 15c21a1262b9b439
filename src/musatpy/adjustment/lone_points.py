"""Points each for itself, at stations as they are: where they come to rest, and what they say of their stations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from musatpy.adjustment.collinear import eliminate, local_normals
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.point_normals import hold, settle_group
from musatpy.adjustment.unknowns import State
from musatpy.arrays import BoolArray, FloatArray, IntArray


class LocalNormals(NamedTuple):
    """The reduced normals of t points, each for itself: u unknowns, those of its stations and X global ones."""

    matrix: FloatArray  # (t, u, u)
    rhs: FloatArray  # (t, u)
    rise: FloatArray  # (t, u) of the height of the point, which follows
    columns: IntArray  # (t, X) of the border


@dataclass(frozen=True, kw_only=True, eq=False)
class LonePoints:
    """Points of a group, each for itself, at stations as they are.

    Of `row` (t,), in which one can be more than once, those rays go through the water that are `wet` (t, m), and
    points are held on water lines `level` (t,), where there are any that are not NaN.
    """

    network: Network
    state: State
    group: PointGroup

    def settled(
        self, row: IntArray, wet: BoolArray, start: FloatArray, level: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return where the points come to rest (t, 3), from where they start, and their weighted squares (t,)."""
        network, group = self._apart(row, wet, level, self.group.known or level is not None)
        start = start if level is None else hold(network, group.point, start)
        return settle_group(network, self.state, group, start)

    def normals(self, row: IntArray, wet: BoolArray, X: FloatArray, level: FloatArray) -> LocalNormals:
        """Return their normals where they are."""
        network, group = self._apart(row, wet, level, known=True)
        E = eliminate(network, self.state, group, X)
        matrix, rhs = local_normals(network, group, E)
        up = np.einsum("kij,kj->ki", E.normals.axes, network.frame.axes(X)[:, 2])
        return LocalNormals(matrix, rhs, -np.einsum("ki,kiu->ku", up, E.F), E.extras.index)

    def _apart(
        self, row: IntArray, wet: BoolArray, level: FloatArray | None, known: bool
    ) -> tuple[Network, PointGroup]:
        group = replace(self.group.part(row), known=known)
        xy = self.network.xy[group.rays.reshape(-1)]
        network, (group,) = self.network.apart([group], xy, wet.reshape(-1))
        return network if level is None else network.with_heights_held(level), group
