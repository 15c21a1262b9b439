"""Images of many points on two photos, through still water, with partials, and where their rays meet.

Vectors of c points are arrays (3, c), components first: a formula runs along the points, so many of them that what
it needs stays in the cache. The equations are those of `refraction.flat`, `geometry.collinearity` and, of the water
over a point, `adjustment.water_surface`. Both rays of a point are wet, or both dry.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import einsum

from musatpy.adjustment.ground import RIDGE
from musatpy.arrays import BoolArray, FloatArray
from musatpy.compilation.bent_rays import Image, Matrix, Numbers, Value, Vector, bent, matrix, pictured
from musatpy.geometry.geodesy import Frame, GeocentricFrame

Vertical = tuple[FloatArray, FloatArray]  # up (3, c) and height (c,) m
CHUNK = 12288  # points at a time
AT_REST = 1e-5  # m; Gauss-Newton squares what is left of a step this small: rounding
APART = 1e-6  # squared sine of the angle between rays, from which on they meet clearly


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """One of the two photos where it is; tide: height (m) of the water at its exposure."""

    station: FloatArray  # (3,)
    M: FloatArray  # (3, 3) to the photo
    focal_length: float  # mm
    principal_point: FloatArray  # (2,) mm
    tide: float

    @cached_property
    def rows(self) -> Matrix:
        """M by plain numbers."""
        return matrix(self.M)

    @cached_property
    def place(self) -> Numbers:
        """The station by plain numbers."""
        x, y, z = self.station.tolist()
        return x, y, z

    @cached_property
    def middle(self) -> tuple[float, float]:
        """The principal point by plain numbers."""
        x, y = self.principal_point.tolist()
        return x, y


@dataclass(frozen=True, kw_only=True, eq=False)
class Water:
    """The water over a model: its index and slope (3,), and the curvature (1/m) of level surfaces there."""

    index: float
    slope: FloatArray
    curvature: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Pair:
    """The left and the right photo, and the water."""

    sides: tuple[Side, Side]
    water: Water

    def gaps(self, X: FloatArray, height: FloatArray) -> FloatArray:
        """Return the heights (2, c) m of the water at either photo over points X at heights (c,)."""
        surface = self.water.slope @ X - height
        return np.stack([side.tide + surface for side in self.sides])

    def seen(self, X: FloatArray) -> BoolArray:
        """Return (c,) whether points are in front of both cameras."""
        left, right = (side.M[2] @ X < side.M[2] @ side.station for side in self.sides)
        return np.asarray(left & right)


@dataclass(frozen=True, kw_only=True, eq=False)
class Over:
    """The water over points: `water_surface.Surface`. Where it is level, one gradient and secant stand for all."""

    normal: FloatArray  # (3, c)
    depth: FloatArray  # (c,)
    gradient: FloatArray  # (3, c) or (3, 1)
    secant: FloatArray  # (c,) or (1,)

    @property
    def components(self) -> Vector[FloatArray]:
        """Return those of the normal."""
        x, y, z = self.normal
        return x, y, z

    def part(self, rows: BoolArray) -> Over:
        """Return that over some of the points."""
        level = self.gradient.shape[1] < len(rows)
        gradient, secant = (self.gradient, self.secant) if level else (self.gradient[:, rows], self.secant[rows])
        return Over(normal=self.normal[:, rows], depth=self.depth[rows], gradient=gradient, secant=secant)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rays:
    """Rays of points, v (3, c) from the station to where they go to in air: `flat.Incidence`, without its matrices.

    With e along the horizontal, u the normal of the water, K = kappa e e' + ratio (I - u u' - e e'): partials of v
    are -K + (e Q_H - u) u' by the station, K - e Q_h u' by the point, e (Q_h - Q_H) + u by the level, e Q_n by the
    index. Of straight rays e is None, and they are -I and I.
    """

    v: FloatArray
    e: FloatArray | None = None
    u: FloatArray | None = None
    kappa: FloatArray | float = 1.0
    ratio: FloatArray | float = 1.0
    Q_H: FloatArray | float = 0.0
    Q_h: FloatArray | float = 0.0
    Q_n: FloatArray | float = 0.0

    def by_station(self, w: FloatArray) -> FloatArray:
        """Return the partials (..., 3, c) by the station of what has the partials w by v."""
        if self.e is None or self.u is None:
            return -w
        along, up = dot(w, self.e), dot(w, self.u)
        out = -self.ratio * w
        out += ((self.ratio - self.kappa) * along)[..., None, :] * self.e
        out += ((self.ratio - 1.0) * up + self.Q_H * along)[..., None, :] * self.u
        return out

    def by_point(self, w: FloatArray) -> FloatArray:
        """Return the partials (..., 3, c) by the point of what has the partials w by v."""
        if self.e is None or self.u is None:
            return w
        along, up = dot(w, self.e), dot(w, self.u)
        out = self.ratio * w
        out += ((self.kappa - self.ratio) * along)[..., None, :] * self.e
        out -= (self.ratio * up + self.Q_h * along)[..., None, :] * self.u
        return out

    def by_level(self, w: FloatArray) -> FloatArray:
        """Return the partials (..., c) by the level, along the normal, of what has the partials w by v."""
        if self.e is None or self.u is None:
            return np.zeros_like(w[..., 0, :])
        return np.asarray(dot(w, self.e) * (self.Q_h - self.Q_H) + dot(w, self.u))

    def by_index(self, w: FloatArray) -> FloatArray:
        """Return the partials (..., c) by the index of what has the partials w by v."""
        return np.zeros_like(w[..., 0, :]) if self.e is None else np.asarray(dot(w, self.e) * self.Q_n)


def chunks(count: int) -> Iterator[slice]:
    """Yield the rows of so many points, chunk by chunk."""
    for first in range(0, count, CHUNK):
        yield slice(first, min(first + CHUNK, count))


def curvature(frame: Frame) -> float:
    """Return the curvature (1/m) of the level surfaces of a frame, by the mean of its axes."""
    return 2.0 / sum(frame.ellipsoid.axes) if isinstance(frame, GeocentricFrame) else 0.0


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the products (..., c) of vectors a (..., 3, c) and b (3, c)."""
    return np.asarray(einsum("...ic,ic->...c", a, b))


