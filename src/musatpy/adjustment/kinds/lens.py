"""Parameters of lenses, and what is known of them beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.iteration import State, WaterKnowledge
from musatpy.adjustment.kinds.kind import OfImages, Rows, in_digits, of_unknowns
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model import LENS_PARAMETERS, Block, ObservationKind, Program
from musatpy.units import MICROMETRE

if TYPE_CHECKING:
    from musatpy.adjustment.sightings import RayImages

_LIMIT = 1e-5  # mm of an image in the corner of the plate


class LensParameter(OfImages):
    """Those of all cameras that are unknown, camera by camera in the order of `LENS_PARAMETERS`."""

    observed = ObservationKind.LENS
    searched = False  # no card of one photo or point is to blame
    change = "the {} still moves images by {} um"

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return their names; IIA holds cameras."""
        if block.options.program is not Program.IIIA:
            return ()
        return self.names_of(block)

    def names_of(self, block: Block) -> tuple[str, ...]:
        """Return the names of what cards say of lenses."""
        table = block.lens_unknowns
        column = np.array([LENS_PARAMETERS.index(name) for name in table.parameter.tolist()])
        order = np.lexsort((column, table.camera))
        return tuple(f"{table.parameter[row]} of camera {block.cameras.ids[table.camera[row]]}" for row in order)

    def rows(self, network: Network, state: State) -> Rows:
        """Return the parameters as observed."""
        unknown, index = _unknown(network), self.numbers(network)
        row = np.arange(len(index))
        return of_unknowns((state.lenses - _given(network))[unknown], self.weight(network), index, row, 0 * row)

    def weights(self, network: Network, block: Block) -> FloatArray:
        """Return the weights (X, 1)."""
        return self.weight(network)[:, None]

    def weight(self, network: Network) -> FloatArray:
        """Return the weights (X,) of what is known of them beforehand, 0 of what is free."""
        return np.zeros(0) if network.lenses is None else network.lenses.weight[network.lenses.unknown]

    def weighted(self, network: Network, block: Block, factor: FloatArray) -> Network:
        """Return the network with the weights times `factor` (X, 1)."""
        if network.lenses is None:
            return network
        weight = network.lenses.weight.copy()
        weight[network.lenses.unknown] *= factor[:, 0]
        return replace(network, lenses=replace(network.lenses, weight=weight))

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that a parameter is off by `size`."""
        return f"the {network.border.columns[self.observed][row]} is {size:.3g} off what is given"

    def state_after(self, network: Network, step: FloatArray, state: State) -> State:
        """Return the state with the parameters after a step (u,)."""
        lenses = state.lenses.copy()
        lenses[_unknown(network)] += self.part_of(network, step)
        return replace(state, lenses=lenses)

    def of_images(self, network: Network, group: PointGroup, images: RayImages) -> tuple[IntArray, FloatArray]:
        """Return columns (k, X) and partials (k, m, 2, X): those of other cameras than that of a photo are 0."""
        index, (k, m) = self.everywhere(network, len(group.point)), group.rays.shape
        if network.lenses is None or images.by_lens is None:
            return index, np.zeros((k, m, 2, index.shape[1]))
        camera, parameter = np.nonzero(network.lenses.unknown)
        seen_by = network.lenses.camera[network.photo[group.rays]]
        of_photo = seen_by[..., None, None] == camera
        return index, np.where(of_photo, images.by_lens[..., parameter], 0.0)

    def movement(self, network: Network, step: FloatArray) -> tuple[float, str]:
        """Return the largest change in mm, of the image farthest from the principal point."""
        if network.lenses is None:
            return 0.0, ""
        size = np.abs(self.part_of(network, step)) * network.lenses.effect[network.lenses.unknown]
        row = int(size.argmax())
        name = network.border.columns[self.observed][row]
        return float(size[row]), self.change.format(name, in_digits(size[row] / MICROMETRE, 2))

    def limit(self, rotation: float, translation: float) -> float:
        """Return the limit of a change."""
        return _LIMIT


def _unknown(network: Network) -> BoolArray:
    return np.zeros((0, len(LENS_PARAMETERS)), dtype=bool) if network.lenses is None else network.lenses.unknown


def _given(network: Network) -> FloatArray:
    return np.zeros((0, len(LENS_PARAMETERS))) if network.lenses is None else network.lenses.given


KINDS = (LensParameter(),)
