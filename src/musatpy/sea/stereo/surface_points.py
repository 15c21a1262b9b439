"""Points on the water, intersected in air from a simultaneous pair, with their covariance from the images.

Okamoto (1982), Discussion, method (1). Rectangular axes, Z up, metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.geometry.collinearity import nearest_point


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfacePoints:
    """n points: ids, position (n, 3) m, covariance (n, 3, 3) m2. Raises `ValueError` where they do not fit."""

    ids: tuple[str, ...]
    position: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        n = len(self.ids)
        if self.position.shape != (n, 3) or self.covariance.shape != (n, 3, 3):
            raise ValueError("surface points have one id, position and covariance each")
        if not (np.isfinite(self.position).all() and np.isfinite(self.covariance).all()):
            raise ValueError("a surface point is not finite")
        if n and not (np.linalg.eigvalsh(self.covariance)[:, 0] > 0.0).all():
            raise ValueError("the covariance of a surface point is not positive")

    def height_variance(self, gradient: FloatArray) -> FloatArray:
        """Return (n,) m2 the variances of heights above a surface of gradients (n, 2): its slope tells on them."""
        normal = np.column_stack([-gradient, np.ones(len(gradient))])
        return np.einsum("ni,nij,nj->n", normal, self.covariance, normal)


def intersection_covariance(cameras: FloatArray, points: FloatArray, sigma: float) -> FloatArray:
    """Return the covariance (n, 3, 3) m2 of points (n, 3) intersected in air from cameras (k, 3).

    sigma (rad): of an image across its ray, both ways: that of a plate coordinate over the focal length, for rays
    near the camera axis. Each ray fixes the point across itself with the weight 1 / (sigma distance)^2.
    """
    gap = points[:, None, :] - cameras
    distance = np.linalg.norm(gap, axis=-1)
    u = gap / distance[..., None]
    across = np.eye(3) - u[..., :, None] * u[..., None, :]
    normal = np.sum(across / np.square(sigma * distance)[..., None, None], axis=1)
    return np.linalg.inv(normal)


def intersected(ids: tuple[str, ...], cameras: FloatArray, direction: FloatArray, sigma: float) -> SurfacePoints:
    """Return the points where unit image rays (k, n, 3) of cameras (k, 3) meet in air; sigma as above."""
    rays = np.swapaxes(direction, 0, 1)
    position = nearest_point(np.broadcast_to(cameras, rays.shape), rays)
    return SurfacePoints(ids=ids, position=position, covariance=intersection_covariance(cameras, position, sigma))
