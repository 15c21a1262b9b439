"""What the errors of pointing, of two stations and of the water do to many points of a pair.

All points hang on the same unknowns, T of both stations and the water: their cofactors are one matrix, and what is
of a point are the partials of its four image coordinates. The twins for any network are in
`adjustment.propagation`, and of y-parallaxes in `errors_of_pairs`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import einsum

from musatpy.adjustment.iteration import LEVEL, State
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import Cofactors
from musatpy.arrays import FloatArray, IntArray
from musatpy.compilation.pair_images import (
    Look,
    Pair,
    Side,
    Sight,
    Water,
    cross,
    curvature,
    directions,
    dot,
    inverse,
    look,
    size,
    step,
    turned,
)
from musatpy.model import ObservationKind


@dataclass(frozen=True, kw_only=True, eq=False)
class Unknowns:
    """What the images of one photo hang on: its station along axes (3, 3) and by its angles, and the water.

    M_partials (3, 3, 3) of the photo by omega, phi, kappa. `rows` (U,) are its unknowns among all T: six of the
    station, then, where it has one, its own level, then the levels that photos share, tilts, the index: as `level`,
    `tilts` and `index` say (of these U), -1 where there is none.
    """

    axes: FloatArray
    M_partials: FloatArray
    rows: IntArray
    level: int
    tilts: int
    index: int


@dataclass(frozen=True, kw_only=True, eq=False)
class PairErrors:
    """A pair with the cofactors (T, T) of what its points hang on.

    surface (T,): partials of the mean height of the water at both photos by its levels. Those by the tilts are the
    place of a point along tilt_axes (2, 3); they stand at `tilts` among the T, -1 where the tilts are known.
    """

    pair: Pair
    unknowns: tuple[Unknowns, Unknowns]
    cofactors: FloatArray
    surface: FloatArray
    tilt_axes: FloatArray
    tilts: int

    @cached_property
    def _blocks(self) -> tuple[tuple[FloatArray, ...], ...]:
        """The cofactors of what one image hangs on with those of another, of left and right."""
        rows = [own.rows for own in self.unknowns]
        return tuple(tuple(self.cofactors[np.ix_(i, j)] for j in rows) for i in rows)

    @classmethod
    def of(cls, network: Network, state: State, photos: tuple[int, int], cofactors: Cofactors) -> PairErrors:
        """Return those of two photos (rows) of a network that meet in its pattern, with its cofactors."""
        water, border, q = network.water, network.border, network.pattern.size
        columns = {
            kind: border.numbers(kind)
            for kind in (ObservationKind.WATER_LEVEL, ObservationKind.WATER_TILT, ObservationKind.WATER_INDEX)
        }
        levels, tilts, index = columns.values()
        group = water.group[list(photos)]
        common = levels[np.maximum(group, 0)] if len(levels) else levels
        at = np.concatenate([common, tilts, index])
        count, surface = 2 * q, np.zeros(2 * q + len(at))
        share = 0.5 * (group >= 0)
        if water.per_photo:
            surface[[LEVEL, q + LEVEL]] = share
        surface[count : count + len(common)] = share[: len(common)]
        of_sides = []
        for side, photo in enumerate(photos):
            own = [LEVEL] if water.per_photo else [q + side] if len(common) and group[side] >= 0 else []
            of_sides.append(
                Unknowns(
                    axes=network.axes[photo],
                    M_partials=state.dM[photo],
                    rows=np.concatenate([side * q + np.arange(q), count + np.arange(len(at))]),
                    level=own[0] if own else -1,
                    tilts=q + len(common) if len(tilts) else -1,
                    index=q + len(at) - 1 if len(index) else -1,
                )
            )
        return cls(
            pair=_pair(network, state, photos),
            unknowns=(of_sides[0], of_sides[1]),
            cofactors=cofactors.with_border(np.array([photos]), at[None])[0],
            surface=surface,
            tilt_axes=network.tilt_axes,
            tilts=count + len(common) if len(tilts) else -1,
        )

    def of_images(self, at: Look, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the partials (U, 2, c) of the images of points X (3, c) on either photo by its unknowns."""
        return self._of_side(0, at, X), self._of_side(1, at, X)

    def between_images(self, A: tuple[FloatArray, FloatArray]) -> FloatArray:
        """Return the cofactors (4, 4, c) of images that come from the unknowns, with their partials `of_images`."""
        out = np.empty((4, 4, A[0].shape[2]))
        for i, j in ((0, 0), (0, 1), (1, 1)):
            QA = einsum("tu,ujc->tjc", self._blocks[i][j], A[j])
            out[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = einsum("tic,tjc->ijc", A[i], QA)
        out[2:, :2] = np.swapaxes(out[:2, 2:], 0, 1)
        return out

    def with_surface(self, A: tuple[FloatArray, FloatArray], X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the cofactors (4, c) of images and (c,) of itself of the water over points X (3, c)."""
        if not self.surface.any() and self.tilts < 0:
            return np.zeros((4, X.shape[1])), np.zeros(X.shape[1])
        s = np.repeat(self.surface[:, None], X.shape[1], axis=1)
        if self.tilts >= 0:
            s[self.tilts : self.tilts + 2] = turned(self.tilt_axes, X)
        Qs = einsum("tu,uc->tc", self.cofactors, s)
        of_images = [einsum("tic,tc->ic", part, Qs[own.rows]) for part, own in zip(A, self.unknowns, strict=True)]
        return np.concatenate(of_images), einsum("tc,tc->c", s, Qs)

    def _of_side(self, number: int, at: Look, X: FloatArray) -> FloatArray:
        side, own, of = self.pair.sides[number], self.unknowns[number], at.sides[number]
        out, rays = np.zeros((len(own.rows), 2, X.shape[1])), of.rays
        by_station = rays.by_station(of.by_v)
        UVS = turned(side.M, rays.v)
        scale, ratio = -side.focal_length / UVS[2], UVS[:2] / UVS[2]
        for axis in range(3):
            out[axis] = einsum("i,ric->rc", own.axes[axis], by_station)
            by_angle = turned(own.M_partials[axis], rays.v)
            out[3 + axis] = scale * (by_angle[:2] - ratio * by_angle[2])
        if of.over is None:
            return out
        by_level = rays.by_level(of.by_v)
        if own.level >= 0:
            out[own.level] = by_level / of.over.secant
        if own.tilts >= 0:
            for row, axis in enumerate(self.tilt_axes, own.tilts):
                out[row] = _by_tilt(axis, side.station[:, None] - X, X, of, by_station, by_level)
        if own.index >= 0:
            out[own.index] = rays.by_index(of.by_v)
        return out


def _pair(network: Network, state: State, photos: tuple[int, int]) -> Pair:
    left, right = (
        Side(
            station=state.position[photo],
            M=state.M[photo],
            focal_length=float(network.focal_length[photo]),
            principal_point=network.principal_point[photo],
            tide=float(state.tide[photo]),
        )
        for photo in photos
    )
    water = Water(index=float(state.index), slope=network.slope(state.tilt), curvature=curvature(network.frame))
    return Pair(sides=(left, right), water=water)


def _by_tilt(
    axis: FloatArray, back: FloatArray, X: FloatArray, of: Sight, by_station: FloatArray, by_level: FloatArray
) -> FloatArray:
    """Return the partials (2, c) of images by the slope of the water along an axis (3,): `water_surface.by_tilt`.

    back (3, c) are the ways from the points X to the station.
    """
    over = of.over
    assert over is not None
    across, secant = axis @ over.gradient, over.secant
    up = secant * over.normal + over.gradient
    normal_by_slope = (up * (axis @ up) - axis[:, None]) / secant - over.normal * across / np.square(secant)
    omega = cross(over.normal, normal_by_slope)
    depth_by_slope = (axis @ X) / secant - over.depth * across / np.square(secant)
    turning = dot(of.by_v, cross(omega, of.rays.v)) - dot(by_station, cross(omega, back))
    return np.asarray(turning + by_level * depth_by_slope)


@dataclass(frozen=True, kw_only=True, eq=False)
class Described:
    """c points where they are least squares, and their errors."""

    X: FloatArray  # (3, c)
    last: FloatArray  # (c,) m, the step that led there
    residual: FloatArray  # (4, c) mm, computed minus read
    covariance: FloatArray  # (3, 3, c) m2, along east, north, up
    gaps: FloatArray  # (2, c) m, heights of the water at either photo over the points
    depth_variance: FloatArray  # (c,) m2, of the mean of these
    incidence: FloatArray  # (c,) rad, mean angle in air between the rays read and the normal of the water
    parallax: FloatArray  # (c,) mm, y-parallaxes
    parallax_variance: FloatArray  # (c,)
    pointing: FloatArray  # (c,) what errors of pointing have in that
    kink: FloatArray  # (c,) m, in height: how far residuals of this size could bring a point (`waterline`)


def described(
    errors: PairErrors, xy: FloatArray, weight: FloatArray, X: FloatArray, height: FloatArray, axes: FloatArray,
    wet: bool,
) -> Described:  # fmt: skip
    """Return points after their last step from X (3, c), and their errors.

    height (c,) and axes (3, 3, c), east, north, up, at X; weight (4, c) of the readings xy (4, c) mm.
    """
    pair, up = errors.pair, axes[2]
    at = look(pair, xy, X, (up, height) if wet else None)
    C, B = inverse(at.B, weight), at.B
    move, A = step(C, at, weight), errors.of_images(at, X)
    S = errors.between_images(A)
    G = einsum("ijc,rjc->ric", C, B * weight[:, None])
    covariance = C + einsum("ric,rjc->ijc", G, einsum("rsc,sic->ric", S, G))
    below = pair.water.slope[:, None] - up
    of_images, of_surface = errors.with_surface(A, X)
    depth = einsum("ic,ijc,jc->c", below, covariance, below) + of_surface
    depth -= 2.0 * einsum("rc,rc->c", einsum("ric,ic->rc", G, below), of_images)
    X, off = X + move, at.off + einsum("ric,ic->rc", B, move)
    null, gaps = null_of(B), pair.gaps(X, height + dot(move, up))
    largest = np.max(np.square(off) * weight, axis=0)
    pointing = np.sum(np.square(null) / weight, axis=0)
    return Described(
        X=X,
        last=size(move),
        residual=off,
        covariance=einsum("aic,ibc->abc", axes, einsum("ijc,bjc->ibc", covariance, axes)),
        gaps=gaps,
        depth_variance=depth,
        incidence=_incidence(pair, xy, up),
        parallax=-einsum("rc,rc->c", null, off),
        parallax_variance=einsum("rc,rsc,sc->c", null, S, null) + pointing,
        pointing=pointing,
        kink=np.sqrt(largest * einsum("ic,ijc,jc->c", up, C, up)),
    )


def null_of(B: FloatArray) -> FloatArray:
    """Return a (4, c) with a'B = 0 of rows B (4, 3, c), as `errors_of_pairs.y_parallax` has it."""
    a, b, c, d = B
    cd, ab = cross(c, d), cross(a, b)
    null = np.stack([dot(b, cd), -dot(a, cd), dot(d, ab), -dot(c, ab)])
    length = np.sqrt(np.square(null[2]) + np.square(null[3]))
    return np.asarray(null / np.where(null[3] < 0.0, -length, length))


def _incidence(pair: Pair, xy: FloatArray, up: FloatArray) -> FloatArray:
    normal = up - pair.water.slope[:, None]
    normal /= np.sqrt(dot(normal, normal))
    sides = zip(pair.sides, (xy[:2], xy[2:]), strict=True)
    angles = [np.arccos(np.clip(-dot(directions(side, read), normal), -1.0, 1.0)) for side, read in sides]
    return np.asarray(0.5 * (angles[0] + angles[1]))
