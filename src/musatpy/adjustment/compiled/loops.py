"""The points of a network that compiled loops take: what these take, out of network and state."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self, TypeVar

import numpy as np

from musatpy.adjustment.collinear import Follow
from musatpy.adjustment.compiled import elimination, spreading, starting
from musatpy.adjustment.compiled.compiler import is_kept
from musatpy.adjustment.compiled.elimination import Eliminated, Known, Pairs, Sums
from musatpy.adjustment.compiled.rays import Measured, Stations, Water
from musatpy.adjustment.dependence import Diagonal
from musatpy.adjustment.kernels import Groups, Loops
from musatpy.adjustment.kinds import WATER
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import Cofactors, NormalEquations
from musatpy.adjustment.point_normals import RIDGE, Priors, hold, prior_rows, steps_to_best, with_known
from musatpy.adjustment.reliability import Part
from musatpy.adjustment.threads import side_by_side
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water_surface import surface
from musatpy.arrays import BoolArray, FloatArray, IntArray, order_of
from musatpy.model import ObservationKind

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
    first_pair: IntArray  # (n + 1,) of each photo in the pattern
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
        pattern, photo = network.pattern, network.photo[rays]
        first = np.searchsorted(pattern.pairs[:, 0], np.arange(pattern.count + 1))
        slots = np.empty(int(np.sum(size * (size + 1) // 2)), dtype=np.int32)
        pairs = Pairs(start=np.empty(len(point) + 1, dtype=np.int64), slot=slots)
        elimination.find_pairs(start, photo, first, np.ascontiguousarray(pattern.pairs[:, 1]), pairs)
        return cls(point=point, row=row, start=start, rays=rays, photo=photo, first_pair=first, pairs=pairs)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Some rows of a sequence, and the blocks of the pattern that their pairs lie in: from `first` to `last`."""

    rows: IntArray
    first: int
    last: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """What loops see in a state."""

    at: Measured
    stations: Stations
    water: Water
    known: Known
    priors: Priors  # of the known points

    @property
    def seen(self) -> tuple[Measured, Stations, Water]:
        return self.at, self.stations, self.water

    @property
    def all(self) -> tuple[Measured, Stations, Water, Known, float]:
        return self.at, self.stations, self.water, self.known, RIDGE


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledFollow:
    """How the points follow a step: what is left of their elimination in a scene."""

    loops: CompiledLoops
    scene: Scene
    eliminated: Eliminated

    def move(self, network: Network, state: State, step: FloatArray, ground: FloatArray) -> None:
        """Set the points of `ground` (p, 3) where they are after a step (u,) of all unknowns from `state`."""
        stations = _plain(step[: network.pattern.order].reshape(network.photos, -1))
        at, of_stations, water, known, _ = self.scene.all
        self.loops.of_parts(
            lambda part: elimination.follow(
                part.rows, at, of_stations, water, known, self.eliminated, stations, ground
            )
        )
        point = self.loops.known_points
        ground[point] = hold(network, point, ground[point])


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledLoops(Loops):
    """Loops over the points that have no unknowns but their own and those of their photos; `others` are left."""

    others: Groups
    _last: list[tuple[tuple[object, ...], Scene]] = field(default_factory=list, repr=False)

    @classmethod
    def of(cls, network: Network, groups: Iterable[PointGroup]) -> Self:
        """Return the loops over some groups.

        Others are kept points, those of equal elevations, and all with a wet ray through waves, or where the border
        has unknowns of the water.
        """
        border = network.border
        unknown = network.sea is not None or any(len(border.numbers(kind.observed)) for kind in WATER)
        mine: list[PointGroup] = []
        others: list[PointGroup] = []
        for group in groups:
            if group.kept or (group.known and border.count(ObservationKind.EQUAL_ELEVATION)):
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

    @property
    def known_points(self) -> IntArray:
        """The points (h,) themselves."""
        return self.sequence.point[self.known_rows]

    def parts(self, rows: IntArray) -> list[Rows]:
        """Return rows in parts of as many rays: how many does not depend on the threads, so that sums do not."""
        sequence = self.sequence
        rays = np.cumsum(sequence.start[rows + 1] - sequence.start[rows])
        total = int(rays[-1]) if len(rays) else 0
        count = min(_MOST, max(1, total // _PART))
        pieces = np.split(rows, np.searchsorted(rays, total * np.arange(1, count) / count))
        parts = []
        for piece in filter(len, pieces):
            photo = sequence.photo[sequence.start[piece[0]] : sequence.start[piece[-1] + 1]]
            first, last = sequence.first_pair[photo[0]], sequence.first_pair[photo.max() + 1]
            parts.append(Rows(rows=piece, first=int(first), last=int(last)))  # the first photo is the lowest
        return parts

    def of_parts(self, work: Callable[[Rows], Result], rows: IntArray | None = None) -> list[Result]:
        """Return the results of `work` at rows in parts, in their order."""
        parts = self.parts(self.rows if rows is None else rows)
        return list(side_by_side(work, parts, len(self.sequence.rays)))

    def scene(self, state: State) -> Scene:
        """Return what is seen in a state: each step is judged where it leads, and the next one begins there."""
        of = (state.position, state.attitude, state.ground, state.tide, state.tilt, state.index, state.levels)
        if not self._last or any(a is not b for a, b in zip(self._last[0][0], of, strict=True)):
            self._last[:] = [(of, self._scene(state))]
        return self._last[0][1]

    def _scene(self, state: State) -> Scene:
        network, sequence, kappa = self.network, self.sequence, state.attitude[:, 2]
        at = Measured(
            point=sequence.point,
            start=sequence.start,
            photo=sequence.photo,
            xy=network.xy.take(sequence.rays, axis=0),
            root=np.sqrt(network.weight.take(sequence.rays, axis=0)),
            ground=state.ground.take(sequence.point, axis=0),
        )
        turn = np.stack([np.cos(kappa), np.sin(kappa)], axis=1)
        arrays = (state.position, state.M, network.axes, turn, network.focal_length, network.principal_point)
        priors = prior_rows(network, state, self.known_points, state.ground[self.known_points])
        row = np.full(len(sequence.point), -1)
        row[self.known_rows] = np.arange(len(self.known_rows))
        weight = np.ascontiguousarray(priors.weight[:, :3])
        return Scene(
            at=at,
            stations=Stations(*map(_plain, arrays)),
            water=self._water(state),
            known=Known(
                row=row,
                axes=_plain(priors.axes),
                free=priors.free,
                weight=weight,
                pull=weight * priors.deviation[:, :3],
            ),
            priors=priors,
        )

    def _water(self, state: State) -> Water:
        """Return the level water over the points."""
        network, rays = self.network, self.sequence.rays
        wet = np.flatnonzero(network.refracted[rays])
        row, wet_rays = np.full(len(rays), -1), rays[wet]
        row[wet] = np.arange(len(wet))
        ground, tide = state.ground[network.point[wet_rays]], state.tide[network.photo[wet_rays]]
        over = surface(network.frame, network.slope(state.tilt), tide, ground)
        return Water(
            row=row,
            normal=_plain(over.normal),
            depth=_plain(over.depth),
            tangent=np.full(len(wet), np.nan),
            rise=_plain(1.0 / over.secant),
            refraction=float(state.index),
            unknowns=(0,) * network.pattern.size,
        )

    def get_ready(self, state: State, say: Callable[[], None]) -> None:
        if is_kept(elimination.eliminate):
            return
        say()
        rows, scene, pairs, q = (
            np.zeros(0, dtype=np.int64),
            self.scene(state),
            self.sequence.pairs,
            self.network.pattern.size,
        )
        X, of_rows, blocks, rhs = np.empty((0, 3)), np.empty(0), np.empty((0, q, q)), np.empty((0, q))
        matrices, xy = np.empty((0, 3, 3)), np.empty((0, 2))
        of = Eliminated(shift=X, inverse=matrices)
        starting.meet(rows, scene.at, scene.stations, 0.0, X, np.empty(0, dtype=bool))
        elimination.residuals(rows, *scene.seen, xy, of_rows)
        elimination.steps(rows, *scene.all, X, of_rows, of_rows)
        elimination.eliminate(rows, *scene.all, pairs, Sums(first=0, blocks=blocks, rhs=rhs), of)
        elimination.follow(rows, *scene.seen, scene.known, of, rhs, X)
        out = spreading.Spread(
            axes=matrices, point=matrices, image=xy, covariance=np.empty((0, 2, 3)), diagonal=rhs
        )
        spreading.spread(rows, *scene.all, pairs, blocks, out)

    def eliminate(self, state: State, normals: NormalEquations, follows: list[Follow]) -> tuple[Groups, float]:
        scene, sequence, (blocks, rhs) = self.scene(state), self.sequence, normals.sums
        k = len(sequence.point)
        out = Eliminated(shift=np.empty((k, 3)), inverse=np.empty((k, 3, 3)))

        def work(part: Rows) -> tuple[Rows, Sums, float]:
            own = np.zeros((part.last - part.first, *blocks.shape[1:]))
            sums = Sums(first=part.first, blocks=own, rhs=np.zeros_like(rhs))
            return part, sums, elimination.eliminate(part.rows, *scene.all, sequence.pairs, sums, out)

        total = 0.0
        for part, sums, gain in self.of_parts(work):
            blocks[part.first : part.last] += sums.blocks
            rhs += sums.rhs
            total += gain
        follows.append(CompiledFollow(loops=self, scene=scene, eliminated=out))
        return self.others, total

    def settle(self, state: State, ground: FloatArray, squares: FloatArray) -> Groups:
        point = self.sequence.point
        shift, objective, falls = np.empty((len(point), 3)), np.empty(len(point)), np.empty(len(point))

        def step(some: IntArray, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            every, rows = ground.copy(), self.rows[some]
            every[point[rows]] = X
            scene = self._scene(replace(state, ground=every))
            self.of_parts(lambda part: elimination.steps(part.rows, *scene.all, shift, objective, falls), rows)
            objective[self.known_rows] += scene.priors.squares
            return shift[rows], objective[rows], falls[rows]

        mine = point[self.rows]
        ground[mine], squares[mine] = steps_to_best(
            step, ground[mine], lambda some, X: hold(self.network, mine[some], X), each=True
        )
        return self.others

    def meet(self, state: State, limit: float, ground: FloatArray, parallel: BoolArray) -> Groups:
        sequence, scene = self.sequence, self.scene(state)
        X, of_rows = np.empty((len(sequence.point), 3)), np.empty(len(sequence.point), dtype=bool)
        self.of_parts(lambda part: starting.meet(part.rows, scene.at, scene.stations, limit, X, of_rows))
        point, known, frame = sequence.point[self.rows], self.known_points, self.network.frame
        ground[point], parallel[point] = X[self.rows], of_rows[self.rows]
        ground[known] = frame.from_level(with_known(self.network, known, frame.level(ground[known])))
        return self.others

    def set_squares(self, state: State, squares: FloatArray) -> Groups:
        scene, sequence = self.scene(state), self.sequence
        off, of_rows = np.empty((len(sequence.rays), 2)), np.empty(len(sequence.point))
        self.of_parts(lambda part: elimination.residuals(part.rows, *scene.seen, off, of_rows))
        of_rows[self.known_rows] += scene.priors.squares
        squares[sequence.point[self.rows]] = of_rows[self.rows]
        return self.others

    def set_residuals(self, state: State, residual: FloatArray) -> Groups:
        scene, sequence = self.scene(state), self.sequence
        off, of_rows = np.full((len(sequence.rays), 2), np.nan), np.empty(len(sequence.point))
        self.of_parts(lambda part: elimination.residuals(part.rows, *scene.seen, off, of_rows))
        residual[sequence.rays] = off
        return self.others

    def spread(
        self, state: State, cofactors: Cofactors, residual: FloatArray, points: FloatArray, diagonal: Diagonal
    ) -> tuple[Groups, list[Part]]:
        network, sequence, scene = self.network, self.sequence, self.scene(state)
        rows = np.setdiff1d(self.rows, self.known_rows, assume_unique=True)
        taken = np.repeat(np.isin(np.arange(len(sequence.point)), rows), np.diff(sequence.start))
        images, k = sequence.rays[taken], len(sequence.point)
        axes = _plain(network.frame.axes(state.ground[sequence.point]))
        point, image, covariance = np.empty((k, 3, 3)), np.empty((len(taken), 2)), np.empty((len(taken), 2, 3))

        def work(part: Rows) -> FloatArray:
            of_part = np.zeros_like(diagonal.stations)
            out = spreading.Spread(axes=axes, point=point, image=image, covariance=covariance, diagonal=of_part)
            spreading.spread(part.rows, *scene.all, sequence.pairs, cofactors.blocks, out)
            return of_part

        for of_part in self.of_parts(work, rows):
            diagonal.stations += of_part
        points[sequence.point[rows]] = point[rows]
        part = Part(
            kind=ObservationKind.PLATE,
            row=np.repeat(images, 2),
            component=np.tile(np.arange(2), len(images)),
            residual=residual[images].reshape(-1),
            weight=network.weight[images].reshape(-1),
            cofactor=image[taken].reshape(-1),
            covariance=covariance[taken].reshape(-1, 3),
        )
        return (*(group for group in self.groups if group.known), *self.others), [part]


def _plain(array: FloatArray) -> FloatArray:
    """Return an array as loops are compiled for: in the order of C, and writable."""
    flags = array.flags
    return array if flags.c_contiguous and flags.writeable else np.array(array, order="C")
