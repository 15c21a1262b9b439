"""Parameters of flat ports."""

from __future__ import annotations

from typing import TYPE_CHECKING

from musatpy.adjustment.kinds.parameter import CameraParameter
from musatpy.adjustment.parameters import Parameters
from musatpy.arrays import FloatArray
from musatpy.model import Block, ObservationKind

if TYPE_CHECKING:
    from musatpy.adjustment.sightings import RayImages


class PortParameter(CameraParameter):
    """Those of all ports that are unknown, camera by camera in the order of `PORT_PARAMETERS`."""

    observed = ObservationKind.PORT

    def parameters(self, block: Block) -> Parameters | None:
        """Return the ports of PRT cards, known ones too: images depend on these all the same."""
        if not block.ports.count:
            return None
        from musatpy.adjustment.ports import CameraPorts  # most cameras are in air

        return CameraPorts.of(block)

    def by_all(self, images: RayImages) -> FloatArray | None:
        """Return the partials (k, m, 2, 6) of images."""
        return images.by_port


KINDS = (PortParameter(),)
