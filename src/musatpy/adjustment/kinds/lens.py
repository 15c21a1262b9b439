"""Parameters of lenses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from musatpy.adjustment.kinds.kind import OfImages
from musatpy.adjustment.kinds.parameter import ParameterUnknown
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.parameters import Parameters
from musatpy.arrays import FloatArray, IntArray
from musatpy.model import LENS_PARAMETERS, Block, ObservationKind

if TYPE_CHECKING:
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


KINDS = (LensParameter(),)
