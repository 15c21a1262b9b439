"""What a kind of observation, or of global unknown, gives to the adjustment; and the kinds of what is known of
single stations and ground points: coordinates, attitudes, levels that points share.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.ground import prior_rows
from musatpy.adjustment.iteration import State, WaterKnowledge
from musatpy.adjustment.network import BACK, ORDER, Network, PointGroup
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry.collinearity import wrapped
from musatpy.geometry.similarity import Similarity
from musatpy.model import Block, ObservationKind
from musatpy.model.tables import finite_rows
from musatpy.units import DEGREE

if TYPE_CHECKING:
    from musatpy.adjustment.sightings import RayImages

_COMPONENTS = ("east", "north", "up")
_ANGLES = ("X-tilt", "Y-tilt", "heading")


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """r scalar observations that concern no image, with their partials by X unknowns of the normal equations each.

    `residual` is adjusted minus observed, `index` counts the unknowns of the photos first, then the global ones;
    `position` are the unknowns east, north, up of the position that the observation belongs to.
    """

    row: IntArray  # (r,) of the table of the kind
    component: IntArray  # (r,)
    residual: FloatArray  # (r,)
    weight: FloatArray  # (r,)
    index: IntArray  # (r, X)
    partials: FloatArray  # (r, X)
    position: IntArray | None = None  # (r, 3); None: it belongs to no position


def of_unknowns(
    residual: FloatArray, weight: FloatArray, index: IntArray, row: IntArray, component: IntArray
) -> Rows:
    """Return observations (r,) of the unknowns `index` (r,) themselves."""
    return Rows(
        row=row,
        component=component,
        residual=residual,
        weight=weight,
        index=index[:, None],
        partials=np.ones((len(residual), 1)),
    )


class Kind:
    """One kind of observation. Arrays of its table have one row for each of its rows, and its components.

    Every kind has residuals and weights; those of which `direct` is true give `rows`: images, and what is known of
    single ground points, stand in the normal equations of the points (`ground`, `collinear`).
    """

    observed: ObservationKind
    direct = True
    searched = True  # the search for blunders can take single observations out

    def rows(self, network: Network, state: State) -> Rows:
        """Return the observations that take part."""
        raise NotImplementedError

    def weights(self, network: Network, block: Block) -> FloatArray:
        """Return the weights of the table, 0 for what takes no part."""
        raise NotImplementedError

    def residuals(self, network: Network, block: Block, state: State) -> FloatArray:
        """Return the residuals of the table, 0 for what takes no part."""
        out = np.zeros(self.weights(network, block).shape)
        if out.size:
            rows = self.rows(network, state)
            out[rows.row, rows.component] = rows.residual
        return out

    def weighted(self, network: Network, block: Block, factor: FloatArray) -> Network:
        """Return the network with the weights of the table times `factor`."""
        raise NotImplementedError

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that an observation is off by `size`."""
        raise NotImplementedError


