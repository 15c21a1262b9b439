"""How the unknowns depend on one another, and what nothing determines; of unknown waves apart from what.

Variance inflation and correlations are from the inverse in its pattern; of points whose rays, and of water of which
the images, do not determine it, no number is stated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.collinear import eliminate
from musatpy.adjustment.iteration import LEVEL, State
from musatpy.adjustment.kinds import direct_rows
from musatpy.adjustment.kinds.water import Wave
from musatpy.adjustment.network import Network, Participation, PointGroup
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.propagation import Piece
from musatpy.adjustment.wavy_water import AZIMUTH, CREST, LENGTH, WorkingSea, names_of_waves
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model import AdjustedWaves, Block, Dependence, ObservationKind
from musatpy.model.tables import falling, finite_rows
from musatpy.model.water import index_range

if TYPE_CHECKING:  # most jobs have no waves
    from musatpy.adjustment.wave_search import OtherCrests

_UP = 2  # of the unknowns of a photo
_DECIMALS = 4  # of correlations, as they are printed
CORRELATED = 0.95  # correlations from here on are listed


class Diagonal:
    """The diagonal of the normal matrix before any point is eliminated, added up piece by piece."""

    def __init__(self, network: Network) -> None:
        self.stations = np.zeros((network.photos, network.pattern.size))
        self.border = np.zeros(network.border.size)

    def add(self, network: Network, piece: Piece) -> None:
        """Add the points of a piece."""
        group, E = piece.group, piece.E
        W = network.weight[group.rays]
        by_station = np.einsum("kmai,kma->kmi", np.square(E.normals.images.by_station), W)
        np.add.at(self.stations, network.photo[group.rays], by_station)
        if E.extras.index.shape[1]:
            # columns that stand for one unknown several times add before they are squared
            rows = E.extras.images.reshape(*W.reshape(len(W), -1).shape, -1)
            weights = W.reshape(len(W), -1)
            if E.normals.priors is not None:
                rows = np.concatenate([rows, E.extras.priors], axis=1)
                weights = np.concatenate([weights, E.normals.priors.weight], axis=1)
            same = E.extras.index[:, :, None] == E.extras.index[:, None, :]
            squares = np.einsum("kre,kr,krf,kef->ke", rows, weights, rows, same)
            np.add.at(self.border, E.extras.index, squares)

    def add_direct(self, network: Network, state: State) -> None:
        """Add the observations that concern no image."""
        split = self.stations.size
        for _, rows in direct_rows(network, state):
            squares, of_photo = np.square(rows.partials) * rows.weight[:, None], rows.index < split
            np.add.at(self.stations.reshape(-1), rows.index[of_photo], squares[of_photo])
            np.add.at(self.border, rows.index[~of_photo] - split, squares[~of_photo])


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


PART_OF_HEIGHT = 0.1  # of the flying height: a place or a level with a larger sigma is not known
FARTHEST = 100.0  # flying heights: a point of the adjustment that is farther has run away, and is rejected


@dataclass(frozen=True, kw_only=True, eq=False)
class Reach:
    """Lengths of rays: the `nearest` (p,) m of each point, and the flying height, which is their median."""

    nearest: FloatArray
    height: float


def reach_of(network: Network, state: State, part: Participation) -> Reach:
    """Return the lengths of the rays at `state`."""
    with np.errstate(invalid="ignore", over="ignore"):
        rays = np.linalg.norm(state.ground[network.point] - state.position[network.photo], axis=1)
    nearest = np.full(network.points, np.inf)
    np.fmin.at(nearest, network.point, rays)
    rays = rays[part.used & np.isfinite(rays)]
    return Reach(nearest=nearest, height=float(np.median(rays)) if len(rays) else np.inf)


def undetermined_points(
    network: Network, state: State, reach: Reach, covariance: FloatArray, kept_out: tuple[PointGroup, ...]
) -> dict[int, str]:
    """Return the points that their rays do not determine, with the reason: points with `covariance` (p, 3, 3) m2.

    The largest axis of their ellipsoid is above a tenth of the flying height, and that of the one by their rays
    and priors alone too, as if the stations were known: a weak datum is another matter.
    """
    limit = PART_OF_HEIGHT * reach.height
    wide = np.einsum("kii->k", covariance) > limit**2  # the sum of squares of the axes; NaN is not
    reasons = {}
    for group, taken in (*((group, True) for group in network.groups), *((group, False) for group in kept_out)):
        rows = wide[group.point]
        if not rows.any():
            continue
        inside = group.part(rows)
        with np.errstate(all="ignore"):
            by_rays = eliminate(network, state, inside).free_inverse
        for point, cofactor in zip(inside.point.tolist(), by_rays, strict=True):
            sizes = [_largest_axis(of) for of in (covariance[point], cofactor)]
            if min(sizes) > limit and not (taken and reach.nearest[point] > FARTHEST * reach.height):
                reasons[point] = f"its rays do not determine it: its ellipsoid is {sizes[0]:.0f} m long"
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
    low, high = index_range(block.water.liquid if block.water else "")
    return {"level": PART_OF_HEIGHT * height, "tilt": PART_OF_HEIGHT, "index": high - low}


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


def adjusted_waves(
    network: Network,
    state: State,
    diagonal: Diagonal,
    cofactors: Cofactors,
    covariances: Cofactors,
    name: Callable[[int], str],
    crests: OtherCrests | None,
) -> AdjustedWaves | None:
    """Return the waves of a solution, None where they were known; `name` names the unknowns.

    Without `crests` nobody has looked whether there are others.
    """
    border = network.border
    if (
        not border.count(ObservationKind.WAVE)
        or network.sea is None
        or network.sea.trains is None
        or network.sea.sea.sigma is None
    ):
        return None
    unknown = network.sea.sea.unknown
    columns = border.at(ObservationKind.WAVE)
    cofactor = np.diagonal(cofactors.corner)[columns]

    def spread(values: FloatArray) -> FloatArray:
        out = np.full(unknown.shape, np.nan)
        out[unknown] = values
        return out

    pairs = list(_correlations(network, cofactors, name))
    from musatpy.adjustment.wave_search import nothing_searched  # most jobs have no waves

    crests = crests or nothing_searched(len(unknown))
    return AdjustedWaves(
        ids=np.array(names_of_waves(network.sea.sea)),
        value=state.waves,
        prior=network.sea.waves,
        prior_sigma=network.sea.sea.sigma,
        sigma=spread(np.sqrt(np.diagonal(covariances.corner)[columns])),
        kept=spread(np.sqrt(cofactor * Wave().weight(network))),
        inflation=spread(cofactor * diagonal.border[columns]),
        speed=network.sea.trains.with_values(state.waves).speed,
        open=_open(network.sea, _reach(network, state, network.sea)),
        rival=crests.rival,
        excess=crests.excess,
        searched=crests.searched,
        first=np.array([first for first, _, _ in pairs], dtype=np.str_),
        second=np.array([second for _, second, _ in pairs], dtype=np.str_),
        correlation=np.array([value for _, _, value in pairs]),
    )


def _reach(network: Network, state: State, sea: WorkingSea) -> float:
    """Return the RMS distance (m) of the points that are seen through the waves from their origin."""
    wet = np.zeros(network.points, dtype=bool)
    wet[network.point[network.refracted]] = True
    ground = state.ground[wet & finite_rows(state.ground)]
    plan = (ground - sea.origin) @ sea.axes[:2].T
    return float(np.sqrt(np.mean(np.sum(np.square(plan), axis=1)))) if len(ground) else 0.0


def _open(sea: WorkingSea, reach: float) -> FloatArray:
    """Return by how much of its length (k,) the sigmas of a wave shift its crests at a distance (m)."""
    L, sigma = sea.waves[:, LENGTH], np.nan_to_num(np.asarray(sea.sea.sigma)).T
    return np.hypot.reduce([reach * sigma[LENGTH] / L**2, reach * sigma[AZIMUTH] / L, sigma[CREST] / L])


def _correlations(
    network: Network, cofactors: Cofactors, name: Callable[[int], str]
) -> Iterator[tuple[str, str, float]]:
    """Yield names and correlations of wave parameters with one another, the water, and one height of a station.

    Of station heights, and of water levels where each photo has its own, the one most correlated stands for all.
    """
    border, n, q = network.border, network.photos, network.pattern.size
    corner = cofactors.corner
    scale = np.sqrt(np.diagonal(corner))
    photo = np.sqrt(np.einsum("nii->ni", cofactors.of_single_photos()))
    edge = cofactors.border.reshape(n, q, -1)
    first_water, waves = border.at(ObservationKind.WATER_LEVEL).start, border.numbers(ObservationKind.WAVE).tolist()
    for number, column in enumerate(waves):
        parameter = name(n * q + column)
        for other in (*waves[number + 1 :], *range(first_water, waves[0])):
            yield parameter, name(n * q + other), float(corner[column, other] / (scale[column] * scale[other]))
        for row in (_UP, *((LEVEL,) if network.water.per_photo else ())):
            with np.errstate(invalid="ignore"):
                correlations = np.nan_to_num(edge[:, row, column] / (photo[:, row] * scale[column]))
            strongest = int(np.argmax(np.round(np.abs(correlations), 9)))
            yield parameter, name(strongest * q + row), float(correlations[strongest])
