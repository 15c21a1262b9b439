"""A flat port: a plane of glass, fixed to a camera; where a point is seen, and what a point of it sees.

Outside is water, or air again: that of a housing or a window over water.

All stands in the axes of the camera, x and y those of the image, which looks along -z. With the unit normal n of
the glass (towards the scene), p the ground point from the projection centre, z = n.p, q = p - z n, the glass from
d to d + t along n, and h = z - d - t, the ray stays in the plane of n and p: sin a = n_g sin g = n_w sin w. With
T = tan a, tan g = T r(T, n_g) and tan w = T r(T, n_w), r(T, n) = 1 / sqrt(n^2 + (n^2 - 1) T^2),

    |q| = T G,    G = d + t r(T, n_g) + h r(T, n_w),    u = n + q / G

is the direction u of the ray in the housing, whose collinear image is that of the point. T G grows with T, ever
slower: Newton's steps from the paraxial start rise towards the root and cannot overshoot. Implicitly, with
F = d(T G)/dT and B = t (n_g^2 - 1) r_g^3 + h (n_w^2 - 1) r_w^3, F dG = G_x G dx - B |q| / G d|q|.

Outside, the ray comes as if from s n on the axis, s = d + t - (d + t r(T, n_g)) / r(T, n_w): a water surface
farther on refracts it as that of a camera there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.refraction.flat import water_tangent_ratio

_MAX_STEPS = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class Port:
    """Ports of rays (...): inner face and thickness in m, indices relative to the air in the housing, tilts in rad.

    The normal is (0, 0, -1), turned about x by the first tilt and then about y by the second, right-handed.
    """

    distance: FloatArray
    thickness: FloatArray
    glass: FloatArray
    water: FloatArray
    tilt: FloatArray  # (..., 2)

    @property
    def normal(self) -> tuple[FloatArray, FloatArray]:
        """(..., 3) unit, towards the scene; and its partials (..., 3, 2) by the tilts."""
        (sa, sb), (ca, cb) = (np.moveaxis(of(self.tilt), -1, 0) for of in (np.sin, np.cos))
        by_first, by_second = (sa * sb, ca, sa * cb), (-ca * cb, 0.0 * ca, ca * sb)
        by_tilts = (np.stack(partials, axis=-1) for partials in (by_first, by_second))
        return np.stack([-ca * sb, sa, -ca * cb], axis=-1), np.stack(list(by_tilts), axis=-1)


def direction(p: FloatArray, port: Port) -> FloatArray:
    """Return the directions u (..., 3) in the housing in which points p (..., 3) m are seen."""
    q, _, _, G = _solved(p, port)
    return port.normal[0] + q / G[..., None]


def seen(p: FloatArray, port: Port) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what `direction` does, and its partials.

    By the points (..., 3, 3), and by distance, thickness, both indices, both tilts (..., 3, 6).
    """
    n, dn = port.normal
    q, h, T, G = _solved(p, port)
    t, n_g, n_w, z = port.thickness, port.glass, port.water, h + port.distance + port.thickness
    r_g, r_w = water_tangent_ratio(T, n_g), water_tangent_ratio(T, n_w)
    F = port.distance + t * n_g**2 * r_g**3 + h * n_w**2 * r_w**3
    B = t * (n_g**2 - 1.0) * r_g**3 + h * (n_w**2 - 1.0) * r_w**3
    slope = -(1.0 + T**2)
    by_size = (1.0 - r_w, r_g - r_w, t * n_g * slope * r_g**3, h * n_w * slope * r_w**3)  # G_x
    across = (np.eye(3) - n[..., :, None] * n[..., None, :]) / G[..., None, None]
    G_p = (G * r_w / F)[..., None] * n - (B / (G * F))[..., None] * q
    dz = np.einsum("...ia,...i->...a", dn, p)
    G_tilt = (G * r_w / F + B * z / (G * F))[..., None] * dz
    dq = -n[..., :, None] * dz[..., None, :] - z[..., None, None] * dn
    per_G = (q / np.square(G)[..., None])[..., :, None]
    by_tilt = dn + dq / G[..., None, None] - per_G * G_tilt[..., None, :]
    by_sizes = -per_G * (np.stack(np.broadcast_arrays(*by_size), axis=-1) * (G / F)[..., None])[..., None, :]
    by_port = np.concatenate([by_sizes, by_tilt], axis=-1)
    return n + q / G[..., None], across - per_G * G_p[..., None, :], by_port


