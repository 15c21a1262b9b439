"""What loops over points of a network do, and what they do by numpy: nothing, all points are left to arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from musatpy.adjustment.collinear import Follow
from musatpy.adjustment.dependence import Diagonal
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import Cofactors, NormalEquations
from musatpy.adjustment.reliability import Part
from musatpy.adjustment.unknowns import State
from musatpy.arrays import BoolArray, FloatArray

Groups = tuple[PointGroup, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Loops:
    """Loops over points of a network, which do what they can and return the points that are left: all, by numpy."""

    network: Network
    groups: Groups

    def get_ready(self, state: State, say: Callable[[], None]) -> None:
        """Compile what no run before has compiled, and say so first."""

    def eliminate(self, state: State, normals: NormalEquations, follows: list[Follow]) -> tuple[Groups, float]:
        """Add points to the normal equations, and to `follows` how they do; return those left, and the gain.

        That is r' N_pp^-1 r of all: by how much the sum of squares falls when these go to their best.
        """
        return self.groups, 0.0

    def settle(self, state: State, ground: FloatArray, squares: FloatArray) -> Groups:
        """Take points to their best for the stations: set `ground` (p, 3) and their weighted `squares` (p,)."""
        return self.groups

    def set_squares(self, state: State, squares: FloatArray) -> Groups:
        """Set the weighted squares (p,) of points where they are, infinite behind a camera."""
        return self.groups

    def set_residuals(self, state: State, residual: FloatArray) -> Groups:
        """Set the residuals (all measurements, 2) mm of the images of points."""
        return self.groups

    def spread(
        self, state: State, cofactors: Cofactors, residual: FloatArray, points: FloatArray, diagonal: Diagonal
    ) -> tuple[Groups, list[Part]]:
        """Set the cofactors of `points` (p, 3, 3) along east, north, up, and return those of their images.

        Adds to the diagonal; `residual` (all measurements, 2) mm.
        """
        return self.groups, []

    def meet(self, state: State, limit: float, ground: FloatArray, parallel: BoolArray) -> Groups:
        """Set `ground` (p, 3) where straight rays of points come nearest, NaN where that is nowhere.

        And which points (p,) have all their rays within an angle of the limit, rad.
        """
        return self.groups
