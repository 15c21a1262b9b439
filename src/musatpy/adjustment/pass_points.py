"""Pass points: m - 1 coplanarity and m - 2 scale restraint conditions for m rays, and their normal equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.adjustment import sightings
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import Sums, summed, upper
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray
from musatpy.geometry.intersection import coplanarity, scale_restraint
from musatpy.model import Weights


@dataclass(frozen=True, kw_only=True, eq=False)
class Conditions:
    """c = 2m - 3 conditions of each of k points, coplanarities first: g + A dx + G v = 0."""

    value: FloatArray  # (k, c)
    A: FloatArray  # (k, c, m, 6) by stations
    G: FloatArray  # (k, c, m, 2) by plate coordinates
    covariance: FloatArray  # (k, c, c) G Q G'


def conditions(network: Network, state: State, group: PointGroup, xy: FloatArray, ground: FloatArray) -> Conditions:
    """Return the conditions of a group linearised at plate coordinates xy (k, m, 2); m >= 2."""
    k, m = group.rays.shape
    X = np.repeat(ground[:, None], m, axis=1)
    rays = sightings.condition_rays(network, state, group.rays, xy, X)
    P, u = rays.origin, rays.direction
    c = 2 * m - 3
    value, partials = np.empty((k, c)), np.zeros((k, c, m, 6))
    row = np.arange(m - 1)
    value[:, : m - 1], pair = coplanarity(_windows(P, 2), _windows(u, 2))
    for side in range(2):
        partials[:, row, row + side] = pair[:, :, side]
    if m > 2:
        row = np.arange(m - 2)
        value[:, m - 1 :], triple = scale_restraint(_windows(P, 3), _windows(u, 3))
        for side in range(3):
            partials[:, m - 1 + row, row + side] = triple[:, :, side]
    # (k, c, m, 6) x (k, m, 6, 6): each ray's partials by its own station and image
    A = np.einsum("kcmi,kmij->kcmj", partials, rays.by_station)
    G = np.einsum("kcmi,kmij->kcmj", partials, rays.by_xy)
    Q = 1.0 / network.weight[group.rays]
    covariance = np.einsum("kcma,kma,kdma->kcd", G, Q, G)
    return Conditions(value=value, A=A, G=G, covariance=covariance)


def _windows(rows: FloatArray, length: int) -> FloatArray:
    """Return the runs of consecutive rays, (k, m - length + 1, length, 3)."""
    m = rows.shape[1]
    return np.stack([rows[:, i : m - length + 1 + i] for i in range(length)], axis=2)


def fully_weighted(network: Network, state: State, group: PointGroup) -> Sums:
    """Return the normal equations of the conditions of a group with full weights, at its adjusted images."""
    ground = np.repeat(state.ground[group.point][:, None], group.rays.shape[1], axis=1)
    adjusted = sightings.image_coordinates(network, state, group.rays, ground)
    C = conditions(network, state, group, adjusted, state.ground[group.point])
    # misclosure at the measured coordinates: g(l0) + G (l - l0)
    w = C.value + np.einsum("kcma,kma->kc", C.G, network.xy[group.rays] - adjusted)
    scale = 1.0 / np.sqrt(np.einsum("kcc->kc", C.covariance))
    k, c, m, _ = C.A.shape
    A, right = (C.A * scale[:, :, None, None]).reshape(k, c, 6 * m), (w * scale)[..., None]
    S = C.covariance * scale[:, :, None] * scale[:, None, :]
    weighted = np.linalg.solve(S, np.concatenate([A, right], axis=-1))
    At = np.swapaxes(A, 1, 2)
    return _sums(network, group, At @ weighted[..., :-1], -(At @ weighted[..., -1:])[..., 0])


def diagonally_weighted(network: Network, group: PointGroup, C: Conditions, variance: FloatArray) -> Sums:
    """Return the normal equations of the conditions of a group by a diagonal weight matrix, 1/variance (k, c)."""
    k, c, m, _ = C.A.shape
    A = C.A.reshape(k, c, 6 * m)
    PA = A / variance[..., None]
    return _sums(network, group, np.swapaxes(A, 1, 2) @ PA, -np.einsum("kci,kc->ki", PA, C.value))


def _sums(network: Network, group: PointGroup, matrix: FloatArray, rhs: FloatArray) -> Sums:
    k, m = group.rays.shape
    blocks = upper(matrix.reshape(k, m, 6, m, 6))
    return summed(network.pattern, network.photo[group.rays], blocks, rhs.reshape(k, m, 6))


def simple_variances(network: Network, state: State, weights: Weights) -> tuple[FloatArray, ...]:
    """Return the variances (k, c) of the conditions of every pass group, at the measured plate coordinates.

    As a program of the 1970s had them: the diagonal of G Q G' only, or (equal weights) one variance, the median,
    for all coplanarities and one for all scale restraints.
    """
    variances = [
        np.einsum("kcc->kc", measured_conditions(network, state, group).covariance).copy()
        for group in network.pass_groups
    ]
    if weights is Weights.EQUAL:
        coplanarities = [v[:, : (v.shape[1] + 1) // 2] for v in variances]
        restraints = [v[:, (v.shape[1] + 1) // 2 :] for v in variances]
        for kind in (coplanarities, restraints):
            together = np.concatenate([v.reshape(-1) for v in kind]) if kind else np.empty(0)
            for v in kind:
                v[...] = np.median(together) if together.size else 1.0
    return tuple(variances)


def measured_conditions(network: Network, state: State, group: PointGroup) -> Conditions:
    """Return the conditions of a group linearised at its measured plate coordinates."""
    return conditions(network, state, group, network.xy[group.rays], state.ground[group.point])
