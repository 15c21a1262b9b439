"""Collinearity: image of a ground vector, ray of an image, with closed-form partial derivatives.

Vectors stand in the working frame (geocentric axes, or those of a local job); M takes them to the photo.
The image vector is (x - xp, y - yp, -f): x - xp = -f U/S, y - yp = -f V/S with (U, V, S) = M v.
"""

from __future__ import annotations

import numpy as np

from musatpy.arrays import BoolArray, FloatArray


def image(v: FloatArray, M: FloatArray, focal_length: FloatArray, principal_point: FloatArray) -> FloatArray:
    """Return plate coordinates (..., 2) mm of the vectors v (..., 3) from station to target. ETL-0306 (4.11)."""
    UVS, scale = _projection(v, M, focal_length)
    return scale * UVS[..., :2] + principal_point


def image_by_vector(
    v: FloatArray, M: FloatArray, focal_length: FloatArray, principal_point: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the image as `image` does, and its partial derivatives (..., 2, 3) mm/m by v alone."""
    UVS, scale = _projection(v, M, focal_length)
    return scale * UVS[..., :2] + principal_point, _differential(M, UVS, scale)


def image_partials(
    v: FloatArray, M: FloatArray, dM: FloatArray, focal_length: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the partial derivatives of the image by v, (..., 2, 3) mm/m, and by attitude, (..., 2, 3) mm/rad.

    `dM` (..., 3, 3, 3) holds dM/d(omega, phi, kappa), the angle on the third axis from the end.
    """
    UVS, scale = _projection(v, M, focal_length)
    dUVS = np.einsum("...aij,...j->...ia", dM, v)
    return _differential(M, UVS, scale), _differential(dUVS, UVS, scale)


def _projection(v: FloatArray, M: FloatArray, focal_length: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (U, V, S) (..., 3) and -f/S (..., 1)."""
    UVS = np.einsum("...ij,...j->...i", M, v)
    return UVS, (-np.asarray(focal_length) / UVS[..., 2])[..., None]


def _differential(dUVS: FloatArray, UVS: FloatArray, scale: FloatArray) -> FloatArray:
    """Return the differentials (..., 2, c) of the image for those of (U, V, S), (..., 3, c).

    dx = -(f/S)(dU - (U/S) dS), dy alike (docs/theory.md, closed form).
    """
    ratio = UVS[..., :2] / UVS[..., 2:]
    return scale[..., None] * (dUVS[..., :2, :] - ratio[..., None] * dUVS[..., 2:, :])


def in_front(v: FloatArray, M: FloatArray) -> BoolArray:
    """Return whether the targets of the vectors v (..., 3) lie in front of the camera (S < 0)."""
    return np.einsum("...j,...j->...", np.asarray(M)[..., 2, :], v) < 0


def ray(xy: FloatArray, M: FloatArray, focal_length: FloatArray, principal_point: FloatArray) -> FloatArray:
    """Return the unit ray (..., 3) in the working frame of plate coordinates xy (..., 2) mm. ETL-0306 (3.1)."""
    r = np.einsum("...ji,...j->...i", M, image_vector(xy, focal_length, principal_point))
    return r / np.linalg.norm(r, axis=-1, keepdims=True)


def ray_partials(
    xy: FloatArray, M: FloatArray, dM: FloatArray, focal_length: FloatArray, principal_point: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the partial derivatives of the unit ray by attitude, (..., 3, 3), and by xy, (..., 3, 2) 1/mm."""
    M = np.asarray(M)
    c = image_vector(xy, focal_length, principal_point)
    r = np.einsum("...ji,...j->...i", M, c)
    length = np.linalg.norm(r, axis=-1)[..., None, None]
    u = r[..., None] / length
    across = (np.eye(3) - u * np.swapaxes(u, -1, -2)) / length
    by_attitude = across @ np.einsum("...aji,...j->...ia", dM, c)
    by_xy = across @ np.swapaxes(M[..., :2, :], -1, -2)
    return by_attitude, by_xy


def image_vector(xy: FloatArray, focal_length: FloatArray, principal_point: FloatArray) -> FloatArray:
    """Return (x - xp, y - yp, -f), (..., 3) mm."""
    xy = np.asarray(xy) - np.asarray(principal_point)
    f = np.broadcast_to(np.asarray(focal_length), xy.shape[:-1])
    return np.concatenate([xy, -f[..., None]], axis=-1)
