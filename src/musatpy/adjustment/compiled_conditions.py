"""Pass points of IIA that compiled kernels work at: those with dry rays alone."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from musatpy.adjustment.compiled_points import Images, beside_one_another, measured, stations_of
from musatpy.adjustment.ground import MAX_STEPS, RIDGE, ROUNDING, STEP_LIMIT
from musatpy.adjustment.kernels import compiled_points
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import NormalEquations
from musatpy.adjustment.sightings import image_coordinates
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray


class CompiledPassPoints:
    """The pass points of a network with straight rays, and the `others`: control, and points with a wet ray."""

    @classmethod
    def of(cls, network: Network) -> CompiledPassPoints | None:
        """Return the points of a network, None where numpy does all."""
        kernels = compiled_points(network.photos)
        return None if kernels is None else cls(kernels, network)

    def __init__(self, kernels: ModuleType, network: Network) -> None:
        from musatpy.adjustment.kernels import conditions  # numba is there

        self._kernels, self._conditions, self._network = kernels, conditions, network
        wet = [np.asarray(network.refracted[group.rays].any(axis=1)) for group in network.pass_groups]
        parts = list(zip(network.pass_groups, wet, strict=True))
        dry = [group.part(~of_group) for group, of_group in parts if not of_group.all()]
        self._images = [Images.of(network, beside_one_another(network, group)) for group in dry]
        self.wet: tuple[PointGroup, ...] = tuple(
            group.part(of_group) for group, of_group in parts if of_group.any()
        )

    def add_conditions(self, state: State, normals: NormalEquations) -> None:
        """Add the conditions of the points with full weights, linearised at their adjusted images."""
        network, (blocks, rhs) = self._network, normals.sums
        stations = stations_of(self._kernels, network, state)
        for images in self._images:
            ground = state.ground[images.group.point]
            targets = np.repeat(ground[:, None], images.photo.shape[1], axis=1)
            adjusted = image_coordinates(network, state, images.group.rays, targets)
            at = measured(self._kernels, images, ground)._replace(xy=adjusted)
            sums = self._kernels.Sums(slot=images.slot, blocks=blocks, rhs=rhs)
            self._conditions.add_conditions(at, images.xy, stations, sums)

    def settle(self, state: State, ground: FloatArray, squares: FloatArray) -> float:
        """Take the points to their optimum: set `ground` (p, 3) and their `squares` (p,).

        Returns by how much the squares of all were still to fall by the last step.
        """
        kernels, unsettled = self._kernels, 0.0
        stations = stations_of(kernels, self._network, state)
        water, known = kernels.dry_water(), kernels.nothing_known()
        for images in self._images:
            point = images.group.point
            at = measured(kernels, images, ground[point])
            of_points, left = np.empty((2, len(point)))
            self._conditions.settle(
                at, stations, water, known, RIDGE, MAX_STEPS, STEP_LIMIT, ROUNDING, of_points, left
            )
            ground[point], squares[point] = at.ground, of_points
            unsettled += float(left.sum())
        return unsettled
