"""Error propagation: covariances of points and depths, redundancy numbers and influences of all observations.

With the ground point eliminated, dX = shift - F ds, the adjusted value of an observation with partials a by the
stations and globals and b by its point moves by (a - b F) ds: its cofactor is (a - b F) Q (a - b F)' + b N^-1 b'.
Its redundancy number is 1 minus weight times that (Foerstner and Wrobel 2016, section 4.6).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from musatpy.adjustment.collinear import Elimination, eliminate
from musatpy.adjustment.iteration import LEVEL, State
from musatpy.adjustment.kinds import PRIORS, WATER, direct_rows
from musatpy.adjustment.network import Network, PointGroup, first_rows
from musatpy.adjustment.normals import Cofactors
from musatpy.arrays import FloatArray, IntArray
from musatpy.model import Block, ObservationKind, Observations

if TYPE_CHECKING:
    from musatpy.adjustment.datum import InnerConstraints

_CHUNK = 2**22  # elements of one gathered piece of the inverse: 32 MB
_SHARING = 5  # points that must have the same photos for their cofactors to be gathered once


class StationCofactors(Protocol):
    """Whatever knows the cofactors of the stations of points."""

    def with_border(self, photo: IntArray, index: IntArray) -> FloatArray:
        """Return the cofactors (k, m q + X, m q + X) of photos (k, m) and global unknowns (k, X)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """Some points of a group with what their errors depend on: T = m q + X unknowns of stations and globals."""

    group: PointGroup
    E: Elimination
    F: FloatArray  # (k, 3, T) the points by these unknowns, zero where they are kept
    cofactors: StationCofactors
    photo: IntArray  # (k, m)
    axes: FloatArray  # (k, 3, 3) axes of the elimination to east, north, up of the points

    @cached_property
    def Q(self) -> FloatArray:
        """(k, T, T) cofactors of what their errors depend on."""
        return self.cofactors.with_border(self.photo, self.E.extras.index)


@dataclass(frozen=True, kw_only=True, eq=False)
class PropagatedObservations:
    """Observations of one kind; `weight` is 1/sigma^2."""

    kind: ObservationKind
    row: IntArray  # (o,)
    component: IntArray  # (o,)
    residual: FloatArray  # (o,)
    weight: FloatArray  # (o,)
    cofactor: FloatArray  # (o,) of the adjusted observation
    covariance: FloatArray  # (o, 3) cofactors of the own position and the adjusted observation


def joined(parts: Iterable[PropagatedObservations]) -> Observations:
    """Return the observations of all parts in the order of kinds, rows and components."""
    every = list(parts)
    kind, row, component, weight, order = _ordered(every)
    weight = weight.take(order)
    influence = np.concatenate([part.covariance for part in every]).take(order, axis=0)
    influence *= weight[:, None]
    return Observations(
        kind=kind.take(order),
        row=row.take(order),
        component=component.take(order),
        residual=np.concatenate([part.residual for part in every]).take(order),
        sigma=1.0 / np.sqrt(weight),
        redundancy=1.0 - weight * np.concatenate([part.cofactor for part in every]).take(order),
        influence=influence,
    )


def variances(parts: Iterable[PropagatedObservations]) -> FloatArray:
    """Return the cofactors (o,) of all parts in the same order."""
    every = list(parts)
    order = _ordered(every)[-1]
    return np.concatenate([part.cofactor for part in every])[order]


def _ordered(parts: list[PropagatedObservations]) -> tuple[IntArray, IntArray, IntArray, FloatArray, IntArray]:
    """Return kinds, rows, components and weights of all observations, and the order of those with a weight."""
    kind = np.concatenate([np.full(len(part.row), part.kind) for part in parts])
    row = np.concatenate([part.row for part in parts])
    component = np.concatenate([part.component for part in parts])
    weight = np.concatenate([part.weight for part in parts])
    if not len(kind):
        return kind, row, component, weight, row
    # one key for all three, smallest values first: runs that are sorted already cost little
    rows, components = int(row.max()) + 1, int(component.max()) + 1
    order = np.argsort((kind * rows + row) * components + component, kind="stable")
    return kind, row, component, weight, order[weight[order] > 0.0]