def axis_point(p: FloatArray, port: Port) -> FloatArray:
    """Return where (..., 3) m rays to points p (..., 3), straight on backward through the port, cross its axis."""
    _, _, T, _ = _solved(p, port)
    return port.normal[0] * _along_axis(T, port)[..., None]


def axis_partials(p: FloatArray, port: Port) -> tuple[FloatArray, FloatArray]:
    """Return the partials of `axis_point` by the points (..., 3, 3), and by the port (..., 3, 6) as in `seen`."""
    n, dn = port.normal
    u, by_point, by_port = seen(p, port)
    square = np.maximum(np.sum(u * u, axis=-1), 1.0)  # 1 + T^2
    T = np.sqrt(square - 1.0)
    r_g, r_w = water_tangent_ratio(T, port.glass), water_tangent_ratio(T, port.water)
    t, inside = port.thickness, port.distance + port.thickness * r_g
    # by T^2, and by what stands in s itself
    slope = t * (port.glass**2 - 1.0) * r_g**3 / r_w - inside * (port.water**2 - 1.0) * r_w
    sizes = (
        1.0 - 1.0 / r_w,
        1.0 - r_g / r_w,
        t * port.glass * square * r_g**3 / r_w,
        -inside * port.water * square * r_w,
    )
    by_u = n[..., :, None] * (slope[..., None] * u)[..., None, :]
    by_itself = n[..., :, None] * np.stack(np.broadcast_arrays(*sizes), axis=-1)[..., None, :]
    turned = dn * _along_axis(T, port)[..., None, None]
    return by_u @ by_point, by_u @ by_port + np.concatenate([by_itself, turned], axis=-1)


def _along_axis(T: FloatArray, port: Port) -> FloatArray:
    """Return s (...)."""
    inside = port.distance + port.thickness * water_tangent_ratio(T, port.glass)
    return port.distance + port.thickness - inside / water_tangent_ratio(T, port.water)


def ray(u: FloatArray, port: Port) -> tuple[FloatArray, FloatArray]:
    """Return where rays of directions u (..., 3) in the housing leave the glass, and their directions in water.

    Points (..., 3) m from the projection centre, and unit directions (..., 3).
    """
    n, _ = port.normal
    tangent = u / np.sum(u * n, axis=-1, keepdims=True) - n
    T = np.linalg.norm(tangent, axis=-1)
    across = port.distance + port.thickness * water_tangent_ratio(T, port.glass)
    w = n + tangent * water_tangent_ratio(T, port.water)[..., None]
    origin = n * (port.distance + port.thickness)[..., None] + tangent * across[..., None]
    return origin, w / np.linalg.norm(w, axis=-1, keepdims=True)


def _solved(p: FloatArray, port: Port) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return q (..., 3), h, T and G (...); points that are not beyond the glass are seen as along its normal.

    NaN where an index below 1 lets no ray through.
    """
    n, d, t, n_g, n_w = port.normal[0], port.distance, port.thickness, port.glass, port.water
    z = np.sum(n * p, axis=-1)
    q = p - z[..., None] * n
    rho, h = np.linalg.norm(q, axis=-1), z - d - t
    beyond = h > 0.0
    T = np.where(beyond, rho / (d + t / n_g + h / n_w), 0.0)
    with np.errstate(invalid="ignore"):
        for _ in range(_MAX_STEPS):
            r_g, r_w = water_tangent_ratio(T, n_g), water_tangent_ratio(T, n_w)
            F = d + t * n_g**2 * r_g**3 + h * n_w**2 * r_w**3
            step = np.where(beyond, (rho - T * (d + t * r_g + h * r_w)) / F, 0.0)
            T = T + step
            if not (np.abs(step) > 4e-16 * T).any():
                break
        return q, h, T, d + t * water_tangent_ratio(T, n_g) + h * water_tangent_ratio(T, n_w)
