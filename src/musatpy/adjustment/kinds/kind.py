"""What a kind of observation, or of global unknown, gives to the adjustment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water_surface import WaterKnowledge
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry.similarity import Similarity
from musatpy.model import Block, ObservationKind


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

    @classmethod
    def of_unknowns(
        cls,
        residual: FloatArray,
        weight: FloatArray,
        index: IntArray,
        row: IntArray | None = None,
        component: IntArray | None = None,
        position: IntArray | None = None,
    ) -> Rows:
        """Return observations (r,) of the unknowns `index` (r,) themselves, by default of successive rows."""
        r = len(residual)
        return cls(
            row=np.arange(r) if row is None else row,
            component=np.zeros(r, dtype=np.int64) if component is None else component,
            residual=residual,
            weight=weight,
            index=index[:, None],
            partials=np.ones((r, 1)),
            position=position,
        )


class Kind:
    """One kind of observation. Arrays of its table have one row for each of its rows, and its components.

    Every kind has residuals and weights; those of which `direct` is true give `rows`: images, and what is known of
    single ground points, stand in the normal equations of the points (`ground`, `collinear`).
    """

    observed: ObservationKind
    direct = True
    searched = True  # the search for blunders can take single observations out

    def takes_part(self, network: Network) -> bool:
        """Return whether there may be observations in `rows` that have a weight."""
        return True

    def rows(self, network: Network, state: State) -> Rows:
        """Return the observations that take part."""
        raise NotImplementedError

    def weights(self, network: Network, block: Block) -> FloatArray:
        """Return the weights of the table, 0 for what takes no part."""
        raise NotImplementedError

    def residuals(self, network: Network, block: Block, state: State) -> FloatArray:
        """Return the residuals of the table, 0 for what takes no part."""
        rows, shape = self.rows(network, state), self.weights(network, block).shape
        out = np.zeros(shape)
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


class OfWater(Unknown):
    """Global unknowns of the water, on which refracted images depend."""

    def of_images(self, network: Network, group: PointGroup, by_water: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return columns (k, X) and the partials (k, m, 2, X) of the images of a group.

        `by_water` (k, m, 2, 4 + w) are those by the level at each photo, the tilts, the index, and the waves.
        """
        raise NotImplementedError

    def of_surface(self, network: Network, state: State, group: PointGroup) -> tuple[IntArray, FloatArray]:
        """Return columns (k, X), and the partials (k, X) of the mean height of the water over the points."""
        return np.zeros((len(group.point), 0), dtype=np.int64), np.zeros((len(group.point), 0))

    def weight(self, network: Network) -> FloatArray:
        """Return the weights (X,) of what is known beforehand, 0 where nothing is."""
        raise NotImplementedError

    def everywhere(self, network: Network, points: int) -> IntArray:
        """Return all of its columns in the border, for each of so many points, (points, X)."""
        columns = network.border.numbers(self.observed)
        return np.broadcast_to(columns, (points, len(columns)))


class Parameter(OfWater):
    """Parameters of the water on which all refracted images depend alike."""

    searched = False  # no card of one photo or point is to blame
    part: slice  # of the partials by the water

    def values(self, network: Network, state: State) -> tuple[FloatArray, FloatArray]:
        """Return the unknown parameters (X,) at `state`, and as they were given."""
        raise NotImplementedError

    def with_values(self, network: Network, state: State, values: FloatArray) -> State:
        """Return the state with other unknown parameters (X,)."""
        raise NotImplementedError

    def rows(self, network: Network, state: State) -> Rows:
        """Return the parameters as observed, components of one row."""
        index = self.numbers(network)
        if not len(index):
            return Rows.of_unknowns(np.zeros(0), np.zeros(0), index)
        values, given = self.values(network, state)
        component = np.arange(len(index))
        return Rows.of_unknowns(
            values - given, self.weight(network), index, row=np.zeros_like(component), component=component
        )

    def state_after(self, network: Network, step: FloatArray, state: State) -> State:
        """Return the state with the parameters after a step (u,)."""
        part = self.part_of(network, step)
        return self.with_values(network, state, self.values(network, state)[0] + part) if len(part) else state

    def of_images(self, network: Network, group: PointGroup, by_water: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return columns (k, X) and partials (k, m, 2, X)."""
        index = self.everywhere(network, len(by_water))
        return index, by_water[..., self.part][..., : index.shape[1]]


def in_digits(size: float, decimals: int) -> str:
    """Return a size with so many decimals, more where it would have less than two digits."""
    more = 1 - math.floor(math.log10(size)) if size > 0.0 and math.isfinite(size) else 0
    return f"{size:.{max(decimals, more)}f}"
