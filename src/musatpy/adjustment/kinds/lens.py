"""Parameters of cameras: of lenses, and of flat ports before them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.kinds.kind import OfImages
from musatpy.adjustment.kinds.parameter import ParameterUnknown
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.parameters import Parameters
from musatpy.arrays import FloatArray, IntArray
from musatpy.model import LENS_PARAMETERS, Block, ObservationKind

if TYPE_CHECKING:
    from musatpy.adjustment.ports import CameraPorts
    from musatpy.adjustment.sightings import RayImages


class LensParameter(ParameterUnknown, OfImages):
    """Those of all cameras that are unknown, camera by camera in the order of `LENS_PARAMETERS`."""

    observed = ObservationKind.LENS

    def parameters(self, block: Block) -> Parameters | None:
        """Return the parameters of CAL cards. Raises `DeckError` where cards of a camera contradict each other."""
        if not block.lens_unknowns.of(LENS_PARAMETERS).count:
            return None
        from musatpy.adjustment.lenses import CameraLenses  # most jobs hold their cameras

        return CameraLenses.of(block)

    def of_images(self, network: Network, group: PointGroup, images: RayImages) -> tuple[IntArray, FloatArray]:
        """Return columns (k, x) and partials (k, m, 2, x)."""
        assert images.by_lens is not None, "images go through the lenses"
        return self.everywhere(network, len(group.point)), images.by_lens


class PortParameter(ParameterUnknown, OfImages):
    """Those of all ports that are unknown, camera by camera in the order of `PORT_PARAMETERS`."""

    observed = ObservationKind.PORT

    def parameters(self, block: Block) -> Parameters | None:
        """Return the ports of PRT cards, known ones too: images depend on these all the same."""
        if not block.ports.count:
            return None
        from musatpy.adjustment.ports import CameraPorts  # most cameras are in air

        return CameraPorts.of(block)

    def of_images(self, network: Network, group: PointGroup, images: RayImages) -> tuple[IntArray, FloatArray]:
        """Return columns (k, X) and partials (k, m, 2, X): those of other cameras than that of a photo are 0."""
        known: CameraPorts = self.known(network)
        camera, parameter = np.nonzero(known.unknown)
        assert images.by_port is not None, "images go through the ports"
        of_photo = known.camera[network.photo[group.rays]][..., None, None] == camera
        partials = np.where(of_photo, images.by_port[..., parameter], 0.0)
        return self.everywhere(network, len(group.point)), partials


KINDS = (LensParameter(), PortParameter())
