"""Error propagation: covariances of stations, levels and ground points, and the count of what went in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment.collinear import eliminate
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.unknowns import State

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_CHUNK = 2**22  # elements of one gathered piece of the inverse: 32 MB


@dataclass(frozen=True, kw_only=True)
class Counts:
    """Scalar observations and unknowns by kind."""

    observations: dict[str, int]
    unknowns: dict[str, int]

    @property
    def degrees_of_freedom(self) -> int:
        """Observations minus unknowns."""
        return sum(self.observations.values()) - sum(self.unknowns.values())


def count(network: Network, unobserved_photos: int) -> Counts:
    """Return what entered the solution; conditions of a point count as its 2m - 3 do, by images minus ground."""
    priors = network.priors
    groups = (*network.pass_groups, *network.control_groups)
    points = np.concatenate([g.point for g in groups]) if groups else np.empty(0, dtype=int)
    grouped = points[priors.group[points] >= 0]
    observations = {
        "plate coordinates, pass points": 2 * sum(g.rays.size for g in network.pass_groups),
        "plate coordinates, control points": 2 * sum(g.rays.size for g in network.control_groups),
        "control coordinates": int(np.count_nonzero(priors.weight[points])),
        "station positions": int(np.count_nonzero(network.position_weight)),
        "station attitudes": int(np.count_nonzero(network.attitude_weight)),
        "equal elevations": len(grouped),
        "air bases": len(network.base_length),
    }
    unknowns = {
        "station parameters": 6 * (network.photos - unobserved_photos),
        "ground coordinates": 3 * len(points) - int(np.count_nonzero(priors.held[points])),
        "levels": len(np.unique(priors.group[grouped])),
    }
    return Counts(observations=observations, unknowns=unknowns)


def point_covariances(
    network: Network, state: State, group: PointGroup, with_priors: bool, cofactors: Cofactors
) -> FloatArray:
    """Return the cofactors (k, 3, 3) of the points of a group along east, north, up.

    Q_xx = N_pp^-1 + F Q_ss F' (the stations are not held).
    """
    m = group.rays.shape[1]
    out = np.empty((len(group.point), 3, 3))
    size = max(1, _CHUNK // (6 * m + 1) ** 2)
    for start in range(0, len(group.point), size):
        part = slice(start, start + size)
        piece = PointGroup(point=group.point[part], rays=group.rays[part])
        out[part] = _piece_covariances(network, state, piece, with_priors, cofactors)
    return out


def _piece_covariances(
    network: Network, state: State, group: PointGroup, with_priors: bool, cofactors: Cofactors
) -> FloatArray:
    k, m = group.rays.shape
    ground = state.ground[group.point]
    E = eliminate(network, state, group, ground, with_priors)
    F = E.by_station.reshape(k, 3, 6 * m)
    photo = network.photo[group.rays]
    of_stations = cofactors.of_photos(photo)
    Q = E.inverse
    if E.normals.priors is not None:
        free = E.normals.priors.free
        Q = Q * free[:, :, None] * free[:, None, :]
    if with_priors and network.levels:
        level = np.maximum(network.priors.group[group.point], 0)  # f is 0 for points without group
        F = np.concatenate([F, E.by_level[:, :, None]], axis=2)
        of_stations = cofactors.with_level(photo, level)
    Q = Q + F @ of_stations @ np.swapaxes(F, 1, 2)
    T = network.frame.axes(ground) @ np.swapaxes(E.normals.axes, 1, 2)
    return np.asarray(T @ Q @ np.swapaxes(T, 1, 2))
