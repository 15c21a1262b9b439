"""The disc of the surface within which all refraction points of a ray lie.

At a refraction point the gradient f of the optical path over level water of the height there balances what the
slope g of the surface adds: f + p g = 0 with p = n cos(beta) - cos(alpha), beta and alpha the angles of the
water and the air leg from the vertical. So |f| is at most p times the largest slope. Over level water the path
is convex, by at least m = n cos^2(beta)/r2 + cos^2(alpha)/r1: the point lies within |f|/m of where the ray
would enter level water of that height, and within h (tan(b) - tan(beta)) of it with sin(b) = sin(beta) + |f|/n,
the better bound where that is far. Both p and m are those at their worst within what the pass before has left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.refraction import flat
from musatpy.refraction.stationary import Rays, Reach
from musatpy.refraction.surface import Surface

_PASSES = 6
_MARGIN = 1e-9  # of the radius: rounding
_SHORTEST = 1e-300


@dataclass(frozen=True, kw_only=True, eq=False)
class Disc:
    """Centre (N, 2) and radius (N,) m."""

    centre: FloatArray
    radius: FloatArray

    def some(self, which: Any) -> Disc:
        """Return the discs of the rays that a mask, slice or array of rows chooses."""
        return Disc(centre=self.centre[which], radius=self.radius[which])

    def has(self, xy: FloatArray, ray: Any = slice(None)) -> BoolArray:
        """Tell which places (M, 2) lie within the discs of their rays (M,)."""
        gap = xy - self.centre[ray]
        return np.hypot(gap[:, 0], gap[:, 1]) <= self.radius[ray]


def disc(surface: Surface, rays: Rays) -> Disc:
    """Return the discs of rays (N,) to ground points below the water; infinite where nothing bounds them."""
    reach = rays.reach(surface)
    bounded = np.isfinite(reach.radius) & (reach.shallowest > 0.0)
    # elsewhere, as for a ground point just below a crest, its reach is all that is known
    centre, radius = rays.ground[:, :2].copy(), reach.radius.copy()
    if bounded.any():
        centre[bounded], radius[bounded] = _bounded(surface, rays.some(bounded), reach.some(bounded))
    return Disc(centre=centre, radius=radius)


def _bounded(surface: Surface, rays: Rays, reach: Reach) -> tuple[FloatArray, FloatArray]:
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
        water = _Leg.of(depth, np.maximum(q[0] - radius, 0.0), np.minimum(q[1] + radius, reach.radius))
        air = _Leg.of(height, np.maximum(Q[1] - radius, 0.0), Q[0] + radius)
        pull = np.maximum(n * water.steepest - air.flattest, air.steepest - n * water.flattest)
        f = pull * surface.limits.slope
        radius = np.minimum(radius, f / (n * water.convexity + air.convexity))
        # along the way from there the gradient grows at least as the sine of the water ray does straight outwards
        lean = sine + f / n
        tangent = lean / np.sqrt(np.maximum(1.0 - lean * lean, _SHORTEST))
        radius = np.where(lean < 1.0, np.minimum(radius, depth[1] * tangent - q[1]), radius)
    centre = rays.ground[:, :2] - gap[:, :2] * (q.mean(axis=0) / np.maximum(D, _SHORTEST))[:, None]
    return centre, (radius + (q[1] - q[0]) / 2.0) * (1.0 + _MARGIN)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Leg:
    """What a leg of the rays is at its worst: cosines (N,) of its angle from the vertical, greatest and least.

    convexity (N,) 1/m: the least curvature of its length over a level surface.
    """

    steepest: FloatArray
    flattest: FloatArray
    convexity: FloatArray

    @classmethod
    def of(cls, up: FloatArray, nearest: FloatArray, farthest: FloatArray) -> _Leg:
        """Return it from the least and greatest height (2, N) and distance in plan (N,), each m."""
        least, greatest = up.min(axis=0), up.max(axis=0)
        # up^2 / length^3 falls with the distance; with the height it rises and then falls: least at an end
        return cls(
            steepest=greatest / np.hypot(greatest, nearest),
            flattest=least / np.hypot(least, farthest),
            convexity=(np.square(up) / np.hypot(up, farthest) ** 3).min(axis=0),
        )
