"""The optical path over a refracting surface, and Newton's method to places where it is stationary."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray, InRows
from musatpy.refraction.surface import Surface

_MAX_STEPS = 80
_HALVINGS = 12
_ROUNDING = 1e-15  # of the coordinates: some units in their last place
_PASSES = 5
_LARGEST_ANGLE = 1.5  # rad, of a water ray from the vertical: beyond it, no bound on its way is worth anything


@dataclass(frozen=True, kw_only=True, eq=False)
class RayEnds(InRows):
    """Cameras and ground points (N, 3) m, indices (N,) and times (N,) s of N rays."""

    camera: FloatArray
    ground: FloatArray
    index: FloatArray
    time: FloatArray

    @classmethod
    def of(cls, camera: ArrayLike, ground: ArrayLike, index: ArrayLike, time: ArrayLike) -> RayEnds:
        """Return rays in one row from arrays whose shapes (..., 3) and (...) broadcast."""
        camera, ground = np.asarray(camera, float), np.asarray(ground, float)
        shape = np.broadcast_shapes(camera.shape[:-1], ground.shape[:-1], np.shape(index), np.shape(time))
        return cls(
            camera=np.broadcast_to(camera, (*shape, 3)).reshape(-1, 3),
            ground=np.broadcast_to(ground, (*shape, 3)).reshape(-1, 3),
            index=np.broadcast_to(np.asarray(index, float), shape).reshape(-1),
            time=np.broadcast_to(np.asarray(time, float), shape).reshape(-1),
        )

    def reach(self, surface: Surface) -> Reach:
        """Return where the rays can meet a surface: nowhere beyond, infinitely far where nothing bounds it.

        A ray under water leaves the normal by no more than Snell's law gives it, the normal the vertical by no more
        than the slope of the surface. Each pass starts from what the one before has left as possible.
        """
        limits = surface.limits
        gap = self.ground - self.camera
        D = np.linalg.norm(gap[:, :2], axis=1)
        here = surface.relief(self.ground[:, :2], self.time).height - self.ground[:, 2]
        gamma = np.arctan(limits.slope)
        air = np.full(len(D), np.pi / 2.0)
        rise = limits.slope * np.tan(_water_angle(air, gamma, self.index))
        # without a highest wave (a tilted plane), from depth = here + slope R, R = depth tan(angle)
        by_slope = np.where(rise < 1.0, here / np.maximum(1.0 - rise, 1e-300), np.inf)
        deepest = np.minimum(limits.highest - self.ground[:, 2], by_slope)
        for _ in range(_PASSES):
            R = deepest * np.tan(_water_angle(air, gamma, self.index))
            air = np.arctan2(D + R, self.camera[:, 2] - self.ground[:, 2] - deepest)
            deepest = np.minimum(deepest, here + limits.slope * R)
        shallowest = np.maximum(limits.lowest - self.ground[:, 2], here - limits.slope * R)
        return Reach(radius=R, air_angle=air, deepest=deepest, shallowest=shallowest)


def _water_angle(air: FloatArray, gamma: float, index: FloatArray) -> FloatArray:
    """Return the largest angle (N,) from the vertical under water, of rays within `air` of it above."""
    sine = np.sin(np.minimum(air + gamma, np.pi / 2.0)) / index
    return np.minimum(np.arcsin(np.minimum(sine, 1.0)) + gamma, _LARGEST_ANGLE)


@dataclass(frozen=True, kw_only=True, eq=False)
class Reach(InRows):
    """How far (N,) m from its ground point a ray can meet the water, and what it can find there.

    Its largest angle in air (N,) rad; greatest and least depth (N,) m of the ground point below the water.
    """

    radius: FloatArray
    air_angle: FloatArray
    deepest: FloatArray
    shallowest: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Path(InRows):
    """The optical path (N,) over places of the surface, its gradient (N, 2) and second derivatives (N, 2, 2) there.

    air, water (N, 3): unit vectors along the path; their lengths (N,) m; height (N,) of the surface and its
    slope (N, 2), which also says its tangents.
    """

    length: FloatArray
    gradient: FloatArray
    hessian: FloatArray
    air: FloatArray
    water: FloatArray
    air_length: FloatArray
    water_length: FloatArray
    height: FloatArray
    slope: FloatArray

    @property
    def tangents(self) -> FloatArray:
        """The tangents (N, 3, 2) of the surface along x and y."""
        plan = np.broadcast_to(np.eye(2), (len(self.slope), 2, 2))
        return np.concatenate([plan, self.slope[:, None, :]], axis=1)

    def replace(self, rows: Any, other: Path) -> None:
        """Put the path of other places into some rows."""
        for field in fields(self):
            getattr(self, field.name)[rows] = getattr(other, field.name)


def path(surface: Surface, rays: RayEnds, xy: FloatArray) -> Path:
    """Return the optical path of rays (N,) over places (N, 2), Okamoto (1982) eq. 9 and 10."""
    relief = surface.relief(xy, rays.time)
    W = np.concatenate([xy, relief.height[:, None]], axis=1)
    a, b = W - rays.camera, rays.ground - W
    r1, r2 = _length(a), _length(b)
    a, b = a / r1[:, None], b / r2[:, None]
    g, n = np.array(relief.gradient), rays.index  # a copy: what a surface gives may be read-only
    pull_z = a[:, 2] - n * b[:, 2]
    # with the tangents T = (I, g'), T'v is v in plan + v_z g, and T'T is I + g g'
    aT, bT = a[:, :2] + a[:, 2:] * g, b[:, :2] + b[:, 2:] * g
    TT = g[:, :, None] * g[:, None, :] + np.eye(2)
    hessian = (
        (TT - aT[:, :, None] * aT[:, None, :]) / r1[:, None, None]
        + (TT - bT[:, :, None] * bT[:, None, :]) * (n / r2)[:, None, None]
        + pull_z[:, None, None] * relief.hessian
    )
    return Path(
        length=r1 + n * r2,
        gradient=aT - n[:, None] * bT,
        hessian=hessian,
        air=a,
        water=b,
        air_length=r1,
        water_length=r2,
        height=relief.height,
        slope=g,
    )


def _length(vectors: FloatArray) -> FloatArray:
    return np.sqrt(np.einsum("ni,ni->n", vectors, vectors))


def stationary(surface: Surface, rays: RayEnds, start: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return places (N, 2) where the gradient of the path vanishes, and which rays (N,) reached one.

    Newton's method from `start` (N, 2); a step that would not make the gradient shorter is halved. What is reached
    may be a minimum, a saddle or a maximum.
    """
    xy = start.copy()
    reached = np.zeros(len(xy), dtype=bool)
    open_ = np.arange(len(xy))
    now, at = rays, path(surface, rays, xy)
    for _ in range(_MAX_STEPS):
        step = -solved(at.hessian, at.gradient)
        # quadratic convergence: the next step would be of the square of this one, in units of the water leg. Just
        # under the water that leg is shorter than coordinates can say: steps of their rounding are the end
        close = np.maximum(1e-9 * at.water_length, _ROUNDING * np.abs(now.camera).max(axis=1))
        small = _length_in_plan(step) <= close
        moved, at = _shortened(surface, now, xy[open_], step, at)
        if small.any():
            moved[small] -= solved(at.hessian[small], at.gradient[small])
        xy[open_] = moved
        reached[open_[small]] = True
        open_ = open_[~small]
        if not len(open_):
            break
        if small.any():
            now, at = rays[open_], at[~small]
    return xy, reached