def images(network: Network, piece: Piece, residual: FloatArray) -> PropagatedObservations:
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
    a = -(B.reshape(k, 2 * m, 3) @ piece.F).reshape(k, m, 2, -1)
    stations = a[..., : m * q].reshape(k, m, 2, m, q)
    ray = np.arange(m)
    stations[:, ray, :, ray] += np.moveaxis(A, 1, 0)
    a[..., m * q :] += E.extras.images
    return a.reshape(k, 2 * m, -1), B.reshape(k, 2 * m, 3)


def prior_partials(piece: Piece) -> tuple[FloatArray, FloatArray]:
    """Return the partials of the four rows of `Priors`, which it has, likewise: (k, 4, T) and (k, 4, 3)."""
    assert piece.E.normals.priors is not None
    b = piece.E.normals.priors.by_point
    a = -b @ piece.F
    a[:, :, piece.F.shape[2] - piece.E.extras.index.shape[1] :] += piece.E.extras.priors
    return a, b


def priors(piece: Piece, block: Block, alone: bool) -> Iterator[PropagatedObservations]:
    """Yield the control and the equal elevations of a piece.

    Of control with covariances what has the weights, or what tests an error of each component `alone`: (P v)_i /
    P_ii with the weight P_ii, whose redundancy number is (P Qvv P)_ii / P_ii (Baarda 1968).
    """
    known = piece.E.normals.priors
    if known is None:
        return
    k = len(piece.group.point)
    a, b = prior_partials(piece)
    components = np.broadcast_to(np.arange(3), (k, 3))
    for kind in PRIORS:
        row, part = first_rows(getattr(block, kind.observed.attribute).point, len(block.points.ids)), kind.part
        rows = np.repeat(row[piece.group.point][:, None], part.stop - part.start, axis=1)
        weight = known.weight[:, part] * np.pad(known.free, ((0, 0), (0, 1)), constant_values=True)[:, part]
        by, of, residual = a[:, part], b[:, part], -known.deviation[:, part]
        if alone and known.decorrelation is not None and kind.observed is ObservationKind.CONTROL:
            P = np.swapaxes(known.decorrelation, 1, 2) * weight[:, None]
            weight = np.einsum("kij,kji->ki", P, known.decorrelation)
            P = P / np.where(weight > 0.0, weight, 1.0)[:, :, None]
            by, of, residual = P @ by, P @ of, (P @ residual[..., None])[..., 0]
        yield _part(kind.observed, piece, by, of, rows, components[:, : rows.shape[1]], residual, weight)


def _part(
    kind: ObservationKind,
    piece: Piece,
    a: FloatArray,
    b: FloatArray,
    row: IntArray,
    component: IntArray,
    residual: FloatArray,
    weight: FloatArray,
) -> PropagatedObservations:
    """Return observations (k, o) of points with partials a (k, o, T) by stations and b (k, o, 3) by the point."""
    aQ = a @ piece.Q
    bN = b @ piece.E.inverse
    cofactor = np.einsum("kot,kot->ko", aQ, a) + np.einsum("koi,koi->ko", bN, b)
    position = aQ[:, :, -3:] if piece.group.kept else bN - aQ @ np.swapaxes(piece.F, 1, 2)
    covariance = position @ np.swapaxes(piece.axes, 1, 2)
    return PropagatedObservations(
        kind=kind,
        row=row.reshape(-1),
        component=component.reshape(-1),
        residual=residual.reshape(-1),
        weight=weight.reshape(-1),
        cofactor=cofactor.reshape(-1),
        covariance=covariance.reshape(-1, 3),
    )


