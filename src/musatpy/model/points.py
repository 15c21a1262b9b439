"""Ground points: every point that a plate measurement or a control card names."""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.arrays import BoolArray, TextArray
from musatpy.model.arrays import freeze


@dataclass(frozen=True, kw_only=True, eq=False)
class Points:
    """p points, in the order of their first appearance in the deck (plate cards before control cards)."""

    ids: TextArray  # (p,)
    bathymetric: BoolArray  # (p,) the point is submerged

    def __post_init__(self) -> None:
        freeze(self, "ids", str, -1)
        freeze(self, "bathymetric", bool, len(self.ids))
