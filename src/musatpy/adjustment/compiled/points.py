"""Points by collinearity, one after the other: their images, partials and normals, their sums, and their errors.

The numpy twins are `sightings.images`, `point_normals`, `collinear.eliminate` and `collinear.reduced`, of single
rays `geometry.collinearity` and `refraction.flat`, whose equations these loops follow. Points have no unknowns but
their own three and those of their stations: six or, with a water level of each, seven. What has more goes by the
twins.

Every function works at some `rows` of points; where sums of several of them are added up is for who calls them, so
that threads can share the work.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import BoolArray, FloatArray, IntArray

Function = TypeVar("Function", bound=Callable[..., object])
_MAX_STEPS = 60


def compiled(function: Function) -> Function:
    """Return a compiled function, kept from run to run; other threads run while it computes.

    Divisions by zero give infinities, as those of numpy do. The order of sums is that of the source.
    """
    kernel = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    # numba would compile anew for changes of its own file only, and not of those whose pieces are a part of it
    cast(Any, kernel)._cache._cache_file._source_stamp = _stamp()
    return cast(Function, kernel)


def piece(function: Function) -> Function:
    """Return the same for a piece that becomes part of others.

    Pieces make no arrays, so that none that they take needs to be counted: that is an atomic addition each time,
    which takes longer than a ray.
    """
    njit = cast(Any, numba.njit)  # whose types leave out `_nrt`, the counting
    return cast(Function, njit(nogil=True, error_model="numpy", forceinline=True, _nrt=False)(function))


def is_kept(kernel: Callable[..., object]) -> bool:
    """Return whether a function that was compiled in a run before is as its source is now."""
    return bool(cast(Any, kernel)._cache._cache_file._load_index())


@cache
def _stamp() -> bytes:
    """Return what is another one when a source of this folder is."""
    return sha256(b"".join(source.read_bytes() for source in sorted(Path(__file__).parent.glob("*.py")))).digest()


class Poses(NamedTuple):
    """n photos where they are."""

    position: FloatArray  # (n, 3) working
    M: FloatArray  # (n, 3, 3) working axes to photo
    axes: FloatArray  # (n, 3, 3) east, north, up, along which positions are corrected
    turn: FloatArray  # (n, 2) cosine and sine of kappa
    focal_length: FloatArray  # (n,) mm
    principal_point: FloatArray  # (n, 2) mm


class PointImages(NamedTuple):
    """k points one after the other, and their r images: those of point p are `start[p]` to `start[p + 1]`."""

    start: IntArray  # (k + 1,)
    photo: IntArray  # (r,)
    xy: FloatArray  # (r, 2) mm
    root: FloatArray  # (r, 2) 1/mm, of the weights
    ground: FloatArray  # (k, 3) working, of the points: those of one photo stand together


class LevelWater(NamedTuple):
    """Level water over the w rays that it refracts."""

    row: IntArray  # (r,) of the ray among those, -1 where it is dry
    normal: FloatArray  # (w, 3)
    depth: FloatArray  # (w,) m, of the points
    rise: FloatArray  # (w,) m of depth by one of the level of the photo
    refraction: float  # index of the water


class Known(NamedTuple):
    """What is known of h points along axes of their own."""

    row: IntArray  # (k,) of the point among those, -1 where nothing is
    axes: FloatArray  # (h, 3, 3)
    free: BoolArray  # (h, 3) the component may move
    diagonal: FloatArray  # (h, 3) 1/m2, weights, and one for what is held
    pull: FloatArray  # (h, 3) 1/m, weights times known minus current


class Pairs(NamedTuple):
    """The blocks of the pairs of rays of k points: of p `start[p]` to `start[p + 1]`, as `triu_indices` has."""

    start: IntArray  # (k + 1,)
    slot: NDArray[np.int32]  # rows of the blocks of the pattern


class LinearPoints(NamedTuple):
    """k points with their r images, linearised, along the axes of what is known of them; all are weighted."""

    A: FloatArray  # (r, 2, q) partials of images by stations
    B: FloatArray  # (r, 2, 3) by the point
    residual: FloatArray  # (r, 2)
    inverse: FloatArray  # (k, 3, 3) N_pp^-1
    shift: FloatArray  # (k, 3) to the best of the point
    squares: FloatArray  # (k,) of the images, infinite behind a camera
    fall: FloatArray  # (k,) of the squares by the shift


@piece
def _newton_step(t: float, H: float, h: float, D: float, n: float) -> float:
    """Return a step of tan(I) to the ray that reaches the point: `flat.air_tangent`, ETL-0306 (4.10).

    Multiplied by the root that it has, which leaves one division.
    """
    n2 = n * n
    square = n2 + (n2 - 1.0) * t * t
    root = math.sqrt(square)
    return square * (root * (D - t * H) - t * h) / (H * square * root + h * n2)


@piece
def _slopes(t: float, H: float, h: float, n: float) -> tuple[float, float, float, float]:
    """Return kappa, Q/D and the partials of Q by H and h, docs/theory.md: those of `flat.incidence`.

    Its fractions by 1/cos^3(I), with the root n cos(theta)/cos(I): one square root in place of three.
    """
    n2, square = n * n, n * n + (n * n - 1.0) * t * t
    root = math.sqrt(square)
    of_air, of_water = h * n2, H * square * root
    share = 1.0 / (of_air + of_water)
    kappa = of_water * share
    return kappa, H * root / (H * root + h), t * of_air * share, -t * kappa / root


@piece
def _bend(
    row: int, water: LevelWater, gap0: float, gap1: float, gap2: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """Return v from camera to water point of a wet ray; the gap is the vector to the point.

    Then the horizontal direction e of the ray, the height of the camera above the water and tan(I), of
    `refraction.flat.incidence`. A step to that leaves no more than its square: what is below 1e-9 ends at rounding.
    """
    up0, up1, up2 = water.normal[row, 0], water.normal[row, 1], water.normal[row, 2]
    h, fall = water.depth[row], -(up0 * gap0 + up1 * gap1 + up2 * gap2)
    e0, e1, e2 = gap0 + up0 * fall, gap1 + up1 * fall, gap2 + up2 * fall
    D = math.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
    share = 1.0 / (D if D > 0.0 else 1.0)  # 0 at the nadir
    e0, e1, e2 = e0 * share, e1 * share, e2 * share
    H = fall - h
    t = D / (H + h / water.refraction)
    for _ in range(_MAX_STEPS):
        step = _newton_step(t, H, h, D, water.refraction)
        t += step
        if not abs(step) > 1e-9 * abs(t):
            break
    Q = H * t
    return e0 * Q - up0 * H, e1 * Q - up1 * H, e2 * Q - up2 * H, e0, e1, e2, H, t


@piece
def _image(
    r: int, at: PointImages, stations: Poses, v0: float, v1: float, v2: float, by_station: bool, out: LinearPoints
) -> None:
    """Set the weighted residual of image r of a vector v from its camera, and its partials.

    `sightings.images`, `geometry.collinearity.image_partials`, with the derivatives of the rotation M by its angles
    in closed form: by omega of M v that of v x east, and so on.
    """
    n, M, axes = at.photo[r], stations.M, stations.axes
    cosine, sine = stations.turn[n, 0], stations.turn[n, 1]
    x = M[n, 0, 0] * v0 + M[n, 0, 1] * v1 + M[n, 0, 2] * v2
    y = M[n, 1, 0] * v0 + M[n, 1, 1] * v1 + M[n, 1, 2] * v2
    depth = M[n, 2, 0] * v0 + M[n, 2, 1] * v1 + M[n, 2, 2] * v2
    inverse = 1.0 / depth
    scale, of_depth = -stations.focal_length[n] * inverse, cosine * x - sine * y
    turned0 = v1 * axes[n, 0, 2] - v2 * axes[n, 0, 1]  # v x east, about which omega turns
    turned1 = v2 * axes[n, 0, 0] - v0 * axes[n, 0, 2]
    turned2 = v0 * axes[n, 0, 1] - v1 * axes[n, 0, 0]
    for c in range(2):
        image = x if c == 0 else y
        root, ratio = at.root[r, c], image * inverse
        factor = scale * root
        out.residual[r, c] = (scale * image + stations.principal_point[n, c] - at.xy[r, c]) * root
        b0 = factor * (M[n, c, 0] - ratio * M[n, 2, 0])
        b1 = factor * (M[n, c, 1] - ratio * M[n, 2, 1])
        b2 = factor * (M[n, c, 2] - ratio * M[n, 2, 2])
        out.B[r, c, 0], out.B[r, c, 1], out.B[r, c, 2] = b0, b1, b2
        if by_station:
            out.A[r, c, 0], out.A[r, c, 1], out.A[r, c, 2] = -b0, -b1, -b2
            out.A[r, c, 3] = b0 * turned0 + b1 * turned1 + b2 * turned2
            out.A[r, c, 4] = factor * ((sine if c else -cosine) * depth - ratio * of_depth)
            out.A[r, c, 5] = -factor * x if c else factor * y


@piece
def _through_water(
    r: int, row: int, water: LevelWater, e0: float, e1: float, e2: float, H: float, t: float, by_station: bool,
    out: LinearPoints,
) -> None:  # fmt: skip
    """Turn partials of image r by v to those by the point, and set those by the camera.

    And those by the level of the photo, where that is unknown. The products with the matrices K of
    `refraction.flat.incidence` are taken apart, K b = kappa e e'b + Q/D (1 - e e' - u u') b.
    """
    up0, up1, up2 = water.normal[row, 0], water.normal[row, 1], water.normal[row, 2]
    kappa, ratio, Q_H, Q_h = _slopes(t, H, water.depth[row], water.refraction)
    A, B = out.A, out.B
    for c in range(2):
        b0, b1, b2 = B[r, c, 0], B[r, c, 1], B[r, c, 2]
        along, rise = b0 * e0 + b1 * e1 + b2 * e2, b0 * up0 + b1 * up1 + b2 * up2
        of_e, of_up = (kappa - ratio) * along, ratio * rise
        k0 = ratio * b0 + of_e * e0 - of_up * up0
        k1 = ratio * b1 + of_e * e1 - of_up * up1
        k2 = ratio * b2 + of_e * e2 - of_up * up2
        by_h, by_H = along * Q_h, along * Q_H - rise
        B[r, c, 0], B[r, c, 1], B[r, c, 2] = k0 - by_h * up0, k1 - by_h * up1, k2 - by_h * up2
        if by_station:
            A[r, c, 0], A[r, c, 1], A[r, c, 2] = by_H * up0 - k0, by_H * up1 - k1, by_H * up2 - k2
            if A.shape[2] > 6:  # what rises is the level: both camera and ground sink
                A[r, c, 6] = (by_h - by_H) * water.rise[row]


@piece
def _along(rows: FloatArray, r: int, axes: FloatArray, n: int) -> None:
    """Turn the first three partials of image r, rows (r, 2, ...), to axes n (3, 3)."""
    for c in range(2):
        x, y, z = rows[r, c, 0], rows[r, c, 1], rows[r, c, 2]
        for i in range(3):
            rows[r, c, i] = x * axes[n, i, 0] + y * axes[n, i, 1] + z * axes[n, i, 2]


@piece
def _see(
    p: int, at: PointImages, stations: Poses, water: LevelWater, known: Known, by_station: bool, out: LinearPoints
) -> bool:
    """Set the weighted residuals and partials of the images of a point; return whether all cameras see it."""
    seen, M, P = True, stations.M, stations.position
    for r in range(at.start[p], at.start[p + 1]):
        n, w = at.photo[r], water.row[r]
        v0, v1, v2 = at.ground[p, 0] - P[n, 0], at.ground[p, 1] - P[n, 1], at.ground[p, 2] - P[n, 2]
        seen &= M[n, 2, 0] * v0 + M[n, 2, 1] * v1 + M[n, 2, 2] * v2 < 0.0
        if w >= 0:
            v0, v1, v2, e0, e1, e2, H, t = _bend(w, water, v0, v1, v2)
            _image(r, at, stations, v0, v1, v2, by_station, out)
            _through_water(r, w, water, e0, e1, e2, H, t, by_station, out)
        else:
            _image(r, at, stations, v0, v1, v2, by_station, out)
        if by_station:
            _along(out.A, r, stations.axes, n)
        if known.row[p] >= 0:
            _along(out.B, r, known.axes, known.row[p])
            for i in range(3):
                if not known.free[known.row[p], i]:
                    out.B[r, 0, i] = out.B[r, 1, i] = 0.0
    return seen


@piece
def _invert(
    p: int, n00: float, n10: float, n11: float, n20: float, n21: float, n22: float, out: FloatArray
) -> None:
    """Set out[p] to the inverse of a positive matrix (3, 3), by its factors L D L'."""
    d0 = 1.0 / n00
    l10, l20 = n10 * d0, n20 * d0
    d1 = 1.0 / (n11 - l10 * n10)
    rest = n21 - l20 * n10
    l21 = rest * d1
    d2 = 1.0 / (n22 - l20 * n20 - l21 * rest)
    corner = l10 * l21 - l20  # of the inverse of L
    out[p, 0, 0], out[p, 1, 1], out[p, 2, 2] = d0 + l10 * l10 * d1 + corner * corner * d2, d1 + l21 * l21 * d2, d2
    out[p, 0, 1] = out[p, 1, 0] = -l10 * d1 - corner * l21 * d2
    out[p, 0, 2] = out[p, 2, 0] = corner * d2
    out[p, 1, 2] = out[p, 2, 1] = -l21 * d2


