"""First positions of points by compiled kernels: where their straight rays meet, or reach a level."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np

from musatpy.adjustment.compiled_points import CompiledRows
from musatpy.adjustment.kernels import compiled_points
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.unknowns import State
from musatpy.arrays import BoolArray, FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledStart(CompiledRows):
    """The eliminated points of at least two rays, and the `others`."""

    intersection: ModuleType
    others: tuple[PointGroup, ...]

    @classmethod
    def of(cls, network: Network) -> CompiledStart | None:
        """Return the points of a network, None where numpy does all."""
        kernels = compiled_points(network.photos)
        if kernels is None:
            return None
        from musatpy.adjustment.kernels import rays  # numba is there

        chosen = [not group.kept and group.rays.shape[1] > 1 for group in network.groups]
        return cls(
            kernels=kernels,
            intersection=rays,
            network=network,
            groups=tuple(group for group, mine in zip(network.groups, chosen, strict=True) if mine),
            others=tuple(group for group, mine in zip(network.groups, chosen, strict=True) if not mine),
        )

    def nearest(self, state: State, limit: float, ground: FloatArray) -> BoolArray:
        """Set the points of `ground` (p, 3) where their rays come nearest, NaN where that is nowhere.

        Returns (p,) whether all rays of a point are within an angle of the limit, rad.
        """
        sequence, direction = self.sequence, self.directions(state)
        at, stations, _ = self.seen(state)
        of_row, parallel = np.zeros(len(sequence.point), dtype=bool), np.zeros(self.network.points, dtype=bool)
        self.of_parts(
            lambda part: self.intersection.nearest(part.rows, at, stations, limit, direction, ground, of_row)
        )
        parallel[sequence.point] = of_row
        return parallel

    def directions(self, state: State) -> FloatArray:
        """Return the unit directions (r, 3) of the rays of the sequence; of points that are not these, anything."""
        (at, stations, _), out = self.seen(state), np.zeros((len(self.sequence.rays), 3))
        self.of_parts(lambda part: self.intersection.directions(part.rows, at, stations, out))
        return out

    def reach(self, state: State, height: float, flattest: float) -> tuple[FloatArray, FloatArray]:
        """Return where the rays (r, 3) of the sequence reach a height above their stations, and their directions.

        Those that fall by less than `flattest` are bent down. The level is flat: it is that of the stations.
        """
        (at, stations, _), u = self.seen(state), self.directions(state)
        up, of_stations = self.network.frame.vertical(state.position)
        up, above, X = np.ascontiguousarray(up), of_stations - height, np.zeros_like(u)
        self.of_parts(lambda part: self.intersection.reach(part.rows, at, stations, up, above, flattest, u, X))
        return X, u

    def set_middles(self, state: State, X: FloatArray, ground: FloatArray) -> None:
        """Set the points of `ground` (p, 3) to the means of places (r, 3) on their rays."""
        at, _, _ = self.seen(state)
        self.of_parts(lambda part: self.intersection.middles(part.rows, at, X, ground))
