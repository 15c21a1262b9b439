"""Control points: their known components."""

from __future__ import annotations

from musatpy.adjustment.kinds.prior import Prior
from musatpy.adjustment.kinds.stations import COMPONENTS
from musatpy.adjustment.network import Network
from musatpy.model import Block, ObservationKind


class Control(Prior):
    """East, north, up of a control point."""

    observed = ObservationKind.CONTROL
    part, weight = slice(0, 3), "weight"

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that a component is off by `size` m."""
        point = block.points.ids[self.points(block)[row]]
        return f"control point {point} is {size:.2f} m off in {COMPONENTS[component]}"


KINDS = (Control(),)
