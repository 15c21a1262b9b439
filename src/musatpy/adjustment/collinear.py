"""Points by collinearity: their images and priors, the ground coordinates eliminated point by point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment.ground import PointNormals, Priors, point_normals
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import NormalEquations
from musatpy.adjustment.unknowns import State

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Extras:
    """Partials of k points with m rays by X global unknowns, which may repeat in a row of `index`.

    The rows of `priors` are those of `ground.Priors`: east, north, up, and up against its level.
    """

    index: IntArray  # (k, X) columns of the border
    images: FloatArray  # (k, m, 2, X)
    priors: FloatArray  # (k, 4, X)


@dataclass(frozen=True, kw_only=True)
class Elimination:
    """The ground coordinates of k points in terms of stations and globals: dX = shift - F ds - F_e de.

    In the axes of the point normals; N_pp^-1 is the covariance of the point for stations without error. A kept
    point is not eliminated: its coordinates are among the globals, and N_pp^-1, F and shift are zero.
    """

    normals: PointNormals
    extras: Extras
    inverse: FloatArray  # (k, 3, 3) N_pp^-1
    by_station: FloatArray  # (k, 3, m, q) F = N_pp^-1 N_ps
    by_extra: FloatArray  # (k, 3, X) F_e = N_pp^-1 N_pe
    shift: FloatArray  # (k, 3) N_pp^-1 times the right side of the point


def eliminate(
    network: Network, state: State, group: PointGroup, ground: FloatArray, with_priors: bool
) -> Elimination:
    """Return the elimination of the points of a group at `ground` (k, 3)."""
    normals = point_normals(network, state, group, ground, with_priors)
    extras = _extras(network, group, normals)
    W = network.weight[group.rays]
    inverse = np.asarray(np.linalg.inv(normals.matrix), dtype=float)
    if group.kept:
        inverse = np.zeros_like(inverse)
    cross = np.einsum("kmai,kma,kmaj->kimj", normals.B, W, normals.images.by_station)
    by_station = np.einsum("kil,klmj->kimj", inverse, cross)
    by_extra = np.einsum("kil,kle->kie", inverse, _point_extra(normals, extras, W))
    shift = np.einsum("kij,kj->ki", inverse, normals.rhs)
    return Elimination(
        normals=normals, extras=extras, inverse=inverse, by_station=by_station, by_extra=by_extra, shift=shift
    )


def _point_extra(N: PointNormals, extras: Extras, W: FloatArray) -> FloatArray:
    """Return N_pe (k, 3, X)."""
    out = np.asarray(np.einsum("kmai,kma,kmae->kie", N.B, W, extras.images))
    if N.priors is not None:
        pull = N.priors.weight[:, 3] * N.priors.free[:, 2]
        out[:, 2] += pull[:, None] * extras.priors[:, 3]
    return out


def _extras(network: Network, group: PointGroup, N: PointNormals) -> Extras:
    """Return the partials of a group by the globals that it depends on."""
    parts = [*_water_extras(network, group, N)]
    if N.priors is not None and network.border.levels:
        level = np.maximum(network.priors.group[group.point], 0)[:, None]  # of no weight for points without group
        row = np.zeros((len(level), 4, 1))
        row[:, 3] = -1.0
        parts.append((level, np.zeros((*N.B.shape[:3], 1)), row))
    if N.priors is not None and group.kept:
        number = np.searchsorted(network.border.kept, group.point)
        parts.append((network.border.kept_columns(number), N.B, _own_rows(N.priors)))
    k, m = group.rays.shape
    none = (np.zeros((k, 0), dtype=np.int64), np.zeros((k, m, 2, 0)), np.zeros((k, 4, 0)))
    index, images, rows = zip(none, *parts, strict=True)
    return Extras(
        index=np.concatenate(index, axis=1),
        images=np.concatenate(images, axis=-1),
        priors=np.concatenate(rows, axis=-1),
    )


def _own_rows(priors: Priors) -> FloatArray:
    """Return the rows (k, 4, 3) of the priors of points by their own coordinates."""
    rows = np.concatenate([np.eye(3), [[0.0, 0.0, 1.0]]])
    return np.asarray(rows * priors.free[:, None, :])


def _water_extras(
    network: Network, group: PointGroup, N: PointNormals
) -> list[tuple[IntArray, FloatArray, FloatArray]]:
    """Return index, image partials and prior rows by the unknown water levels, tilts and index of the border."""
    border, by_water = network.border, N.images.by_water
    if by_water is None or not (
        network.refracted[group.rays].any() and border.waters + border.tilts + border.indices
    ):
        return []
    k, m = group.rays.shape
    index, images = [], []
    if border.waters:
        water = network.water.group[network.photo[group.rays]]
        own = np.zeros((k, m, 2, m))
        ray = np.arange(m)
        own[:, ray, :, ray] = np.moveaxis(by_water[..., 0] * (water >= 0)[..., None], 1, 0)
        index.append(border.first_water + np.maximum(water, 0))
        images.append(own)
    if border.tilts:
        index.append(np.broadcast_to(border.first_tilt + np.arange(2), (k, 2)))
        images.append(by_water[..., 1:3])
    if border.indices:
        index.append(np.full((k, 1), border.index_column))
        images.append(by_water[..., 3:])
    columns = np.concatenate(index, axis=1)
    return [(columns, np.concatenate(images, axis=-1), np.zeros((k, 4, columns.shape[1])))]


def add_collinear(network: Network, group: PointGroup, E: Elimination, out: NormalEquations) -> None:
    """Add the reduced normal equations of the points of a group: of their stations and globals."""
    N, A = E.normals, E.normals.images.by_station
    W = network.weight[group.rays]
    m = group.rays.shape[1]
    cross = np.einsum("kmai,kma,kmaj->kmij", A, W, N.B)  # N_sp
    photo = network.photo[group.rays]
    matrix = -np.einsum("kmil,klnj->kminj", cross, E.by_station)
    ray = np.arange(m)
    # advanced indices apart from each other: numpy puts the ray axis first
    matrix[:, ray, :, ray] += np.einsum("kmai,kma,kmaj->mkij", A, W, A)
    rhs = -np.einsum("kmai,kma,kma->kmi", A, W, N.residual) - np.einsum("kmil,kl->kmi", cross, E.shift)
    out.add(photo, matrix, rhs)
    if E.extras.index.shape[1]:
        _add_extras(network, group, E, cross, out)


def _add_extras(
    network: Network, group: PointGroup, E: Elimination, cross: FloatArray, out: NormalEquations
) -> None:
    N, X = E.normals, E.extras
    W = network.weight[group.rays]
    of_point = _point_extra(N, X, W)
    corner = np.einsum("kmae,kma,kmaf->kef", X.images, W, X.images) - np.einsum(
        "kie,kif->kef", of_point, E.by_extra
    )
    rhs = -np.einsum("kmae,kma,kma->ke", X.images, W, N.residual) - np.einsum("kie,ki->ke", of_point, E.shift)
    if N.priors is not None:
        weight = N.priors.weight
        corner += np.einsum("kae,ka,kaf->kef", X.priors, weight, X.priors)
        rhs += np.einsum("kae,ka,ka->ke", X.priors, weight, N.priors.deviation)
    border = np.einsum("kmai,kma,kmae->kmie", N.images.by_station, W, X.images)
    border -= np.einsum("kmil,kle->kmie", cross, E.by_extra)
    out.add_border(network.photo[group.rays], X.index, border)
    out.add_corner(X.index, corner, rhs)
