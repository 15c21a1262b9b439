"""Redundancy numbers and influences of all observations, from the inverse of the normal equations.

With the ground point eliminated, dX = shift - F ds, the adjusted value of an observation with partials a by the
stations and globals and b by its point moves by (a - b F) ds: its cofactor is (a - b F) Q (a - b F)' + b N^-1 b'.
Its redundancy number is 1 minus weight times that (Foerstner and Wrobel 2016, section 4.6).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.collinear import Elimination
from musatpy.adjustment.direct import (
    Rows,
    air_bases,
    distances,
    height_differences,
    level_corrections,
    station_deviation,
    water_rows,
)
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray, IntArray
from musatpy.model import Block, ObservationKind, Observations

_EQUAL = 3  # row of the priors that holds a point against the level of its group


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """Some points of a group with what their errors depend on: T = m q + X unknowns of stations and globals."""

    group: PointGroup
    E: Elimination
    F: FloatArray  # (k, 3, T) the points by these unknowns, zero where they are kept
    Q: FloatArray  # (k, T, T) cofactors
    axes: FloatArray  # (k, 3, 3) axes of the elimination to east, north, up of the points


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """Observations of one kind; `weight` is 1/sigma^2."""

    kind: ObservationKind
    row: IntArray  # (o,)
    component: IntArray  # (o,)
    residual: FloatArray  # (o,)
    weight: FloatArray  # (o,)
    cofactor: FloatArray  # (o,) of the adjusted observation
    covariance: FloatArray  # (o, 3) cofactors of the own position and the adjusted observation


def joined(parts: Iterable[Part]) -> Observations:
    """Return the observations of all parts in the order of kinds, rows and components."""
    found = list(parts)
    kind, row, component, weight, order = _ordered(found)
    covariance = np.concatenate([part.covariance for part in found])
    return Observations(
        kind=kind[order],
        row=row[order],
        component=component[order],
        residual=np.concatenate([part.residual for part in found])[order],
        sigma=1.0 / np.sqrt(weight[order]),
        redundancy=1.0 - weight[order] * np.concatenate([part.cofactor for part in found])[order],
        influence=(covariance * weight[:, None])[order],
    )


def variances(parts: Iterable[Part]) -> FloatArray:
    """Return the cofactors (o,) of all parts in the same order."""
    found = list(parts)
    order = _ordered(found)[-1]
    return np.concatenate([part.cofactor for part in found])[order]


def _ordered(parts: list[Part]) -> tuple[IntArray, IntArray, IntArray, FloatArray, IntArray]:
    """Return kinds, rows, components and weights of all observations, and the order of those with a weight."""
    kind = np.concatenate([np.full(len(part.row), part.kind) for part in parts])
    row = np.concatenate([part.row for part in parts])
    component = np.concatenate([part.component for part in parts])
    weight = np.concatenate([part.weight for part in parts])
    order = np.lexsort((component, row, kind))
    return kind, row, component, weight, order[weight[order] > 0.0]


def images(network: Network, piece: Piece, residual: FloatArray) -> Part:
    """Return the plate coordinates of a piece; `residual` (all measurements, 2) mm."""
    group = piece.group
    k, m = group.rays.shape
    a, b = image_partials(network, piece)
    rows = np.repeat(group.rays.reshape(k, m, 1), 2, axis=2)
    component = np.broadcast_to(np.arange(2), rows.shape)
    return _part(
        ObservationKind.PLATE,
        piece,
        a,
        b,
        rows.reshape(k, -1),
        component.reshape(k, -1),
        residual[group.rays].reshape(k, -1),
        network.weight[group.rays].reshape(k, -1),
    )


def image_partials(network: Network, piece: Piece) -> tuple[FloatArray, FloatArray]:
    """Return the partials of images by stations and globals (k, 2m, T), and by their points (k, 2m, 3).

    The points follow the stations.
    """
    E = piece.E
    k, m = piece.group.rays.shape
    A, B, q = E.normals.images.by_station, E.normals.B, network.pattern.size
    a = -np.einsum("kmai,kit->kmat", B, piece.F)
    stations = a[..., : m * q].reshape(k, m, 2, m, q)
    ray = np.arange(m)
    stations[:, ray, :, ray] += np.moveaxis(A, 1, 0)
    a[..., m * q :] += E.extras.images
    return a.reshape(k, 2 * m, -1), B.reshape(k, 2 * m, 3)


def prior_partials(piece: Piece) -> tuple[FloatArray, FloatArray]:
    """Return the partials of the four rows of `Priors` likewise: (k, 4, T) and (k, 4, 3)."""
    known = piece.E.normals.priors
    free = np.ones((len(piece.group.point), 3)) if known is None else known.free
    b = np.concatenate([np.eye(3), [[0.0, 0.0, 1.0]]]) * free[:, None, :]
    a = -b @ piece.F
    a[:, :, piece.F.shape[2] - piece.E.extras.index.shape[1] :] += piece.E.extras.priors
    return a, b


def priors(piece: Piece, block: Block) -> Iterator[Part]:
    """Yield the control and the equal elevations of a piece."""
    known = piece.E.normals.priors
    if known is None:
        return
    k = len(piece.group.point)
    a, b = prior_partials(piece)
    components = np.broadcast_to(np.arange(3), (k, 3))
    for kind, table, rows in (
        (ObservationKind.CONTROL, block.control.point, slice(0, _EQUAL)),
        (ObservationKind.EQUAL_ELEVATION, block.equal_elevations.point, slice(_EQUAL, _EQUAL + 1)),
    ):
        row = np.full(len(block.points.ids), -1)
        row[table[::-1]] = np.arange(len(table))[::-1]
        found = np.repeat(row[piece.group.point][:, None], rows.stop - rows.start, axis=1)
        weight = known.weight[:, rows] * np.pad(known.free, ((0, 0), (0, 1)), constant_values=True)[:, rows]
        yield _part(
            kind, piece, a[:, rows], b[:, rows], found, components[:, : found.shape[1]],
            -known.deviation[:, rows], weight,
        )  # fmt: skip


def _part(
    kind: ObservationKind,
    piece: Piece,
    a: FloatArray,
    b: FloatArray,
    row: IntArray,
    component: IntArray,
    residual: FloatArray,
    weight: FloatArray,
) -> Part:
    """Return observations (k, o) of points with partials a (k, o, T) by stations and b (k, o, 3) by the point."""
    aQ = a @ piece.Q
    bN = b @ piece.E.inverse
    cofactor = np.einsum("kot,kot->ko", aQ, a) + np.einsum("koi,koi->ko", bN, b)
    own = aQ[:, :, -3:] if piece.group.kept else bN - aQ @ np.swapaxes(piece.F, 1, 2)
    covariance = own @ np.swapaxes(piece.axes, 1, 2)
    return Part(
        kind=kind,
        row=row.reshape(-1),
        component=component.reshape(-1),
        residual=residual.reshape(-1),
        weight=weight.reshape(-1),
        cofactor=cofactor.reshape(-1),
        covariance=covariance.reshape(-1, 3),
    )


def direct(network: Network, state: State, block: Block, cofactors: Cofactors) -> Iterator[Part]:
    """Yield the observations that concern no image."""
    yield from _stations(network, state, cofactors)
    yield _bases(network, state, cofactors)
    yield from _water(network, state, cofactors)
    if len(network.border.kept):
        used = np.isin(block.distances.point, network.border.kept).all(axis=1)
        rows = np.flatnonzero(used)
        yield _tie(ObservationKind.DISTANCE, distances(network, state), rows, cofactors)
        used = np.isin(block.height_differences.point, network.border.kept).all(axis=1)
        rows = np.flatnonzero(used)
        yield _tie(ObservationKind.HEIGHT_DIFFERENCE, height_differences(network, state), rows, cofactors)


def _stations(network: Network, state: State, cofactors: Cofactors) -> Iterator[Part]:
    Q = cofactors.of_single_photos()
    deviation = station_deviation(network, state)
    n = network.photos
    for kind, first, weight in (
        (ObservationKind.STATION_POSITION, 0, network.position_weight),
        (ObservationKind.STATION_ATTITUDE, 3, network.attitude_weight),
    ):
        columns = first + np.arange(3)
        yield Part(
            kind=kind,
            row=np.repeat(np.arange(n), 3),
            component=np.tile(np.arange(3), n),
            residual=deviation[:, columns].reshape(-1),
            weight=weight.reshape(-1),
            cofactor=np.einsum("nii->ni", Q)[:, columns].reshape(-1),
            covariance=Q[:, columns, :3].reshape(-1, 3),
        )


def _bases(network: Network, state: State, cofactors: Cofactors) -> Part:
    length, unit = air_bases(network, state)
    photo, q = network.base_photo, network.pattern.size
    a = np.zeros((len(length), 2, q))
    a[:, 0, :3] = -np.einsum("bij,bj->bi", network.axes[photo[:, 0]], unit)
    a[:, 1, :3] = np.einsum("bij,bj->bi", network.axes[photo[:, 1]], unit)
    aQ = np.einsum("bi,bij->bj", a.reshape(-1, 2 * q), cofactors.of_photos(photo))
    return Part(
        kind=ObservationKind.AIR_BASE,
        row=np.arange(len(length)),
        component=np.zeros(len(length), dtype=int),
        residual=length - network.base_length,
        weight=network.base_weight,
        cofactor=np.einsum("bi,bi->b", aQ, a.reshape(-1, 2 * q)),
        covariance=aQ[:, q : q + 3],
    )


def _water(network: Network, state: State, cofactors: Cofactors) -> Iterator[Part]:
    water, border = network.water, network.border
    if water.per_photo:
        level = cofactors.of_single_photos()[:, 6, 6]
        weight = np.where(water.group >= 0, water.level_weight, 0.0)
        yield _alone(ObservationKind.WATER_LEVEL, level_corrections(network, state), weight, level)
    rows = water_rows(network, state)
    Q = np.diagonal(cofactors.corner)[border.first_water : border.first_kept]
    start = 0
    for kind, count in (
        (ObservationKind.WATER_LEVEL, border.waters),
        (ObservationKind.WATER_TILT, border.tilts),
        (ObservationKind.WATER_INDEX, border.indices),
    ):
        part = slice(start, start + count)
        yield _alone(kind, -rows.deviation[part], rows.weight[part], Q[part])
        start += count
    if network.sea is not None and border.waves:
        wave, parameter = np.nonzero(network.sea.sea.unknown)
        waves = _alone(ObservationKind.WAVE, -rows.deviation[start:], rows.weight[start:], Q[start:])
        yield replace(waves, row=wave, component=parameter)


def _alone(kind: ObservationKind, residual: FloatArray, weight: FloatArray, cofactor: FloatArray) -> Part:
    """Return direct observations of unknowns that belong to no position."""
    count = np.arange(len(residual))
    is_tilt = kind is ObservationKind.WATER_TILT
    return Part(
        kind=kind,
        row=np.zeros_like(count) if is_tilt else count,
        component=count if is_tilt else np.zeros_like(count),
        residual=residual,
        weight=weight,
        cofactor=cofactor,
        covariance=np.full((len(residual), 3), np.nan),
    )


def _tie(kind: ObservationKind, rows: Rows, links: IntArray, cofactors: Cofactors) -> Part:
    Q = cofactors.corner[rows.index[:, :, None], rows.index[:, None, :]]
    aQ = np.einsum("ri,rij->rj", rows.partials, Q)
    return Part(
        kind=kind,
        row=links,
        component=np.zeros(len(links), dtype=int),
        residual=-rows.deviation,
        weight=rows.weight,
        cofactor=np.einsum("ri,ri->r", aQ, rows.partials),
        covariance=aQ[:, 3:],
    )
