"""Exact ray tracing through a calm water surface, or a flat port, for simulated images only.

The surface is the one of constant ellipsoidal height t (the plane Z = t in local jobs), or one whose height above
that grows evenly along a slope vector. Fermat: the light path from
the camera C to the ground point G by way of the surface point W is stationary, so the tangential part of
u_air - n u_water vanishes at W; that is Snell with the exact normal. Everything is reckoned in the local vertical
frame at the foot of G on the surface, from closed differences, so that nothing is lost to the size of the Earth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import MusatError
from musatpy.geometry.collinearity import local_vertical
from musatpy.units import DEGREE

# Places (k, 3) of level water in the axes of the job -> heights (k,) m of waves over it, their gradients (k, 3).
Rise = Callable[[FloatArray], tuple[FloatArray, FloatArray]]

RELATIVE_PRECISION = 1e-13  # of the incidence point, against the depth
MAX_STEPS = 50
_FAR = 1e7  # m: no ray goes so far
_NEAR = 1e-5  # between directions of which the differential is taken


class RayTraceError(MusatError):
    """The incidence point was not found: a camera below the water, or a ray along the surface."""


@dataclass(frozen=True, kw_only=True)
class TracedRays:
    """k refracted rays from cameras down to submerged points, in the axes of the job (geocentric or local)."""

    incidence: FloatArray  # (k, 3) m, W on the water surface
    air: FloatArray  # (k, 3) unit, from the camera to W
    water: FloatArray  # (k, 3) unit, from W to the ground point
    normal: FloatArray  # (k, 3) unit, upward normal of the surface at W


class TracedSurface(Protocol):
    """A water surface seen from the feet of k ground points: parameters q (k, 2) m, east and north of the foot."""

    def at(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return W (k, 3), axes E N U at W (k, 3, 3), curvatures along E, N (k, 2) and |dW/dq| (k, 2)."""


