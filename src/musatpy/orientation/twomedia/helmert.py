"""Gauss-Helmert adjustment of conditions between images, control and an orientation, of many starts side by side.

Two phases. From the start the conditions are linearised at the measured values and weighted by (A Q A')^-1, in steps
of Levenberg and Marquardt along `basis` directions that the geometry decorrelates. From where these end they are
linearised at the adjusted values until nothing moves: that minimum is that of the bundle of the same rays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.orientation.twomedia.conditions import Misclosure
from musatpy.orientation.twomedia.rays import IMAGE, PHOTO, WATER, Orientation, Rays, rays

STEPS = 60  # of Levenberg and Marquardt
_FINAL = 25  # steps at the adjusted values
_SMALL = 1e-12  # of the scale of an unknown: a step that moves nothing
_GAIN = 1e-10  # relative decrease of the squares that ends the first phase
_DAMPING = 1e-3  # of the diagonal, to begin with
_MOST_DAMPED = 1e10


@dataclass(frozen=True, kw_only=True, eq=False)
class Group:
    """k points with the same conditions: the images (k, r) of each and its control point (k,), -1 for none."""

    condition: Callable[[Rays, FloatArray, Orientation], Misclosure]
    images: IntArray
    control: IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """n images of m photos, c control points, and the conditions between them.

    Images and their sigmas (n, 2) in tangents; control (c, 3) with sigmas (c, 3), infinite for a component that is
    not known. `unknown` (6 m + 4,) of the vector of an orientation; `prior` sigmas (6 m + 4,) about `centre`,
    infinite for none. `equal`: conditions have equal weights, as printed, in place of (A Q A')^-1. `basis` gives the
    directions (..., 6 m + 4, u) in which the u unknowns step.
    """

    photo: IntArray
    image: FloatArray
    image_sigma: FloatArray
    wet: BoolArray
    control: FloatArray
    control_sigma: FloatArray
    groups: tuple[Group, ...]
    unknown: BoolArray
    prior: FloatArray
    centre: FloatArray
    basis: Callable[[Orientation], FloatArray]
    equal: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Linear:
    """The conditions of a group at some values: misclosures w (..., k, q) reduced to the measured values.

    by_unknown B (..., k, q, 6 m + 4); by_values A (..., k, q, 2 r + 3) of images and control, with their variances
    (k, 2 r + 3); weight (..., k, q, q), (A Q A')^-1. `settling` (..., k, 3, q) moves the components of control that
    are not known to where they fit, None where all are.
    """

    misclosure: FloatArray
    by_unknown: FloatArray
    by_values: FloatArray
    variance: FloatArray
    weight: FloatArray
    settling: FloatArray | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Adjusted:
    """Orientations (s,) after the adjustment, and what came of each.

    squares (s,) v' Q^-1 v with the priors; converged (s,); normals (s, u, u) of the unknowns along `basis` (s, 6 m +
    4, u); residuals of images (s, n, 2) and control (s, c, 3).
    """

    at: Orientation
    squares: FloatArray
    converged: BoolArray
    normals: FloatArray
    basis: FloatArray
    image_residuals: FloatArray
    control_residuals: FloatArray
    linear: tuple[Linear, ...]

    @property
    def covariance(self) -> FloatArray:
        """(s, 6 m + 4, 6 m + 4) of the orientation, of unit variance of weight 1; 0 for what is not unknown."""
        return np.asarray(self.basis @ np.linalg.pinv(self.normals, hermitian=True) @ np.swapaxes(self.basis, -1, -2))


def adjust(problem: Problem, starts: Orientation) -> Adjusted:
    """Return the adjusted orientations of starts (s,)."""
    at, _, found = _descended(problem, starts)
    return _settled(problem, at, found)


def linearised(problem: Problem, at: Orientation, image: FloatArray, control: FloatArray) -> tuple[list[Linear], BoolArray]:
    """Return the conditions of all groups at images (s, n, 2) and control (s, c, 3), and which (s,) are real."""
    bundle = rays(at, problem.photo, image, problem.wet)
    linear = [_linear(problem, group, bundle, at, image, control) for group in problem.groups]
    return linear, bundle.real.all(axis=-1)


def _linear(
    problem: Problem, group: Group, bundle: Rays, at: Orientation, image: FloatArray, control: FloatArray
) -> Linear:
    rows = group.images
    k, r = rows.shape
    some = Rays(
        origin=bundle.origin[:, rows, :],
        direction=bundle.direction[:, rows, :],
        partials=bundle.partials[:, rows, :, :],
        station=bundle.station[:, rows, :],
        real=bundle.real[:, rows],
    )
    has_control = bool((group.control >= 0).all())
    places = control[:, group.control, :] if has_control else np.zeros((len(control), k, 3))
    g = group.condition(some, places, at)
    q = g.value.shape[-1]
    unknown = np.zeros((*g.value.shape, PHOTO * at.photos + WATER))
    columns = PHOTO * problem.photo[rows][..., None] + np.arange(PHOTO)  # (k, r, 6)
    for ray in range(r):
        part = np.zeros_like(unknown)
        where = np.broadcast_to(columns[:, ray][:, None, :], (*g.value.shape, PHOTO))
        np.put_along_axis(part, where, g.by_rays[..., ray, :PHOTO], axis=-1)
        part[..., -WATER:] = g.by_rays[..., ray, PHOTO : PHOTO + WATER]
        unknown += part
    by_images = g.by_rays[..., IMAGE].reshape(*g.value.shape, 2 * r)
    measured, sigma = problem.image[rows], problem.image_sigma[rows]
    w = g.value + np.einsum("...kqri,...kri->...kq", g.by_rays[..., IMAGE], measured - image[:, rows])
    variance = np.square(sigma).reshape(k, 2 * r)
    if not has_control:
        values, spread, free = by_images, variance, None
    else:
        known = np.isfinite(problem.control_sigma[group.control])
        off = np.where(known, problem.control[group.control] - places, 0.0)
        w = w + np.einsum("...kqi,...ki->...kq", g.by_control, off)
        values = np.concatenate([by_images, g.by_control], axis=-1)
        spread = np.concatenate([variance, np.where(known, np.square(problem.control_sigma[group.control]), 0.0)], axis=-1)
        free = None if known.all() else g.by_control * ~known[:, None, :]
    weight, settling = _weights(values, spread, free, problem.equal)
    return Linear(
        misclosure=w, by_unknown=unknown, by_values=values, variance=spread, weight=weight, settling=settling
    )


def _weights(
    A: FloatArray, variance: FloatArray, free: FloatArray | None, equal: bool
) -> tuple[FloatArray, FloatArray | None]:
    """Return (A Q A')^-1 or 1, without what values take away that are not known, columns `free` (..., q, 3)."""
    if equal:
        weight = np.broadcast_to(np.eye(A.shape[-2]), (*A.shape[:-1], A.shape[-2]))
    else:
        weight = np.linalg.inv((A * variance[:, None, :]) @ np.swapaxes(A, -1, -2))
    if free is None:
        return weight, None
    against = weight @ free
    across = np.swapaxes(against, -1, -2)
    settling = -np.linalg.pinv(np.swapaxes(free, -1, -2) @ against, hermitian=True) @ across
    return weight + against @ settling, settling


def _descended(problem: Problem, starts: Orientation) -> tuple[Orientation, FloatArray, BoolArray]:
    """Return orientations, squares (s,) and success (s,) of steps of Levenberg and Marquardt at the measured values."""
    x = starts.vector.copy()
    damping = np.full(len(x), _DAMPING)
    linear, real = linearised(problem, starts, *_measured(problem, len(x)))
    squares = np.where(real, _squares(problem, starts, linear), np.inf)
    active = real.copy()
    for _ in range(STEPS):
        rows = np.flatnonzero(active)
        if not len(rows):
            break
        at = Orientation.of(x[rows])
        linear, _ = linearised(problem, at, *_measured(problem, len(rows)))
        N, rhs, T = _normals(problem, at, linear)
        scale = np.einsum("suu->su", N).copy()
        scale[scale == 0.0] = 1.0
        left = np.arange(len(rows))
        for _ in range(8):  # until the step of each goes down
            damped = N[left] + np.einsum("su,uv->suv", damping[rows[left], None] * scale[left], np.eye(N.shape[-1]))
            step = np.linalg.solve(damped, rhs[left][..., None])
            trial = x[rows[left]] + (T[left] @ step)[..., 0]
            there = Orientation.of(trial)
            tried, real = linearised(problem, there, *_measured(problem, len(left)))
            value = np.where(real, _squares(problem, there, tried), np.inf)
            lower = value < squares[rows[left]]
            index = rows[left]
            gain = np.where(lower, squares[index] - np.where(lower, value, 0.0), 0.0)
            ended = lower & (gain <= _GAIN * squares[index])
            x[index[lower]] = trial[lower]
            squares[index[lower]] = value[lower]
            damping[index] = np.where(lower, damping[index] / 10.0, damping[index] * 10.0)
            active[index[ended | (damping[index] > _MOST_DAMPED)]] = False
            left = left[~lower & active[index]]
            if not len(left):
                break
    return Orientation.of(x), squares, np.isfinite(squares)


def _settled(problem: Problem, start: Orientation, usable: BoolArray) -> Adjusted:
    """Return the minimum that steps at the adjusted values reach."""
    x = start.vector.copy()
    image, control = (values.copy() for values in _measured(problem, len(x)))
    converged = np.zeros(len(x), dtype=bool)
    for _ in range(_FINAL):
        at = Orientation.of(x)
        linear, real = linearised(problem, at, image, control)
        N, rhs, T = _normals(problem, at, linear)
        with np.errstate(all="ignore"):
            step = (T @ (np.linalg.pinv(N, hermitian=True) @ rhs[..., None]))[..., 0]
        image, control = _corrected(problem, linear, step, control)
        sigma = np.sqrt(np.einsum("suu->su", T @ np.linalg.pinv(N, hermitian=True) @ np.swapaxes(T, -1, -2)))
        moved = np.abs(step) > _SMALL * np.maximum(np.abs(x), 1.0) + 1e-9 * sigma
        x = np.where((usable & real)[:, None], x + step, x)
        converged = usable & real & ~moved.any(axis=-1)
        if (converged | ~usable).all():
            break
    at = Orientation.of(x)
    linear, real = linearised(problem, at, image, control)
    N, _, T = _normals(problem, at, linear)
    return Adjusted(
        at=at,
        squares=_squares(problem, at, linear),
        converged=converged & real,
        normals=N,
        basis=T,
        image_residuals=image - problem.image,
        control_residuals=control - problem.control,
        linear=tuple(linear),
    )


def _measured(problem: Problem, starts: int) -> tuple[FloatArray, FloatArray]:
    return (
        np.broadcast_to(problem.image, (starts, *problem.image.shape)),
        np.broadcast_to(problem.control, (starts, *problem.control.shape)),
    )


def _squares(problem: Problem, at: Orientation, linear: list[Linear]) -> FloatArray:
    """Return the weighted squares (s,) of misclosures and priors."""
    total = np.sum(np.square((at.vector - problem.centre) / problem.prior), axis=-1)
    for one in linear:
        total = total + np.einsum("...kq,...kqp,...kp->...", one.misclosure, one.weight, one.misclosure)
    return np.asarray(total)


def _normals(problem: Problem, at: Orientation, linear: list[Linear]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return normals (s, u, u) and right sides (s, u) along the basis, and the basis (s, 6 m + 4, u)."""
    T = problem.basis(at)
    information = np.square(1.0 / problem.prior)
    full = np.diag(information)
    rhs = -information * (at.vector - problem.centre)
    for one in linear:
        B = one.by_unknown
        WB = one.weight @ B
        full = full + np.einsum("...kqx,...kqy->...xy", B, WB)
        rhs = rhs - np.einsum("...kqx,...kq->...x", WB, one.misclosure)
    across = np.swapaxes(T, -1, -2)
    return across @ full @ T, (across @ rhs[..., None])[..., 0], T


def _corrected(
    problem: Problem, linear: list[Linear], step: FloatArray, settled: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return images and control as a step (s, 6 m + 4) of the unknowns adjusts them: v = -Q A' W (B dx + w).

    Components of control that are not known go on from where they are in `settled` (s, c, 3).
    """
    image, control = (values.copy() for values in _measured(problem, len(step)))
    control = np.where(np.isfinite(problem.control_sigma), control, settled)
    for group, one in zip(problem.groups, linear, strict=True):
        left = one.misclosure + np.einsum("...kqx,...x->...kq", one.by_unknown, step)
        pull = np.einsum("...kqp,...kp->...kq", one.weight, left)
        v = -one.variance * np.einsum("...kqv,...kq->...kv", one.by_values, pull)
        k, r = group.images.shape
        image[:, group.images] += v[..., : 2 * r].reshape(len(step), k, r, 2)
        if v.shape[-1] > 2 * r:
            control[:, group.control] += v[..., 2 * r :]
        if one.settling is not None:
            control[:, group.control] += np.einsum("...kcq,...kq->...kc", one.settling, left)
    return image, control
