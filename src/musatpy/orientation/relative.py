"""Relative orientation of many photo pairs at once, from their common points, whatever the relief.

Images are tangents x = ((x - xp)/f, (y - yp)/f); u = (x, 1) downwards is (x, y, -1). Photo 2 stands at the unit
base b of photo 1's axes, and R takes these axes to its own: the images of a point satisfy b.(u1 x R'u2) = 0.

Two starts come from the homography of the common points, which flat ground makes exact and relief only blurs, and
one from the assumption of two vertical photos; least squares of the coplanarity with Cauchy's weights takes each to
its minimum. The eight-point method is not used: over flat ground it has no unique answer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import BoolArray, ComplexArray, FloatArray, InRows
from musatpy.geometry.collinearity import cross, nearest_distances, orthogonal, turn
from musatpy.geometry.similarity import TO_SIGMA, cauchy, cauchy_cost

_SAMPLES = 60  # of two points, for the plane similarity of a pair
_BLURRED = 10  # steps of the homography
_ROUNDS, _STEPS = 2, 7  # of the coplanarity: new robust scales, and steps with each
_AS_GOOD = 2.0  # solutions with scales within this factor are told apart by the tilt of the ground
_IN_FRONT = 0.8  # share of the points that a solution must have before both cameras
_UNKNOWNS = 5
_UNCHECKED = 4.0  # times less trustworthy is an orientation without redundancy
_LEVEL = 0.35  # rad; without redundancy nothing but ground as level as this tells sense from nonsense


@dataclass(frozen=True, kw_only=True)
class RelativeOrientations(InRows):
    """k relative orientations of m images each, absent ones with weight 0."""

    rotation: FloatArray  # (k, 3, 3) R, from the axes of photo 1 to those of photo 2
    base: FloatArray  # (k, 3) unit, in the axes of photo 1
    scale: FloatArray  # (k,) robust standard deviation of the images, tangents
    weight: FloatArray  # (k, m) of the points, with their robust part
    sigma: FloatArray  # (k,) rad, size of the error of rotation and base that the images leave
    front: FloatArray  # (k,) share of the points in front of both cameras

    @property
    def is_sound(self) -> BoolArray:
        """(k,) True where the points lie in front of both cameras."""
        return (self.front >= _IN_FRONT) & np.isfinite(self.sigma)


def relative_orientations(x1: FloatArray, x2: FloatArray, weight: FloatArray, floor: float) -> RelativeOrientations:
    """Return the orientations of k pairs by the tangents x1, x2 (k, m, 2) and weights (k, m) of common points.

    A pair needs five points; `floor` is the least standard deviation (tangent) that the images may show. Of the
    minima the one before both cameras is taken, then with small residuals, then over level ground: flat ground
    leaves two solutions, and in the false one base and normal of the ground have changed places.
    """
    minima = solutions(x1, x2, weight, floor)
    of_starts = (_ground_tilt(x1, x2, minima), minima.scale, minima.front)
    tilt, scale, front = (values.reshape(-1, len(x1)) for values in of_starts)
    ahead = front >= _IN_FRONT
    allowed = ahead | ~ahead.any(axis=0)
    good = allowed & (scale <= _AS_GOOD * np.where(allowed, scale, np.inf).min(axis=0))
    choice, pairs = np.where(good, tilt, np.inf).argmin(axis=0), np.arange(len(x1))
    best = minima[choice * len(x1) + pairs]
    checked = (best.weight > 0).sum(axis=1) > _UNKNOWNS
    return replace(best, sigma=np.where(checked | (tilt[choice, pairs] < _LEVEL), best.sigma, np.inf))


def solutions(x1: FloatArray, x2: FloatArray, weight: FloatArray, floor: float) -> RelativeOrientations:
    """Return the minima (3 k) that starts of k pairs lead to: both of the homography, and two vertical photos."""
    robust = weight * plane_similarity(x1, x2, weight)[2]
    H = _homographies(x1, x2, robust, floor)
    starts = [*_decompose(H, x1, weight), _vertical(x1, x2, weight)]
    R, b = (np.concatenate(parts) for parts in zip(*starts, strict=True))
    pairs = np.tile(np.arange(len(x1)), len(starts))
    return _adjust(x1[pairs], x2[pairs], weight[pairs], R, b, floor)


def model_points(
    x1: FloatArray, x2: FloatArray, rotation: FloatArray, base: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the points (..., m, 3) nearest to both rays, in the axes of photo 1, and the distances (..., m, 2)."""
    u1, v = _vectors(x1), _vectors(x2) @ rotation
    b = base[..., None, :]
    distance = nearest_distances(b, u1, v)
    with np.errstate(invalid="ignore"):
        X = 0.5 * (distance[..., :1] * u1 + b + distance[..., 1:] * v)
    return X, distance