def turned(M: FloatArray, v: FloatArray) -> FloatArray:
    """Return M v (..., c) of matrices M (..., 3)."""
    return np.asarray(einsum("...i,ic->...c", M, v))


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a x b (3, c)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def directions(side: Side, xy: FloatArray) -> FloatArray:
    """Return the unit rays (3, c) of images xy (2, c) mm: `collinearity.ray`."""
    M, (x, y) = side.M, xy - side.principal_point[:, None]
    r = M[0][:, None] * x + M[1][:, None] * y - (side.focal_length * M[2])[:, None]
    return np.asarray(r / np.sqrt(dot(r, r)))


def half_way(P: FloatArray, u: FloatArray, Q: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the points half-way between rays from P and from Q (3, c), and the squared sines of their angles.

    `intersection.first_pair`.
    """
    B, D = Q - P, cross(u, v)
    sine2 = dot(D, D)
    along_u, along_v = dot(D, cross(B, v)) / sine2, dot(D, cross(B, u)) / sine2
    return np.asarray(0.5 * (P + along_u * u + Q + along_v * v)), sine2


def beside(vertical: Vertical, d: FloatArray, curvature: float) -> Vertical:
    """Return the vertical at places d (3, c) beside those that have one: good to some 1e-8 of d."""
    up, height = vertical
    rise = dot(d, up)
    flat = d - rise * up
    return up + curvature * flat, height + rise + 0.5 * curvature * dot(flat, flat)


def water_over(water: Water, tide: float, X: FloatArray, up: FloatArray, height: FloatArray) -> Over:
    """Return the water over points: `water_surface.surface`."""
    s = water.slope
    below = tide - height
    if not s.any():
        return Over(normal=up, depth=below, gradient=np.zeros((3, 1)), secant=np.ones(1))
    gradient = s[:, None] - up * (s @ up)
    secant = np.sqrt(1.0 + dot(gradient, gradient))
    return Over(normal=(up - gradient) / secant, depth=(below + s @ X) / secant, gradient=gradient, secant=secant)


def refracted(gap: FloatArray, over: Over, index: float) -> Rays:
    """Return the refracted rays to points from a station `gap` (3, c) away."""
    x, y, z = gap
    ray = bent((x, y, z), over.components, over.depth, index)
    return Rays(
        v=np.stack(ray.v), e=np.stack(ray.e), u=over.normal, kappa=ray.kappa, ratio=ray.ratio,
        Q_H=ray.t * (1.0 - ray.kappa), Q_h=-ray.tilt,
        Q_n=ray.tilt * over.depth * (1.0 + ray.under * ray.under) / index,
    )  # fmt: skip


def images(side: Side, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the images (2, c) mm of vectors (3, c), and their partials (2, 3, c) by these."""
    x, y, z = v
    (right, up), by_v = pictured(side.rows, side.focal_length, (x, y, z))
    xy = np.stack([right, up])
    xy += side.principal_point[:, None]
    return xy, np.stack([*by_v[0], *by_v[1]]).reshape(2, 3, -1)


def image_of(
    side: Side, gap: Vector[Value], surface: tuple[Vector[Value], Value] | None, index: float
) -> Image[Value]:
    """Return the image of a point `gap` from the station by components, and its partials by the point.

    surface: normal of the water over it, and its depth; None: along a straight ray.
    """
    if surface is None:
        (x, y), by_point = pictured(side.rows, side.focal_length, gap)
    else:
        ray = bent(gap, *surface, index)
        (x, y), (of_x, of_y) = pictured(side.rows, side.focal_length, ray.v)
        by_point = ray.by_point(of_x), ray.by_point(of_y)
    px, py = side.middle
    return (x + px, y + py), by_point


def entering(
    side: Side, water: Water, u: FloatArray, X: FloatArray, vertical: Vertical
) -> tuple[FloatArray, FloatArray]:
    """Return where rays in air u (3, c) enter the water over X, and their directions in it: `refracted_ray`."""
    over, n = water_over(water, side.tide, X, *vertical), water.index
    c = -dot(u, over.normal)
    H = dot(side.station[:, None] - X, over.normal) - over.depth
    below = u / n + over.normal * (c / n - np.sqrt(1.0 - (1.0 - c * c) / (n * n)))
    return side.station[:, None] + (H / c) * u, below


@dataclass(frozen=True, kw_only=True, eq=False)
class Sight:
    """Points as one photo shows them: xy (2, c) mm, with partials by their rays v and by the points, (2, 3, c).

    over: the water over them, None where they are dry.
    """

    xy: FloatArray
    by_v: FloatArray
    by_point: FloatArray
    rays: Rays
    over: Over | None


def sight(side: Side, X: FloatArray, over: Over | None = None, index: float = 1.0) -> Sight:
    """Return points X (3, c) as a photo shows them: through the water over them, or along straight rays."""
    gap = X - side.station[:, None]
    if over is None:
        xy, by_v = images(side, gap)
        return Sight(xy=xy, by_v=by_v, by_point=by_v, rays=Rays(v=gap), over=None)
    rays = refracted(gap, over, index)
    xy, by_v = images(side, rays.v)
    return Sight(xy=xy, by_v=by_v, by_point=rays.by_point(by_v), rays=rays, over=over)


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """Points as both photos show them: off (4, c) mm, computed minus read, and partials B (4, 3, c) by them."""

    off: FloatArray
    B: FloatArray
    sides: tuple[Sight, Sight]


def look(pair: Pair, xy: FloatArray, X: FloatArray, vertical: Vertical | None = None) -> Look:
    """Return points X (3, c), read at xy (4, c) mm, as both photos show them; below the water with a vertical."""
    water = pair.water
    left, right = (
        sight(side, X, None if vertical is None else water_over(water, side.tide, X, *vertical), water.index)
        for side in pair.sides
    )
    return Look(
        off=np.concatenate([left.xy, right.xy]) - xy,
        B=np.concatenate([left.by_point, right.by_point]),
        sides=(left, right),
    )


def inverse(B: FloatArray, weight: FloatArray) -> FloatArray:
    """Return (B'WB)^-1, (3, 3, c), of rows B (4, 3, c) with weights (4, c), by its Cholesky factor.

    The ridge is that of `ground.point_normals`.
    """
    W = B * weight[:, None]
    N = {(i, j): einsum("rc,rc->c", W[:, i], B[:, j]) for i in range(3) for j in range(i + 1)}
    ridge = RIDGE * np.maximum(np.maximum(N[0, 0], N[1, 1]), N[2, 2])
    a = 1.0 / np.sqrt(N[0, 0] + ridge)
    p, q = N[1, 0] * a, N[2, 0] * a
    d = 1.0 / np.sqrt(N[1, 1] + ridge - p * p)
    s = (N[2, 1] - p * q) * d
    f = 1.0 / np.sqrt(N[2, 2] + ridge - q * q - s * s)
    b, g = -p * a * d, -s * d * f
    c = -(q * a + s * b) * f
    out = np.empty((3, 3, len(a)))
    out[0, 0], out[1, 1], out[2, 2] = a * a + b * b + c * c, d * d + g * g, f * f
    out[1, 0] = out[0, 1] = b * d + c * g
    out[2, 0] = out[0, 2] = c * f
    out[2, 1] = out[1, 2] = g * f
    return out


def step(C: FloatArray, at: Look, weight: FloatArray) -> FloatArray:
    """Return the steps (3, c) of Gauss and Newton, of points with the inverse C of their normals."""
    pull = einsum("ric,rc->ic", at.B, weight * at.off)
    return np.asarray(-einsum("ijc,jc->ic", C, pull))


def size(steps: FloatArray) -> FloatArray:
    """Return the largest components (c,) of steps (3, c)."""
    return np.asarray(np.abs(steps).max(axis=0))


def met(pair: Pair, xy: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return where straight rays of images xy (4, c) meet best; last steps (c,), squared sines of their angles.

    From half-way between them: the second step is below a micrometre unless images are far off.
    """
    left, right = pair.sides
    X, sine2 = half_way(
        left.station[:, None], directions(left, xy[:2]), right.station[:, None], directions(right, xy[2:])
    )
    for _ in range(2):
        at = look(pair, xy, X)
        move = step(inverse(at.B, weight), at, weight)
        X = X + move
    return X, size(move), sine2


def sunk(pair: Pair, xy: FloatArray, weight: FloatArray, X: FloatArray, vertical: Vertical) -> FloatArray:
    """Return where refracted rays meet best, from apparent points X with their vertical: but for one step.

    From half-way between them, as (5.1) to (5.26) of ETL-0306 have it.
    """
    ends = [
        entering(side, pair.water, directions(side, read), X, vertical)
        for side, read in zip(pair.sides, (xy[:2], xy[2:]), strict=True)
    ]
    true, _ = half_way(*ends[0], *ends[1])
    at = look(pair, xy, true, beside(vertical, true - X, pair.water.curvature))
    return true + step(inverse(at.B, weight), at, weight)