def _shortened(
    surface: Surface, rays: RayEnds, xy: FloatArray, step: FloatArray, before: Path
) -> tuple[FloatArray, Path]:
    """Return places (N, 2) after steps that make the gradients of the path shorter, and the path there."""
    enough = np.maximum(_length_in_plan(before.gradient), 1e-12)  # rounding is not worse
    shifted = xy + step
    at = path(surface, rays, shifted)
    worse = np.flatnonzero(_length_in_plan(at.gradient) > enough)
    for halving in range(1, _HALVINGS + 1):
        if not len(worse):
            break
        shifted[worse] = xy[worse] + step[worse] / 2.0**halving
        again = path(surface, rays[worse], shifted[worse])
        at.replace(worse, again)
        worse = worse[_length_in_plan(again.gradient) > enough[worse]]
    return shifted, at


def _length_in_plan(vectors: FloatArray) -> FloatArray:
    return np.hypot(vectors[:, 0], vectors[:, 1])


def solved(A: FloatArray, b: FloatArray) -> FloatArray:
    """Return the solutions (N, 2) of 2 by 2 systems; a singular one gives a step along b."""
    det = A[:, 0, 0] * A[:, 1, 1] - A[:, 0, 1] * A[:, 1, 0]
    singular = np.abs(det) <= 1e-300
    scale = np.where(singular, 1.0, det)
    x = np.stack([A[:, 1, 1] * b[:, 0] - A[:, 0, 1] * b[:, 1], A[:, 0, 0] * b[:, 1] - A[:, 1, 0] * b[:, 0]], axis=1)
    return np.where(singular[:, None], b, x / scale[:, None])
