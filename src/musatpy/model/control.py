"""What is known of the ground and of the flight: control points, equal elevations, air bases."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model.tables import Table, per_row


class ControlKind(IntEnum):
    """Which components of a control point are known to the adjustment."""

    FULL = 0
    HORIZONTAL = 1
    VERTICAL = 2
    CHECK = 3  # none: compared with the result only


_LETTERS = {
    "": ControlKind.CHECK,
    "F": ControlKind.FULL,
    "H": ControlKind.HORIZONTAL,
    "V": ControlKind.VERTICAL,
    "C": ControlKind.CHECK,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Control(Table):
    """k control points.

    Positions stand in the coordinate system of the job (see `Photos`), NaN in components that the card leaves
    blank; sigmas are along east, north, up (X, Y, Z in local jobs), metres. A `fixed` point holds its known
    components without error, whatever its sigmas.
    """

    point: IntArray = per_row(link="points", key=True)  # (k,) link to Points
    kind: IntArray = per_row(sort=True, codes=_LETTERS)  # (k,) ControlKind
    fixed: BoolArray = per_row(codes={"": False, "X": True}, noun="fixed flag", blank=False)  # (k,)
    position: FloatArray = per_row(3, sort=True)  # (k, 3) in the job's system
    sigma: FloatArray = per_row(  # (k, 3) east north up, or NaN
        3, noun="standard deviations", unit="m", blank=np.nan
    )

    @property
    def known(self) -> BoolArray:
        """(k, 3) True where the east, north, up component enters the adjustment."""
        horizontal = (self.kind == ControlKind.FULL) | (self.kind == ControlKind.HORIZONTAL)
        vertical = (self.kind == ControlKind.FULL) | (self.kind == ControlKind.VERTICAL)
        return np.stack([horizontal, horizontal, vertical], axis=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class EqualElevations(Table):
    """g groups of points that share one unknown level (a shore line, a lake), and their members."""

    ids: TextArray = per_row(identity=True)  # (g,)
    sigma: FloatArray = per_row(unit="m")  # (g,) of each point about the level
    group: IntArray = per_row(link="equal_elevations", rows="members")  # (e,) link to ids
    point: IntArray = per_row(link="points", rows="members")  # (e,) link to Points

    def with_members(self, stays: BoolArray) -> EqualElevations:
        """Return the groups with some of their members (e,), without the groups that have none left."""
        group, point = self.group[stays], self.point[stays]
        used = np.isin(np.arange(len(self.ids)), group)
        number = np.cumsum(used) - 1
        return EqualElevations(ids=self.ids[used], sigma=self.sigma[used], group=number[group], point=point)


@dataclass(frozen=True, kw_only=True, eq=False)
class AirBases(Table):
    """b known distances between two exposure stations."""

    photo: IntArray = per_row(2, link="photos")  # (b, 2) links to Photos
    length: FloatArray = per_row(unit="m")  # (b,)
    sigma: FloatArray = per_row(unit="m")  # (b,)


@dataclass(frozen=True, kw_only=True, eq=False)
class Distances(Table):
    """d measured distances between two ground points, along the straight line (IIIA)."""

    point: IntArray = per_row(2, link="points")  # (d, 2) links to Points
    length: FloatArray = per_row(unit="m")  # (d,)
    sigma: FloatArray = per_row(unit="m")  # (d,)


@dataclass(frozen=True, kw_only=True, eq=False)
class HeightDifferences(Table):
    """d measured height differences between two ground points, the second minus the first (IIIA)."""

    point: IntArray = per_row(2, link="points")  # (d, 2) links to Points
    difference: FloatArray = per_row(unit="m")  # (d,)
    sigma: FloatArray = per_row(unit="m")  # (d,)
