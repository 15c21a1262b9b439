"""Points with control: collinearity, the ground coordinates eliminated point by point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment.ground import PointNormals, point_normals
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import NormalEquations
from musatpy.adjustment.unknowns import State

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Elimination:
    """The ground coordinates of k points in terms of stations and levels: dX = x0 - F ds - f dlevel.

    In the axes of the point normals; N_pp^-1 is the covariance of the point for stations without error.
    """

    normals: PointNormals
    inverse: FloatArray  # (k, 3, 3) N_pp^-1
    by_station: FloatArray  # (k, 3, m, 6) F = N_pp^-1 N_ps
    by_level: FloatArray  # (k, 3) f = N_pp^-1 N_pl, 0 without group


def eliminate(
    network: Network, state: State, group: PointGroup, ground: FloatArray, with_priors: bool
) -> Elimination:
    """Return the elimination of the points of a group at their optimum `ground` (k, 3)."""
    normals = point_normals(network, state, group, ground, with_priors)
    W = network.weight[group.rays]
    inverse = np.asarray(np.linalg.inv(normals.matrix), dtype=float)
    cross = np.einsum("kmai,kma,kmaj->kimj", normals.B, W, normals.images.by_station)
    by_station = np.einsum("kil,klmj->kimj", inverse, cross)
    by_level = np.zeros_like(ground)
    if normals.priors is not None:
        pull = normals.priors.weight[:, 3] * normals.priors.free[:, 2]
        by_level = -inverse[:, :, 2] * pull[:, None]
    return Elimination(normals=normals, inverse=inverse, by_station=by_station, by_level=by_level)


def add_collinear(network: Network, state: State, group: PointGroup, out: NormalEquations) -> None:
    """Add the points of a group with control: the reduced normal equations of their stations and levels."""
    E = eliminate(network, state, group, state.ground[group.point], with_priors=True)
    N, A = E.normals, E.normals.images.by_station
    W = network.weight[group.rays]
    m = group.rays.shape[1]
    cross = np.einsum("kmai,kma,kmaj->kmij", A, W, N.B)  # N_sp
    photo = network.photo[group.rays]
    matrix = -np.einsum("kmil,klnj->kminj", cross, E.by_station)
    ray = np.arange(m)
    # advanced indices apart from each other: numpy puts the ray axis first
    matrix[:, ray, :, ray] += np.einsum("kmai,kma,kmaj->mkij", A, W, A)
    shift = np.einsum("kij,kj->ki", E.inverse, N.rhs)
    rhs = -np.einsum("kmai,kma,kma->kmi", A, W, N.residual) - np.einsum("kmil,kl->kmi", cross, shift)
    out.add(photo, matrix, rhs)
    if N.priors is not None:
        _add_levels(network, group, E, cross, shift, out)


def _add_levels(
    network: Network,
    group: PointGroup,
    E: Elimination,
    cross: FloatArray,
    shift: FloatArray,
    out: NormalEquations,
) -> None:
    """Add what points of equal elevation groups say of their levels: one row (up - level) with its weight."""
    grouped = network.priors.group[group.point] >= 0
    if not grouped.any() or E.normals.priors is None:
        return
    priors = E.normals.priors
    level = network.priors.group[group.point[grouped]]
    w = priors.weight[grouped, 3]
    free = priors.free[grouped, 2]
    f = E.by_level[grouped]
    # N_ll - N_lp f with N_lp = -w up; right side - w deviation + w up . shift
    out.add_levels(level, w + w * f[:, 2] * free, w * (shift[grouped, 2] * free - priors.deviation[grouped, 3]))
    out.add_border(network.photo[group.rays[grouped]], level, -np.einsum("kmil,kl->kmi", cross[grouped], f))
