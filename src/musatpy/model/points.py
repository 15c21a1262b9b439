"""Ground points: every point that a plate measurement or a control card names."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, TextArray
from musatpy.model.tables import Table, per_row


@dataclass(frozen=True, kw_only=True, eq=False)
class Points(Table):
    """p points, in the order of their first appearance in the deck (plate cards before control cards)."""

    ids: TextArray = per_row(identity=True)  # (p,)
    bathymetric: BoolArray = per_row(codes={"": False, "B": True}, noun="submerged flag", blank=False)  # (p,)
    # (p,) for certain, though the point may lie below the water: behind a dike, in a polder or a sump
    dry: BoolArray = per_row(codes={"": False, "D": True}, noun="flag of certainly dry points", blank=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.bathymetric & self.dry).any():
            raise ValueError("points that are submerged and dry")

    @property
    def letters(self) -> TextArray:
        """(p,) the flags as cards have them: B submerged, D dry for certain, blank neither."""
        return np.where(self.bathymetric, "B", np.where(self.dry, "D", ""))
