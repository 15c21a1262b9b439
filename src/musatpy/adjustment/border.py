"""The few unknowns that belong to no single photo: their order in the border of the normal equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from musatpy.arrays import IntArray
from musatpy.model import ObservationKind


@dataclass(frozen=True, kw_only=True, eq=False)
class Border:
    """The global unknowns: those of each kind, in the order of `kinds.UNKNOWNS`, then the kept points."""

    columns: Mapping[ObservationKind, tuple[str, ...]]  # the names of the unknowns of each kind
    kept: IntArray  # (c,) points that are not eliminated, three columns each: east, north, up

    @property
    def size(self) -> int:
        """Number of global unknowns g."""
        return self.first_kept + 3 * len(self.kept)

    @property
    def first_kept(self) -> int:
        """Column of the first coordinate of the first kept point."""
        return sum(len(names) for names in self.columns.values())

    def count(self, kind: ObservationKind) -> int:
        """Return the number of unknowns of a kind."""
        return len(self.columns[kind])

    def at(self, kind: ObservationKind) -> slice:
        """Return the columns of the unknowns of a kind."""
        first = sum(len(names) for each, names in self.columns.items() if each < kind)
        return slice(first, first + self.count(kind))

    def numbers(self, kind: ObservationKind) -> IntArray:
        """Return the same as numbers."""
        return np.arange(self.first_kept)[self.at(kind)]

    def having(self, kind: ObservationKind, names: tuple[str, ...]) -> Self:
        """Return the border with other unknowns of a kind."""
        return replace(self, columns={**self.columns, kind: names})

    def kept_columns(self, point: IntArray) -> IntArray:
        """Return the columns (..., 3) of kept points (...)."""
        return self.first_kept + 3 * np.searchsorted(self.kept, point)[..., None] + np.arange(3)

    def names(self, point_ids: list[str]) -> list[str]:
        """Return a name for every global unknown."""
        return [
            *(name for names in self.columns.values() for name in names),
            *(f"point {point_ids[point]} {axis}" for point in self.kept for axis in ("east", "north", "up")),
        ]
