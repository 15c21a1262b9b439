"""The search for all refraction points of rays: the disc within which they lie is divided, until nothing is open.

A cell of the disc is dropped where the gradient of the optical path is too long to vanish anywhere within it, by
bounds on its derivatives from the limits of the surface. It is done where it can hold one refraction point at most
and Newton's method cannot miss that one (Kantorovich). Else it is divided in four. So no refraction point is lost,
however near to another; only where cells become much smaller than the waves (two points about to meet) Newton's
method starts without that proof.

Whether that found all of them shows in their indices: +1 for a minimum or a maximum of the path, -1 for a saddle.
Their sum is 1 on any surface, for on the rim of the disc the path grows outwards (Poincare and Hopf). Where the sum
is another one, the cells are made smaller.

At a refraction point the gradient f of the optical path over level water of the height there balances what the
slope g of the surface adds: f + p g = 0 with p = n cos(beta) - cos(alpha), beta and alpha the angles of the
water and the air leg from the vertical. So |f| is at most p times the largest slope. Over level water the path
is convex, by at least m = n cos^2(beta)/r2 + cos^2(alpha)/r1: the point lies within |f|/m of where the ray
would enter level water of that height, and within h (tan(b) - tan(beta)) of it with sin(b) = sin(beta) + |f|/n,
the better bound where that is far: that is the disc. Both p and m are at their worst in what the pass before left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, InRows, IntArray
from musatpy.refraction import flat
from musatpy.refraction.stationary import Path, RayEnds, Reach, path, solved, stationary
from musatpy.refraction.surface import Surface

_MOST_LENGTHS = 133.0  # along the diameter of a disc: with more waves the search takes too long
_SMALLEST = 1.0 / 256.0  # side of a cell, of the shortest wave length
_REFINEMENTS = 3
_FINER = 8.0
_CERTAIN = 3.0  # Kantorovich's h is 0.39 at most then, below the 1/2 that he asks for
_BATCH = 8192  # cells at a time: arrays of that size stay in the cache
_SAME = 1e-6  # of the radius of the disc: places closer to one another are one
_PASSES = 6
_MARGIN = 1e-9  # of the radius: rounding
_SHORTEST = 1e-300


@dataclass(frozen=True, kw_only=True, eq=False)
class RayPoints:
    """Refraction points of N rays: ray (k,) ascending, places (k, 2), optical paths (k,), ascending for each ray.

    minimum (k,): which are minima; complete (N,): whether the indices of a ray add up.
    """

    ray: IntArray
    xy: FloatArray
    path: FloatArray
    minimum: BoolArray
    complete: BoolArray


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cells(InRows):
    """Squares: rows of their rays (M,), centres (M, 2), half their sides (M,) m."""

    ray: IntArray
    centre: FloatArray
    half: FloatArray

    def quarters(self) -> _Cells:
        corner = np.array([[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5]])
        centre = self.centre[:, None, :] + corner * self.half[:, None, None]
        return _Cells(ray=np.repeat(self.ray, 4), centre=centre.reshape(-1, 2), half=np.repeat(self.half / 2.0, 4))


def search(surface: Surface, rays: RayEnds) -> RayPoints:
    """Return the refraction points of rays (N,) to ground points below the water.

    Raises `ValueError` where none is found: the ray grazes the waves, or they are too sharp or too short for the
    search.
    """
    within = _searchable(surface, rays)
    smallest, open_ = surface.limits.length * _SMALLEST, np.arange(len(rays.index))
    complete, parts = np.zeros(len(open_), dtype=bool), []
    for left in range(_REFINEMENTS, -1, -1):
        found = _divided(surface, rays[open_], within[open_], smallest)
        complete[open_] = found.complete
        kept = (found.complete | (left == 0))[found.ray]
        parts.append((open_[found.ray[kept]], found.xy[kept], found.path[kept], found.minimum[kept]))
        open_, smallest = open_[~found.complete], smallest / _FINER
        if not len(open_):
            break
    ray, xy, length, minimum = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(ray, kind="stable")
    points = RayPoints(ray=ray[order], xy=xy[order], path=length[order], minimum=minimum[order], complete=complete)
    if (np.bincount(points.ray, minlength=len(rays.index)) == 0).any():
        raise ValueError("no refraction point was found for a ray: it grazes the waves, or they are too sharp")
    return points


def _searchable(surface: Surface, rays: RayEnds) -> Disc:
    """Return the discs of rays; where nothing bounds it, one as wide as the water is deep. Raises `ValueError`."""
    within = disc(surface, rays)
    depth = surface.relief(rays.ground[:, :2], rays.time).height - rays.ground[:, 2]
    radius = np.where(np.isfinite(within.radius), within.radius, depth)
    widest = 2.0 * float(radius.max(initial=0.0))
    if widest > _MOST_LENGTHS * surface.limits.length:
        message = f"waves of {surface.limits.length:.3g} m are too short for a search over {widest:.3g} m of water"
        raise ValueError(message)
    return Disc(centre=within.centre, radius=radius)


def _divided(surface: Surface, rays: RayEnds, within: Disc, smallest: float) -> RayPoints:
    """Return the refraction points of a search with cells of so small a side (m) at least."""
    cells = _Cells(ray=np.arange(len(rays.index)), centre=within.centre, half=within.radius)
    ray, start = [cells.ray[:0]], [within.centre[:0]]
    while len(cells.ray):
        cut = max(len(cells.ray) - _BATCH, 0)
        now, cells = cells[cut:], cells[:cut]
        at = path(surface, rays[now.ray], now.centre)
        open_, alone = _judged(surface, rays.index[now.ray], within, now, at)
        done = alone | (open_ & (2.0 * now.half <= smallest))
        ray.append(now.ray[done])
        step = np.where(alone[done, None], solved(at.hessian[done], at.gradient[done]), 0.0)
        start.append(now.centre[done] - step)
        cells = cells.then(now[open_ & ~done].quarters())
    rows, places = np.concatenate(ray), np.concatenate(start)
    xy, reached = stationary(surface, rays[rows], places)
    here = reached & within.has(xy, rows)
    rows, xy = _distinct(rows[here], xy[here], _SAME * within.radius)
    return _sorted(surface, rays, rows, xy)


def _judged(surface: Surface, n: FloatArray, within: Disc, cells: _Cells, at: Path) -> tuple[BoolArray, BoolArray]:
    """Return which cells (M,) may hold refraction points, and which of these hold one at most and reveal it.

    n: (M,); `at`: the path over the centres. Over a cell of half the diagonal d the gradient changes by no more
    than `bend` d, and it differs from its linear change by no more than `third` d^2/2.
    """
    limits = surface.limits
    d = cells.half * np.sqrt(2.0)
    rise = np.hypot(1.0, limits.slope)  # way along the surface, of the way in plan
    r1, r2 = (np.maximum(leg - rise * d, 1e-100) for leg in (at.air_length, at.water_length))
    turn = 1.0 / r1 + n / r2
    pull = np.abs(at.air[:, 2] - n * at.water[:, 2]) + rise * d * turn
    bend = rise**2 * turn + pull * limits.curvature
    # of the length of a leg along a curve: 3 t'c/r - 3 t_r t^2/r^2 + the third derivative, t across the leg and t_r
    # along it, c the curvature; t_r t^2 is rise^3 2/(3 sqrt 3) at most
    third = pull * limits.third + 3.0 * rise * limits.curvature * turn
    third += 2.0 / np.sqrt(3.0) * rise**3 * (1.0 / r1**2 + n / r2**2)
    g, A = at.gradient, at.hessian
    rest = third * d**2 / 2.0
    det = A[:, 0, 0] * A[:, 1, 1] - A[:, 0, 1] ** 2
    adjugate = np.stack([A[:, 1, 1], -A[:, 0, 1], -A[:, 0, 1], A[:, 0, 0]], axis=1).reshape(-1, 2, 2)
    # det (x - centre) = -adjugate (g + rest), free of a division that might be by zero
    beyond = (
        np.abs(np.einsum("nij,nj->ni", adjugate, g))
        - np.hypot(adjugate[:, :, 0], adjugate[:, :, 1]) * rest[:, None]
    )
    gap = cells.centre - within.centre[cells.ray]
    open_ = (
        (np.hypot(g[:, 0], g[:, 1]) <= bend * d)
        & (beyond <= (np.abs(det) * cells.half)[:, None]).all(axis=1)
        & (np.hypot(gap[:, 0], gap[:, 1]) <= within.radius[cells.ray] + d)
    )
    middle, half = (A[:, 0, 0] + A[:, 1, 1]) / 2.0, (A[:, 0, 0] - A[:, 1, 1]) / 2.0
    weakest = np.abs(np.abs(middle) - np.hypot(half, A[:, 0, 1]))  # the smaller singular value
    return open_, open_ & (_CERTAIN * third * d < weakest)


def _distinct(ray: IntArray, xy: FloatArray, same: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return places (M, 2) of rays (M,) once where `same` (N,) m apart: first by x, then by y among these."""
    group = ray
    for axis in (0, 1):
        order = np.lexsort([xy[:, axis], group])
        ray, xy, group = ray[order], xy[order], group[order]
        new = (np.diff(group, prepend=-1) != 0) | (np.diff(xy[:, axis], prepend=-np.inf) > same[ray])
        group = np.cumsum(new) - 1
    return ray[new], xy[new]