def _vectors(x: FloatArray) -> FloatArray:
    return np.concatenate([x, np.full((*x.shape[:-1], 1), -1.0)], axis=-1)


def _median(values: FloatArray, present: BoolArray) -> FloatArray:
    """Return the medians along the last axis of the values that are present."""
    ordered = np.sort(np.where(present, values, np.inf), axis=-1)
    middle = np.broadcast_to(present.sum(axis=-1) // 2, ordered.shape[:-1])
    return np.take_along_axis(ordered, np.minimum(middle, ordered.shape[-1] - 1)[..., None], axis=-1)[..., 0]


def plane_similarity(
    x1: FloatArray, x2: FloatArray, weight: FloatArray
) -> tuple[ComplexArray, ComplexArray, FloatArray]:
    """Return a, b (k,) of x2 = a x1 + b (complex) with the least median error, and robust weights (k, m)."""
    z1, z2 = x1[..., 0] + 1j * x1[..., 1], x2[..., 0] + 1j * x2[..., 1]
    present = weight > 0
    k, m = present.shape
    rng = np.random.default_rng(m)
    rank = np.argsort(np.where(present[:, None], rng.random((1, _SAMPLES, m)), 2.0), axis=2)
    i, j = rank[..., 0], rank[..., 1]
    row = np.arange(k)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        a = (z2[row, j] - z2[row, i]) / (z1[row, j] - z1[row, i])
    b = z2[row, i] - a * z1[row, i]
    error = _median(np.abs(z2[:, None] - a[..., None] * z1[:, None] - b[..., None]), present[:, None])
    best = np.where(np.isfinite(error), error, np.inf).argmin(axis=1)
    a, b, spread = a[row[:, 0], best], b[row[:, 0], best], error[row[:, 0], best]
    off = np.abs(z2 - a[:, None] * z1 - b[:, None])
    robust = 1.0 / (1.0 + np.square(off / np.maximum(3.0 * spread, 1e-9)[:, None]))
    return a, b, robust


def _vertical(x1: FloatArray, x2: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return R and b of two vertical photos at one height: the plane similarity turned into a rotation."""
    a, b, _ = plane_similarity(x1, x2, weight)
    heading = a / np.maximum(np.abs(a), 1e-12)
    R = np.zeros((len(a), 3, 3))
    R[:, 0, 0] = R[:, 1, 1] = heading.real
    R[:, 0, 1], R[:, 1, 0] = -heading.imag, heading.imag
    R[:, 2, 2] = 1.0
    base = -b / np.where(a == 0, 1.0, a)
    return R, _unit(np.stack([base.real, base.imag, np.zeros(len(a))], axis=1))


def _homographies(x1: FloatArray, x2: FloatArray, weight: FloatArray, floor: float) -> FloatArray:
    """Return H (k, 3, 3) with u2 ~ H u1, by the direct linear transformation with Cauchy's weights."""
    u1, present = _vectors(x1), weight > 0
    zero = np.zeros_like(u1)
    # u2 ~ (U, V, S) with x2 = -U/S: rows U + x2 S and V + y2 S
    rows = np.stack(
        [
            np.concatenate([u1, zero, x2[..., :1] * u1], axis=-1),
            np.concatenate([zero, u1, x2[..., 1:] * u1], axis=-1),
        ],
        axis=-2,
    )
    robust = weight
    for _ in range(_BLURRED):
        normal = np.einsum("kmai,km,kmaj->kij", rows, robust, rows)
        H = np.linalg.eigh(normal)[1][:, :, 0].reshape(-1, 3, 3)
        projected = u1 @ np.swapaxes(H, 1, 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            error = np.linalg.norm(x2 + projected[..., :2] / projected[..., 2:], axis=-1)
        error = np.where(np.isfinite(error), error, 1e3)
        spread = np.maximum(TO_SIGMA * _median(error, present), floor)
        robust = cauchy(error, spread[:, None], weight)
    towards = np.einsum("kmi,kmi,km->k", projected, _vectors(x2), robust)
    return H * np.where(towards < 0, -1.0, 1.0)[:, None, None]


def _decompose(H: FloatArray, x1: FloatArray, weight: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Return the two pairs R, b of H = R (I - b n'), n the normal of the ground, away from the camera.

    Ma, Soatto, Kosecka and Sastry, An Invitation to 3-D Vision (2004), theorem 5.19.
    """
    values, V = np.linalg.eigh(np.swapaxes(H, 1, 2) @ H)
    values = np.maximum(values / np.maximum(values[:, 1:2], 1e-300), 0.0)
    G = H / np.sqrt(np.maximum(np.linalg.eigvalsh(np.swapaxes(H, 1, 2) @ H)[:, 1], 1e-300))[:, None, None]
    V = V * np.sign(np.linalg.det(V))[:, None, None]
    low, high = values[:, 0], values[:, 2]
    v3, v2, v1 = V[..., 0], V[..., 1], V[..., 2]
    v1 = v1 * np.sign(np.einsum("ki,ki->k", np.cross(v1, v2), v3))[:, None]
    span = np.sqrt(np.maximum(high - low, 1e-300))[:, None]
    first, second = np.sqrt(np.maximum(1.0 - low, 0.0))[:, None], np.sqrt(np.maximum(high - 1.0, 0.0))[:, None]
    middle = np.einsum("km,kmi->ki", weight, _vectors(x1))
    solutions = []
    for sign in (1.0, -1.0):
        w = (first * v1 + sign * second * v3) / span
        n = np.cross(v2, w)
        U = np.stack([v2, w, n], axis=-1)
        Gv, Gw = np.einsum("kij,kj->ki", G, v2), np.einsum("kij,kj->ki", G, w)
        turned = np.stack([Gv, Gw, np.cross(Gv, Gw)], axis=-1) @ np.swapaxes(U, 1, 2)
        R = orthogonal(np.where(np.isfinite(turned), turned, 0.0))
        outwards = np.where(np.einsum("ki,ki->k", n, middle) < 0, -1.0, 1.0)[:, None]
        b = -np.einsum("kji,kjl,kl->ki", R, G - R, n * outwards)
        solutions.append((R, _unit(b)))
    return solutions


def _unit(v: FloatArray) -> FloatArray:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    good = (length > 1e-12) & np.isfinite(length)
    return np.where(good, v / np.where(good, length, 1.0), np.array([1.0, 0.0, 0.0]))


def coplanarity(x1: FloatArray, x2: FloatArray, R: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the coplanarity residuals (k, m) as image errors (tangents), and partials (k, m, 6).

    By a small turn w of the rays of photo 2, v = R'u2 becoming v + w x v, and by b. Sampson's weighting turns the
    volume b.(u1 x v) into an image error; its own change is left out of the partials, which loses nothing at the
    minimum.
    """
    residual, size, v, bu = _residual(x1, x2, R, b)
    partials = np.concatenate([cross(v, bu), cross(_vectors(x1), v)], axis=-1)
    return residual, partials / size[..., None]


def _residual(
    x1: FloatArray, x2: FloatArray, R: FloatArray, b: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the residuals (k, m), what the volumes are divided by, the rays v and the products b x u1."""
    v = _vectors(x2) @ R
    b = b[:, None, :]
    bu = cross(b, _vectors(x1))
    volume = np.einsum("kmi,kmi->km", bu, v)
    by_x1 = cross(v, b)[..., :2]
    by_x2 = (bu @ np.swapaxes(R, 1, 2))[..., :2]
    size = np.sqrt(np.square(by_x1).sum(axis=-1) + np.square(by_x2).sum(axis=-1)) + 1e-12
    return volume / size, size, v, bu


def _adjust(
    x1: FloatArray, x2: FloatArray, weight: FloatArray, R: FloatArray, b: FloatArray, floor: float
) -> RelativeOrientations:
    """Return the orientations at the robust minimum next to R, b, by Levenberg-Marquardt steps of all pairs."""
    damping = np.full(len(R), 1e-3)
    for _ in range(_ROUNDS):
        residual, _ = coplanarity(x1, x2, R, b)
        scale = _scale(residual, weight, floor)
        cost = (weight * cauchy_cost(residual, scale[:, None])).sum(axis=1)
        for _ in range(_STEPS):
            residual, partials = coplanarity(x1, x2, R, b)
            J, tangent = _in_tangents(partials, b)
            robust = cauchy(residual, scale[:, None], weight)
            weighted = robust[..., None] * J
            N = np.swapaxes(weighted, 1, 2) @ J
            diagonal = np.einsum("kii->ki", N)
            diagonal *= 1.0 + damping[:, None]
            diagonal += 1e-12 + 1e-9 * diagonal.max(axis=1, keepdims=True)
            rhs = np.swapaxes(weighted, 1, 2) @ residual[..., None]
            step: FloatArray = -np.asarray(np.linalg.solve(N, rhs))[..., 0]
            step /= np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True) / 0.5)
            new_R = R @ np.swapaxes(turn(step[:, :3]), 1, 2)
            new_b = _unit(b + np.einsum("ka,kai->ki", step[:, 3:], tangent))
            residual = _residual(x1, x2, new_R, new_b)[0]
            new_cost = (weight * cauchy_cost(residual, scale[:, None])).sum(axis=1)
            better = new_cost < cost
            R, b = np.where(better[:, None, None], new_R, R), np.where(better[:, None], new_b, b)
            cost = np.where(better, new_cost, cost)
            damping = np.where(better, 0.1 * damping, np.minimum(10.0 * damping, 1e6))
    return _described(x1, x2, weight, R, b, floor)


def _scale(residual: FloatArray, weight: FloatArray, floor: float) -> FloatArray:
    """Return the robust standard deviations (k,) of residuals (k, m)."""
    return np.maximum(TO_SIGMA * _redundancy(weight) * _median(np.abs(residual), weight > 0), floor)


def _redundancy(weight: FloatArray) -> FloatArray:
    """Return by what factors (k,) errors are larger than residuals."""
    count = (weight > 0).sum(axis=1)
    return np.sqrt(count / np.maximum(count - _UNKNOWNS, 1.0))


def _in_tangents(partials: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return partials (k, m, 5) by w and the two directions across b, and these directions (k, 2, 3)."""
    axis = np.eye(3)[np.abs(b).argmin(axis=1)]
    first = _unit(np.cross(b, axis))
    tangent = np.stack([first, np.cross(b, first)], axis=1)
    across = partials[..., 3:] @ np.swapaxes(tangent, 1, 2)
    return np.concatenate([partials[..., :3], across], axis=-1), tangent


def _described(
    x1: FloatArray, x2: FloatArray, weight: FloatArray, R: FloatArray, b: FloatArray, floor: float
) -> RelativeOrientations:
    """Return the orientations with their robust scales, weights and errors, the base pointing to photo 2."""
    residual, partials = coplanarity(x1, x2, R, b)
    scale = _scale(residual, weight, floor)
    robust = cauchy(residual, scale[:, None], weight)
    J, _ = _in_tangents(partials, b)
    N = np.einsum("kmi,km,kmj->kij", J, robust, J)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = np.linalg.eigvalsh(N)
        spread = np.sqrt(np.where(values > 1e-14, 1.0 / np.maximum(values, 1e-14), np.inf).sum(axis=1))
    checked = (weight > 0).sum(axis=1) > _UNKNOWNS
    trust = np.where(checked, _redundancy(weight), _UNCHECKED)
    _, distance = model_points(x1, x2, R, b)
    ahead, behind = (distance > 0).all(axis=-1), (distance < 0).all(axis=-1)
    total = np.maximum(robust.sum(axis=1), 1e-300)
    front, back = (robust * ahead).sum(axis=1) / total, (robust * behind).sum(axis=1) / total
    flip = back > front
    return RelativeOrientations(
        rotation=R,
        base=np.where(flip[:, None], -b, b),
        scale=scale,
        weight=robust,
        sigma=scale * spread * trust,
        front=np.where(flip, back, front),
    )


def _ground_tilt(x1: FloatArray, x2: FloatArray, solution: RelativeOrientations) -> FloatArray:
    """Return the larger angles rad between the normal of the ground and the axes of the cameras, start by start."""
    times = len(solution.scale) // len(x1)
    X, _ = model_points(np.tile(x1, (times, 1, 1)), np.tile(x2, (times, 1, 1)), solution.rotation, solution.base)
    weight = np.where(np.isfinite(X).all(axis=-1), solution.weight, 0.0)
    X = np.where(weight[..., None] > 0, X, 0.0)
    share = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    X = X - np.einsum("km,kmi->ki", share, X)[:, None]
    n = np.linalg.eigh(np.einsum("km,kmi,kmj->kij", share, X, X))[1][:, :, 0]
    cosine = np.minimum(np.abs(n[:, 2]), np.abs(np.einsum("ki,ki->k", solution.rotation[:, 2], n)))
    return np.arccos(np.clip(cosine, 0.0, 1.0))
