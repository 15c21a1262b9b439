"""The eliminated points of a network one after the other, as compiled kernels take them."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from types import ModuleType
from typing import TYPE_CHECKING, Generic, TypeVar, cast

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, order_of

if TYPE_CHECKING:
    from musatpy.adjustment.ground import Priors
    from musatpy.adjustment.kernels import points
    from musatpy.adjustment.network import Network, PointGroup

Made = TypeVar("Made")

_MOST = 4  # parts of the work: each has sums of its own
_PART = 10_000  # rays: less is not worth a thread
_KEPT = 6  # choices of groups that were asked for last


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """Some rows of a sequence, and the blocks of the pattern that their pairs lie in: from `first` to `last`."""

    rows: IntArray
    first: int
    last: int


class Last(Generic[Made]):
    """What was made last, for as long as it is asked for of the same objects: arrays that stay are not copied."""

    def __init__(self) -> None:
        self._of: tuple[object, ...] | None = None
        self._made: Made | None = None

    def made(self, make: Callable[[], Made], *of: object) -> Made:
        """Return what `make` has made of these objects."""
        if self._of is None or any(map(operator.is_not, self._of, of)):
            self._of, self._made = of, make()
        return cast(Made, self._made)


@dataclass(frozen=True, kw_only=True, eq=False)
class PointSequence:
    """k points and their r rays, in the order of first photos: what they add to stays in the cache."""

    point: IntArray  # (k,)
    row: IntArray  # (p,) of each point in the sequence, -1 where it is not in it
    start: IntArray  # (k + 1,) first ray of each
    rays: IntArray  # (r,) measurements
    photo: IntArray  # (r,)
    pairs: points.Pairs
    first_pair: IntArray  # (n + 1,) of each photo in the pattern
    _xy: Last[FloatArray] = field(default_factory=Last, repr=False)
    _roots: Last[FloatArray] = field(default_factory=Last, repr=False)
    _wet: Last[tuple[IntArray, IntArray, IntArray]] = field(default_factory=Last, repr=False)
    _chosen: list[tuple[tuple[PointGroup, ...], IntArray, list[Part]]] = field(default_factory=list, repr=False)
    # of `CompiledRows`
    last_stations: Last[points.Stations] = field(default_factory=Last, repr=False)
    last_seen: Last[tuple[points.Measured, points.Stations, points.Water]] = field(default_factory=Last, repr=False)
    last_priors: Last[Priors] = field(default_factory=Last, repr=False)

    @classmethod
    def of(cls, kernels: ModuleType, network: Network, groups: Iterable[PointGroup]) -> PointSequence:
        """Return the sequence of the points of groups of a network."""
        every = [group for group in groups if len(group.point)]
        point = np.concatenate([group.point for group in every]) if every else np.zeros(0, dtype=np.int64)
        size = np.concatenate([np.full(len(g.point), g.rays.shape[1]) for g in every]) if every else point
        rays = np.concatenate([group.rays.reshape(-1) for group in every]) if every else point
        before = np.cumsum(size) - size
        order = order_of(network.photo[rays[before]])
        point, size = point[order], size[order]
        start = np.concatenate([[0], np.cumsum(size)])
        rays = rays[np.repeat(before[order] - start[:-1], size) + np.arange(start[-1])]
        row = np.full(network.points, -1)
        row[point] = np.arange(len(point))
        pattern, photo = network.pattern, network.photo[rays]
        first = np.searchsorted(pattern.pairs[:, 0], np.arange(pattern.count + 1))
        pairs = kernels.Pairs(
            start=np.empty(len(point) + 1, dtype=np.int64),
            slot=np.empty(int(np.sum(size * (size + 1) // 2)), dtype=np.int32),
        )
        kernels.find_pairs(start, photo, first, np.ascontiguousarray(pattern.pairs[:, 1]), pairs)
        return cls(point=point, row=row, start=start, rays=rays, photo=photo, pairs=pairs, first_pair=first)

    def images(self, xy: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the images (r, 2) of the rays and the roots (r, 2) of their weights, of those measured (m, 2).

        Networks have these in common.
        """
        return (
            self._xy.made(lambda: xy.take(self.rays, axis=0), xy),
            self._roots.made(lambda: np.sqrt(weight.take(self.rays, axis=0)), weight),
        )

    def wet(self, refracted: BoolArray, point: IntArray) -> tuple[IntArray, IntArray, IntArray]:
        """Return the rays (w,) that are `refracted` (m,), their points (w,), and the row (r,) of each ray, or -1.

        `point` (m,): those of all measurements. Networks have these in common, or what is made of one and the same
        of them.
        """

        def made() -> tuple[IntArray, IntArray, IntArray]:
            wet = np.flatnonzero(refracted[self.rays])
            row = np.full(len(self.rays), -1)
            row[wet] = np.arange(len(wet))
            return wet, point.take(self.rays.take(wet)), row

        return self._wet.made(made, refracted)

    def chosen(self, groups: Iterable[PointGroup]) -> tuple[IntArray, list[Part]]:
        """Return the rows of the points of groups, ascending, and in parts of as many rays.

        How many parts does not depend on the threads, so that sums do not. Networks have most groups in common.
        """
        groups = tuple(groups)
        for number, (before, _, _) in enumerate(self._chosen):
            if len(before) == len(groups) and all(map(operator.is_, before, groups)):
                self._chosen.insert(0, self._chosen.pop(number))
                return self._chosen[0][1:]
        every = [np.zeros(0, dtype=np.int64), *(self.row[group.point] for group in groups)]
        rows = np.sort(np.concatenate(every))
        self._chosen[:] = [(groups, rows, self._parts(rows)), *self._chosen[: _KEPT - 1]]
        return self._chosen[0][1:]

    def _parts(self, rows: IntArray) -> list[Part]:
        rays = np.cumsum(self.start[rows + 1] - self.start[rows])
        total = int(rays[-1]) if len(rays) else 0
        count = min(_MOST, max(1, total // _PART))
        cut = np.searchsorted(rays, total * np.arange(1, count) / count)
        return [self._part(piece) for piece in np.split(rows, cut) if len(piece)]

    def _part(self, rows: IntArray) -> Part:
        photo = self.photo[self.start[rows[0]] : self.start[rows[-1] + 1]]  # the first of them is the lowest
        return Part(rows=rows, first=int(self.first_pair[photo[0]]), last=int(self.first_pair[photo.max() + 1]))