@compiled
def linearise(
    rows: IntArray, at: PointImages, stations: Poses, water: LevelWater, known: Known, ridge: float,
    by_station: bool, out: LinearPoints,
) -> None:  # fmt: skip
    """Set the images of points, and their normal equations solved for the stations as they are.

    `ridge`: what the diagonal has beyond what is observed, of its largest. The images have partials by their
    stations only where asked for.
    """
    B = out.B
    for p in rows:
        squares = 0.0 if _see(p, at, stations, water, known, by_station, out) else np.inf
        n00 = n10 = n11 = n20 = n21 = n22 = b0 = b1 = b2 = 0.0
        for r in range(at.start[p], at.start[p + 1]):
            for c in range(2):
                x, y, z, v = B[r, c, 0], B[r, c, 1], B[r, c, 2], out.residual[r, c]
                n00, n11, n22 = n00 + x * x, n11 + y * y, n22 + z * z
                n10, n20, n21 = n10 + y * x, n20 + z * x, n21 + z * y
                b0, b1, b2 = b0 - x * v, b1 - y * v, b2 - z * v
                squares += v * v
        row = known.row[p]
        if row >= 0:
            D, pull = known.diagonal, known.pull
            n00, n11, n22 = n00 + D[row, 0], n11 + D[row, 1], n22 + D[row, 2]
            b0, b1, b2 = b0 + pull[row, 0], b1 + pull[row, 1], b2 + pull[row, 2]
        beyond = ridge * max(n00, n11, n22)
        _invert(p, n00 + beyond, n10, n11 + beyond, n20, n21, n22 + beyond, out.inverse)
        for i in range(3):
            out.shift[p, i] = out.inverse[p, i, 0] * b0 + out.inverse[p, i, 1] * b1 + out.inverse[p, i, 2] * b2
        out.fall[p] = out.shift[p, 0] * b0 + out.shift[p, 1] * b1 + out.shift[p, 2] * b2
        out.squares[p] = squares if squares < np.inf else np.inf


