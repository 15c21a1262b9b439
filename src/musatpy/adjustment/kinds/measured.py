"""What was measured between exposure stations and ground points: a function of their positions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from musatpy.adjustment.iteration import State
from musatpy.adjustment.kinds.kind import Kind, Rows
from musatpy.adjustment.network import MeasuredTies, Network, inverse_squares, kept_axes
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model import Block, CauseKind, ObservationKind, Program
from musatpy.model.tables import taken


class MeasuredKind(Kind):
    """A kind whose table has `photo` (d, a) or `point` (d, b) or both, the attribute `value`, and `sigma`.

    Points at its ends stay among the unknowns, which takes the simultaneous adjustment: in IIA they are no ends.
    """

    value: str  # attribute of the table

    @property
    def cause(self) -> CauseKind:
        """What may be wrong with one of them: the member of the same name."""
        return CauseKind[self.observed.name]

    def model(self, network: Network, ends: FloatArray, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the observed quantity (d,) and its partials (d, e, 3) along `axes` (d, e, 3, 3) at the ends.

        The ends (d, e, 3) are in working coordinates, stations first.
        """
        raise NotImplementedError

    def applies(self, block: Block) -> bool:
        """Return whether the program of a block uses the table."""
        return block.options.program is Program.IIIA or not self._links(block)[1].shape[1]

    def with_starts(self, block: Block) -> Block:
        """Return the block with starts of photos for which no card gives any, where the table has them."""
        return block

    def without(self, block: Block, out: BoolArray) -> Block:
        """Return the block without the rows of the table that are `out` (rows,)."""
        return replace(block, **{self.observed.attribute: taken(self._table(block), ~out)})

    def measured(self, block: Block, enters: BoolArray) -> MeasuredTies:
        """Return what takes part of the table of a block; points that enter (p,) may be kept."""
        table, (photo, point) = self._table(block), self._links(block)
        used = np.asarray(enters[point].all(axis=1)) & self.applies(block)
        return MeasuredTies(
            row=np.flatnonzero(used),
            photo=photo[used],
            point=point[used],
            value=getattr(table, self.value)[used],
            weight=inverse_squares(table.sigma[used]),
        )

    def values(self, block: Block, network: Network, state: State) -> FloatArray:
        """Return the quantity (rows,) of the whole table at `state`, NaN where an end has no position."""
        photo, point = self._links(block)
        ends = np.concatenate([state.position[photo], state.ground[point]], axis=1)
        out, known = np.full(len(ends), np.nan), np.isfinite(ends).all(axis=(1, 2))
        out[known] = self.model(network, ends[known], np.zeros((*ends[known].shape, 3)))[0]
        return out

    def rows(self, network: Network, state: State) -> Rows:
        """Return the observations that take part."""
        of, ground = network.measured[self.observed], state.ground[network.measured[self.observed].point]
        value, partials = self.model(
            network,
            np.concatenate([state.position[of.photo], ground], axis=1),
            np.concatenate([network.axes[of.photo], kept_axes(network, ground)], axis=1),
        )
        stations = of.photo[:, :, None] * network.pattern.size + np.arange(3)
        index = np.concatenate([stations, network.pattern.order + network.border.kept_columns(of.point)], axis=1)
        d, e = index.shape[:2]
        return Rows(
            row=of.row,
            component=np.zeros(d, dtype=np.int64),
            residual=value - of.value,
            weight=of.weight,
            index=index.reshape(d, 3 * e),
            partials=partials.reshape(d, 3 * e),
            position=index[:, -1],
        )

    def weights(self, network: Network, block: Block) -> FloatArray:
        """Return the weights (rows, 1) of the table."""
        of, out = network.measured[self.observed], np.zeros((self._table(block).count, 1))
        out[of.row, 0] = of.weight
        return out

    def weighted(self, network: Network, block: Block, factor: FloatArray) -> Network:
        """Return the network with the weights of the table times `factor` (rows, 1)."""
        of = network.measured[self.observed]
        changed = replace(of, weight=of.weight * factor[of.row, 0])
        return replace(network, measured={**network.measured, self.observed: changed})

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that an observation is off by `size` m."""
        photos, points = self.observed.links(block, row)
        parts = [f"{what}s {' and '.join(ids)}" for what, ids in (("photo", photos), ("point", points)) if ids]
        return f"the {self.cause} of {' and '.join(parts)} is off by {size:.2f} m"

    def _table(self, block: Block) -> Any:
        return getattr(block, self.observed.attribute)

    def _links(self, block: Block) -> tuple[IntArray, IntArray]:
        """Return the photos (rows, a) and the points (rows, b) of the table."""
        table = self._table(block)
        rows = table.count
        none = np.zeros((rows, 0), dtype=np.int64)
        photo, point = (getattr(table, name, none) for name in ("photo", "point"))
        return photo.reshape(rows, *photo.shape[1:2] or [1]), point.reshape(rows, *point.shape[1:2] or [1])


class StraightLength(MeasuredKind):
    """A kind of distances between two ends."""

    value = "length"

    def model(self, network: Network, ends: FloatArray, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the lengths (d,) in m, and their partials (d, 2, 3)."""
        return straight_length(ends, axes)


class AirBase(StraightLength):
    """Air bases."""

    observed = ObservationKind.AIR_BASE


class Distance(StraightLength):
    """Distances."""

    observed = ObservationKind.DISTANCE


class HeightDifference(MeasuredKind):
    """Height differences."""

    observed = ObservationKind.HEIGHT_DIFFERENCE
    value = "difference"

    def model(self, network: Network, ends: FloatArray, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the differences (d,) in m, and their partials (d, 2, 3)."""
        height = network.frame.height(ends.reshape(-1, 3)).reshape(-1, 2) if len(ends) else np.zeros((0, 2))
        partials = np.zeros_like(ends)
        partials[:, :, 2] = [-1.0, 1.0]
        return height[:, 1] - height[:, 0], partials


def straight_length(ends: FloatArray, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the distances (d,) of two ends (d, 2, 3), and their partials (d, 2, 3) along axes (d, 2, 3, 3)."""
    between = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(between, axis=1)
    unit = between / length[:, None]
    return length, np.einsum("deij,dej->dei", axes, np.stack([-unit, unit], axis=1))


KINDS = (AirBase(), Distance(), HeightDifference())
