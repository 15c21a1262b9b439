"""Parameters of lenses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from musatpy.adjustment.kinds.parameter import CameraParameter
from musatpy.adjustment.parameters import Parameters
from musatpy.arrays import FloatArray
from musatpy.model import LENS_PARAMETERS, Block, ObservationKind

if TYPE_CHECKING:
    from musatpy.adjustment.sightings import RayImages


class LensParameter(CameraParameter):
    """Those of all cameras that are unknown, camera by camera in the order of `LENS_PARAMETERS`."""

    observed = ObservationKind.LENS

    def parameters(self, block: Block) -> Parameters | None:
        """Return the parameters of CAL cards. Raises `DeckError` where cards of a camera contradict each other."""
        if not block.lens_unknowns.of(LENS_PARAMETERS).count:
            return None
        from musatpy.adjustment.lenses import CameraLenses  # most jobs hold their cameras

        return CameraLenses.of(block)

    def by_all(self, images: RayImages) -> FloatArray | None:
        """Return the partials (k, m, 2, 10) of images."""
        return images.by_lens


KINDS = (LensParameter(),)
