"""Error propagation: covariances of stations, levels and ground points, and the count of what went in."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.collinear import eliminate
from musatpy.adjustment.kinds import WATER
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.reliability import Piece, StationCofactors
from musatpy.adjustment.unknowns import LEVEL, State
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model import ObservationKind

if TYPE_CHECKING:
    from musatpy.adjustment.datum import InnerConstraints


_CHUNK = 2**22  # elements of one gathered piece of the inverse: 32 MB


@dataclass(frozen=True, kw_only=True, eq=False)
class Counts:
    """Scalar observations and unknowns by kind."""

    observations: dict[str, int]
    unknowns: dict[str, int]

    @property
    def degrees_of_freedom(self) -> int:
        """Observations minus unknowns."""
        return sum(self.observations.values()) - sum(self.unknowns.values())


def count(network: Network, unobserved_photos: int, free_motions: int) -> Counts:
    """Return what entered the solution; conditions of a point count as its 2m - 3 do, by images minus ground."""
    priors, water = network.priors, network.water
    control = (*network.control_groups, *network.kept_groups)
    known = np.concatenate([np.zeros(0, dtype=np.int64), *(g.point for g in control)])  # of others nothing is
    grouped = known[priors.group[known] >= 0]
    points = sum(len(g.point) for g in network.groups)
    wet = any(network.refracted[group.rays].any() for group in network.groups)
    of_water = sum(
        network.border.count(kind.observed)
        for kind in WATER
        if kind.observed is not ObservationKind.WATER_LEVEL and (wet or kind.weight(network).any())
    )
    levels = int(np.count_nonzero(_sees_water(network) | (water.level_weight > 0.0)))
    observations = {
        "plate coordinates, pass points": 2 * sum(g.rays.size for g in network.pass_groups),
        "plate coordinates, control points": 2 * sum(g.rays.size for g in control),
        "control coordinates": int(np.count_nonzero(priors.weight[known])),
        "station positions": int(np.count_nonzero(network.position_weight)),
        "station attitudes": int(np.count_nonzero(network.attitude_weight)),
        "equal elevations": len(grouped),
        "air bases": 0,
    }
    unknowns = {
        "station parameters": 6 * (network.photos - unobserved_photos),
        "ground coordinates": 3 * points - int(np.count_nonzero(priors.held[known])),
        "levels": len(np.unique(priors.group[grouped])),
    }
    further = {kind.noun: len(measured.row) for kind, measured in network.measured.items()}
    further["water"] = sum(int(np.count_nonzero(kind.weight(network))) for kind in WATER)
    further["inner constraints"] = free_motions
    observations |= {kind: number for kind, number in further.items() if number}
    if levels + of_water:
        unknowns["water"] = levels + of_water
    return Counts(observations=observations, unknowns=unknowns)


def redundancy(network: Network) -> int:
    """Return the degrees of freedom of a network all of whose photos are held, at least 1."""
    return max(count(network, 0, 0).degrees_of_freedom, 1)


def _sees_water(network: Network) -> BoolArray:
    """Return (c,) whether a refracted ray depends on the correction of a tide."""
    seen = np.zeros(len(network.water.ids), dtype=bool)
    for group in network.groups if len(seen) else ():
        photo = network.photo[group.rays[network.refracted[group.rays]]]
        corrections = network.water.group[photo]
        seen[corrections[corrections >= 0]] = True
    return seen


def pieces(
    network: Network, state: State, group: PointGroup, cofactors: StationCofactors
) -> Iterator[tuple[slice, Piece]]:
    """Yield the points of a group in portions."""
    for rows in portions(network, group):
        yield rows, _piece(network, state, group.part(rows), cofactors)


def portions(network: Network, group: PointGroup) -> Iterator[slice]:
    """Yield the rows of a group, so many at a time that what is gathered of the inverse stays small."""
    width = network.pattern.size * group.rays.shape[1] + 4
    size = max(1, _CHUNK // width**2)
    for start in range(0, len(group.point), size):
        yield slice(start, start + size)


def _piece(network: Network, state: State, group: PointGroup, cofactors: StationCofactors) -> Piece:
    E = eliminate(network, state, group)
    E = replace(E, inverse=E.free_inverse)
    return Piece(
        group=group,
        E=E,
        F=E.F,
        cofactors=cofactors,
        photo=network.photo[group.rays],
        axes=network.frame.axes(state.ground[group.point]) @ np.swapaxes(E.normals.axes, 1, 2),
    )


def point_covariances(
    network: Network, piece: Piece, cofactors: Cofactors, inner: InnerConstraints | None
) -> FloatArray:
    """Return the cofactors (k, 3, 3) of the points of a piece along east, north, up.

    Q_xx = N_pp^-1 + F Q_ss F' (the stations are not held), under the inner constraints where there are any.
    """
    group, E = piece.group, piece.E
    if group.kept:
        columns = network.border.kept_columns(group.point)
        corner = (inner.cofactors(cofactors) if inner else cofactors).corner
        free = np.ones((len(columns), 3)) if E.normals.priors is None else E.normals.priors.free
        Q = corner[columns[:, :, None], columns[:, None, :]] * free[:, :, None] * free[:, None, :]
        return _turned(piece.axes, Q)
    Q = E.inverse + piece.F @ piece.Q @ np.swapaxes(piece.F, 1, 2)
    if inner:
        constrained = any(np.isin(group.point[:1], other.point).all() for other in network.groups)
        Q = inner.points(network, group, Q, E, constrained)
    return _turned(piece.axes, Q)


def depth_cofactors(
    network: Network, state: State, piece: Piece, cofactors: Cofactors, inner: InnerConstraints | None
) -> FloatArray:
    """Return the cofactors (k,) of the depths of the points of a piece: of the water over them minus their heights.

    The water is that of the mean tide of the photos that give the point its position.
    """
    group, E, F = piece.group, piece.E, piece.F
    m = group.rays.shape[1]
    split, T = m * network.pattern.size, F.shape[2]
    index, surface = _surface_partials(network, state, group)
    columns = np.concatenate([E.extras.index, index], axis=1)
    Q = cofactors.with_border(network.photo[group.rays], columns)
    by_point = E.normals.axes @ network.slope(state.tilt) - piece.axes[:, 2]
    a = np.concatenate([-np.einsum("ki,kit->kt", by_point, F), surface[:, split:]], axis=1)
    a[:, :split] += surface[:, :split]
    if group.kept:  # the coordinates stand last among the extras
        a[:, T - 3 : T] += by_point
    variance = np.einsum("kt,ktu,ku->k", a, Q, a) + np.einsum("ki,kij,kj->k", by_point, E.inverse, by_point)
    if inner is None:
        return np.asarray(variance)
    unknowns, depth = network.unknowns(group, columns), variance[:, None, None]
    constrained = any(np.isin(group.point[:1], other.point).all() for other in network.groups)
    return inner.of_points(unknowns, a[:, None], by_point[:, None], depth, E, constrained)[:, 0, 0]


def _surface_partials(network: Network, state: State, group: PointGroup) -> tuple[IntArray, FloatArray]:
    """Return border columns (k, W) of the water over points, and the partials (k, m q + W) of its height."""
    k, m = group.rays.shape
    stations = np.zeros((k, m, network.pattern.size))
    if network.water.per_photo:
        stations[..., LEVEL] = (network.water.group[network.photo[group.rays]] >= 0) / m
    index, parts = zip(*(kind.of_surface(network, state, group) for kind in WATER), strict=True)
    return np.concatenate(index, axis=1), np.concatenate([stations.reshape(k, -1), *parts], axis=1)


def _turned(T: FloatArray, Q: FloatArray) -> FloatArray:
    return T @ Q @ np.swapaxes(T, 1, 2)
