"""Points by collinearity, and MUSAT-IIIA as a least squares problem: stations, water and ground points at once.

Collinearity of every image, the refraction in its equations (ETL-0306 section 4 with the corrections of
docs/theory.md), and what is known of points. The ground points are eliminated from the normal equations point by
point, and follow the step of the stations by back substitution.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from musatpy.adjustment.ground import PointNormals, hold, point_normals, point_squares, settle_group
from musatpy.adjustment.iteration import Linearisation, State, not_raised
from musatpy.adjustment.kernels import Loops, loops_of, side_by_side
from musatpy.adjustment.kinds import (
    OF_IMAGES,
    UNKNOWNS,
    add_direct,
    direct_squares,
    kept_movement,
    largest_movements,
    redundancy,
    state_after,
)
from musatpy.adjustment.network import RAYS, Network, PointGroup, parts_of, together
from musatpy.adjustment.normals import NormalEquations, Sums, factorised, summed
from musatpy.adjustment.sparse import upper_triangle
from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry import collinearity
from musatpy.model import INDEX_RANGE, ObservationKind, Options

_FLATTEST = 0.1  # of the curvature of the normal equations
_SHARE = 1e-5  # of the sigmas of waves: steps of the central differences, which lose ten digits of sixteen


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
    B: FloatArray  # (k, m, 2, 3) by the points, likewise
    G: FloatArray  # (k, m, 2, X) by the globals, likewise
    residual: FloatArray  # (k, m, 2) likewise
    cross: FloatArray  # (k, m q, 3) N_sp
    of_extras: FloatArray  # (k, 3, X) N_pe
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
    by_global = extras.images * root[..., None]
    of_extras = np.swapaxes(B.reshape(k, 2 * m, 3), 1, 2) @ by_global.reshape(k, 2 * m, by_global.shape[-1])
    if normals.priors is not None:
        pull = normals.priors.weight[:, 3] * normals.priors.free[:, 2]
        of_extras[:, 2] += pull[:, None] * extras.priors[:, 3]
    return Elimination(
        normals=normals,
        extras=extras,
        A=A,
        B=B,
        G=by_global,
        residual=normals.residual * root,
        cross=cross.reshape(k, -1, 3),
        of_extras=of_extras,
        inverse=np.asarray(inverse, dtype=float),
        by_station=by_station.reshape(k, 3, m, -1),
        by_extra=inverse @ of_extras,
        shift=np.einsum("kij,kj->ki", inverse, normals.rhs),
    )


def _extras(network: Network, group: PointGroup, N: PointNormals) -> Extras:
    """Return the partials of a group by the globals that it depends on."""
    parts = [*_image_extras(network, group, N)]
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


def _image_extras(
    network: Network, group: PointGroup, N: PointNormals
) -> list[tuple[IntArray, FloatArray, FloatArray]]:
    """Return index, image partials, prior rows by what images depend on in the border: the water, lenses."""
    unknown = (kind for kind in OF_IMAGES if network.border.count(kind.observed))
    parts = [kind.of_images(network, group, N.images) for kind in unknown]
    return [(index, images, np.zeros((len(index), 4, index.shape[1]))) for index, images in parts if index.shape[1]]


@dataclass(frozen=True, kw_only=True, eq=False)
class ReducedNormals:
    """Reduced normal equations of k points with m rays: of their stations, and of the X globals of their extras.

    Plain arrays out of plain arrays: what forms them knows nothing of how they are stored and solved.
    """

    sums: Sums
    border: FloatArray  # (k, m, q, X)
    corner: FloatArray  # (k, X, X)
    corner_rhs: FloatArray  # (k, X)


def reduced(network: Network, group: PointGroup, E: Elimination) -> ReducedNormals:
    """Return the reduced normal equations of the points of a group."""
    pattern, photo = network.pattern, network.photo[group.rays]
    k, m, _, q = E.A.shape
    At = np.swapaxes(E.A, 2, 3)
    rhs = -(At @ E.residual[..., None])[..., 0] - (E.cross @ E.shift[..., None]).reshape(k, m, q)
    i, j = upper_triangle(m)
    blocks = -E.cross.reshape(k, m, q, 3)[:, i] @ np.swapaxes(E.by_station, 1, 2)[:, j]
    blocks[:, i == j] += At @ E.A
    return ReducedNormals(sums=summed(pattern, photo, blocks, rhs), **_of_extras(E))


def add_collinear(
    network: Network, group: PointGroup, E: Elimination, part: ReducedNormals, out: NormalEquations
) -> None:
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
    extras = _of_extras(E)
    border = extras["border"].reshape(k, m * q, -1)
    matrix = np.block([[stations, border], [np.swapaxes(border, 1, 2), extras["corner"]]])
    return matrix, np.concatenate([rhs, extras["corner_rhs"]], axis=1)


def _of_extras(E: Elimination) -> dict[str, FloatArray]:
    X, priors, (k, m, _, count) = E.extras.priors, E.normals.priors, E.G.shape
    G, residual = E.G.reshape(k, 2 * m, count), E.residual.reshape(k, 2 * m, 1)
    Gt = np.swapaxes(G, 1, 2)
    corner = Gt @ G - np.swapaxes(E.of_extras, 1, 2) @ E.by_extra
    rhs = -(Gt @ residual)[..., 0] - np.einsum("kie,ki->ke", E.of_extras, E.shift)
    if priors is not None:
        corner += np.einsum("kae,ka,kaf->kef", X, priors.weight, X)
        rhs += np.einsum("kae,ka,ka->ke", X, priors.weight, priors.deviation)
    border = np.swapaxes(E.A, 2, 3) @ (E.G - E.B @ E.by_extra[:, None])
    return {"border": border, "corner": corner, "corner_rhs": rhs}


def sum_of_squares(network: Network, state: State) -> float:
    """Return the weighted sum of squares at a state that has those of its points; infinite if it is senseless."""
    total = direct_squares(network, state)
    total += sum(float(state.squares[group.point].sum()) for group in network.groups)
    return total if np.isfinite(total) else np.inf


def sensible_water(network: Network, state: State) -> bool:
    """Return whether waves and index, where they are unknown, are such as water has: no step was too long."""
    index = INDEX_RANGE[0] <= state.index <= INDEX_RANGE[1] or not network.border.count(ObservationKind.WATER_INDEX)
    return index and (network.sea is None or network.sea.at(state.waves).sensible)


@dataclass(frozen=True, kw_only=True, eq=False)
class Simultaneous:
    """The simultaneous adjustment of a network."""

    network: Network
    options: Options  # its limits
    held: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # what holds a free block

    @cached_property
    def _loops(self) -> Loops:
        return loops_of(self.network, self.network.groups)

    @cached_property
    def _redundancy(self) -> int:
        return redundancy(self.network)

    def linearise(self, state: State) -> Linearisation:
        """Return the normal equations of stations and globals at `state`, the ground points eliminated."""
        network = self.network
        normals = NormalEquations(network.pattern, network.border.size)
        follows: list[Follow] = []

        def eliminated(part: PointGroup) -> tuple[Elimination, ReducedNormals]:
            E = eliminate(network, state, part)
            return E, reduced(network, part, E)

        left, of_points = self._loops.eliminate(state, normals, follows)
        parts = parts_of(together(left), RAYS)
        for part, (E, equations) in zip(parts, side_by_side(eliminated, parts, len(network.photo)), strict=True):
            add_collinear(network, part, E, equations, normals)
            follows.append(E.follow(part))
            of_points += E.gain
        add_direct(network, state, normals)
        matrix, rhs = normals.finished(self.held)
        return Linearisation(
            matrix=matrix,
            rhs=rhs,
            objective=self.evaluate(state),
            context=follows,
            redundancy=self._redundancy,
            of_points=of_points,
        )

    def evaluate(self, state: State, context: list[Follow] | None = None) -> float:
        """Return the weighted sum of squares at `state`."""
        return sum_of_squares(self.network, state)

    def apply(self, state: State, step: FloatArray, context: list[Follow]) -> State:
        """Return the state after a step, which the ground points follow by back substitution.

        However short the step of the stations, the points take their whole one: where that would raise the sum of
        squares, the points that got worse go from where they were to their optimum instead. So a step that is
        damped enough lowers the sum always.
        """
        network, before = self.network, self.evaluate(state)
        new = state_after(network, state, step)
        ground = new.ground.copy()
        for follow in context:
            follow.move(network, state, step, ground)
        after = replace(new, ground=ground)
        if not sensible_water(network, new):
            squares = np.full_like(state.squares, np.inf)  # the step was too long
            return replace(after, squares=squares)
        after = self.with_squares(after)
        if not_raised(self.evaluate(after), before):
            return after
        return self._settled(after, state)

    def _settled(self, after: State, before: State) -> State:
        """Return the state `after` with those eliminated points at their optimum that fitted better `before`."""
        network, ground, squares = self.network, after.ground.copy(), after.squares.copy()
        for group in together(network.groups):
            worse = after.squares[group.point] > before.squares[group.point]
            if worse.any() and not group.kept:
                part = group.part(worse)
                start = before.ground[part.point]
                ground[part.point], squares[part.point] = settle_group(network, after, part, start, trial=True)
        return replace(after, ground=ground, squares=squares)

    def with_squares(self, state: State) -> State:
        """Return the state with the weighted squares of its points where they are."""
        squares = state.squares.copy()
        for group in together(self._loops.set_squares(state, squares)):
            squares[group.point] = point_squares(self.network, state, group, state.ground[group.point])
        return replace(state, squares=squares)

    def converged(self, step: FloatArray) -> bool:
        """Return whether the largest steps of stations and water are below their limits."""
        _, rotation, _, translation = largest_movements(step, self.network)
        turn, shift = self.options.rotation_limit, self.options.translation_limit
        rest = all(kind.movement(self.network, step)[0] < kind.limit(turn, shift) for kind in UNKNOWNS)
        return rest and rotation < turn and max(translation, kept_movement(step, self.network)) < shift


@dataclass(frozen=True, kw_only=True, eq=False)
class Curved(Simultaneous):
    """The simultaneous adjustment with the second derivatives of the images by unknown waves.

    In the effect of length, azimuth and crest the height is a factor. Of a wave that hardly shows, steps that take
    the images for linear go from one side of the minimum to the other, or have to be damped to a crawl. With the
    second derivatives by the waves alone, steps are those of Newton's method in them. Those by waves and points, or
    stations, are left out: these move by less than a hundredth of a length.
    """

    def linearise(self, state: State) -> Linearisation:
        """Return the normal equations at `state`, their corner with the curvature by the waves."""
        line, border = super().linearise(state), self.network.border
        matrix, factor = line.matrix, factorised(line.matrix)
        if factor is None:
            return line
        waves, corner = border.at(ObservationKind.WAVE), matrix.corner.copy()
        rows = len(matrix.border) + border.numbers(ObservationKind.WAVE)
        units = np.zeros((matrix.size, len(rows)))
        units[rows, np.arange(len(rows))] = factor.scale[rows]
        cofactor = factor.solve_scaled(units)[rows] * factor.scale[rows, None]
        corner[waves, waves] += safe_curvature(wave_curvature(self.network, state), cofactor)
        return replace(line, matrix=replace(matrix, corner=corner))


def safe_curvature(curvature: FloatArray, cofactor: FloatArray) -> FloatArray:
    """Return the curvature C (w, w) so that N + C is positive definite; `cofactor` (w, w) is N^-1 of the waves.

    Against N, N + C has the eigenvalues 1 + m. Where they are below zero, or hardly above, the sum of squares
    curves down, or not at all: their sizes count then, and no less than `_FLATTEST`. So no step goes to a maximum.
    """
    L = np.linalg.cholesky(np.linalg.inv(0.5 * (cofactor + cofactor.T)))
    inner = np.linalg.solve(L, np.linalg.solve(L, curvature).T)
    m, U = np.linalg.eigh(0.5 * (inner + inner.T))
    turned = L @ U
    return (turned * (np.maximum(np.abs(1.0 + m), _FLATTEST) - 1.0)) @ turned.T


def wave_curvature(network: Network, state: State) -> FloatArray:
    """Return sum of P r times the second derivatives of the images by the unknown parameters of the waves (w, w).

    r are the residuals (adjusted minus measured) at `state`, P their weights. The waves act through their height
    and gradient at the incidence points: the partials of these by the parameters are differenced, all else stays.
    """
    sea = network.sea
    assert sea is not None and sea.trains is not None and sea.sea.sigma is not None, "there are unknown waves"
    trains, sigma = sea.trains, sea.sea.sigma
    rays = np.concatenate([group.rays.reshape(-1) for group in network.groups])
    rays = rays[network.refracted[rays]]
    photo, ground = network.photo[rays], state.ground[network.point[rays]]
    bent = sea.at(state.waves).incidence(photo, state.position[photo], ground, state.tide[photo], state.index)
    f, pp = network.focal_length[photo], network.principal_point[photo]
    xy, by_v = collinearity.image_by_vector(bent.v, state.M[photo], f, pp)
    pull = np.einsum("na,nai->ni", network.weight[rays] * (xy - network.xy[rays]), by_v)
    by_height = np.einsum("ni,ni->n", pull, bent.by_level)
    by_slope = np.einsum("ni,nia->na", pull, bent.by_slope)
    unknown, time = sea.sea.unknown, sea.sea.time[photo]

    def gradient(waves: FloatArray) -> FloatArray:
        height, slope = trains.with_values(waves).by_parameters(bent.place, time)
        return by_height @ height[:, unknown] + np.einsum("na,naw->w", by_slope, slope[..., unknown])

    rows = []
    for wave, of in np.argwhere(unknown):
        step = np.zeros_like(state.waves)
        step[wave, of] = _SHARE * sigma[wave, of]
        rows.append((gradient(state.waves + step) - gradient(state.waves - step)) / (2.0 * step[wave, of]))
    matrix = np.array(rows).reshape(len(rows), len(rows))
    return 0.5 * (matrix + matrix.T)
