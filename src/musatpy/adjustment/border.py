"""The few unknowns that belong to no single photo: their order in the border of the normal equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Border:
    """Counts of the global unknowns, in their order: levels, water levels, tilts, index, waves, kept points."""

    levels: int = 0  # of equal elevation groups
    waters: int = 0  # corrections that the tides of groups of photos have in common
    tilts: int = 0  # 0, or 2: slopes of the water surface towards east and north
    indices: int = 0  # 0 or 1: refractive index
    waves: tuple[str, ...] = ()  # names of the unknown parameters of waves
    kept: IntArray  # (c,) points that are not eliminated, three columns each: east, north, up

    @property
    def size(self) -> int:
        """Number of global unknowns g."""
        return self.first_kept + 3 * len(self.kept)

    @property
    def first_water(self) -> int:
        """Column of the first water level correction."""
        return self.levels

    @property
    def first_tilt(self) -> int:
        """Column of the tilt towards east; that towards north follows."""
        return self.levels + self.waters

    @property
    def index_column(self) -> int:
        """Column of the refractive index."""
        return self.first_tilt + self.tilts

    @property
    def first_wave(self) -> int:
        """Column of the first parameter of a wave."""
        return self.index_column + self.indices

    @property
    def first_kept(self) -> int:
        """Column of the first coordinate of the first kept point."""
        return self.first_wave + len(self.waves)

    def kept_columns(self, number: IntArray) -> IntArray:
        """Return the columns (..., 3) of kept points by their numbers (...) in `kept`."""
        return self.first_kept + 3 * number[..., None] + np.arange(3)

    def names(self, group_ids: list[str], water_ids: list[str], point_ids: list[str]) -> list[str]:
        """Return a name for every global unknown."""
        return [
            *(f"level of group {name}" for name in group_ids[: self.levels]),
            *(f"water level{f' of {name}' if name else ''}" for name in water_ids[: self.waters]),
            *("tilt of the water east", "tilt of the water north")[: self.tilts],
            *("refractive index",)[: self.indices],
            *self.waves,
            *(f"point {point_ids[point]} {axis}" for point in self.kept for axis in ("east", "north", "up")),
        ]
