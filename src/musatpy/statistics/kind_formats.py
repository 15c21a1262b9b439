"""How observations of each kind are printed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from musatpy.arrays import IntArray
from musatpy.model import ObservationKind

if TYPE_CHECKING:
    from musatpy.statistics.analyses import Statistics

ENU = ObservationKind.CONTROL.components
ANGLES = ObservationKind.STATION_ATTITUDE.components


@dataclass(frozen=True, eq=False)
class Kind:
    """How observations of one kind are printed: label, component names, unit, and what they belong to."""

    kind: ObservationKind
    name: str
    components: tuple[str, ...]
    unit: str
    factor: float

    def owner(self, s: Statistics, row: int) -> str:
        """Return the ids of the photos and points of an observation, its tide, or its wave."""
        if self.kind.attribute:
            photos, points = self.kind.links(s.block, row)
            ids = photos + points
            return ids[0] if len(ids) == 1 else " ".join(f"{name:<8}" for name in ids)
        water = s.solution.water
        if water and self.kind is ObservationKind.WATER_LEVEL:
            return str(water.correction_ids[row])
        return str(water.waves.ids[row]) if water and water.waves and self.kind is ObservationKind.WAVE else ""

    def owners(self, s: Statistics, rows: IntArray) -> list[list[str]]:
        """Return these of observations (r,), id by id."""
        if self.kind.attribute:
            return self.kind.ids_of(s.block, rows)
        return [self.owner(s, row).split() for row in rows.tolist()]


KINDS = {kind: Kind(kind, kind.label, kind.components, kind.unit, kind.factor) for kind in ObservationKind}