class PlaneSurface:
    """The plane of a local job: the foot is the origin, the vertical +Z everywhere."""

    def at(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """See `TracedSurface.at`."""
        k = len(q)
        position = np.column_stack([q, np.zeros(k)])
        return position, np.broadcast_to(np.eye(3), (k, 3, 3)), np.zeros((k, 2)), np.ones((k, 2))


@dataclass(frozen=True, kw_only=True)
class EllipsoidalSurface:
    """The surface of constant ellipsoidal height about feet at given latitudes."""

    latitude: FloatArray  # (k,) rad, of the feet
    height: FloatArray  # (k,) m, t
    semi_major_axis: float  # m
    eccentricity_squared: float

    def radii(self, latitude: FloatArray) -> FloatArray:
        """Return the radii of curvature of the surface along east (N + t) and north (M + t), (k, 2)."""
        w2 = 1.0 - self.eccentricity_squared * np.sin(latitude) ** 2
        prime_vertical = self.semi_major_axis / np.sqrt(w2)
        meridian = prime_vertical * (1.0 - self.eccentricity_squared) / w2
        return np.stack([prime_vertical + self.height, meridian + self.height], axis=-1)

    def at(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """See `TracedSurface.at`. Parameters are longitude and latitude from the foot, times the radii there."""
        radii0 = self.radii(self.latitude)
        parallel0 = radii0[:, 0] * np.cos(self.latitude)
        d_longitude, d_latitude = q[:, 0] / parallel0, q[:, 1] / radii0[:, 1]
        latitude = self.latitude + d_latitude
        radii = self.radii(latitude)
        to_foot = local_vertical(self.latitude, np.zeros_like(d_longitude))
        position = np.einsum("kij,kj->ki", to_foot, self._from_foot(latitude, d_latitude, d_longitude))
        axes = local_vertical(latitude, d_longitude) @ np.swapaxes(to_foot, -1, -2)
        stretch = np.stack([radii[:, 0] * np.cos(latitude) / parallel0, radii[:, 1] / radii0[:, 1]], axis=-1)
        return position, axes, 1.0 / radii, stretch

    def _from_foot(self, latitude: FloatArray, d_latitude: FloatArray, d_longitude: FloatArray) -> FloatArray:
        """Return W minus the foot (k, 3) in geocentric axes turned to the foot's meridian, without cancellation."""
        a, e2, t = self.semi_major_axis, self.eccentricity_squared, self.height
        s0, s, c = np.sin(self.latitude), np.sin(latitude), np.cos(latitude)
        middle, half = self.latitude + d_latitude / 2.0, np.sin(d_latitude / 2.0)
        ds, dc = 2.0 * np.cos(middle) * half, -2.0 * np.sin(middle) * half  # s - s0, c - c0
        w0, w = np.sqrt(1.0 - e2 * s0 * s0), np.sqrt(1.0 - e2 * s * s)
        N0, dN = a / w0, a * e2 * (s + s0) * ds / (w * w0 * (w + w0))
        p = (N0 + dN + t) * c
        dp = dN * c + (N0 + t) * dc
        dz = (1.0 - e2) * dN * s + ((1.0 - e2) * N0 + t) * ds
        return np.stack([dp - 2.0 * p * np.sin(d_longitude / 2.0) ** 2, p * np.sin(d_longitude), dz], axis=-1)


@dataclass(frozen=True, kw_only=True)
class TiltedSurface:
    """A level surface raised by s . (W - foot) at W: where its own normal is U, the raised one has U - s."""

    level: TracedSurface
    slope: FloatArray  # (k, 3) s, in the frames at the feet

    def at(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """See `TracedSurface.at`. Curvatures and stretches are of the level surface, to the slope's first order."""
        position, axes, curvature, stretch = self.level.at(q)
        up = axes[:, 2]
        rise = np.sum(self.slope * position, axis=1) / (1.0 - np.sum(self.slope * up, axis=1))
        return position + rise[:, None] * up, _leaning(axes, _unit(up - self.slope)), curvature, stretch


@dataclass(frozen=True, kw_only=True)
class WavySurface:
    """A level surface with waves on it, up the vertical at each of its points."""

    level: TracedSurface
    rise: Rise
    foot: FloatArray  # (k, 3) m, of the frames, in the axes of the job
    to_local: FloatArray  # (k, 3, 3) from the axes of the job to the frames at the feet

    def at(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """See `TracedSurface.at`. Curvatures are those of the level surface: steps miss by a small part."""
        position, axes, curvature, stretch = self.level.at(q)
        up = axes[:, 2]
        height, gradient = self.rise(self.foot + np.einsum("kji,kj->ki", self.to_local, position))
        slope = np.einsum("kij,kj->ki", self.to_local, gradient)
        level = slope - up * np.sum(slope * up, axis=1)[:, None]
        return position + height[:, None] * up, _leaning(axes, _unit(up - level)), curvature, stretch


def _leaning(axes: FloatArray, normal: FloatArray) -> FloatArray:
    """Return east, north and normal (k, 3, 3) of a surface with these normals (k, 3), near `axes`."""
    east = _unit(axes[:, 0] - normal * np.sum(normal * axes[:, 0], axis=1)[:, None])
    return np.stack([east, np.cross(normal, east), normal], axis=1)


def _unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def _gradient(
    q: FloatArray, camera: FloatArray, depth: FloatArray, surface: TracedSurface, index: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the gradient (k, 2) of the light path along E and N at W, its Jacobian (k, 2, 2) and |dW/dq|.

    In the Jacobian the turning of E and N about the vertical is left out: it multiplies the gradient itself.
    """
    W, axes, curvature, stretch = surface.at(q)
    in_air, in_water = W - camera, -W
    in_water[:, 2] -= depth
    r1, r2 = np.linalg.norm(in_air, axis=1), np.linalg.norm(in_water, axis=1)
    u1, u2 = in_air / r1[:, None], in_water / r2[:, None]
    tangent = axes[:, :2]
    a = np.einsum("kij,kj->ki", tangent, u1)
    b = np.einsum("kij,kj->ki", tangent, u2)
    vertical = np.einsum("kj,kj->k", axes[:, 2], u1 - index * u2)
    jacobian = np.eye(2) * ((1.0 / r1 + index / r2)[:, None] - vertical[:, None] * curvature)[:, None, :]
    jacobian -= np.einsum("ki,kj->kij", a, a) / r1[:, None, None]
    jacobian -= np.einsum("ki,kj->kij", b, b) * (index / r2)[:, None, None]
    return a - index * b, jacobian, stretch


def solve_incidence(camera: FloatArray, depth: FloatArray, surface: TracedSurface, index: float) -> FloatArray:
    """Return the parameters q (k, 2) of the incidence points by Newton; all steps below 1e-13 of the depth.

    `camera` (k, 3) is reckoned from the foot of the ground point in its local vertical frame, the point is
    (0, 0, -depth). Raises `RayTraceError`.
    """
    # Snell for the straight line from the camera to the foot, exact as depth -> 0
    sine = camera[:, :2] / np.linalg.norm(camera, axis=1)[:, None] / index
    q = sine * (depth / np.sqrt(np.maximum(1.0 - np.sum(sine * sine, axis=1), 0.1)))[:, None]
    for _ in range(MAX_STEPS):
        gradient, jacobian, stretch = _gradient(q, camera, depth, surface, index)
        # waves over a point just below them can lead a step astray
        if not (np.abs(q) < _FAR).all():
            break
        step = -np.linalg.solve(jacobian, gradient[..., None])[..., 0]
        q = q + step / stretch
        if np.all(np.abs(step) <= RELATIVE_PRECISION * depth[:, None]):
            return q
    raise RayTraceError("no incidence point on the water surface")


def trace(
    camera: FloatArray,
    ground: FloatArray,
    level: FloatArray,
    index: float,
    ellipsoid: tuple[float, float] | None = None,
    slope: FloatArray | None = None,
    rise: Rise | None = None,
) -> TracedRays:
    """Trace rays through the surface of height `level` (k,) m over ground points, each below it.

    `camera` (k, 3) m, geocentric or local; `ground` (k, 3) latitude, longitude (rad) and height (m), or X, Y, Z of
    a local job; `ellipsoid`: semi-major axis (m) and eccentricity squared, None in local jobs; `index` of water
    relative to air. The surface rises along the `slope` (3,), in the axes of the cameras, where one is given, and
    has waves of a `rise`, where one is given. Raises `RayTraceError` where there is no incidence point, or a camera
    does not look at the surface from above.
    """
    depth = level - ground[:, 2]
    surface, to_local, foot = _level_surface(ground, level, ellipsoid)
    if slope is not None and slope.any():
        surface = TiltedSurface(level=surface, slope=np.einsum("kij,j->ki", to_local, slope))
    if rise is not None:
        surface = WavySurface(level=surface, rise=rise, foot=foot, to_local=to_local)
    local_camera = camera - foot if ellipsoid is None else np.einsum("kij,kj->ki", to_local, camera - foot)
    W, axes, _, _ = surface.at(solve_incidence(local_camera, depth, surface, index))
    in_air, in_water = W - local_camera, -W
    in_water[:, 2] -= depth
    if np.any(np.einsum("kj,kj->k", in_air, axes[:, 2]) >= 0.0):
        raise RayTraceError("a camera lies at or below the water surface")

    def turned(vectors: FloatArray) -> FloatArray:
        return np.einsum("kji,kj->ki", to_local, vectors)

    return TracedRays(
        incidence=foot + turned(W),
        air=turned(in_air / np.linalg.norm(in_air, axis=1)[:, None]),
        water=turned(in_water / np.linalg.norm(in_water, axis=1)[:, None]),
        normal=turned(axes[:, 2]),
    )


def _level_surface(
    ground: FloatArray, level: FloatArray, ellipsoid: tuple[float, float] | None
) -> tuple[TracedSurface, FloatArray, FloatArray]:
    """Return the level surface, the axes (k, 3, 3) at the feet of the ground points on it, and the feet (k, 3)."""
    if ellipsoid is None:
        to_local = np.broadcast_to(np.eye(3), (len(ground), 3, 3))
        return PlaneSurface(), to_local, np.column_stack([ground[:, :2], level])
    latitude, longitude, _ = ground.T
    a, e2 = ellipsoid
    surface = EllipsoidalSurface(latitude=latitude, height=level, semi_major_axis=a, eccentricity_squared=e2)
    to_local = local_vertical(latitude, longitude)
    # the foot is (N + t) U, less e2 N sin(latitude) along the polar axis
    east_radius = surface.radii(latitude)[:, 0]
    foot = east_radius[:, None] * to_local[:, 2]
    foot[:, 2] -= e2 * (east_radius - level) * np.sin(latitude)
    return surface, to_local, foot


def through_port(
    points: FloatArray, distance: float, thickness: float, glass: float, water: float, *tilts: float
) -> FloatArray:
    """Return the directions (k, 3) in the housing in which a camera behind a flat port sees points.

    `points` (k, 3) m along the axes of the image, from the projection centre; the port as `PortKeys` has it.
    Rays are shot by Snell's law in vectors until they hit: Newton, the differential of where they hit by
    differences. NaN for points that are not beyond the glass. Raises `RayTraceError` where no ray hits a point.
    """
    (sa, sb), (ca, cb) = np.sin(np.multiply(tilts, DEGREE)), np.cos(np.multiply(tilts, DEGREE))
    about_x, about_y = (
        np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]]),
        np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]]),
    )
    to_port = (about_y @ about_x).T  # its z axis is the normal, which points to the camera
    target, inner, outer = points @ to_port.T, -distance / 1e3, -(distance + thickness) / 1e3
    beyond, out = target[:, 2] < outer, np.full_like(target, np.nan)
    target = target[beyond]
    tangents = target[:, :2] / -target[:, 2:]

    def missed(tangents: FloatArray) -> FloatArray:
        """Return by how much (k, 2) rays (x, y, -1), in the axes of the port, miss the points in their planes."""
        ray, place = _unit(np.column_stack([tangents, -np.ones(len(tangents))])), np.zeros_like(target)
        for depth, ratio in ((inner, 1.0 / glass), (outer, glass / water), (target[:, 2], 1.0)):
            place = place + ray * ((depth - place[:, 2]) / ray[:, 2])[:, None]
            along = ratio * ray[:, :2]
            ray = np.column_stack([along, -np.sqrt(1.0 - np.sum(along**2, axis=1))])
        return (place - target)[:, :2]

    for _ in range(MAX_STEPS):
        differences = [missed(tangents + step) - missed(tangents - step) for step in _NEAR * np.eye(2)]
        slope = np.stack(differences, axis=2) / (2.0 * _NEAR)
        step = np.linalg.solve(slope, missed(tangents)[..., None])[..., 0]
        tangents = tangents - step
        if not (np.abs(step) > RELATIVE_PRECISION * (1.0 + np.abs(tangents))).any():
            out[beyond] = np.column_stack([tangents, -np.ones(len(tangents))]) @ to_port
            return out
    raise RayTraceError("no ray through the port hits a point")
