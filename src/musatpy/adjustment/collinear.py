"""Points by collinearity: their images and priors, the ground coordinates eliminated point by point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from musatpy.adjustment.ground import PointNormals, hold, point_normals
from musatpy.adjustment.kinds import WATER
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import NormalEquations, Sums, summed
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray, IntArray
from musatpy.model import ObservationKind


@dataclass(frozen=True, kw_only=True, eq=False)
class Extras:
    """Partials of k points with m rays by X global unknowns, which may repeat in a row of `index`.

    The rows of `priors` are those of `ground.Priors`: east, north, up, and up against its level.
    """

    index: IntArray  # (k, X) columns of the border
    images: FloatArray  # (k, m, 2, X)
    priors: FloatArray  # (k, 4, X)


class Follow(Protocol):
    """How points follow a step of stations and globals: what is left of their elimination."""

    def move(self, network: Network, state: State, step: FloatArray, ground: FloatArray) -> None:
        """Set the points of `ground` (p, 3) where they are after a step (u,) of all unknowns from `state`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GroupFollow:
    """How the k points of one group follow."""

    group: PointGroup
    axes: FloatArray  # (k, 3, 3)
    shift: FloatArray  # (k, 3)
    by_station: FloatArray  # (k, 3, m, q)
    by_extra: FloatArray  # (k, 3, X)
    index: IntArray  # (k, X)

    def move(self, network: Network, state: State, step: FloatArray, ground: FloatArray) -> None:
        """Set the points of `ground` (p, 3) where they are after a step (u,) of all unknowns from `state`."""
        point = self.group.point
        change = np.einsum("kji,kj->ki", self.axes, self.step(network, step))
        ground[point] = hold(network, point, state.ground[point] + change)

    def step(self, network: Network, step: FloatArray) -> FloatArray:
        """Return the steps (k, 3) of the points along `axes` in a step (u,) of all unknowns."""
        split = network.pattern.order
        if self.group.kept:
            return step[split:][network.border.kept_columns(self.group.point)]
        stations = step[:split].reshape(network.photos, -1)[network.photo[self.group.rays]]
        local = self.shift - np.einsum("kimj,kmj->ki", self.by_station, stations)
        return local - np.einsum("kie,ke->ki", self.by_extra, step[split:][self.index])


@dataclass(frozen=True, kw_only=True, eq=False)
class Elimination:
    """The ground coordinates of k points in terms of stations and globals: dX = shift - F ds - F_e de.

    In the axes of the point normals; N_pp^-1 is the covariance of the point for stations without error. A kept
    point is not eliminated: its coordinates are among the globals, and N_pp^-1, F and shift are zero.
    """

    normals: PointNormals
    extras: Extras
    A: FloatArray  # (k, m, 2, q) images by stations, times the roots of the weights
    residual: FloatArray  # (k, m, 2) likewise
    cross: FloatArray  # (k, m q, 3) N_sp
    inverse: FloatArray  # (k, 3, 3) N_pp^-1
    by_station: FloatArray  # (k, 3, m, q) F = N_pp^-1 N_ps
    by_extra: FloatArray  # (k, 3, X) F_e = N_pp^-1 N_pe
    shift: FloatArray  # (k, 3) N_pp^-1 times the right side of the point

    @property
    def F(self) -> FloatArray:
        """(k, 3, m q + X) the points by all these stations and globals."""
        return np.concatenate([self.by_station.reshape(len(self.shift), 3, -1), self.by_extra], axis=2)

    @property
    def free_inverse(self) -> FloatArray:
        """(k, 3, 3) N_pp^-1 without what is held of the points, which has no error."""
        if self.normals.priors is None:
            return self.inverse
        free = self.normals.priors.free
        return self.inverse * free[:, :, None] * free[:, None, :]

    def follow(self, group: PointGroup) -> GroupFollow:
        """Return how the points, those of `group`, follow a step."""
        return GroupFollow(
            group=group,
            axes=self.normals.axes,
            shift=self.shift,
            by_station=self.by_station,
            by_extra=self.by_extra,
            index=self.extras.index,
        )

    @property
    def gain(self) -> float:
        """r' N_pp^-1 r: by how much the sum of squares falls when the points go to their best; sigmas, squared."""
        return float(np.sum(self.normals.rhs * self.shift))


