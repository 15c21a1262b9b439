"""The points of a network that compiled loops take: what these take, out of network and state."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self, TypeVar

import numpy as np

from musatpy.adjustment.collinear import Follow
from musatpy.adjustment.compiled import points as compiled
from musatpy.adjustment.compiled.points import Known, LevelWater, LinearPoints, Pairs, PointImages, Poses
from musatpy.adjustment.ground import RIDGE, hold, prior_rows, steps_to_best
from musatpy.adjustment.iteration import State
from musatpy.adjustment.kernels import Loops, side_by_side
from musatpy.adjustment.kinds import WATER
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import Cofactors, NormalEquations
from musatpy.adjustment.propagation import Diagonal, PointRows, PropagatedObservations
from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry.geodesy import surface
from musatpy.model import ObservationKind
from musatpy.model.tables import order_of

Groups = tuple[PointGroup, ...]
Result = TypeVar("Result")
_MOST = 4  # parts of the work: each has sums of its own
_PART = 10_000  # rays: less is not worth a thread


@dataclass(frozen=True, kw_only=True, eq=False)
class Sequence:
    """k points and their r rays, in the order of first photos: what they add to stays in the cache."""

    point: IntArray  # (k,)
    row: IntArray  # (p,) of each point in the sequence, -1 where it is not in it
    start: IntArray  # (k + 1,) first ray of each
    rays: IntArray  # (r,) measurements
    photo: IntArray  # (r,)
    pairs: Pairs

    @classmethod
    def of(cls, network: Network) -> Sequence:
        """Return the sequence of the points that are eliminated; networks of the same points and rays share it."""
        if Sequence not in network.gathered:
            network.gathered[Sequence] = cls._gathered(network)
        return network.gathered[Sequence]

    @classmethod
    def _gathered(cls, network: Network) -> Sequence:
        none = np.zeros(0, dtype=np.int64)
        groups = (*network.pass_groups, *network.control_groups)
        point = np.concatenate([none, *(group.point for group in groups)])
        size = np.concatenate([none, *(np.full(len(group.point), group.rays.shape[1]) for group in groups)])
        rays = np.concatenate([none, *(group.rays.reshape(-1) for group in groups)])
        before = np.cumsum(size) - size
        order = order_of(network.photo[rays[before]])
        point, size = point[order], size[order]
        start = np.concatenate([[0], np.cumsum(size)])
        rays = rays[np.repeat(before[order] - start[:-1], size) + np.arange(start[-1])]
        row = np.full(network.points, -1)
        row[point] = np.arange(len(point))
        photo, first_pair = network.photo[rays], np.concatenate([[0], np.cumsum(size * (size + 1) // 2)])
        slot = np.empty(first_pair[-1], dtype=np.int32)
        for m in np.flatnonzero(np.bincount(size)).tolist():
            some, (i, j) = np.flatnonzero(size == m), np.triu_indices(m)
            of_some = photo[start[some][:, None] + np.arange(m)]
            slot[first_pair[some][:, None] + np.arange(len(i))] = network.pattern.find(of_some[:, i], of_some[:, j])
        pairs = Pairs(start=first_pair, slot=slot)
        return cls(point=point, row=row, start=start, rays=rays, photo=photo, pairs=pairs)


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledFollow:
    """How the points follow a step: what is left of their elimination."""

    loops: CompiledLoops
    points: LinearPoints
    known: Known

    def move(self, network: Network, state: State, step: FloatArray, ground: FloatArray) -> None:
        """Set the points of `ground` (p, 3) where they are after a step (u,) of all unknowns from `state`."""
        loops, sequence, rows, known_rows = self.loops, self.loops.sequence, self.loops.rows, self.loops.known_rows
        stations, change = step[: network.pattern.order].reshape(network.photos, -1), self.points.shift.copy()
        loops.of_parts(
            lambda part: compiled.follow(
                part, sequence.start, sequence.photo, self.points, loops.unknowns, stations, change
            ),
            rows,
        )
        change[known_rows] = np.einsum("kji,kj->ki", self.known.axes, change[known_rows])
        ground[sequence.point[rows]] = state.ground[sequence.point[rows]] + change[rows]
        known = sequence.point[known_rows]
        ground[known] = hold(network, known, ground[known])


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledLoops(Loops):
    """Loops over the points that have no unknowns but their own and those of their photos; `others` are left."""

    others: Groups
    _last: list[tuple[tuple[object, ...], LinearPoints, Known]] = field(default_factory=list, repr=False)

    @classmethod
    def of(cls, network: Network, groups: Iterable[PointGroup]) -> Self:
        """Return the loops over some groups.

        Others are kept points, those of equal elevations, control where any has covariances, and all with a wet ray
        through waves, or where the border has unknowns of the water.
        """
        border = network.border
        unknown = network.sea is not None or any(len(border.numbers(kind.observed)) for kind in WATER)
        mine: list[PointGroup] = []
        others: list[PointGroup] = []
        for group in groups:
            by_numpy = border.count(ObservationKind.EQUAL_ELEVATION) or network.priors.decorrelation is not None
            if network.lenses or network.ports or group.kept or (group.known and by_numpy):
                others.append(group)
            elif unknown:
                wet = np.asarray(network.refracted[group.rays].any(axis=1))
                mine += group.some(~wet)
                others += group.some(wet)
            else:
                mine.append(group)
        return cls(network=network, groups=tuple(mine), others=tuple(others))

    @cached_property
    def sequence(self) -> Sequence:
        """All points of the network that are eliminated."""
        return Sequence.of(self.network)

    @cached_property
    def rows(self) -> IntArray:
        """The rows (j,) of the points of the groups."""
        return self._rows_of(self.groups)

    @cached_property
    def known_rows(self) -> IntArray:
        """The rows (h,) of the points of which something is known."""
        return self._rows_of([group for group in self.groups if group.known])

    def _rows_of(self, groups: Iterable[PointGroup]) -> IntArray:
        rows = [self.sequence.row[group.point] for group in groups]
        return np.sort(np.concatenate([np.zeros(0, dtype=np.int64), *rows]))

    @cached_property
    def _root(self) -> FloatArray:
        """The roots (r, 2) of the weights of images."""
        return np.sqrt(self.network.weight.take(self.sequence.rays, axis=0))

    def of_parts(self, work: Callable[[IntArray], Result], rows: IntArray) -> list[Result]:
        """Return the results of `work` at rows in parts of as many rays: so sums do not depend on the threads."""
        start = self.sequence.start
        rays = np.cumsum(start[rows + 1] - start[rows])
        total = int(rays[-1]) if len(rays) else 0
        count = min(_MOST, max(1, total // _PART))
        pieces = np.split(rows, np.searchsorted(rays, total * np.arange(1, count) / count))
        return list(side_by_side(work, pieces, len(self.sequence.rays)))

    def points(self, state: State) -> tuple[LinearPoints, Known]:
        """Return the points in a state: each step is judged where it leads, and the next one begins there."""
        of = (state.position, state.attitude, state.ground, state.tide, state.tilt, state.index, state.levels)
        if not self._last or any(a is not b for a, b in zip(self._last[0][0], of, strict=True)):
            self._last[:] = [(of, *self._linearised(state, self.rows))]
        return self._last[0][1:]

    def _linearised(self, state: State, rows: IntArray, by_station: bool = True) -> tuple[LinearPoints, Known]:
        """Return some points, and what is known of all, as they are in a state; what is not asked for is zero."""
        network, sequence, kappa = self.network, self.sequence, state.attitude[:, 2]
        k, r, q = len(sequence.point), len(sequence.rays), network.pattern.size
        at = PointImages(
            start=sequence.start,
            photo=sequence.photo,
            xy=network.xy.take(sequence.rays, axis=0),
            root=self._root,
            ground=state.ground.take(sequence.point, axis=0),
        )
        turn = np.stack([np.cos(kappa), np.sin(kappa)], axis=1)
        arrays = (state.position, state.M, network.axes, turn, network.focal_length, network.principal_point)
        known_point, row = sequence.point[self.known_rows], np.full(k, -1)
        row[self.known_rows] = np.arange(len(known_point))
        priors = prior_rows(network, state, known_point, state.ground[known_point])
        weight = priors.weight[:, :3]
        known = Known(
            row=row,
            axes=_plain(priors.axes),
            free=priors.free,
            diagonal=np.where(priors.free, weight, weight + 1.0),
            pull=weight * priors.deviation[:, :3],
        )
        shapes = ((r if by_station else 0, 2, q), (r, 2, 3), (r, 2), (k, 3, 3), (k, 3), (k,), (k,))
        out, stations, water = LinearPoints(*map(np.zeros, shapes)), Poses(*map(_plain, arrays)), self._water(state)
        self.of_parts(
            lambda part: compiled.linearise(part, at, stations, water, known, RIDGE, by_station, out), rows
        )
        out.squares[self.known_rows] += priors.squares
        return out, known

    def _water(self, state: State) -> LevelWater:
        """Return the level water over the points."""
        network, rays = self.network, self.sequence.rays
        wet = np.flatnonzero(network.refracted[rays])
        row, wet_rays = np.full(len(rays), -1), rays[wet]
        row[wet] = np.arange(len(wet))
        ground, tide = state.ground[network.point[wet_rays]], state.tide[network.photo[wet_rays]]
        over = surface(network.frame, network.slope(state.tilt), tide, ground)
        normal, depth, rise = map(_plain, (over.normal, over.depth, 1.0 / over.secant))
        return LevelWater(row=row, normal=normal, depth=depth, rise=rise, refraction=float(state.index))

    @property
    def unknowns(self) -> tuple[int, ...]:
        """Zeros, as many as each station has unknowns: loops are compiled for their number."""
        return (0,) * self.network.pattern.size

    def get_ready(self, state: State, say: Callable[[], None]) -> None:
        if not compiled.is_kept(compiled.linearise):
            say()
            pattern, none, follows = self.network.pattern, replace(self, groups=()), list[Follow]()
            none.eliminate(state, NormalEquations(pattern, 0), follows)
            follows[0].move(self.network, state, np.zeros(pattern.order), state.ground.copy())
            none._errors(state, np.zeros((0, pattern.size, pattern.size)))

    def eliminate(self, state: State, normals: NormalEquations, follows: list[Follow]) -> tuple[Groups, float]:
        (points, known), sequence, (blocks, rhs) = self.points(state), self.sequence, normals.sums
        first_pair = np.searchsorted(normals.pattern.pairs[:, 0], np.arange(normals.pattern.count + 1))

        def work(rows: IntArray) -> tuple[int, FloatArray, FloatArray]:
            """Return sums of the pattern from the first photo on, which is the lowest, to the highest one."""
            photo = sequence.photo[sequence.start[rows[0]] : sequence.start[rows[-1] + 1]] if len(rows) else rows
            first, last = (int(first_pair[n]) for n in (photo[0], photo.max() + 1)) if len(rows) else (0, 0)
            own, own_rhs = np.zeros((last - first, *blocks.shape[1:])), np.zeros_like(rhs)
            compiled.add(
                rows, sequence.start, sequence.photo, points, sequence.pairs, self.unknowns, first, own, own_rhs
            )
            return first, own, own_rhs

        for first, own, own_rhs in self.of_parts(work, self.rows):
            blocks[first : first + len(own)] += own
            rhs += own_rhs
        follows.append(CompiledFollow(loops=self, points=points, known=known))
        return self.others, float(np.sum(points.fall))

    def settle(self, state: State, ground: FloatArray, squares: FloatArray) -> Groups:
        mine = self.sequence.point[self.rows]

        def step(some: IntArray, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            every, rows = ground.copy(), self.rows[some]
            every[mine[some]] = X
            points, known = self._linearised(replace(state, ground=every), rows, by_station=False)
            shift = points.shift
            shift[self.known_rows] = np.einsum("kji,kj->ki", known.axes, shift[self.known_rows])
            return shift[rows], points.squares[rows], points.fall[rows]

        ground[mine], squares[mine] = steps_to_best(
            step, ground[mine], lambda some, X: hold(self.network, mine[some], X)
        )
        return self.others

    def set_squares(self, state: State, squares: FloatArray) -> Groups:
        points, _ = self.points(state)
        squares[self.sequence.point[self.rows]] = points.squares[self.rows]
        return self.others

    def spread(
        self, state: State, cofactors: Cofactors, residual: FloatArray, points: FloatArray, diagonal: Diagonal
    ) -> tuple[Groups, list[PropagatedObservations]]:
        sequence, network = self.sequence, self.network
        rows = np.setdiff1d(self.rows, self.known_rows, assume_unique=True)
        of_points, cofactor, covariance = self._errors(state, cofactors.blocks)
        points[sequence.point[rows]] = of_points[rows]
        taken = np.repeat(np.isin(np.arange(len(of_points)), rows), np.diff(sequence.start))
        A, images = self.points(state)[0].A, sequence.rays[taken]
        squares = np.einsum("rci,rci->ri", A, A)[taken]
        for unknown, of_stations in enumerate(diagonal.stations.T):
            of_stations += np.bincount(sequence.photo[taken], squares[:, unknown], network.photos)
        part = PropagatedObservations(
            kind=ObservationKind.PLATE,
            row=np.repeat(images, 2),
            component=np.tile(np.arange(2), len(images)),
            residual=residual[images].reshape(-1),
            weight=network.weight[images].reshape(-1),
            cofactor=cofactor[taken].reshape(-1),
            covariance=covariance[taken].reshape(-1, 3),
        )
        return (*(group for group in self.groups if group.known), *self.others), [part]

    def observations(self, state: State) -> tuple[Groups, list[PointRows]]:
        (points, _), sequence, found = self.points(state), self.sequence, []
        for group in self.groups:
            (k, m), rows = group.rays.shape, sequence.row[group.point]
            lines = sequence.start[rows][:, None] + np.arange(m)
            if not group.known:
                of_points = PointRows(
                    point=group.point,
                    line=group.rays,
                    photo=sequence.photo[lines],
                    root=self._root.take(lines, axis=0).reshape(k, 2 * m),
                    A=points.A.take(lines, axis=0),
                    B=points.B.take(lines, axis=0).reshape(k, 2 * m, 3),
                    inverse=points.inverse.take(rows, axis=0),
                    axes=np.broadcast_to(np.eye(3), (k, 3, 3)),
                    index=np.zeros((k, 0), dtype=np.int64),
                    extra=np.zeros((k, 2 * m, 0)),
                )
                found.append(of_points)
        return (*(group for group in self.groups if group.known), *self.others), found

    def _errors(self, state: State, Q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return cofactors of points (k, 3, 3), of images (r, 2), and of both (r, 2, 3), along east, north, up.

        Of points of which nothing is known; Q (e, q, q) is of the stations. `propagation.point_covariances`,
        Q_xx = N_pp^-1 + F Q_ss F', and `reliability.images`: with partials A by the stations, B by the point and
        F = Y'A, (A - B F) Q_ss (A - B F)' + B N_pp^-1 B' = C - 2 D B' + B Q_xx B', where C = A Q_ss A', D = C Y.
        """
        (points, _), sequence = self.points(state), self.sequence
        axes, k, r = self.network.frame.axes(state.ground[sequence.point]), len(sequence.point), len(sequence.rays)
        given = (sequence.start, points, self._root, _plain(axes), sequence.pairs, self.unknowns, Q)
        out = of_points, images, both = np.zeros((k, 3, 3)), np.zeros((r, 2)), np.zeros((r, 2, 3))
        self.of_parts(lambda rows: compiled.spread(rows, *given, *out), self.rows)
        return axes @ of_points @ np.swapaxes(axes, 1, 2), images, both


def _plain(array: FloatArray) -> FloatArray:
    """Return an array as loops are compiled for: in the order of C, and writable."""
    flags = array.flags
    return array if flags.c_contiguous and flags.writeable else np.array(array, order="C")