def _sorted(surface: Surface, rays: RayEnds, ray: IntArray, xy: FloatArray) -> RayPoints:
    at = path(surface, rays[ray], xy)
    det, trace = np.linalg.det(at.hessian), np.trace(at.hessian, axis1=1, axis2=2)
    # what meets the surface from below, or leaves it upwards, is stationary but no refraction
    normal = np.concatenate([-at.slope, np.ones((len(xy), 1))], axis=1)
    through = (np.einsum("ni,ni->n", at.air, normal) < 0.0) & (np.einsum("ni,ni->n", at.water, normal) < 0.0)
    order = np.lexsort([at.length, ray])
    order = order[through[order]]
    return RayPoints(
        ray=ray[order],
        xy=xy[order],
        path=at.length[order],
        minimum=((det > 0.0) & (trace > 0.0))[order],
        complete=np.bincount(ray, np.sign(det), minlength=len(rays.index)) == 1.0,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Disc(InRows):
    """Centre (N, 2) and radius (N,) m."""

    centre: FloatArray
    radius: FloatArray

    def has(self, xy: FloatArray, ray: Any = slice(None)) -> BoolArray:
        """Tell which places (M, 2) lie within the discs of their rays (M,)."""
        gap = xy - self.centre[ray]
        return np.hypot(gap[:, 0], gap[:, 1]) <= self.radius[ray]


def disc(surface: Surface, rays: RayEnds) -> Disc:
    """Return the discs of rays (N,) to ground points below the water; infinite where nothing bounds them."""
    reach = rays.reach(surface)
    bounded = np.isfinite(reach.radius) & (reach.shallowest > 0.0)
    # elsewhere, as for a ground point just below a crest, its reach is all that is known
    centre, radius = rays.ground[:, :2].copy(), reach.radius.copy()
    if bounded.any():
        centre[bounded], radius[bounded] = _bounded(surface, rays[bounded], reach[bounded])
    return Disc(centre=centre, radius=radius)


def _bounded(surface: Surface, rays: RayEnds, reach: Reach) -> tuple[FloatArray, FloatArray]:
    """Return centres (N, 2) and radii (N,), where depths are bounded."""
    n = rays.index
    gap = rays.ground - rays.camera
    D = np.hypot(gap[:, 0], gap[:, 1])
    depth = np.stack([reach.shallowest, reach.deepest])
    height = -gap[:, 2] - depth
    Q = height * flat.air_tangent(height, depth, D, n)
    q = D - Q  # from the ground point to where the ray would enter level water, lowest and highest
    sine = q[1] / np.hypot(depth[1], q[1])
    radius = reach.radius + q[1]
    for _ in range(_PASSES):
        steep, flattest, bend = _leg(depth, np.maximum(q[0] - radius, 0.0), np.minimum(q[1] + radius, reach.radius))
        air_steep, air_flattest, air_bend = _leg(height, np.maximum(Q[1] - radius, 0.0), Q[0] + radius)
        pull = np.maximum(n * steep - air_flattest, air_steep - n * flattest)
        f = pull * surface.limits.slope
        radius = np.minimum(radius, f / (n * bend + air_bend))
        # along the way from there the gradient grows at least as the sine of the water ray does straight outwards
        lean = sine + f / n
        tangent = lean / np.sqrt(np.maximum(1.0 - lean * lean, _SHORTEST))
        radius = np.where(lean < 1.0, np.minimum(radius, depth[1] * tangent - q[1]), radius)
    centre = rays.ground[:, :2] - gap[:, :2] * (q.mean(axis=0) / np.maximum(D, _SHORTEST))[:, None]
    return centre, (radius + (q[1] - q[0]) / 2.0) * (1.0 + _MARGIN)


def _leg(up: FloatArray, nearest: FloatArray, farthest: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what a leg of the rays is at its worst, each (N,).

    The cosines of its angle from the vertical, greatest and least, and the least curvature (1/m) of its length over
    a level surface; from the least and greatest height (2, N) and distance in plan (N,), each m.
    """
    least, greatest = up.min(axis=0), up.max(axis=0)
    # up^2 / length^3 falls with the distance; with the height it rises and then falls: least at an end
    curvature = (np.square(up) / np.hypot(up, farthest) ** 3).min(axis=0)
    return greatest / np.hypot(greatest, nearest), least / np.hypot(least, farthest), curvature
