"""What is known of the ground and of the flight: control points, equal elevations, air bases."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model.arrays import freeze


class ControlKind(IntEnum):
    """Which components of a control point are known to the adjustment."""

    FULL = 0
    HORIZONTAL = 1
    VERTICAL = 2
    CHECK = 3  # none: compared with the result only


@dataclass(frozen=True, kw_only=True, eq=False)
class Control:
    """k control points.

    Positions stand in the coordinate system of the job (see `Photos`), NaN in components that the card leaves
    blank; sigmas are along east, north, up (X, Y, Z in local jobs), metres. A `fixed` point holds its known
    components without error, whatever its sigmas.
    """

    point: IntArray  # (k,) link to Points
    kind: IntArray  # (k,) ControlKind
    fixed: BoolArray  # (k,)
    position: FloatArray  # (k, 3) in the job's system
    sigma: FloatArray  # (k, 3) m, east north up, NaN where not given

    def __post_init__(self) -> None:
        freeze(self, "point", int, -1)
        k = len(self.point)
        freeze(self, "kind", int, k)
        freeze(self, "fixed", bool, k)
        freeze(self, "position", float, k, 3)
        freeze(self, "sigma", float, k, 3)

    @property
    def known(self) -> BoolArray:
        """(k, 3) True where the east, north, up component enters the adjustment."""
        horizontal = (self.kind == ControlKind.FULL) | (self.kind == ControlKind.HORIZONTAL)
        vertical = (self.kind == ControlKind.FULL) | (self.kind == ControlKind.VERTICAL)
        return np.stack([horizontal, horizontal, vertical], axis=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class EqualElevations:
    """g groups of points that share one unknown level (a shore line, a lake), and their members."""

    ids: TextArray  # (g,)
    sigma: FloatArray  # (g,) m, of each point about the level
    group: IntArray  # (e,) link to ids
    point: IntArray  # (e,) link to Points

    def __post_init__(self) -> None:
        freeze(self, "ids", str, -1)
        freeze(self, "sigma", float, len(self.ids))
        freeze(self, "group", int, -1)
        freeze(self, "point", int, len(self.group))


@dataclass(frozen=True, kw_only=True, eq=False)
class AirBases:
    """b known distances between two exposure stations."""

    photo: IntArray  # (b, 2) links to Photos
    length: FloatArray  # (b,) m
    sigma: FloatArray  # (b,) m

    def __post_init__(self) -> None:
        freeze(self, "photo", int, -1, 2)
        freeze(self, "length", float, len(self.photo))
        freeze(self, "sigma", float, len(self.photo))


@dataclass(frozen=True, kw_only=True, eq=False)
class Distances:
    """d measured distances between two ground points, along the straight line (IIIA)."""

    point: IntArray  # (d, 2) links to Points
    length: FloatArray  # (d,) m
    sigma: FloatArray  # (d,) m

    def __post_init__(self) -> None:
        freeze(self, "point", int, -1, 2)
        freeze(self, "length", float, len(self.point))
        freeze(self, "sigma", float, len(self.point))


@dataclass(frozen=True, kw_only=True, eq=False)
class HeightDifferences:
    """d measured height differences between two ground points, the second minus the first (IIIA)."""

    point: IntArray  # (d, 2) links to Points
    difference: FloatArray  # (d,) m
    sigma: FloatArray  # (d,) m

    def __post_init__(self) -> None:
        freeze(self, "point", int, -1, 2)
        freeze(self, "difference", float, len(self.point))
        freeze(self, "sigma", float, len(self.point))


def no_distances() -> Distances:
    """Return no distances at all."""
    return Distances(point=np.zeros((0, 2), dtype=int), length=np.zeros(0), sigma=np.zeros(0))


def no_height_differences() -> HeightDifferences:
    """Return no height differences at all."""
    return HeightDifferences(point=np.zeros((0, 2), dtype=int), difference=np.zeros(0), sigma=np.zeros(0))
