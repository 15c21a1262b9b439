"""Gauss-Helmert adjustment of conditions between images, control and an orientation, of many starts side by side.

From a start the conditions are linearised at the measured values and weighted by (A Q A')^-1, in steps of
Levenberg and Marquardt. From where these end they are linearised at the adjusted values until nothing changes:
that minimum is the one of the bundle of the same rays (docs/theory.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.collinearity import attitude_matrix, attitude_matrix_partials
from musatpy.orientation.twomedia import rays

_STEPS = 60  # of Levenberg and Marquardt
_LAST_STEPS = 200  # at the adjusted values; from the air each may leave .8 of what the one before has left
_SAME = 1e-7  # of its sigma, by which an unknown or an image may change in the last step
_ROUNDING = 1e-13  # of its size, by which it changes without end
_GAIN = 1e-5  # relative decrease of the squares that ends the first phase
_NEAR = 1e-2  # that ends an approach
_SHALLOW = 0.1  # of the height of the cameras: over shallower water tilt and attitude go together
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-12, 1e8  # of the diagonal


@dataclass(frozen=True, kw_only=True, eq=False)
class HelmertProblem:
    """n images of m photos, c control points, and the conditions between them.

    image (n, 2), tangents, with sigmas (n, 2), of `photo` (n,), `wet` (n,) or not, with the water higher by rise
    (n,); control (c, 3) with sigmas (c, 3), infinite for a component that is not known. unknown (6 m + 4,) of the
    vector of an orientation; `prior` (6 m + 4,) sigmas of its `centre`, infinite for none. bottom (3,) is the
    middle of the points where that is known. `approach` are conditions of the same unknowns that lead there from
    farther away, where the method has any. `equal`: every condition has weight 1 in the estimate, as printed, in
    place of (A Q A')^-1; what is said of it goes by the latter.
    """

    photo: IntArray
    point: IntArray
    image: FloatArray
    image_sigma: FloatArray
    wet: BoolArray
    rise: FloatArray
    control: FloatArray
    control_sigma: FloatArray
    groups: tuple[rays.ConditionGroup, ...]
    unknown: BoolArray
    centre: FloatArray
    prior: FloatArray
    bottom: FloatArray | None = None
    approach: tuple[rays.ConditionGroup, ...] = ()
    equal: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Linear:
    """Conditions of a group linearised at some values: w + B dx + A v = 0.

    misclosure w (s, k, q) of the measured values; by_unknown B (s, k, q, 6 m + 4); by_values A (s, k, q, 2 r + 3)
    by images and control, of variances (k, 2 r + 3); weight (s, k, q, q) by these, and that of the `estimate`, the
    same or equal ones. `settling` (s, k, 3, q) moves the components of control that are not known to where they
    fit, None where all are.
    """

    misclosure: FloatArray
    by_unknown: FloatArray
    by_values: FloatArray
    variance: FloatArray
    weight: FloatArray
    estimate: FloatArray
    settling: FloatArray | None

    def __getitem__(self, kept: slice) -> Self:
        """Return those of some orientations."""
        rows = ("misclosure", "by_unknown", "by_values", "weight", "estimate")
        settling = None if self.settling is None else self.settling[kept]
        return replace(self, **{name: getattr(self, name)[kept] for name in rows}, settling=settling)

    @property
    def full(self) -> Linear:
        """The same, with the weights by the variances in the estimate too."""
        return replace(self, estimate=self.weight)

    @property
    def squares(self) -> FloatArray:
        """Squares (s, k) of each point, in the weights of the estimate."""
        return np.einsum("skp,skpq,skq->sk", self.misclosure, self.estimate, self.misclosure)


@dataclass(frozen=True, kw_only=True, eq=False)
class Adjusted:
    """Orientations (s,) after the adjustment.

    squares (s,) v' Q^-1 v with those of the priors; converged (s,); normals (s, u, u) by the variances, along
    `directions` (s, 6 m + 4, u); adjusted images (s, n, 2) and control (s, c, 3); the conditions of each group at
    these values.
    """

    at: rays.Orientation
    squares: FloatArray
    converged: BoolArray
    normals: FloatArray
    directions: FloatArray
    image: FloatArray
    control: FloatArray
    linear: tuple[Linear, ...]

    def __getitem__(self, row: int) -> Self:
        """Return one of the solutions, still with a leading axis."""
        kept = slice(row, row + 1)
        values = {name: getattr(self, name)[kept] for name in self.__dataclass_fields__ if name != "linear"}
        return type(self)(**values, linear=tuple(part[kept] for part in self.linear))


def adjust(problem: HelmertProblem, starts: rays.Orientation) -> Adjusted:
    """Return the adjusted orientations of starts (s,)."""
    return refined(problem, sampled(problem, starts))


def sampled(problem: HelmertProblem, starts: rays.Orientation, trust: FloatArray | None = None) -> rays.Orientation:
    """Return where starts (s,) lead, near a minimum, when each counts points (p,) by its `trust` (s, p), 0 or 1."""
    if problem.approach:
        starts = _descended(replace(problem, groups=problem.approach, approach=()), starts, trust, _NEAR)
    return _descended(problem, starts, trust)


def misfits(problem: HelmertProblem, at: rays.Orientation) -> FloatArray:
    """Return the misclosures (s, k) of all points at the measured values, in their sigmas; infinite if unreal."""
    linear, real = linearised(problem, at, *_measured(problem, len(at.level)))
    squares = [part.full.squares / part.misclosure.shape[-1] for part in linear]
    # rounding makes them negative near a plane through a camera
    points = [np.sqrt(np.where(square >= 0.0, square, np.inf)) for square in squares]
    return np.where(real[:, None], np.concatenate(points, axis=-1), np.inf)


def linearised(
    problem: HelmertProblem, at: rays.Orientation, image: FloatArray, control: FloatArray
) -> tuple[list[Linear], BoolArray]:
    """Return the conditions of all groups at images (s, n, 2) and control (s, c, 3), and which (s,) are real."""
    bundle = rays.image_rays(at, problem.photo, image, problem.wet, problem.rise)
    linear = [_linear(problem, group, bundle, at, image, control) for group in problem.groups]
    return linear, np.asarray(bundle.real.all(axis=-1))


def _linear(
    problem: HelmertProblem,
    group: rays.ConditionGroup,
    bundle: rays.ImageRays,
    at: rays.Orientation,
    image: FloatArray,
    control: FloatArray,
) -> Linear:
    s, (k, r) = len(image), group.images.shape
    points = np.zeros((s, k, 3)) if group.control is None else control[:, group.control]
    conditions = group.condition(bundle[group.images], points, at)
    by_rays = conditions.by_rays
    shape = conditions.value.shape
    B = np.zeros((*shape, rays.PHOTO * at.photos + rays.WATER))
    for ray, photo in enumerate(group.photos):
        B[..., rays.PHOTO * photo : rays.PHOTO * (photo + 1)] = by_rays[..., ray, : rays.PHOTO]
        B[..., -rays.WATER :] += by_rays[..., ray, rays.PHOTO : rays.PHOTO + rays.WATER]
    A = by_rays[..., rays.IMAGE].reshape(*shape, 2 * r)
    off = (problem.image - image)[:, group.images].reshape(s, k, 2 * r)
    variance = np.square(problem.image_sigma[group.images]).reshape(k, 2 * r)
    free = None
    if group.control is not None:
        sigma = problem.control_sigma[group.control]
        known = np.isfinite(sigma)
        A = np.concatenate([A, conditions.by_control], axis=-1)
        off = np.concatenate([off, np.where(known, problem.control[group.control] - points, 0.0)], axis=-1)
        variance = np.concatenate([variance, np.where(known, sigma, 0.0) ** 2], axis=-1)
        free = None if known.all() else conditions.by_control * ~known[:, None]
    weight, settling = _settled(_inverse((A * variance[:, None]) @ np.swapaxes(A, -1, -2)), free)
    estimate = _settled(np.broadcast_to(np.eye(shape[-1]), weight.shape), free)[0] if problem.equal else weight
    return Linear(
        misclosure=conditions.value + np.einsum("skqv,skv->skq", A, off),
        by_unknown=B,
        by_values=A,
        variance=variance,
        weight=weight,
        estimate=estimate,
        settling=settling,
    )


def _settled(weight: FloatArray, free: FloatArray | None) -> tuple[FloatArray, FloatArray | None]:
    """Return weights less what values take away that are not known, of partials `free` (s, k, q, 3)."""
    if free is None:
        return weight, None
    against = weight @ free
    inverse = np.linalg.pinv(np.swapaxes(free, -1, -2) @ against, hermitian=True)
    settling = -inverse @ np.swapaxes(against, -1, -2)
    return weight + against @ settling, settling


def _inverse(spread: FloatArray) -> FloatArray:
    """Return inverses; pseudo-inverses of a condition that nothing moves: of a plane through the camera."""
    try:
        return np.asarray(np.linalg.inv(spread))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(spread, hermitian=True))


def _descended(
    problem: HelmertProblem, starts: rays.Orientation, trust: FloatArray | None, least_gain: float = _GAIN
) -> rays.Orientation:
    """Return where steps of Levenberg and Marquardt lead starts (s,) at the measured values; unreal ones stay.

    `trust` (s, p) in the points, None for 1. Steps end where the squares decrease by less than `least_gain`.
    """
    x = starts.vector.copy()
    trust = _trust(problem, len(x)) if trust is None else trust
    linear, squares = _evaluated(problem, starts, trust)
    damping = np.full(len(x), _DAMPING)
    active = np.flatnonzero(np.isfinite(squares))
    N, rhs, T = (part[active] for part in _normals(problem, starts, linear, trust))
    for _ in range(_STEPS):
        if not len(active):
            break
        diagonal = np.einsum("suu->su", N)
        added = damping[active, None] * np.where(diagonal > 0.0, diagonal, 1.0)
        change = np.linalg.solve(N + np.eye(N.shape[-1]) * added[:, None], rhs[..., None])
        trial = x[active] + (T @ change)[..., 0]
        at = rays.Orientation.of(trial)
        linear, value = _evaluated(problem, at, trust[active])
        lower = value < squares[active]
        # of a step that leads nowhere what it should have gained: the weights change with the orientation
        gain = np.where(lower, squares[active] - np.where(lower, value, 0.0), np.einsum("su,suo->s", rhs, change))
        ended = gain <= least_gain * squares[active]
        better = active[lower]
        x[better], squares[better] = trial[lower], value[lower]
        damping[active] = np.maximum(damping[active] * np.where(lower, 0.1, 10.0), _LEAST_DAMPING)
        renewed = _normals(problem, at, linear, trust[active])
        N, rhs, T = (
            np.where(lower.reshape(-1, *[1] * (old.ndim - 1)), new, old)
            for new, old in zip(renewed, (N, rhs, T), strict=True)
        )
        kept = ~ended & (damping[active] < _MOST_DAMPING)
        active, N, rhs, T = active[kept], N[kept], rhs[kept], T[kept]
    return rays.Orientation.of(x)


def refined(problem: HelmertProblem, near: rays.Orientation) -> Adjusted:
    """Return the minima to which steps at the adjusted values lead from starts (s,) near them."""
    x = near.vector.copy()
    plain = _trust(problem, len(x))
    image, control = (values.copy() for values in _measured(problem, len(x)))
    converged, active = np.zeros(len(x), dtype=bool), np.arange(len(x))
    for _ in range(_LAST_STEPS):
        at = rays.Orientation.of(x[active])
        linear, real = linearised(problem, at, image[active], control[active])
        N, rhs, T = _normals(problem, at, linear, plain[active])
        usable = real & np.isfinite(N).all(axis=(1, 2))
        inverse = np.linalg.pinv(np.where(usable[:, None, None], N, 1.0), hermitian=True)
        rhs = np.where(usable[:, None], rhs, 0.0)
        step = np.where(usable[:, None], (T @ (inverse @ rhs[..., None]))[..., 0], 0.0)
        sigma = np.sqrt(np.maximum(np.einsum("sxu,suv,sxv->sx", T, inverse, T), 0.0))
        before = image[active]
        image[active], control[active] = _corrected(problem, linear, step, control[active])
        still = np.abs(step) <= _SAME * sigma + _ROUNDING * np.maximum(np.abs(x[active]), 1.0)
        fitted = np.abs(image[active] - before) <= _SAME * problem.image_sigma
        converged[active] = usable & still.all(axis=-1) & fitted.all(axis=(1, 2))
        x[active] += step
        active = active[usable & ~converged[active]]
        if not len(active):
            break
    at = rays.Orientation.of(x)
    linear, real = linearised(problem, at, image, control)
    full = [part.full for part in linear]
    N, _, T = _normals(problem, at, full, plain)
    return Adjusted(
        at=at,
        squares=np.where(real, _squares(problem, at, full, plain), np.inf),
        converged=converged & real,
        normals=N,
        directions=T,
        image=image,
        control=control,
        linear=tuple(linear),
    )


def _measured(problem: HelmertProblem, starts: int) -> tuple[FloatArray, FloatArray]:
    """Return the measured images (s, n, 2) and control (s, c, 3)."""
    image, control = problem.image, problem.control
    return np.broadcast_to(image, (starts, *image.shape)), np.broadcast_to(control, (starts, *control.shape))


def _evaluated(problem: HelmertProblem, at: rays.Orientation, trust: FloatArray) -> tuple[list[Linear], FloatArray]:
    """Return the conditions at the measured values, and the squares (s,), infinite where they are not real."""
    linear, real = linearised(problem, at, *_measured(problem, len(at.level)))
    return linear, np.where(real, _squares(problem, at, linear, trust), np.inf)


def _squares(problem: HelmertProblem, at: rays.Orientation, linear: list[Linear], trust: FloatArray) -> FloatArray:
    """Return the weighted squares (s,) of misclosures and priors."""
    total = np.sum(np.square((at.vector - problem.centre) / problem.prior), axis=-1)
    for group, part in zip(problem.groups, linear, strict=True):
        total = total + np.sum(part.squares * trust[:, problem.point[group.images[:, 0]]], axis=-1)
    return total


def precision(problem: HelmertProblem, at: rays.Orientation, image: FloatArray, control: FloatArray) -> FloatArray:
    """Return covariances (s, 6 m + 4, 6 m + 4) for unit weight, at images (s, n, 2) and control (s, c, 3)."""
    return inverse_of_normals(problem, at, linearised(problem, at, image, control)[0])


def inverse_of_normals(problem: HelmertProblem, at: rays.Orientation, linear: Sequence[Linear]) -> FloatArray:
    """Return the inverses (s, 6 m + 4, 6 m + 4) of the normals of the estimate."""
    N, _, T = _normals(problem, at, linear, _trust(problem, len(at.level)))
    return np.asarray(T @ np.linalg.pinv(N, hermitian=True) @ np.swapaxes(T, 1, 2))


def _trust(problem: HelmertProblem, starts: int) -> FloatArray:
    """Return a trust of 1 in all points (s, p)."""
    return np.ones((starts, int(problem.point.max()) + 1))


def _normals(
    problem: HelmertProblem, at: rays.Orientation, linear: Sequence[Linear], trust: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return normals (s, u, u) and right sides (s, u) along the directions, and these, (s, 6 m + 4, u)."""
    T = directions(at, problem.unknown, _bottom(problem, at))
    information = np.square(1.0 / problem.prior)
    N = np.einsum("sxu,x,sxv->suv", T, information, T)
    rhs = -np.einsum("sxu,x,sx->su", T, information, at.vector - problem.centre)
    for group, part in zip(problem.groups, linear, strict=True):
        BT = part.by_unknown @ T[:, None]
        WBT = part.estimate @ BT * trust[:, problem.point[group.images[:, 0]], None, None]
        s, k, q, u = BT.shape
        flat = WBT.reshape(s, k * q, u)
        N = N + np.swapaxes(BT.reshape(s, k * q, u), -1, -2) @ flat
        rhs = rhs - (part.misclosure.reshape(s, 1, k * q) @ flat)[:, 0]
    return N, rhs, T


def _bottom(problem: HelmertProblem, at: rays.Orientation) -> FloatArray:
    """Return the middle of the points (s, 3): as given, or where the axes of the photos meet the water."""
    if problem.bottom is not None:
        return np.broadcast_to(problem.bottom, (len(at.level), 3))
    middle = at.station.mean(axis=-2)
    middle[:, 2] = at.water_at(middle[:, None, :2])[:, 0]
    return middle


def _corrected(
    problem: HelmertProblem, linear: list[Linear], step: FloatArray, control: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return images and control as a step (s, 6 m + 4) of the unknowns adjusts them: v = -Q A' W (B dx + w).

    Components of control (s, c, 3) that are not known go on from where they are.
    """
    image, measured = (values.copy() for values in _measured(problem, len(step)))
    control = np.where(np.isfinite(problem.control_sigma), measured, control)
    for group, part in zip(problem.groups, linear, strict=True):
        left = part.misclosure + np.einsum("skqx,sx->skq", part.by_unknown, step)
        v = -part.variance * np.einsum("skqv,skqp,skp->skv", part.by_values, part.weight, left)
        k, r = group.images.shape
        image[:, group.images] += v[..., : 2 * r].reshape(len(step), k, r, 2)
        if group.control is not None:
            control[:, group.control] += v[..., 2 * r :]
            if part.settling is not None:
                control[:, group.control] += np.einsum("skcq,skq->skc", part.settling, left)
    return image, control


def directions(at: rays.Orientation, unknown: BoolArray, bottom: FloatArray) -> FloatArray:
    """Return directions (s, 6 m + 4, u) of the u unknowns: changes of the vector of orientations (s,).

    `bottom` (s, 3) is the middle of the points. The level is that over it. The apparent bottom rises with the
    level by 1 - 1/n, and the station with it; the station changes with the attitude so that the axis of the photo
    stays on the apparent bottom; and over shallow water a tilt turns rays as a prism does, by 1 - 1/n, which phi
    and omega follow.
    """
    size = rays.PHOTO * at.photos + rays.WATER
    T = np.broadcast_to(np.eye(size), (len(at.level), size, size)).copy()
    slope, level = slice(size - rays.WATER, size - rays.WATER + 2), size - rays.WATER + 2
    bend = 1.0 - 1.0 / at.index
    M, dM = attitude_matrix(at.attitude), attitude_matrix_partials(at.attitude)
    axis, axis_by = -M[..., 2, :], -dM[..., 2, :]  # (s, m, 3), and by the angles (s, m, angles, 3)
    run = axis[..., :2] / axis[..., 2:]
    run_by = (axis_by[..., :2] - run[..., None, :] * axis_by[..., 2:]) / axis[..., None, 2:]
    water = at.water_at(bottom[:, None, :2])[:, 0]
    apparent = water - (water - bottom[:, 2]) / at.index
    shallow = np.abs(water - bottom[:, 2]) < _SHALLOW * np.abs(at.station[..., 2].mean(axis=-1) - water)
    prism = np.where(shallow, bend, 0.0)
    T[:, level, slope] = -bottom[:, :2]
    for photo in range(at.photos):
        angles = slice(rays.PHOTO * photo, rays.PHOTO * photo + 3)
        omega, phi, Z = angles.start, angles.start + 1, angles.stop + 2
        T[:, phi, slope.start], T[:, omega, slope.start + 1] = -prism, prism
        T[:, Z, level] = bend
        T[:, Z, slope] = bend[:, None] * (at.station[:, photo, :2] - bottom[:, :2])
        drop = (apparent - at.station[:, photo, 2])[:, None, None]
        T[:, angles.stop : Z] -= drop * np.einsum("sax,sau->sxu", run_by[:, photo], T[:, angles])
    T[:, ~unknown] = 0.0
    return T[..., unknown]
