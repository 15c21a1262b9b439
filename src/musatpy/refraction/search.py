"""The search for all refraction points of one ray.

A net of places covers the circle within which they lie. In each of its meshes over which both components of the
gradient of the optical path change sign, Newton's method starts. Whether that found all of them shows in their
indices: +1 for a minimum or a maximum of the path, -1 for a saddle. Their sum over the plane is 1 on any surface,
for far away the path grows in every direction (Poincare and Hopf). Where the sum is another one, the net is made
finer. (A pair of a minimum and a saddle that are missed together does not show; both lie within one mesh then.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.refraction.stationary import Rays, path, stationary
from musatpy.refraction.surface import BoolArray, FloatArray, Surface

_PER_LENGTH = 12  # meshes per shortest wave length
_LEAST_PER_LENGTH = 3  # with fewer the net would not see the waves
_FEWEST, _MOST = 8, 400  # meshes along the diameter of the circle
_REFINEMENTS = 3
_SAME = 1e-6  # of the circle: places closer to one another are one


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """Places (k, 2), optical paths (k,) ascending, which are minima (k,), and whether the indices add up."""

    xy: FloatArray
    path: FloatArray
    minimum: BoolArray
    complete: bool


def search(surface: Surface, ray: Rays) -> Found:
    """Return the refraction points of one ray (N = 1) to a ground point below the water.

    Raises `ValueError` where none is found: the ray grazes the waves, or they are too sharp or too short for the
    search.
    """
    relief = surface.relief(ray.ground[:, :2], ray.time)
    reach, depth = float(ray.reach(surface).radius[0]), float(relief.height[0] - ray.ground[0, 2])
    R = max(reach, depth) if np.isfinite(reach) else depth
    wanted = 2.0 * R / surface.limits.length * _PER_LENGTH
    if wanted > _MOST * _PER_LENGTH / _LEAST_PER_LENGTH:
        message = f"waves of {surface.limits.length:.3g} m are too short for a search over {2.0 * R:.3g} m of water"
        raise ValueError(message)
    meshes = int(np.clip(np.ceil(wanted), _FEWEST, _MOST))
    for _ in range(_REFINEMENTS):
        found = _in_net(surface, ray, R, meshes)
        if found.complete or meshes >= _MOST:
            break
        meshes = min(2 * meshes, _MOST)
    if not len(found.xy):
        raise ValueError("no refraction point was found for a ray: it grazes the waves, or they bend too sharply")
    return found


def _in_net(surface: Surface, ray: Rays, R: float, meshes: int) -> Found:
    centre = ray.ground[0, :2]
    # a little off the middle, so that neither the ground point nor a symmetric surface lies on the lines of the net
    nodes = np.linspace(-1.0, 1.0, meshes + 1) * R * 1.037 + 0.0113 * R
    net = centre + np.stack(np.meshgrid(nodes, nodes, indexing="ij"), axis=-1)
    slope = path(surface, ray.repeated(net.size // 2), net.reshape(-1, 2)).gradient.reshape(net.shape)
    corners = np.stack([slope[:-1, :-1], slope[1:, :-1], slope[:-1, 1:], slope[1:, 1:]])
    signs = ((corners.min(axis=0) <= 0.0) & (corners.max(axis=0) >= 0.0)).all(axis=-1)
    middle = (net[:-1, :-1] + net[1:, 1:]) / 2.0
    start = np.concatenate([middle[signs], centre[None]])
    xy, reached = stationary(surface, ray.repeated(len(start)), start)
    # a step that wandered off may end far away on a surface without edges: there is nothing there (module's text)
    near = reached & (np.linalg.norm(xy - centre, axis=1) <= 2.0 * R)
    return _judged(surface, ray, _distinct(xy[near], _SAME * R))


def _distinct(xy: FloatArray, same: float) -> FloatArray:
    kept: list[FloatArray] = []
    for place in xy:
        if all(np.hypot(*(place - other)) > same for other in kept):
            kept.append(place)
    return np.array(kept).reshape(-1, 2)


def _judged(surface: Surface, ray: Rays, xy: FloatArray) -> Found:
    at = path(surface, ray.repeated(len(xy)), xy)
    det, trace = np.linalg.det(at.hessian), np.trace(at.hessian, axis1=1, axis2=2)
    # what meets the surface from below, or leaves it upwards, is stationary but no refraction
    normal = np.concatenate([-at.tangents[:, 2], np.ones((len(xy), 1))], axis=1)
    through = (np.einsum("ni,ni->n", at.air, normal) < 0.0) & (np.einsum("ni,ni->n", at.water, normal) < 0.0)
    order = np.flatnonzero(through)[np.argsort(at.length[through], kind="stable")]
    return Found(
        xy=xy[order],
        path=at.length[order],
        minimum=((det > 0.0) & (trace > 0.0))[order],
        complete=int(np.sign(det).sum()) == 1,
    )
