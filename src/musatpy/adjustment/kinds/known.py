"""What was observed of single stations and ground points: coordinates, attitudes, levels that points share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from musatpy.adjustment.kinds.kind import Kind, Rows, Unknown
from musatpy.adjustment.network import BACK, ORDER, Network
from musatpy.adjustment.point_normals import prior_rows
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water_surface import WaterKnowledge
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import FloatArray, IntArray, finite_rows
from musatpy.geometry.rotations import wrapped
from musatpy.geometry.similarity import Similarity
from musatpy.model import Block, ObservationKind
from musatpy.units import DEGREE

_COMPONENTS = ("east", "north", "up")
_ANGLES = ("X-tilt", "Y-tilt", "heading")


class StationKind(Kind):
    """Three observed unknowns of each photo."""

    first: int  # of the unknowns of a photo
    attribute: str  # weights of the network

    def deviation(self, network: Network, state: State) -> FloatArray:
        """Return adjusted minus given (n, 3)."""
        raise NotImplementedError

    def takes_part(self, network: Network) -> bool:
        """Return whether any station is observed."""
        return bool(getattr(network, self.attribute).any())

    def rows(self, network: Network, state: State) -> Rows:
        """Return the observations of all photos."""
        photo, component = np.divmod(np.arange(3 * network.photos), 3)
        start, position = photo * network.pattern.size, np.tile(np.arange(3), (len(photo), 1))
        turned = np.isin(photo, np.flatnonzero(network.turned))
        position[turned] = BACK
        stated = np.where(turned & (self.first == 0), np.take(ORDER, component), component)
        return Rows.of_unknowns(
            self.deviation(network, state).reshape(-1),
            getattr(network, self.attribute).reshape(-1),
            start + self.first + component,
            row=photo,
            component=stated,
            position=start[:, None] + position,
        )

    def weights(self, network: Network, block: Block) -> FloatArray:
        """Return the weights (n, 3)."""
        weight: FloatArray = getattr(network, self.attribute)
        return weight

    def weighted(self, network: Network, block: Block, factor: FloatArray) -> Network:
        """Return the network with the weights times `factor` (n, 3)."""
        return replace(network, **{self.attribute: getattr(network, self.attribute) * factor})


class StationPosition(StationKind):
    """East, north, up along the axes at the given station."""

    observed = ObservationKind.STATION_POSITION
    first, attribute = 0, "position_weight"

    def deviation(self, network: Network, state: State) -> FloatArray:
        """Return adjusted minus given (n, 3) m."""
        return np.einsum("nij,nj->ni", network.axes, state.position - network.position)

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that a component is off by `size` m."""
        return (
            f"the observed station of photo {block.photos.ids[row]} is {size:.2f} m off in {_COMPONENTS[component]}"
        )


class StationAttitude(StationKind):
    """X-tilt, Y-tilt, heading."""

    observed = ObservationKind.STATION_ATTITUDE
    first, attribute = 3, "attitude_weight"

    def deviation(self, network: Network, state: State) -> FloatArray:
        """Return adjusted minus given (n, 3) rad, within half a turn."""
        return wrapped(state.attitude - network.attitude)

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that an angle is off by `size` rad."""
        off = f"{size / DEGREE:.2f} degrees off in {_ANGLES[component]}"
        return f"the observed attitude of photo {block.photos.ids[row]} is {off}"


class Prior(Kind):
    """A kind whose table links to points."""

    direct = False
    part: slice  # of the four rows of `ground.Priors`
    weight: str  # attribute of `GroundPriors`

    def points(self, block: Block) -> IntArray:
        """Return the points (k,) of the table."""
        point: IntArray = getattr(block, self.observed.attribute).point
        return point

    def residuals(self, network: Network, block: Block, state: State) -> FloatArray:
        """Return adjusted minus known (k, components) in m, 0 for points that take no part."""
        point = self.points(block)
        deviation = np.zeros((len(point), 4))
        known = finite_rows(state.ground[point])
        deviation[known] = prior_rows(network, state, point[known], state.ground[point[known]]).deviation
        return -deviation[:, self.part]

    def weights(self, network: Network, block: Block) -> FloatArray:
        """Return the weights (k, components)."""
        point = self.points(block)
        weight: FloatArray = getattr(network.priors, self.weight)[point]
        return weight.reshape(len(point), len(self.observed.components))

    def weighted(self, network: Network, block: Block, factor: FloatArray) -> Network:
        """Return the network with the weights times `factor` (k, components)."""
        weight = getattr(network.priors, self.weight).copy()
        weight[self.points(block)] *= factor.reshape(len(factor), *weight.shape[1:])
        return replace(network, priors=replace(network.priors, **{self.weight: weight}))


class Control(Prior):
    """East, north, up of a control point."""

    observed = ObservationKind.CONTROL
    part, weight = slice(0, 3), "weight"

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that a component is off by `size` m."""
        point = block.points.ids[self.points(block)[row]]
        return f"control point {point} is {size:.2f} m off in {_COMPONENTS[component]}"


class EqualElevation(Prior, Unknown):
    """Members of the groups, and the levels of these: members stand in the normal equations of the points."""

    observed = ObservationKind.EQUAL_ELEVATION
    part, weight = slice(3, 4), "group_weight"
    change = "a level still changes by {} m"

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return the names of the levels."""
        return [f"level of group {name}" for name in block.equal_elevations.ids.tolist()]

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that a point is off by `size` m."""
        point = block.points.ids[self.points(block)[row]]
        return f"point {point} is {size:.2f} m off its equal elevation"

    def state_after(self, network: Network, step: FloatArray, state: State) -> State:
        """Return the state with the levels after a step (u,)."""
        return replace(state, levels=state.levels + self.part_of(network, step))

    def transformed(self, network: Network, state: State, centre: FloatArray, move: Similarity) -> State:
        """Return the state with the levels lifted, and grown apart from the height of the centre."""
        height = float(network.frame.height(centre))
        return replace(state, levels=height + move.scale * (state.levels - height) + move.shift[2])

    def put_motions(self, network: Network, state: State, centre: FloatArray, motions: FloatArray) -> None:
        """Put what the motions do to the levels into `motions` (u, 7)."""
        has_points = np.isfinite(state.levels)  # that of a group without any is no unknown
        part = self.part_of(network, motions)
        part[:, 2] = has_points
        part[:, 6] = np.where(has_points, state.levels - float(network.frame.height(centre)), 0.0)


KINDS = (StationPosition(), StationAttitude(), Control(), EqualElevation())