@compiled
def add(
    rows: IntArray, start: IntArray, photo: IntArray, points: LinearPoints, pairs: Pairs, unknowns: tuple[int, ...],
    first: int, blocks: FloatArray, rhs: FloatArray,
) -> None:  # fmt: skip
    """Add points to the normal equations of their stations, N_ss - N_sp N_pp^-1 N_ps = A'(I - B N_pp^-1 B')A.

    `blocks` (e, q, q) from row `first` of the pattern on, rhs (n, q): `collinear.reduced`. Of `unknowns` of a
    station only the number counts, for which the loop is compiled.
    """
    A, B, N = points.A, points.B, points.inverse
    for p in rows:
        x, y, z, pair = points.shift[p, 0], points.shift[p, 1], points.shift[p, 2], pairs.start[p]
        for k in range(start[p], start[p + 1]):
            v0 = points.residual[k, 0] + B[k, 0, 0] * x + B[k, 0, 1] * y + B[k, 0, 2] * z
            v1 = points.residual[k, 1] + B[k, 1, 0] * x + B[k, 1, 1] * y + B[k, 1, 2] * z
            for a in range(len(unknowns)):
                rhs[photo[k], a] -= A[k, 0, a] * v0 + A[k, 1, a] * v1
            for other in range(k, start[p + 1]):
                p00 = p11 = 1.0 if other == k else 0.0
                p01 = p10 = 0.0
                for i in range(3):  # less B N_pp^-1 B', which weighs images of one by those of the other
                    y0 = B[k, 0, 0] * N[p, 0, i] + B[k, 0, 1] * N[p, 1, i] + B[k, 0, 2] * N[p, 2, i]
                    y1 = B[k, 1, 0] * N[p, 0, i] + B[k, 1, 1] * N[p, 1, i] + B[k, 1, 2] * N[p, 2, i]
                    p00, p01 = p00 - y0 * B[other, 0, i], p01 - y0 * B[other, 1, i]
                    p10, p11 = p10 - y1 * B[other, 0, i], p11 - y1 * B[other, 1, i]
                e = pairs.slot[pair] - first
                pair += 1
                for a in range(len(unknowns)):
                    c0 = A[k, 0, a] * p00 + A[k, 1, a] * p10
                    c1 = A[k, 0, a] * p01 + A[k, 1, a] * p11
                    for b in range(len(unknowns)):
                        blocks[e, a, b] += c0 * A[other, 0, b] + c1 * A[other, 1, b]


