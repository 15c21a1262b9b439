"""Images near points that are not theirs: a bound that few reach, and only these need a closer look.

The numpy twin is `blunders.names`, which looks at all of them: whatever it finds near a point is marked here.

An image x is off the image x' of a point by d sigmas, d^2 = (x - x')' (B S B' + Q)^-1 (x - x'), Q and S the
covariances of x and of the point, B the partials of x' by it: |x - x'|^2 / (|B|^2 tr S + tr Q) at least. A straight
ray of the length r that leaves the axis of its camera by the angle a has |B| = f / (r cos^2 a).

A ray through level water leaves its camera, H above the water, by the angle I to the vertical that
H tan I + h tan(theta) = D says, ETL-0306 (4.10). As tan(theta) is between 0 and tan I, x' lies between the images
that the point has by a straight ray and that it would have at the height of the water. As tan(theta) grows by less
than tan I, H tan I changes by no more than the place of the point does, and by tan I with its height, as the image
of a point at the height of the water does, or of the point itself where it is above it. With H of the higher of
both |B| <= f / (H cos^2 a).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from musatpy.adjustment.kernels.points import Stations
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.compiling import compiled, inlined


class Measurements(NamedTuple):
    """The m measurements of n photos and p points: their points by photos, their photos by points."""

    of_photo: IntArray  # (n + 1,) where those of each begin
    point: IntArray  # (m,)
    of_point: IntArray  # (p + 1,)
    photo: IntArray  # (m,)


class Places(NamedTuple):
    """p points, and the level water over w of them."""

    ground: FloatArray  # (p, 3) working
    variance: FloatArray  # (p,) m2, traces of their covariances; NaN of points that are not looked for
    tide: FloatArray  # (n,) m
    row: IntArray  # (p,) of the point among those under water, -1 where it is dry
    normal: FloatArray  # (w, 3)
    depth: FloatArray  # (w,) m, under water of the height 0
    rise: FloatArray  # (w,) m of depth by one of that height


class Suspects(NamedTuple):
    """s images in the order of their photos."""

    photo: IntArray  # (s,)
    point: IntArray  # (s,) that they are named
    xy: FloatArray  # (s, 2) mm, from the principal point
    variance: FloatArray  # (s,) mm2
    near: BoolArray  # (s,) to be set


@inlined
def _image(n: int, v0: float, v1: float, v2: float, stations: Stations) -> tuple[float, float, bool]:
    """Return the image of a vector from a station, from the principal point, and whether it is in front of it."""
    M = stations.M
    depth = M[n, 2, 0] * v0 + M[n, 2, 1] * v1 + M[n, 2, 2] * v2
    scale = -stations.focal_length[n] / depth
    x = scale * (M[n, 0, 0] * v0 + M[n, 0, 1] * v1 + M[n, 0, 2] * v2)
    return x, scale * (M[n, 1, 0] * v0 + M[n, 1, 1] * v1 + M[n, 1, 2] * v2), depth < 0.0


@inlined
def _look(
    n: int, q: int, first: int, last: int, sigmas: float, stations: Stations, places: Places, suspects: Suspects
) -> None:
    """Mark those suspects of a photo that may lie near point q."""
    v0 = places.ground[q, 0] - stations.position[n, 0]
    v1 = places.ground[q, 1] - stations.position[n, 1]
    v2 = places.ground[q, 2] - stations.position[n, 2]
    x, y, seen = _image(n, v0, v1, v2, stations)
    if not seen:
        return
    bent, square, length, w = 0.0, x * x + y * y, v0 * v0 + v1 * v1 + v2 * v2, places.row[q]
    if w >= 0:
        up0, up1, up2 = places.normal[w, 0], places.normal[w, 1], places.normal[w, 2]
        depth = places.depth[w] + places.rise[w] * places.tide[n]
        height = -(up0 * v0 + up1 * v1 + up2 * v2)
        a, b, seen = _image(n, v0 + depth * up0, v1 + depth * up1, v2 + depth * up2, stations)
        height = min(height, height - depth)
        seen &= height > 0.0
        bent, square, length = (a - x) ** 2 + (b - y) ** 2, max(square, a * a + b * b), height * height
    f = stations.focal_length[n]
    variance = places.variance[q] * (f * f + square) ** 2 / (f * f * length)  # 1 / cos^2 a = 1 + square / f^2
    for i in range(first, last):
        if suspects.point[i] != q:
            off = (suspects.xy[i, 0] - x) ** 2 + (suspects.xy[i, 1] - y) ** 2
            limit = 2.0 * (bent + sigmas * sigmas * (variance + suspects.variance[i]))  # (a + b)^2 <= 2 (a^2 + b^2)
            if not (seen and off > limit):
                suspects.near[i] = True


@compiled
def mark_near(
    sigmas: float, measurements: Measurements, stations: Stations, places: Places, suspects: Suspects
) -> None:
    """Mark the images that may lie within so many sigmas of points that are not theirs.

    Of the points on photos that have points in common with theirs.
    """
    met, asked = np.full(len(measurements.of_photo) - 1, -1), np.full(len(measurements.of_point) - 1, -1)
    first = 0
    while first < len(suspects.photo):
        n, last = suspects.photo[first], first
        while last < len(suspects.photo) and suspects.photo[last] == n:
            last += 1
        for i in range(measurements.of_photo[n], measurements.of_photo[n + 1]):
            p = measurements.point[i]
            for j in range(measurements.of_point[p], measurements.of_point[p + 1]):
                other = measurements.photo[j]
                if met[other] == n:
                    continue
                met[other] = n
                for k in range(measurements.of_photo[other], measurements.of_photo[other + 1]):
                    q = measurements.point[k]
                    if asked[q] != n and not math.isnan(places.variance[q]):
                        asked[q] = n
                        _look(n, q, first, last, sigmas, stations, places, suspects)
        first = last
