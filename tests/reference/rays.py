"""Straight and refracted projection for the reference adjustment, safe for complex arguments."""

import math
from typing import Any

import numpy as np

_BISECTIONS = 30  # a bracket of 1e-9: from there Newton's three steps are quadratic whatever the geometry


def rotation(angles: np.ndarray) -> np.ndarray:
    """(..., 3, 3) rotation from local vertical to photo axes of (..., 3) omega, phi, kappa in radians."""
    omega, phi, kappa = np.moveaxis(angles, -1, 0)
    one, nil = np.ones_like(omega), np.zeros_like(omega)
    c, s = np.cos, np.sin
    r1 = [[one, nil, nil], [nil, c(omega), s(omega)], [nil, -s(omega), c(omega)]]
    r2 = [[c(phi), nil, -s(phi)], [nil, one, nil], [s(phi), nil, c(phi)]]
    r3 = [[c(kappa), s(kappa), nil], [-s(kappa), c(kappa), nil], [nil, nil, one]]
    m1, m2, m3 = (np.stack([np.stack(row, axis=-1) for row in r], axis=-2) for r in (r1, r2, r3))
    return m3 @ m2 @ m1


def angles_of(matrix: np.ndarray) -> np.ndarray:
    """(..., 3) omega, phi, kappa of real rotations."""
    omega = np.arctan2(-matrix[..., 2, 1], matrix[..., 2, 2])
    phi = np.arcsin(np.clip(matrix[..., 2, 0], -1.0, 1.0))
    kappa = np.arctan2(-matrix[..., 1, 0], matrix[..., 0, 0])
    return np.stack([omega, phi, kappa], axis=-1)


def tangent_in_water(D: np.ndarray, H: np.ndarray, d: np.ndarray, n: np.ndarray | float) -> np.ndarray:
    """Tangent of the refracted ray's angle from the vertical, for n >= 1.

    D is the horizontal distance of camera and point, H and d the heights of camera and point from the water, both
    positive downwards through it. The root t of n sin(water) - sin(air) lies between 0 and the tangent of the
    straight line, because a denser medium bends the ray to the vertical; it is found there by bisection on the
    real parts, and Newton steps on the given numbers then carry complex increments through.
    """

    def mismatch(t: np.ndarray, D: np.ndarray, H: np.ndarray, d: np.ndarray, n: Any) -> np.ndarray:
        Q = D - d * t
        return n * t / np.sqrt(1.0 + t * t) - Q / np.sqrt(Q * Q + H * H)

    def slope(t: np.ndarray, D: np.ndarray, H: np.ndarray, d: np.ndarray, n: Any) -> np.ndarray:
        Q = D - d * t
        return n / (1.0 + t * t) ** 1.5 + d * H * H / (Q * Q + H * H) ** 1.5

    real = (np.real(D), np.real(H), np.real(d), np.real(n))
    low, high = np.zeros_like(real[0]), real[0] / (real[1] + real[2])
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        beyond = mismatch(middle, *real) > 0.0
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    t: np.ndarray = 0.5 * (low + high)
    for _ in range(3):
        t = t - mismatch(t, D, H, d, n) / slope(t, D, H, d, n)
    return t


def level_axes(slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes (r, 3, 3) in which planes of slopes (r, 2) are level, and the vertical (r,) over their normals."""
    one = np.ones(len(slope))
    length = np.sqrt(1.0 + (slope**2).sum(axis=1))
    up = np.column_stack([-slope, one]) / length[:, None]
    east = np.column_stack([up[:, 2], 0.0 * one, -up[:, 0]]) / np.sqrt(up[:, 0] ** 2 + up[:, 2] ** 2)[:, None]
    return np.stack([east, np.cross(up, east), up], axis=1), length


def sighted(camera: np.ndarray, depth: np.ndarray, n: np.ndarray | float) -> np.ndarray:
    """(r, 3) where a ray leaves for the camera: the point itself, or its water point when `depth` is positive.

    All vectors stand in the east, north, up frame of the ground point with the point as origin: `camera` (r, 3);
    `depth` (r,) is that of the point below the water.
    """
    wet = np.real(depth) > 0.0
    safe = np.where(wet, depth, 1.0)
    H = camera[..., 2] - safe
    D2 = camera[..., 0] ** 2 + camera[..., 1] ** 2
    vertical = np.abs(D2) < 1e-12
    D = np.sqrt(np.where(vertical, 1.0, D2))
    # at the nadir t/D tends to 1/(n H + d), the small angle form
    ratio = np.where(vertical, 1.0 / (n * H + safe), tangent_in_water(D, H, safe, n) / D)
    water = np.stack([camera[..., 0] * ratio * safe, camera[..., 1] * ratio * safe, safe], axis=-1)
    return np.where(wet[..., None], water, 0.0)


def incidence_distance(
    height: float, depth: float, distance: float, index: float, tolerance: float = 1e-6
) -> float:
    """Return Q, the horizontal distance from the camera to the water point, to `tolerance` metres.

    WATPNT as printed in 1983 (ETL-0306, section 4.2.2): binary interpolation of the refraction angle, ray by ray.
    The maximum of the refraction angle is asin(1/n), its minimum 0.
    """
    low, high = 0.0, math.asin(1.0 / index)
    while True:
        theta = 0.5 * (low + high)
        incidence = math.asin(min(1.0, index * math.sin(theta)))
        q = height * math.tan(incidence)
        excess = q + depth * math.tan(theta) - distance
        if abs(excess) < tolerance:
            return q
        if excess > 0.0:
            high = theta
        else:
            low = theta
