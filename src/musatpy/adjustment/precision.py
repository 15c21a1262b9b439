"""How well a solution is known: covariances of stations, water, points and depths, and the observations' checks.

Covariances are those of the estimates, scaled by the variance of unit weight, and what comes to them from
considered parameters, which is not (`considered`). Of points whose rays, and of water of which the images, do not
determine it, no number is stated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment import propagation
from musatpy.adjustment.collinear import eliminate
from musatpy.adjustment.iteration import LEVEL, State, is_considered, stated
from musatpy.adjustment.kernels import Loops, loops_of
from musatpy.adjustment.kinds import WATER
from musatpy.adjustment.network import Network, Participation, PointGroup
from musatpy.adjustment.normals import SINGULAR, Cofactors, Factor, NormalMatrix, factorised
from musatpy.adjustment.propagation import Diagonal, depth_cofactors, pieces, point_covariances
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import AdjustmentError, Problem
from musatpy.model import (
    Block,
    ConsideredWater,
    Dependence,
    LevelPairs,
    ObservationKind,
    Observations,
    Program,
    StationPairs,
    Treatment,
    WaterPrecision,
    Weights,
)
from musatpy.model.tables import falling, finite_rows
from musatpy.model.water import index_range

if TYPE_CHECKING:
    from musatpy.adjustment.considered import Considered
    from musatpy.adjustment.datum import Freedom, InnerConstraints


NOTHING_HELD = np.zeros(0, dtype=np.int64)
_DECIMALS = 4  # of correlations, as they are printed
CORRELATED = 0.95  # correlations from here on are listed
PART_OF_HEIGHT = 0.1  # of the flying height: a place or a level with a larger sigma is not known
_MANY = 1000  # submerged points, beyond which some of them tell what all do
FARTHEST = 100.0  # flying heights: a point of the adjustment that is farther has run away, and is rejected


@dataclass(frozen=True, kw_only=True, eq=False)
class Covariances:
    """Covariances of a solution, in metres and radians; those of p points along east, north, up."""

    unit_sigma: float  # standard deviation of unit weight that scales the covariances of the estimates
    cofactors: Cofactors  # of the unknowns, for unit weight, without what is considered
    unknowns: Cofactors  # the covariances of the unknowns
    points: FloatArray  # (p, 3, 3) m2, NaN where not determined
    depths: FloatArray  # (p,) m2, variance of the water over a submerged point minus its height, NaN likewise
    observed: Observations
    diagonal: Diagonal
    loops: Loops  # over the points that take part
    full: Factor  # of the normal equations by full weights
    wide: Considered | None
    pairs: StationPairs
    levels: LevelPairs | None  # None: no photo has a level of its own as an unknown
    water: WaterPrecision | None

    @property
    def border_sigma(self) -> FloatArray:
        """(g,) standard deviations of the global unknowns."""
        return np.sqrt(np.diagonal(self.unknowns.corner))

    @property
    def considered(self) -> ConsideredWater | None:
        """The considered parameters."""
        return None if self.wide is None else self.wide.parameters


def factor_of(matrix: NormalMatrix) -> Factor:
    """Return the factor of the normal equations of a last iteration. Raises `AdjustmentError`."""
    factor = factorised(matrix) or factorised(matrix, SINGULAR)
    if factor is None:
        message = "the normal equations of the last iteration cannot be solved: points have run away"
        advice = "gross errors make them (OP2 editing EDIT looks for these and takes them out)"
        raise AdjustmentError([Problem(message=f"{message}, as {advice}")])
    return factor


def precision(
    block: Block,
    network: Network,
    state: State,
    factor: Factor,
    free: Freedom | None,
    residual: FloatArray,
    squares: float,
    dof: int,
) -> Covariances:
    """Return the precision of a solution at `state`.

    `network` has the true rays: straight ones would make depths look n times as sure. `factor` is that of its
    normals, `residual` (m, 2) mm are those of all plate coordinates, `squares` is their weighted sum with that of
    all others.
    """
    held, inner, cofactors = _held(network, state, factor, free)
    full = factor
    if block.options.program is Program.IIA and block.options.weights is not Weights.FULL:
        from musatpy.adjustment.collinear import Simultaneous  # only here, and it would load with every run

        # full weights, by which observations check each other
        full = factor_of(Simultaneous(network=network, options=block.options).linearise(state).matrix)
    considered = None
    if _has_considered(block, network):
        from musatpy.adjustment.considered import considered_parameters  # most jobs have none

        considered = considered_parameters(block, network, state, full, free.held if free else NOTHING_HELD, inner)
    left = squares - (considered.parameters.explained if considered else 0.0)
    unit_sigma = float(np.sqrt(max(left, 0.0) / dof)) if dof > 0 else 1.0
    estimates = ErrorSources(network=network, state=state, cofactors=held, inner=inner)
    spread, of_depths = _spread(estimates, block, residual)
    points, depths = spread.points * unit_sigma**2, of_depths * unit_sigma**2
    unknowns = estimated = cofactors.times(unit_sigma**2)
    if full is not factor:
        # conditions with simple weights have no redundancy numbers of single observations
        spread = spread_to_observations(replace(estimates, cofactors=full.cofactors()), block, residual)
    observed = propagation.joined(spread.parts)
    if considered is not None:
        errors = ErrorSources(
            network=considered.network,
            state=considered.state,
            cofactors=considered.cofactors,
            of_parameters=True,
        )
        other, of_depths = _spread(errors, block, residual)
        points, depths = points + other.points, depths + of_depths
        unknowns = considered.with_covariances(unknowns)
        observed = replace(observed, considered=propagation.variances(other.parts))
    unknowns, estimated = (stated(network, state, of) for of in (unknowns, estimated))
    return Covariances(
        unit_sigma=unit_sigma,
        cofactors=cofactors,
        unknowns=unknowns,
        points=points,
        depths=depths,
        observed=observed,
        diagonal=spread.diagonal,
        loops=estimates.loops,
        full=full,
        wide=considered,
        pairs=_pairs(unknowns),
        levels=_level_pairs(unknowns),
        water=_water_precision(network, estimated, considered),
    )


def _pairs(covariances: Cofactors) -> StationPairs:
    """Return the covariances of stations that meet in a point."""
    photo = covariances.pattern.pairs
    apart = photo[:, 0] < photo[:, 1]
    return StationPairs(photo=photo[apart], covariance=covariances.blocks[apart, :6, :6])


def _level_pairs(covariances: Cofactors) -> LevelPairs | None:
    """Return the covariances of the levels of single photos, None where these are no unknowns."""
    if covariances.pattern.size == 6:
        return None
    blocks = covariances.blocks
    return LevelPairs(
        photo=covariances.pattern.pairs,
        of_first=blocks[:, :6, LEVEL],
        of_second=blocks[:, LEVEL, :6],
        level=blocks[:, LEVEL, LEVEL],
    )


def _water_precision(
    network: Network, estimated: Cofactors, considered: Considered | None
) -> WaterPrecision | None:
    """Return the joint covariances of the water and of lenses that are unknown, and of water that is considered."""
    border, rows, corner = network.border, estimated.border, estimated.corner
    if considered is not None:
        border, spread = considered.network.border, considered.cofactors
        wide = np.zeros((len(considered.free), len(considered.free)))
        wide[np.ix_(considered.free, considered.free)] = corner
        corner, full = wide + spread.corner, spread.border.copy()
        full[:, considered.free] += rows
        rows = full
    lens = [ObservationKind.LENS] if network.lenses is not None else []
    water = np.sort(np.concatenate([border.numbers(kind) for kind in (*(of.observed for of in WATER), *lens)]))
    if not len(water):
        return None
    names = border.names([""] * network.points)
    of_stations = rows[:, water].reshape(network.photos, network.pattern.size, -1)
    return WaterPrecision(
        names=tuple(names[column] for column in water),
        covariance=corner[np.ix_(water, water)],
        stations=of_stations[:, :6],
        levels=of_stations[:, LEVEL] if network.water.per_photo else np.empty((0, len(water))),
    )


def _has_considered(block: Block, network: Network) -> bool:
    """Return whether anything that is held has a sigma: cameras in IIA; water and waves, with submerged points."""
    if not network.parameters and block.lens_unknowns.count:
        return True
    waves = network.sea is not None and network.sea.sea.considered
    return bool(block.points.bathymetric.any()) and (is_considered(block, network.water) or waves)


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorSources:
    """Errors that spread to points: those of unknowns with these cofactors, and of the images and priors of points.

    Without the latter where they come from considered parameters alone. `alone`: see `propagation.priors`.
    """

    network: Network
    state: State
    cofactors: Cofactors
    inner: InnerConstraints | None = None
    of_parameters: bool = False
    alone: bool = True

    @cached_property
    def loops(self) -> Loops:
        """Over the points that take part."""
        return loops_of(self.network, self.network.groups)


@dataclass(frozen=True, kw_only=True, eq=False)
class PropagatedCofactors:
    """Cofactors of points (p, 3, 3), NaN where not determined, and those of the observations."""

    points: FloatArray
    parts: list[propagation.PropagatedObservations]
    diagonal: Diagonal


def spread_to_observations(errors: ErrorSources, block: Block, residual: FloatArray) -> PropagatedCofactors:
    """Return how errors spread to the points that take part and to all observations; `residual` (m, 2) mm."""
    network, state, cofactors = errors.network, errors.state, errors.cofactors
    points = np.full((network.points, 3, 3), np.nan)
    parts, diagonal = list(propagation.direct(network, state, cofactors)), Diagonal(network)
    diagonal.add_direct(network, state)
    groups: tuple[PointGroup, ...] = network.groups
    if errors.inner is None and not errors.of_parameters:
        groups, images = errors.loops.spread(state, cofactors, residual, points, diagonal)
        parts += images
    for group in groups:
        for rows, piece in _pieces(errors, group):
            points[group.point[rows]] = point_covariances(network, piece, cofactors, errors.inner)
            parts += [propagation.images(network, piece, residual), *propagation.priors(piece, block, errors.alone)]
            diagonal.add(network, piece)
    return PropagatedCofactors(points=points, parts=parts, diagonal=diagonal)


def _spread(errors: ErrorSources, block: Block, residual: FloatArray) -> tuple[PropagatedCofactors, FloatArray]:
    """Return the same with the points that took no part and have a position, and the cofactors (p,) of depths."""
    spread = spread_to_observations(errors, block, residual)
    for group in errors.network.left_out:
        for rows, piece in _pieces(errors, group):
            covariance = point_covariances(errors.network, piece, errors.cofactors, errors.inner)
            spread.points[group.point[rows]] = covariance
    return spread, _depths(errors, block, spread.points)


def _depths(errors: ErrorSources, block: Block, points: FloatArray) -> FloatArray:
    """Return the cofactors (p,) of depths, NaN for points on land; `points` (p, 3, 3) are those of positions."""
    network, state, submerged = errors.network, errors.state, block.points.bathymetric
    depths = np.full(network.points, np.nan)
    if not network.water.unknown:
        wet = np.flatnonzero(submerged & finite_rows(state.ground))
        by_point = network.frame.axes(state.ground[wet]) @ network.slope(state.tilt) - np.array([0.0, 0.0, 1.0])
        depths[wet] = np.einsum("ki,kij,kj->k", by_point, points[wet], by_point)
        return depths
    for group in (*network.groups, *network.left_out):
        part = group.part(submerged[group.point])
        for rows, piece in _pieces(errors, part):
            depths[part.point[rows]] = depth_cofactors(network, state, piece, errors.cofactors, errors.inner)
    return depths


def mean_depth(block: Block, network: Network, state: State, known: Covariances) -> FloatArray | None:
    """Return the cofactors (u + 1,) of the mean depth of submerged points with all unknowns, then its own.

    None where no such point takes part; of more than a thousand, every second, third, ... counts. No motion of the
    datum is free.
    """
    step = 1 + np.count_nonzero(block.points.bathymetric) // _MANY
    partials, own, count = np.zeros(network.pattern.order + network.border.size), 0.0, 0
    for group in network.groups:
        part = group.part(np.flatnonzero(block.points.bathymetric[group.point])[::step])
        for _, piece in pieces(network, state, part, known.cofactors):
            columns, by_unknowns, by_point = propagation.depth_partials(network, state, piece)
            np.add.at(partials, network.unknowns(piece.group, columns), by_unknowns)
            own += float(np.einsum("ki,kij,kj->", by_point, piece.E.inverse, by_point))
            count += len(by_point)
    if not count:
        return None
    cofactors = known.full.solve(partials / count)
    return np.append(cofactors, partials @ cofactors / count + own / count**2)


def _pieces(errors: ErrorSources, group: PointGroup) -> Iterator[tuple[slice, propagation.Piece]]:
    for rows, piece in pieces(errors.network, errors.state, group, errors.cofactors):
        if errors.of_parameters:
            piece = replace(piece, E=replace(piece.E, inverse=np.zeros_like(piece.E.inverse)))
        yield rows, piece


def _held(
    network: Network, state: State, factor: Factor, free: Freedom | None
) -> tuple[Cofactors, InnerConstraints | None, Cofactors]:
    """Return the cofactors, unknowns held as in the iteration; the inner constraints; the cofactors under these."""
    if free is None or not free.count:
        cofactors = factor.cofactors()
        return cofactors, None, cofactors
    from musatpy.adjustment.datum import inner_constraints  # most jobs do without

    held, inner = factor.cofactors().holding(free.held), inner_constraints(network, state, factor, free)
    return held, inner, inner.cofactors(held)


def dependence(
    network: Network,
    diagonal: Diagonal,
    cofactors: Cofactors,
    covariances: Cofactors,
    name: Callable[[int], str],
) -> Dependence:
    """Return variance inflation and correlations; `name` names the unknowns of the normal equations."""
    n, q = network.photos, network.pattern.size
    variances = cofactors.diagonal()
    photo, border = variances[: n * q].reshape(n, q), variances[n * q :]
    first, second, value = _correlated(cofactors, photo.reshape(-1), border)
    with np.errstate(invalid="ignore"):
        inflation = np.where(photo > 0.0, photo * diagonal.stations, np.nan)
    # the water levels of single photos stand with the six unknowns of their photos
    level = np.arange(n * q).reshape(n, q)[:, 6:][np.isfinite(inflation[:, 6:])]
    numbers = np.concatenate([level, n * q + np.arange(network.border.size)])
    factors = np.concatenate([inflation.reshape(-1)[level], border * diagonal.border])
    return Dependence(
        station_inflation=inflation[:, :6],
        names=np.array([name(int(i)) for i in numbers], dtype=str),
        sigma=np.where(factors > 0.0, np.sqrt(np.maximum(covariances.diagonal()[numbers], 0.0)), np.nan),
        inflation=np.where(factors > 0.0, factors, np.nan),  # 0 is of what no observation touches
        first=np.array([name(int(i)) for i in first], dtype=str),
        second=np.array([name(int(i)) for i in second], dtype=str),
        correlation=value,
    )


def _correlated(
    cofactors: Cofactors, photo: FloatArray, border: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return numbers (c,), (c,) of unknowns and their correlations, the strongest first."""
    q, split = cofactors.pattern.size, len(photo)
    scale = np.sqrt(np.where(photo > 0.0, photo, np.inf)), np.sqrt(np.where(border > 0.0, border, np.inf))
    per_photo = scale[0].reshape(-1, q)
    i, j = cofactors.pattern.pairs.T
    blocks = cofactors.blocks / (per_photo[i][:, :, None] * per_photo[j][:, None, :])
    lower = (i == j)[:, None, None] & (np.arange(q)[:, None] >= np.arange(q))
    pair, row, column = np.nonzero((np.abs(blocks) >= CORRELATED) & ~lower)
    edge = cofactors.border / (scale[0][:, None] * scale[1])
    edge_row, edge_column = np.nonzero(np.abs(edge) >= CORRELATED)
    corner = np.triu(cofactors.corner / (scale[1][:, None] * scale[1]), 1)
    corner_row, corner_column = np.nonzero(np.abs(corner) >= CORRELATED)
    first = np.concatenate([i[pair] * q + row, edge_row, split + corner_row])
    second = np.concatenate([j[pair] * q + column, split + edge_column, split + corner_column])
    value = np.concatenate(
        [blocks[pair, row, column], edge[edge_row, edge_column], corner[corner_row, corner_column]]
    )
    order = np.lexsort((second, first))
    order = order[falling(np.abs(value[order]), _DECIMALS)]
    return first[order], second[order], np.clip(value[order], -1.0, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class RayReach:
    """Lengths of rays: the `nearest` (p,) m of each point, and the flying height, which is their median."""

    nearest: FloatArray
    height: float


def reach_of(network: Network, state: State, used: BoolArray) -> RayReach:
    """Return the lengths of the rays at `state`; the flying height is that of the measurements `used` (m,)."""
    with np.errstate(invalid="ignore", over="ignore"):
        rays = np.linalg.norm(state.ground[network.point] - state.position[network.photo], axis=1)
    nearest = np.full(network.points, np.inf)
    np.fmin.at(nearest, network.point, rays)
    rays = rays[used & np.isfinite(rays)]
    return RayReach(nearest=nearest, height=float(np.median(rays)) if len(rays) else np.inf)


def undetermined_points(network: Network, state: State, reach: RayReach, known: Covariances) -> dict[int, str]:
    """Return the points that their rays do not determine, with the reason.

    The largest axis of their ellipsoid by rays and priors alone, as if the stations were known, is above a tenth of
    the flying height: a weak datum is another matter. Residuals play no part in it.
    """
    limit = PART_OF_HEIGHT * reach.height
    least = limit * min(known.unit_sigma, 1.0)
    wide = np.einsum("kii->k", known.points) > least**2  # the sum of squares of the axes; NaN is not
    reasons = {}
    for number, group in enumerate((*network.groups, *network.left_out)):
        rows = wide[group.point]
        if not rows.any():
            continue
        inside = group.part(rows)
        with np.errstate(all="ignore"):
            by_rays = eliminate(network, state, inside).free_inverse
        for point, cofactor in zip(inside.point.tolist(), by_rays, strict=True):
            size, taken = _largest_axis(cofactor), number < len(network.groups)
            if size > limit and not (taken and reach.nearest[point] > FARTHEST * reach.height):
                length = max(size, _largest_axis(known.points[point]))
                reasons[point] = f"its rays do not determine it: its ellipsoid is {length:.0f} m long"
    return reasons


def _largest_axis(covariance: FloatArray) -> float:
    """Return the largest standard deviation in any direction, infinite where there is none."""
    if not np.isfinite(covariance).all():
        return np.inf
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))


