"""Which rays go through the water surface, and how that may change from one triangulation to the next.

At the water line the image of a point has a kink. Were a ray wet or dry as the point stands at every moment, a
point near the tide of one of its photos would switch for ever, or stop the run. So the rays keep their state while
a triangulation runs, the formulas going on smoothly through zero depth; after it each point takes the state with
the least squares of those that agree with where it then comes to stand. Where none does, every state taking the
point to the other side of a tide, the sum of squares is least on that water line, and there the point is held.

So it is in IIA, where WATPT corrects the images and no point can be held, in IIIA, and in the search for blunders.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from musatpy.adjustment.collinear import eliminate, local_normals
from musatpy.adjustment.ground import hold, point_normals, settle_group
from musatpy.adjustment.iteration import Outcome, State, heights_and_water
from musatpy.adjustment.network import Network, PointGroup, group_points, together
from musatpy.adjustment.normals import Cofactors, Factor
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.geodesy import water_heights
from musatpy.model.tables import finite_rows

_KINK = 1.0  # of a residual, in height: refraction changes partials by a quarter, and stations follow
_TURNS = 6  # changes of a point after which it rests: those of several points can go round in a circle
# triangulations in a row that end short of their limits: one may be helped by the next, while rays change their
# sides of the water; where that ends short too, points are no guide to the water, and more of them only take time.
# On waves, where one takes many times as long, the first that ends short is the last
SHORT = 2
_SAME = 1e-4  # m, of water lines that points are held on: where the water is tilted they move with the points


@dataclass(frozen=True, kw_only=True, eq=False)
class WaterLine:
    """The state of m rays and of the p points they belong to."""

    wet: BoolArray  # (m,)
    way: IntArray  # (p,) last change of a point: above zero drying, below it flooding, 0 none yet; counts changes
    rests: BoolArray  # (p,) the point changes no more
    level: FloatArray  # (p,) m, of the water line on which a point is held, NaN for most

    def same_as(self, other: WaterLine) -> bool:
        """Return whether no ray and no held point has changed."""
        return self is other or (np.array_equal(self.wet, other.wet) and not _moved(self.level, other.level).any())


def water_line(network: Network, state: State, bathymetric: BoolArray) -> WaterLine:
    """Return the state of the rays of bathymetric points (p,) where they stand."""
    height, water = heights_and_water(network, state, bathymetric)
    return starting_line(height < water, network.points)


def every_ray_wet(network: Network, bathymetric: BoolArray) -> WaterLine:
    """Return the line with all rays of bathymetric points (p,) under water, wherever these stand."""
    return starting_line(np.asarray(bathymetric[network.point]), network.points)


def starting_line(wet: BoolArray, points: int) -> WaterLine:
    """Return the line with rays (m,) under water or not, of so many points that have not moved yet."""
    nothing = np.zeros(points, dtype=int)
    return WaterLine(wet=wet, way=nothing, rests=nothing.astype(bool), level=np.full(points, np.nan))


def refracted(network: Network, line: WaterLine, state: State) -> tuple[Network, State]:
    """Return network and state with the rays refracted that are wet, and points on a water line held there.

    `network` is the measured one.
    """
    network = network.with_plates(network.xy, line.wet).with_heights_held(line.level)
    point = np.flatnonzero(np.isfinite(line.level))
    ground = state.ground.copy()
    ground[point] = hold(network, point, ground[point])
    return network, replace(state, ground=ground)


def at_rest_in_water(
    measured: Network,
    line: WaterLine,
    state: State,
    bathymetric: BoolArray,
    adjusted: Callable[[Network, State, int], Outcome],
    passes: Iterable[int],
) -> tuple[Network, WaterLine, Outcome]:
    """Return network, line and outcome with every ray on the side of the water where its point comes to rest.

    `adjusted` returns the outcome of an adjustment of a network from a state, with all bathymetric points (p,) in
    its state, and its factor where the line may go by it. The numbers of `passes` say how many there may be.
    """
    network, outcome, short = measured, None, 0
    for number in passes:
        network, state = refracted(measured, line, state)
        outcome = adjusted(network, state, number)
        state, last = outcome.state, line
        short = short + 1 if outcome.failure else 0
        if outcome.lost or short == (SHORT if measured.sea is None else 1):
            break
        line = best_line(measured, line, state, bathymetric, outcome.factor)
        if line.same_as(last):
            break
    assert outcome is not None, "there is a pass"
    return network, line, outcome


def best_line(
    network: Network,
    line: WaterLine,
    state: State,
    bathymetric: BoolArray,
    factor: Factor | None = None,
    held: bool = True,
) -> WaterLine:
    """Return the line with every bathymetric point (p,) in its best state at the stations of `state`.

    `network` is the measured one. A point that turns back from its last change lies on the water line between. When
    nothing changes any more, points near a tide are asked once more, whether another state would be better once the
    stations had followed; `factor` is that of the adjustment that led to `state`. Where the height of the
    water is unknown, or waves go on it, nothing can be `held` on its line, and such a point rests as it is.
    """
    if not bathymetric.any():
        return line
    fixed = network.water.unknown or network.sea is not None or not held
    height, water = heights_and_water(network, state, bathymetric)
    present, _ = refracted(network, line, state)
    near = np.zeros(network.points, dtype=bool)
    asked: list[tuple[States, PointGroup, BoolArray]] = []  # and which of them may be asked again
    wet, level = height < water, np.full(network.points, np.nan)
    groups = list(_bathymetric_groups(network, state, bathymetric))
    reach = _reaches(present, state, groups)
    for group, entering in groups:
        gap = water[group.rays] - height[group.rays]
        close = np.abs(gap).min(axis=1) < _KINK * reach[group.point]
        near[group.point] = close
        at_odds = (line.wet[group.rays] != (gap > 0.0)).any(axis=1)
        at_odds |= close | np.isfinite(line.level[group.point])
        chosen = at_odds & ~line.rests[group.point]
        for part in group.some(chosen):
            states = States.of(network, state, part)
            asked.append((states, part, close[chosen] & entering))
            wet[part.rays], level[part.point] = states.best()
    _set_between(network, line, near, water, height, wet, level)
    new = _changed(network, line, water, wet, level, fixed)
    again = [(states.part(rows), part.part(rows)) for states, part, rows in asked if rows.any()]
    if fixed or factor is None or not again or not new.same_as(line):
        return new
    cofactors, wet, level = factor.cofactors(), line.wet.copy(), line.level.copy()
    for states, group in again:
        at = states.present(group, line.wet[group.rays], line.level[group.point], cofactors)
        wet[group.rays], level[group.point] = states.best(at)
    return _changed(network, line, water, wet, level, fixed)


def _set_between(
    network: Network,
    line: WaterLine,
    near: BoolArray,
    water: FloatArray,
    height: FloatArray,
    wet: BoolArray,
    level: FloatArray,
) -> None:
    """Set the water lines (p,) of points `near` them that turn back from their last change, with wet rays (m,)."""
    change, _ = _changes(network, line, wet)
    back = near & (change * line.way < 0)
    if not back.any():
        return
    point = network.point
    turned = np.flatnonzero(back[point] & (wet != line.wet))
    distance, nearest = np.abs(water - height)[turned], np.full(network.points, np.inf)
    np.fmin.at(nearest, point[turned], distance)
    between = turned[distance == nearest[point[turned]]]
    level[point[between]] = water[between]


def _changed(
    network: Network,
    line: WaterLine,
    water: FloatArray,
    wet: BoolArray,
    level: FloatArray,
    fixed: bool,
) -> WaterLine:
    """Return the line with other wet rays (m,) and water lines of points (p,), as far as these may change."""
    if np.array_equal(wet, line.wet) and not np.isfinite([level, line.level]).any():
        return line
    point = network.point
    change, rays = _changes(network, line, wet)
    # a ray that is flooded as another one dries is a change too: such points also go round in a circle
    changed = (rays > 0) | _moved(level, line.level)
    rests = line.rests | (changed & (np.abs(line.way) >= _TURNS)) | (np.isfinite(level) & fixed)
    on_line = np.isfinite(level)[point]
    wet = np.where(on_line, water > level[point], wet)
    sign = np.where(change != 0, np.sign(change), np.where(line.way < 0, -1, 1))
    return WaterLine(
        wet=np.where(rests[point], line.wet, wet),
        way=np.where(changed & ~rests, sign * (np.abs(line.way) + 1), line.way),
        rests=rests,
        level=np.where(rests, line.level, level),
    )


def _changes(network: Network, line: WaterLine, wet: BoolArray) -> tuple[IntArray, IntArray]:
    """Return how many more rays of points (p,) dry than are flooded, with other wet rays (m,), and how many do."""
    dry, flooded = _per_point(network, line.wet & ~wet), _per_point(network, wet & ~line.wet)
    return dry - flooded, dry + flooded


def _moved(level: FloatArray, before: FloatArray) -> BoolArray:
    """Return which points (p,) are held on another water line than before, or no more."""
    return ~np.isclose(level, before, rtol=0.0, atol=_SAME, equal_nan=True)


def _per_point(network: Network, rays: BoolArray) -> IntArray:
    return np.bincount(network.point[rays], minlength=network.points)


def _bathymetric_groups(
    network: Network, state: State, bathymetric: BoolArray
) -> Iterator[tuple[PointGroup, bool]]:
    """Yield the bathymetric points by the rays that give their positions, and whether these enter the adjustment.

    Tied points are not among them: they stand where the ties hold them.
    """
    entering = np.zeros(network.points, dtype=bool)
    for group in network.groups:
        entering[group.point] = True
        if not group.kept:
            yield from ((part, True) for part in group.some(bathymetric[group.point]))
    others = bathymetric & finite_rows(state.ground) & ~entering
    if others.any():
        every_ray = np.ones(len(network.point), dtype=bool)
        for part in group_points(network.photo, network.point, every_ray, others):
            yield part, False


def _reaches(network: Network, state: State, groups: Iterable[tuple[PointGroup, bool]]) -> FloatArray:
    """Return (p,) m how far the largest of their residuals moves points of groups, entering or not, upward.

    So far the kink of their images could bring them: on the other side of the water the same residuals pull at
    other partials. NaN for others.
    """
    out = np.full(network.points, np.nan)
    for group in together([group for group, _ in groups]):
        X = state.ground[group.point]
        normals = point_normals(network, state, group, X, stations=False)
        up = np.einsum("kij,kj->ki", normals.axes, network.frame.vertical(X)[0])
        variance = np.einsum("ki,kij,kj->k", up, np.linalg.inv(normals.matrix), up)
        square = np.max(np.square(normals.residual) * network.weight[group.rays], axis=(1, 2))
        out[group.point] = square * variance
    return np.sqrt(out)


@dataclass(frozen=True, kw_only=True, eq=False)
class Present:
    """The normals of k points in the states that they have, and the cofactors (k, u, u) of all their unknowns."""

    normals: LocalNormals
    cofactors: FloatArray

    def following(self, row: IntArray, other: LocalNormals) -> tuple[FloatArray, FloatArray]:
        """Return by how much squares fall and heights rise (t,) where stations follow points `row` (t,) to others.

        With N' = N + dN and the right side dr that is left of an adjustment at its minimum, the step is N'^-1 dr,
        and the sum of squares falls by dr' N'^-1 dr; of N'^-1 only the part of the point is needed,
        (I + Q dN)^-1 Q.
        """
        Q, dr = self.cofactors[row], (other.rhs - self.normals.rhs[row])[..., None]
        change = np.eye(Q.shape[1]) + Q @ (other.matrix - self.normals.matrix[row])
        step = np.linalg.solve(change, Q @ dr)[..., 0]
        return np.sum(dr[..., 0] * step, axis=1), np.sum(other.rise * step, axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class States:
    """The states of k points with m rays and T tides, with the points at rest in each, at stations as they are.

    Rays of lower tides dry first: state j of a point has those of its j lowest tides dry, and agrees with where
    the point then stands if that is not below tide j, but below tide j + 1. Where each point has one tide, its rays
    dry together. Where state j - 1 takes the point over tide j and state j takes it back under, the sum of squares
    has a minimum on that water line, at the kink of its images.
    """

    lone: LonePoints
    row: IntArray  # (k,) of the group of `lone`
    rank: IntArray  # (k, m) of the tides of rays
    tide: FloatArray  # (k, T) ascending
    start: FloatArray  # (k, 3) where the points are
    X: FloatArray  # (k, T + 1, 3)
    squares: FloatArray  # (k, T + 1)

    @classmethod
    def of(cls, network: Network, state: State, group: PointGroup) -> States:
        """Return those of the points of a group; `network` is the measured one."""
        start, points = state.ground[group.point], LonePoints(network=network, state=state, group=group)
        given = state.tide[network.photo[group.rays]]
        tides = water_heights(network.slope(state.tilt), given, np.repeat(start[:, None], given.shape[1], axis=1))
        rank, tide = np.zeros(tides.shape, dtype=int), tides[:, :1]
        if (tides != tide).any():
            rank = np.argsort(np.argsort(tides, axis=1, kind="stable"), axis=1, kind="stable")
            tide = np.sort(tides, axis=1)
        k, T = tide.shape
        row, number = np.repeat(np.arange(k), T + 1), np.tile(np.arange(T + 1), k)
        X, squares = points.settled(row, rank[row] >= number[:, None], start[row])
        return cls(
            lone=points,
            row=np.arange(k),
            rank=rank,
            tide=tide,
            start=start,
            X=X.reshape(k, T + 1, 3),
            squares=squares.reshape(k, T + 1),
        )

    def part(self, chosen: BoolArray) -> States:
        """Return those of some of the points."""
        arrays = {one.name: getattr(self, one.name)[chosen] for one in fields(self)[1:]}
        return replace(self, **arrays)

    def present(self, group: PointGroup, wet: BoolArray, level: FloatArray, cofactors: Cofactors) -> Present:
        """Return the normals of the points, those of `group`, as rays are `wet` (k, m) and points held.

        `cofactors` are those of the adjustment that has them so, at its minimum.
        """
        normals = self.lone.normals(self.row, wet, self.start, level)
        Q = cofactors.with_border(self.lone.network.photo[group.rays], normals.columns)
        return Present(normals=normals, cofactors=Q)

    def best(self, present: Present | None = None) -> tuple[BoolArray, FloatArray]:
        """Return which rays (k, m) of the points are wet, and the water line (k,) that they are on, or NaN.

        The least squares count, of the states that agree with where the points then stand, and of the water lines
        between states that do not. Stations stay as they are; with `present` they follow each point.
        """
        (k, T), frame = self.tide.shape, self.lone.network.frame
        squares, height = np.full((k, 2 * T + 1), np.inf), frame.height(self.X)
        squares[:, ::2] = self.squares
        if present is not None:
            row, number = np.repeat(np.arange(k), T + 1), np.tile(np.arange(T + 1), k)
            fall, rise = self._following(present, row, self.rank[row] >= number[:, None], self.X.reshape(-1, 3))
            squares[:, ::2] -= fall.reshape(k, -1)
            height = height + rise.reshape(k, -1)
        # under tide j in state j, and over it in state j - 1
        sunk, risen = height[:, 1:] < self.tide, height[:, :-1] >= self.tide
        squares[:, 2::2][sunk] = squares[:, :-1:2][risen] = np.inf
        row, number = np.nonzero(sunk & risen)
        if len(row):
            wet, level = self.rank[row] > number[:, None], self.tide[row, number]
            X, on_line = self.lone.settled(self.row[row], wet, self.start[row], level)
            if present is not None:
                on_line -= self._following(present, row, wet, X, level)[0]
            squares[row, 2 * number + 1] = on_line
        squares[~np.isfinite(squares)] = np.inf
        some = np.isfinite(squares).any(axis=1)
        best = np.where(some, np.argmin(squares, axis=1), 2 * np.sum(self.tide <= height[:, :1], axis=1))
        dry = (best + 1) // 2  # so many tides; on a water line its own is, as good as wet
        line = self.tide[np.arange(k), np.minimum(best // 2, T - 1)]
        return self.rank >= dry[:, None], np.where(best % 2 == 1, line, np.nan)

    def _following(
        self, present: Present, row: IntArray, wet: BoolArray, X: FloatArray, level: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        level = np.full(len(row), np.nan) if level is None else level
        return present.following(row, self.lone.normals(self.row[row], wet, X, level))


class LocalNormals(NamedTuple):
    """The reduced normals of t points, each for itself: u unknowns, those of its stations and X global ones."""

    matrix: FloatArray  # (t, u, u)
    rhs: FloatArray  # (t, u)
    rise: FloatArray  # (t, u) of the height of the point, which follows
    columns: IntArray  # (t, X) of the border


@dataclass(frozen=True, kw_only=True, eq=False)
class LonePoints:
    """Points of a group, each for itself, at stations as they are.

    Of `row` (t,), in which one can be more than once, those rays go through the water that are `wet` (t, m), and
    points are held on water lines `level` (t,), where there are any that are not NaN.
    """

    network: Network
    state: State
    group: PointGroup

    def settled(
        self, row: IntArray, wet: BoolArray, start: FloatArray, level: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return where the points come to rest (t, 3), from where they start, and their weighted squares (t,)."""
        network, group = self._apart(row, wet, level, self.group.known or level is not None)
        start = start if level is None else hold(network, group.point, start)
        return settle_group(network, self.state, group, start)

    def normals(self, row: IntArray, wet: BoolArray, X: FloatArray, level: FloatArray) -> LocalNormals:
        """Return their normals where they are."""
        network, group = self._apart(row, wet, level, known=True)
        E = eliminate(network, self.state, group, X)
        matrix, rhs = local_normals(network, group, E)
        up = np.einsum("kij,kj->ki", E.normals.axes, network.frame.axes(X)[:, 2])
        return LocalNormals(matrix, rhs, -np.einsum("ki,kiu->ku", up, E.F), E.extras.index)

    def _apart(
        self, row: IntArray, wet: BoolArray, level: FloatArray | None, known: bool
    ) -> tuple[Network, PointGroup]:
        group = replace(self.group.part(row), known=known)
        xy = self.network.xy[group.rays.reshape(-1)]
        network, (group,) = self.network.apart([group], xy, wet.reshape(-1))
        return network if level is None else network.with_heights_held(level), group