def direct(network: Network, state: State, cofactors: Cofactors) -> Iterator[PropagatedObservations]:
    """Yield the observations that concern no image."""
    for kind, rows in direct_rows(network, state):
        aQ = np.einsum("rx,rxy->ry", rows.partials, cofactors.between(rows.index, rows.index))
        covariance = np.full((len(rows.row), 3), np.nan)
        if rows.position is not None:
            covariance = np.einsum("rx,rxi->ri", rows.partials, cofactors.between(rows.index, rows.position))
        yield PropagatedObservations(
            kind=kind.observed,
            row=rows.row,
            component=rows.component,
            residual=rows.residual,
            weight=rows.weight,
            cofactor=np.einsum("ry,ry->r", aQ, rows.partials),
            covariance=covariance,
        )


def pieces(
    network: Network, state: State, group: PointGroup, cofactors: StationCofactors
) -> Iterator[tuple[slice, Piece]]:
    """Yield the points of a group, so many at a time that what is gathered of the inverse stays small."""
    size = max(1, _CHUNK // (network.pattern.size * group.rays.shape[1] + 4) ** 2)
    for start in range(0, len(group.point), size):
        rows = slice(start, start + size)
        part = group.part(rows)
        E = eliminate(network, state, part)
        E = replace(E, inverse=E.free_inverse)
        axes = network.frame.axes(state.ground[part.point]) @ np.swapaxes(E.normals.axes, 1, 2)
        photo = network.photo[part.rays]
        yield rows, Piece(group=part, E=E, F=E.F, cofactors=cofactors, photo=photo, axes=axes)


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
    group, E = piece.group, piece.E
    columns, a, by_point = depth_partials(network, state, piece)
    variance = cofactors.cofactors_of(network.photo[group.rays], columns, a[:, None])[:, 0, 0]
    variance += np.einsum("ki,kij,kj->k", by_point, E.inverse, by_point)
    if inner is None:
        return np.asarray(variance)
    unknowns, depth = network.unknowns(group, columns), variance[:, None, None]
    constrained = any(np.isin(group.point[:1], other.point).all() for other in network.groups)
    return inner.of_points(unknowns, a[:, None], by_point[:, None], depth, E, constrained)[:, 0, 0]


def covariances_with_depths(
    network: Network, state: State, piece: Piece, cofactors: Cofactors
) -> tuple[FloatArray, FloatArray]:
    """Return the cofactors (k, 3, 3) of points of a piece along east, north, up, and those (k,) of their depths.

    `point_covariances` and `depth_cofactors` of points that are not kept, without constraints, at once. Neighbours
    in the piece that have the same photos share the cofactors of these, where enough do.
    """
    columns, a, by_point = depth_partials(network, state, piece)
    partials = np.zeros((len(a), 4, a.shape[1]))
    partials[:, :3, : piece.F.shape[2]], partials[:, 3] = -piece.F, a
    depends = np.concatenate([piece.photo, columns], axis=1)
    start = np.flatnonzero(np.append(True, (depends[1:] != depends[:-1]).any(axis=1)))
    if len(a) < _SHARING * len(start):
        Q = cofactors.cofactors_of(piece.photo, columns, partials)
    else:
        Q = np.empty((len(a), 4, 4))
        for first, last in zip(start.tolist(), [*start[1:].tolist(), len(a)], strict=True):
            shared = cofactors.with_border(piece.photo[first, None], columns[first, None])[0]
            some = partials[first:last]  # one product of matrices for all of their functions
            Q[first:last] = (some.reshape(-1, len(shared)) @ shared).reshape(some.shape) @ some.swapaxes(1, 2)
    inverse = piece.E.inverse
    depth = Q[:, 3, 3] + np.einsum("ki,kij,kj->k", by_point, inverse, by_point)
    return _turned(piece.axes, inverse + Q[:, :3, :3]), depth


def depth_partials(network: Network, state: State, piece: Piece) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return border columns (k, X), and partials of depths by stations and these (k, m q + X) and by points (k, 3).

    The points follow the stations.
    """
    group, E, F = piece.group, piece.E, piece.F
    split, T = group.rays.shape[1] * network.pattern.size, F.shape[2]
    index, surface = _surface_partials(network, state, group)
    by_point = E.normals.axes @ network.slope(state.tilt) - piece.axes[:, 2]
    a = np.concatenate([-np.einsum("ki,kit->kt", by_point, F), surface[:, split:]], axis=1)
    a[:, :split] += surface[:, :split]
    if group.kept:  # the coordinates stand last among the extras
        a[:, T - 3 : T] += by_point
    return np.concatenate([E.extras.index, index], axis=1), a, by_point


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


@dataclass(frozen=True, kw_only=True, eq=False)
class PointRows:
    """The l lines of two observations of each of k points, weighted: images, and two of what is known of the point.

    With partials by stations, by globals, and by the point, which follows. Errors of P kinds are told apart.
    """

    point: IntArray  # (k,)
    line: IntArray  # (k, l) of a table of all measurements, then two lines of each point
    photo: IntArray  # (k, m) of the images, which stand first
    root: FloatArray  # (k, 2l) of the weights
    A: FloatArray  # (k, m, 2, q) of images by their stations
    B: FloatArray  # (k, 2l, 3)
    inverse: FloatArray  # (k, 3, 3) N_pp^-1
    axes: FloatArray  # (k, 3, 3)
    index: IntArray  # (k, X) columns of the border
    extra: FloatArray  # (k, 2l, X)

    def weighted(self, errors: FloatArray) -> FloatArray:
        """Return the weighted errors (k, 2l, P) of these lines, out of those of the whole table."""
        return errors.take(self.line, axis=0).reshape(*self.root.shape, errors.shape[2]) * self.root[..., None]

    def left(self, errors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what the points leave of errors (k, 2l, P) for known stations, and their movements (k, 3, P)."""
        moves = -self.inverse @ (np.swapaxes(self.B, 1, 2) @ errors)
        return errors + self.B @ moves, moves

    def by_unknowns(self, network: Network, step: FloatArray) -> FloatArray:
        """Return the changes (k, 2l, P) by steps (u, P) of stations and globals."""
        split, (k, m), P = network.pattern.order, self.photo.shape, step.shape[1]
        change = self.extra @ step[split:][self.index]
        change[:, : 2 * m] += (
            self.A @ step[:split].reshape(network.photos, -1, P).take(self.photo, axis=0)
        ).reshape(k, -1, P)
        return change

    def add_rhs(self, network: Network, errors: FloatArray, rhs: FloatArray) -> None:
        """Add the right sides by errors (k, 2l, P) that the points leave to those of all unknowns, (u, P)."""
        split, (k, m), P = network.pattern.order, self.photo.shape, rhs.shape[1]
        of_images = np.swapaxes(self.A, 2, 3) @ errors[:, : 2 * m].reshape(k, m, 2, P)
        photo, stations = self.photo.reshape(-1), rhs[:split].reshape(network.photos, -1)
        for column, values in enumerate(of_images.reshape(k * m, -1).T):
            stations[:, column] -= np.bincount(photo, values, network.photos)
        np.add.at(rhs[split:], self.index, -np.swapaxes(self.extra, 1, 2) @ errors)


def point_rows(network: Network, state: State, group: PointGroup) -> PointRows:
    """Return the weighted observations of the points of a group where they are."""
    E, (k, m) = eliminate(network, state, group), group.rays.shape
    line, weight, B = group.rays, group.weights(network.weight).reshape(k, 2 * m), E.normals.B.reshape(k, 2 * m, 3)
    extra = E.extras.images.reshape(k, 2 * m, E.extras.index.shape[1])
    if (priors := E.normals.priors) is not None:
        line = np.concatenate([line, len(network.photo) + 2 * group.point[:, None] + np.arange(2)], axis=1)
        weight = np.concatenate([weight, priors.weight], axis=1)
        B = np.concatenate([B, priors.by_point], axis=1)
        extra = np.concatenate([extra, E.extras.priors], axis=1)
    root = np.sqrt(weight)
    return PointRows(
        point=group.point,
        line=line,
        photo=network.photo[group.rays],
        root=root,
        A=E.A,
        B=B * root[..., None],
        inverse=E.inverse,
        axes=E.normals.axes,
        index=E.extras.index,
        extra=extra * root[..., None],
    )


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