def limits_of_water(block: Block, height: float) -> dict[str, float]:
    """Return the sigmas beyond which water is not determined, for rays of a `height`.

    Of a level a part of it, of a tilt that a flying height away, of an index the range that the liquid can have.
    """
    index = 0.0
    if block.water and block.options.water_index is Treatment.ADJUST:
        low, high = index_range(block.water.liquid)
        index = high - low
    return {"level": PART_OF_HEIGHT * height, "tilt": PART_OF_HEIGHT, "index": index}


def undetermined_water(
    block: Block, network: Network, part: Participation, loose: BoolArray, sigmas: dict[str, FloatArray]
) -> dict[str, bool]:
    """Return the names of what is not determined, `loose` levels (c,) and whatever has no sigma, in words.

    With each, whether images depend on it: those of flagged points, on photos whose tide is known.
    """
    flagged = part.used & block.points.bathymetric[network.point]
    groups = network.water.group[network.photo[flagged]]
    seen = np.isin(np.arange(len(loose)), groups)
    noun = "photo " if network.water.per_photo else ""
    names = {
        f"the level of the water{f' of {noun}{network.water.ids[row]}' if network.water.ids[row] else ''}": bool(
            seen[row]
        )
        for row in np.flatnonzero(loose).tolist()
    }
    for name, of in (("the tilt of the water", "tilt"), ("the refractive index", "index")):
        if np.isnan(sigmas[of]).any():
            names[name] = bool(flagged.any())
    return names