class Unknown(Kind):
    """A kind of global unknowns, and the observations of them beforehand."""

    change: str  # that the largest change by a step is told with
    unit, digits = 1.0, 4  # of that change

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return a name for each of its columns in the border, () without any."""
        raise NotImplementedError

    def state_after(self, network: Network, step: FloatArray, state: State) -> State:
        """Return the state after a step (u,)."""
        raise NotImplementedError

    def transformed(self, network: Network, state: State, centre: FloatArray, move: Similarity) -> State:
        """Return the state after a similarity, in the level axes at `centre` (3,), where that moves it."""
        return state

    def put_motions(self, network: Network, state: State, centre: FloatArray, motions: FloatArray) -> None:
        """Put what the seven motions of a datum, about `centre` (3,), do to it into `motions` (u, 7)."""

    def movement(self, network: Network, step: FloatArray) -> tuple[float, str]:
        """Return the largest change by a step (u,), and how it is told."""
        size = float(np.abs(self.part_of(network, step)).max(initial=0.0))
        return size, self.change.format(in_digits(size / self.unit, self.digits))

    def limit(self, rotation: float, translation: float) -> float:
        """Return the limit of `movement`, by the limits of stations in rad and m."""
        return translation

    def numbers(self, network: Network) -> IntArray:
        """Return the numbers of its columns among all unknowns."""
        return network.pattern.order + network.border.numbers(self.observed)

    def part_of(self, network: Network, values: FloatArray) -> FloatArray:
        """Return the part of values (u, ...) of all unknowns that belongs to it, a view."""
        at, first = network.border.at(self.observed), network.pattern.order
        return values[first + at.start : first + at.stop]


class OfImages(Unknown):
    """Global unknowns on which images depend."""

    def of_images(self, network: Network, group: PointGroup, images: RayImages) -> tuple[IntArray, FloatArray]:
        """Return columns (k, X) of the border and the partials (k, m, 2, X) of the images of a group by them."""
        raise NotImplementedError

    def weight(self, network: Network) -> FloatArray:
        """Return the weights (X,) of what is known beforehand, 0 where nothing is."""
        raise NotImplementedError

    def everywhere(self, network: Network, points: int) -> IntArray:
        """Return all of its columns in the border, for each of so many points, (points, X)."""
        columns = network.border.numbers(self.observed)
        return np.broadcast_to(columns, (points, len(columns)))


class OfWater(OfImages):
    """Global unknowns of the water, on which refracted images depend."""

    def of_images(self, network: Network, group: PointGroup, images: RayImages) -> tuple[IntArray, FloatArray]:
        """Return columns (k, X) and the partials (k, m, 2, X) of the images of a group: none of dry points."""
        if images.by_water is None or not network.refracted[group.rays].any():
            k, m = group.rays.shape
            return np.zeros((k, 0), dtype=np.int64), np.zeros((k, m, 2, 0))
        return self.of_wet_images(network, group, images.by_water)

    def of_wet_images(
        self, network: Network, group: PointGroup, by_water: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Return columns (k, X) and the partials (k, m, 2, X) of the images of a group.

        `by_water` (k, m, 2, 4 + w) are those by the level at each photo, the tilts, the index, and the waves.
        """
        raise NotImplementedError

    def of_surface(self, network: Network, state: State, group: PointGroup) -> tuple[IntArray, FloatArray]:
        """Return columns (k, X), and the partials (k, X) of the mean height of the water over the points."""
        return np.zeros((len(group.point), 0), dtype=np.int64), np.zeros((len(group.point), 0))


def in_digits(size: float, decimals: int) -> str:
    """Return a size with so many decimals, more where it would have less than two digits."""
    more = 1 - math.floor(math.log10(size)) if size > 0.0 and math.isfinite(size) else 0
    return f"{size:.{max(decimals, more)}f}"


class StationKind(Kind):
    """Three observed unknowns of each photo."""

    first: int  # of the unknowns of a photo
    attribute: str  # weights of the network

    def deviation(self, network: Network, state: State) -> FloatArray:
        """Return adjusted minus given (n, 3)."""
        raise NotImplementedError

    def rows(self, network: Network, state: State) -> Rows:
        """Return the observations of all photos."""
        photo, component = np.divmod(np.arange(3 * network.photos), 3)
        start, position = photo * network.pattern.size, np.tile(np.arange(3), (len(photo), 1))
        turned = np.isin(photo, np.flatnonzero(network.turned))
        position[turned] = BACK
        stated = np.where(turned & (self.first == 0), np.take(ORDER, component), component)
        residual, weight = self.deviation(network, state), getattr(network, self.attribute)
        index = start + self.first + component
        rows = of_unknowns(residual.reshape(-1), weight.reshape(-1), index, photo, stated)
        return replace(rows, position=start[:, None] + position)

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
        if block.control.correlated[row]:  # the size is of what has the weights
            return f"control point {point} does not fit its covariances, above all in {_COMPONENTS[component]}"
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
