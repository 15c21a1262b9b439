"""One straight ray from a camera: to a point, and its image with partials, in registers.

The numpy twins are `geometry.collinearity.image` and `image_by_vector`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from musatpy.compiling import inlined

if TYPE_CHECKING:
    from musatpy.adjustment.kernels.points import Measured, Stations


@inlined
def image_by_vector(
    r: int, at: Measured, stations: Stations, v0: float, v1: float, v2: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """Return the residuals of image r in mm, and its weighted partials by the vector v from the camera.

    `geometry.collinearity.image_by_vector`. In registers: what is not used of it is not computed.
    """
    n, M = at.photo[r], stations.M
    x = M[n, 0, 0] * v0 + M[n, 0, 1] * v1 + M[n, 0, 2] * v2
    y = M[n, 1, 0] * v0 + M[n, 1, 1] * v1 + M[n, 1, 2] * v2
    inverse = 1.0 / (M[n, 2, 0] * v0 + M[n, 2, 1] * v1 + M[n, 2, 2] * v2)
    scale, ratio_x, ratio_y = -stations.focal_length[n] * inverse, x * inverse, y * inverse
    of_x, of_y = scale * at.root[r, 0], scale * at.root[r, 1]
    return (
        scale * x + stations.principal_point[n, 0] - at.xy[r, 0],
        scale * y + stations.principal_point[n, 1] - at.xy[r, 1],
        of_x * (M[n, 0, 0] - ratio_x * M[n, 2, 0]),
        of_x * (M[n, 0, 1] - ratio_x * M[n, 2, 1]),
        of_x * (M[n, 0, 2] - ratio_x * M[n, 2, 2]),
        of_y * (M[n, 1, 0] - ratio_y * M[n, 2, 0]),
        of_y * (M[n, 1, 1] - ratio_y * M[n, 2, 1]),
        of_y * (M[n, 1, 2] - ratio_y * M[n, 2, 2]),
    )


@inlined
def to_point(r: int, p: int, at: Measured, stations: Stations) -> tuple[float, float, float, bool]:
    """Return the vector from the camera of image r to point p, and whether that sees it."""
    n, X, P, M = at.photo[r], at.ground, stations.position, stations.M
    v0, v1, v2 = X[p, 0] - P[n, 0], X[p, 1] - P[n, 1], X[p, 2] - P[n, 2]
    return v0, v1, v2, M[n, 2, 0] * v0 + M[n, 2, 1] * v1 + M[n, 2, 2] * v2 < 0.0
