"""Parameters of lenses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.kinds.kind import OfImages
from musatpy.adjustment.kinds.parameter import ParameterUnknown
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.parameters import Parameters
from musatpy.arrays import FloatArray, IntArray
from musatpy.model import Block, ObservationKind

if TYPE_CHECKING:
    from musatpy.adjustment.sightings import RayImages


class LensParameter(ParameterUnknown, OfImages):
    """Those of all cameras that are unknown, camera by camera in the order of `LENS_PARAMETERS`."""

    observed = ObservationKind.LENS

    def parameters(self, block: Block) -> Parameters | None:
        """Return the parameters of CAL cards. Raises `DeckError` where cards of a camera contradict each other."""
        if not block.lens_unknowns.count:
            return None
        from musatpy.adjustment.lenses import CameraLenses  # most jobs hold their cameras

        return CameraLenses.of(block)

    def of_images(self, network: Network, group: PointGroup, images: RayImages) -> tuple[IntArray, FloatArray]:
        """Return columns (k, X) and partials (k, m, 2, X): those of other cameras than that of a photo are 0."""
        index, (k, m) = self.everywhere(network, len(group.point)), group.rays.shape
        if network.lenses is None or images.by_lens is None:
            return index, np.zeros((k, m, 2, index.shape[1]))
        camera, parameter = np.nonzero(network.lenses.unknown)
        seen_by = network.lenses.camera[network.photo[group.rays]]
        of_photo = seen_by[..., None, None] == camera
        return index, np.where(of_photo, images.by_lens[..., parameter], 0.0)


KINDS = (LensParameter(),)