@compiled
def spread(
    rows: IntArray, start: IntArray, points: LinearPoints, root: FloatArray, axes: FloatArray, pairs: Pairs,
    unknowns: tuple[int, ...], Q: FloatArray, of_points: FloatArray, images: FloatArray, both: FloatArray,
) -> None:  # fmt: skip
    """Set the cofactors of points (k, 3, 3), of images (r, 2), and of both along `axes` (k, 3, 3): (r, 2, 3).

    All are zero before; Q (e, q, q) is of the stations. What `CompiledLoops._errors` says, by C = A Q A' and D.
    """
    A, B, N, D = points.A, points.B, points.inverse, both
    for p in rows:
        pair = pairs.start[p]
        for k in range(start[p], start[p + 1]):
            for other in range(k, start[p + 1]):
                e = pairs.slot[pair]
                pair += 1
                c00 = c01 = c10 = c11 = 0.0
                for b in range(len(unknowns)):
                    x = y = 0.0
                    for a in range(len(unknowns)):
                        x += A[k, 0, a] * Q[e, a, b]
                        y += A[k, 1, a] * Q[e, a, b]
                    c00, c01 = c00 + x * A[other, 0, b], c01 + x * A[other, 1, b]
                    c10, c11 = c10 + y * A[other, 0, b], c11 + y * A[other, 1, b]
                for i in range(3):  # D = C B N_pp^-1, yet without the last factor
                    D[k, 0, i] += c00 * B[other, 0, i] + c01 * B[other, 1, i]
                    D[k, 1, i] += c10 * B[other, 0, i] + c11 * B[other, 1, i]
                    if other != k:
                        D[other, 0, i] += c00 * B[k, 0, i] + c10 * B[k, 1, i]
                        D[other, 1, i] += c01 * B[k, 0, i] + c11 * B[k, 1, i]
                if other == k:
                    images[k, 0], images[k, 1] = c00, c11
        for k in range(start[p], start[p + 1]):
            for c in range(2):
                x, y, z = D[k, c, 0], D[k, c, 1], D[k, c, 2]
                for i in range(3):
                    D[k, c, i] = x * N[p, 0, i] + y * N[p, 1, i] + z * N[p, 2, i]
                    for j in range(3):
                        of_points[p, j, i] += B[k, c, j] * D[k, c, i]
        for i in range(3):  # Q_xx = N_pp^-1 + N_pp^-1 B' D
            x, y, z = of_points[p, 0, i], of_points[p, 1, i], of_points[p, 2, i]
            for j in range(3):
                of_points[p, j, i] = N[p, j, i] + N[p, j, 0] * x + N[p, j, 1] * y + N[p, j, 2] * z
        for k in range(start[p], start[p + 1]):
            for c in range(2):
                b0, b1, b2 = B[k, c, 0], B[k, c, 1], B[k, c, 2]
                x = b0 * of_points[p, 0, 0] + b1 * of_points[p, 1, 0] + b2 * of_points[p, 2, 0] - D[k, c, 0]
                y = b0 * of_points[p, 0, 1] + b1 * of_points[p, 1, 1] + b2 * of_points[p, 2, 1] - D[k, c, 1]
                z = b0 * of_points[p, 0, 2] + b1 * of_points[p, 1, 2] + b2 * of_points[p, 2, 2] - D[k, c, 2]
                images[k, c] += b0 * (x - D[k, c, 0]) + b1 * (y - D[k, c, 1]) + b2 * (z - D[k, c, 2])
                images[k, c] /= root[k, c] * root[k, c]
                for i in range(3):
                    both[k, c, i] = (axes[p, i, 0] * x + axes[p, i, 1] * y + axes[p, i, 2] * z) / root[k, c]


@compiled
def follow(
    rows: IntArray, start: IntArray, photo: IntArray, points: LinearPoints, unknowns: tuple[int, ...],
    step: FloatArray, change: FloatArray,
) -> None:  # fmt: skip
    """Set the changes (k, 3) of points that follow a step (n, q) of their stations, N_pp^-1 (b - N_ps step)."""
    A, B, N = points.A, points.B, points.inverse
    for p in rows:
        x = y = z = 0.0
        for r in range(start[p], start[p + 1]):
            for c in range(2):
                v = 0.0
                for a in range(len(unknowns)):
                    v += A[r, c, a] * step[photo[r], a]
                x, y, z = x + B[r, c, 0] * v, y + B[r, c, 1] * v, z + B[r, c, 2] * v
        for i in range(3):
            change[p, i] = points.shift[p, i] - (N[p, i, 0] * x + N[p, i, 1] * y + N[p, i, 2] * z)
