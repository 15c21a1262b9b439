"""The disc of the surface within which all refraction points of a ray lie.

At a refraction point the gradient of the optical path over level water of the height there, f, balances what the
slope g of the surface adds: f + p g = 0 with p = n cos(beta) - cos(alpha), beta and alpha the angles of the water
and the air leg from the vertical. So |f| is at most p times the largest slope. Over level water the path is convex,
by at least m = n cos^2(beta)/r2 + cos^2(alpha)/r1: the point lies within |f|/m of where the ray would enter level
water of that height. Both p and m are those at their worst within what the pass before has left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.refraction import flat
from musatpy.refraction.stationary import Rays, Reach
from musatpy.refraction.surface import BoolArray, FloatArray, Surface

_PASSES = 6
_MARGIN = 1e-9  # of the radius: rounding
_SHORTEST = 1e-300


@dataclass(frozen=True, kw_only=True, eq=False)
class Disc:
    """Centre (N, 2) and radius (N,) m; `convex` (N,): the path is convex all over it, there is one refraction point."""

    centre: FloatArray
    radius: FloatArray
    convex: BoolArray

    def some(self, which: Any) -> Disc:
        """Return the discs of the rays that a mask, slice or array of rows chooses."""
        return Disc(centre=self.centre[which], radius=self.radius[which], convex=self.convex[which])

    def has(self, xy: FloatArray, ray: Any = slice(None)) -> BoolArray:
        """Tell which places (M, 2) lie within the discs of their rays (M,)."""
        gap = xy - self.centre[ray]
        return np.asarray(np.hypot(gap[:, 0], gap[:, 1]) <= self.radius[ray])


def disc(surface: Surface, rays: Rays) -> Disc:
    """Return the discs of rays (N,) to ground points below the water; of infinite radius where nothing bounds them."""
    reach = rays.reach(surface)
    bounded = np.isfinite(reach.radius) & (reach.shallowest > 0.0)
    radius = np.full(len(bounded), np.inf)
    centre, convex = rays.ground[:, :2].copy(), np.zeros(len(bounded), dtype=bool)
    if bounded.any():
        some = rays.some(bounded)
        centre[bounded], radius[bounded], convex[bounded] = _bounded(surface, some, reach.some(bounded))
    # the ground point just below a crest: its reach is all that is known
    radius[~bounded] = reach.radius[~bounded]
    return Disc(centre=centre, radius=radius, convex=convex)


def _bounded(surface: Surface, rays: Rays, reach: Reach) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return centres (N, 2), radii (N,) and whether the path is convex there (N,), where depths are bounded."""
    limits, n = surface.limits, rays.index
    gap = rays.ground - rays.camera
    D = np.hypot(gap[:, 0], gap[:, 1])
    depth = np.stack([reach.shallowest, reach.deepest])
    height = -gap[:, 2] - depth
    Q = height * flat.air_tangent(height, depth, D, n)
    q = D - Q  # from the ground point to where the ray would enter level water, lowest and highest
    radius = reach.radius + q[1]
    for _ in range(_PASSES):
        water = _Leg.of(depth, np.maximum(q[0] - radius, 0.0), np.minimum(q[1] + radius, reach.radius))
        air = _Leg.of(height, np.maximum(Q[1] - radius, 0.0), Q[0] + radius)
        pull = np.maximum(n * water.steepest - air.flattest, air.steepest - n * water.flattest)
        radius = np.minimum(radius, pull * limits.slope / (n * water.convexity + air.convexity))
    # the form of `Path.hessian`: what a leg bends the path by at least, against what the surface bends it by
    leaning = np.arctan(limits.slope)
    straight = n * water.bend(leaning) + air.bend(leaning)
    convex = straight > pull * limits.curvature
    centre = rays.ground[:, :2] - gap[:, :2] * (q.mean(axis=0) / np.maximum(D, _SHORTEST))[:, None]
    return centre, (radius + (q[1] - q[0]) / 2.0) * (1.0 + _MARGIN), convex


@dataclass(frozen=True, kw_only=True, eq=False)
class _Leg:
    """What a leg of the rays is at its worst: cosines (N,) of its angle from the vertical, greatest and least.

    Its greatest length (N,) m; convexity (N,) 1/m: the least curvature of its length over a level surface.
    """

    steepest: FloatArray
    flattest: FloatArray
    longest: FloatArray
    convexity: FloatArray

    @classmethod
    def of(cls, up: FloatArray, nearest: FloatArray, farthest: FloatArray) -> _Leg:
        """Return it from the least and greatest height (2, N) and distance in plan (N,), each m."""
        least, greatest = up.min(axis=0), up.max(axis=0)
        # up^2 / length^3 falls with the distance; with the height it rises and then falls: least at an end
        return cls(
            steepest=greatest / np.hypot(greatest, nearest),
            flattest=least / np.hypot(least, farthest),
            longest=np.hypot(greatest, farthest),
            convexity=(np.square(up) / np.hypot(up, farthest) ** 3).min(axis=0),
        )

    def bend(self, leaning: float) -> FloatArray:
        """Return by how much at least (N,) 1/m the leg bends the path over a surface that leans by so much (rad)."""
        angle = np.arccos(np.minimum(self.flattest, 1.0)) + leaning
        return np.where(angle < np.pi / 2.0, np.square(np.cos(angle)), 0.0) / self.longest