def eliminate(network: Network, state: State, group: PointGroup, ground: FloatArray | None = None) -> Elimination:
    """Return the elimination of the points of a group where they are, or at `ground` (k, 3)."""
    ground = state.ground[group.point] if ground is None else ground
    normals = point_normals(network, state, group, ground)
    extras = _extras(network, group, normals)
    k, m = group.rays.shape
    # weighted rows: from here on every product is a plain one
    root = np.sqrt(group.weights(network.weight))
    A, B = normals.images.by_station * root[..., None], normals.B * root[..., None]
    cross = np.swapaxes(A, 2, 3) @ B  # (k, m, q, 3) N_sp
    inverse = np.zeros_like(normals.matrix) if group.kept else np.linalg.inv(normals.matrix)
    by_station = inverse @ np.swapaxes(cross.reshape(k, -1, 3), 1, 2)
    by_extra = inverse @ _point_extra(normals, extras, group.weights(network.weight))
    return Elimination(
        normals=normals,
        extras=extras,
        A=A,
        residual=normals.residual * root,
        cross=cross.reshape(k, -1, 3),
        inverse=np.asarray(inverse, dtype=float),
        by_station=by_station.reshape(k, 3, m, -1),
        by_extra=by_extra,
        shift=np.einsum("kij,kj->ki", inverse, normals.rhs),
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
    if N.priors is not None and network.border.count(ObservationKind.EQUAL_ELEVATION):
        level = np.maximum(network.priors.group[group.point], 0)[:, None]  # of no weight for points without group
        row = np.zeros((len(level), 4, 1))
        row[:, 3] = -1.0
        parts.append((level, np.zeros((*N.B.shape[:3], 1)), row))
    if N.priors is not None and group.kept:
        parts.append((network.border.kept_columns(group.point), N.B, N.priors.by_point))
    k, m = group.rays.shape
    none = (np.zeros((k, 0), dtype=np.int64), np.zeros((k, m, 2, 0)), np.zeros((k, 4, 0)))
    index, images, rows = zip(none, *parts, strict=True)
    return Extras(
        index=np.concatenate(index, axis=1),
        images=np.concatenate(images, axis=-1),
        priors=np.concatenate(rows, axis=-1),
    )


def _water_extras(
    network: Network, group: PointGroup, N: PointNormals
) -> list[tuple[IntArray, FloatArray, FloatArray]]:
    """Return index, image partials, prior rows by the unknown water in the border: levels, tilts, index, waves."""
    by_water = N.images.by_water
    if by_water is None or not network.refracted[group.rays].any():
        return []
    index, images = zip(*(kind.of_images(network, group, by_water) for kind in WATER), strict=True)
    columns = np.concatenate(index, axis=1)
    if not columns.shape[1]:
        return []
    return [(columns, np.concatenate(images, axis=-1), np.zeros((len(columns), 4, columns.shape[1])))]


@dataclass(frozen=True, kw_only=True, eq=False)
class Reduced:
    """Reduced normal equations of k points with m rays: of their stations, and of the X globals of their extras.

    Plain arrays out of plain arrays: what forms them knows nothing of how they are stored and solved.
    """

    sums: Sums
    border: FloatArray  # (k, m, q, X)
    corner: FloatArray  # (k, X, X)
    corner_rhs: FloatArray  # (k, X)


def reduced(network: Network, group: PointGroup, E: Elimination) -> Reduced:
    """Return the reduced normal equations of the points of a group."""
    pattern, photo, weight = network.pattern, network.photo[group.rays], group.weights(network.weight)
    k, m, _, q = E.A.shape
    At = np.swapaxes(E.A, 2, 3)
    rhs = -(At @ E.residual[..., None])[..., 0] - (E.cross @ E.shift[..., None]).reshape(k, m, q)
    i, j = np.triu_indices(m)
    blocks = -E.cross.reshape(k, m, q, 3)[:, i] @ np.swapaxes(E.by_station, 1, 2)[:, j]
    blocks[:, i == j] += At @ E.A
    return Reduced(sums=summed(pattern, photo, blocks, rhs), **_of_extras(E, weight))


def add_collinear(network: Network, group: PointGroup, E: Elimination, part: Reduced, out: NormalEquations) -> None:
    """Add the reduced normal equations of the points of a group."""
    photo = network.photo[group.rays]
    out.add_sums(part.sums)
    if E.extras.index.shape[1]:
        out.add_border(photo, E.extras.index, part.border)
        out.add_corner(E.extras.index, part.corner, part.corner_rhs)


def local_normals(network: Network, group: PointGroup, E: Elimination) -> tuple[FloatArray, FloatArray]:
    """Return matrix (k, u, u) and right side (k, u) of the reduced normals of each point for itself.

    By the u = m q + X unknowns of its stations and extras, in the order of `Cofactors.with_border`.
    """
    k, m, _, q = E.A.shape
    At = np.swapaxes(E.A, 2, 3)
    stations = -E.cross @ E.by_station.reshape(k, 3, m * q)
    ray = np.arange(m)
    stations.reshape(k, m, q, m, q)[:, ray, :, ray, :] += np.moveaxis(At @ E.A, 1, 0)
    rhs = -(At @ E.residual[..., None]).reshape(k, m * q) - (E.cross @ E.shift[..., None])[..., 0]
    extras = _of_extras(E, group.weights(network.weight))
    border = extras["border"].reshape(k, m * q, -1)
    matrix = np.block([[stations, border], [np.swapaxes(border, 1, 2), extras["corner"]]])
    return matrix, np.concatenate([rhs, extras["corner_rhs"]], axis=1)


def _of_extras(E: Elimination, W: FloatArray) -> dict[str, FloatArray]:
    N, X = E.normals, E.extras
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
    border -= (E.cross @ E.by_extra).reshape(border.shape)
    return {"border": border, "corner": corner, "corner_rhs": rhs}
