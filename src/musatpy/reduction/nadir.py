"""Displacements of images to or from the nadir: what refraction and the earth's curvature have in common.

The image vector v = (x - xp, y - yp, -f) of a ray that makes the angle q with the vertical is bent in the plane
of the two. With n the unit vector to the nadir, t = n . v and tan^2(q) = v^2/t^2 - 1,

    v' = v + n t (b + c tan^2(q)),        x' = xp - f v'_1 / v'_3

Looking straight down, n = (0, 0, -1), this is x' - xp = (x - xp) / (1 + b + c r^2/f^2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray

DOWN = np.array([0.0, 0.0, -1.0])  # the nadir of a vertical photo, in its own system
DOWN.flags.writeable = False


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """How a photo looks at the ground."""

    focal_length: float  # mm
    principal_point: FloatArray  # (2,) mm, of autocollimation
    nadir: FloatArray  # (3,) unit vector to the nadir in the photo's system: M (0, 0, -1)


def bend(view: View, xy: FloatArray, b: float, c: float) -> FloatArray:
    """Return the displaced images (..., 2) mm of images xy (..., 2)."""
    bent = _bent(view, xy, b, c)
    return view.principal_point - view.focal_length * bent[..., :2] / bent[..., 2:]


def bend_partials(view: View, xy: FloatArray, b: float, c: float) -> FloatArray:
    """Return the derivatives (..., 2, 2) of the displaced images by the images xy."""
    v, t = _vector(view, xy)
    square = np.sum(v * v, axis=-1, keepdims=True)
    n = view.nadir
    by_v = (b - c) * n + c * (2.0 * v / t - square * n / t**2)
    by_v = np.eye(3) + n[:, None] * by_v[..., None, :]
    return _projected(view, _bent(view, xy, b, c), by_v[..., :2])


def bend_by_parameters(view: View, xy: FloatArray, b: float, c: float) -> FloatArray:
    """Return the derivatives (..., 2, 2) of the displaced images by b and c."""
    v, t = _vector(view, xy)
    square = np.sum(v * v, axis=-1, keepdims=True)
    columns = np.stack([view.nadir * t, view.nadir * (square / t - t)], axis=-1)
    return _projected(view, _bent(view, xy, b, c), columns)


def _vector(view: View, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    away = xy - view.principal_point
    v = np.concatenate([away, np.full_like(away[..., :1], -view.focal_length)], axis=-1)
    return v, (v @ view.nadir)[..., None]


def _bent(view: View, xy: FloatArray, b: float, c: float) -> FloatArray:
    v, t = _vector(view, xy)
    square = np.sum(v * v, axis=-1, keepdims=True)
    return v + view.nadir * (b * t + c * (square / t - t))


def _projected(view: View, bent: FloatArray, columns: FloatArray) -> FloatArray:
    """Return the derivatives of the images by what changes their vectors by `columns` (..., 3, k)."""
    third = bent[..., 2, None, None]
    ratio = bent[..., :2, None] / third
    return -view.focal_length / third * (columns[..., :2, :] - ratio * columns[..., 2:, :])
