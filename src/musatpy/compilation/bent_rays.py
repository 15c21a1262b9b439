"""The refracted ray to a point and its image, component by component.

Components are numbers of one point, or arrays (c,) of many: the loop follows one mark by plain numbers, which cost
a tenth of what arrays of one element do. The equations are those of `refraction.flat` and `geometry.collinearity`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

from musatpy.arrays import FloatArray
from musatpy.refraction.flat import tangent_of_equals

Value = TypeVar("Value", float, FloatArray)
Vector = tuple[Value, Value, Value]
Image = tuple[tuple[Value, Value], tuple[Vector[Value], Vector[Value]]]  # and its partials
Numbers = tuple[float, float, float]
Matrix = tuple[Numbers, Numbers, Numbers]


@dataclass(frozen=True, kw_only=True, eq=False)
class Bent(Generic[Value]):
    """A refracted ray: `pair_images.Rays` by components; excess: kappa - ratio; tilt: -Q_h.

    t and under: tangents of its angles in air and in water.
    """

    v: Vector[Value]
    e: Vector[Value]
    u: Vector[Value]
    kappa: Value
    ratio: Value
    excess: Value
    t: Value
    under: Value
    tilt: Value

    def by_point(self, w: Vector[Value]) -> Vector[Value]:
        """Return the partials by the point of what has the partials w by v: `Rays.by_point`."""
        (x, y, z), (ex, ey, ez), (ux, uy, uz) = w, self.e, self.u
        along, up = x * ex + y * ey + z * ez, x * ux + y * uy + z * uz
        ratio = self.ratio
        a, b = self.excess * along, self.tilt * along - ratio * up
        return ratio * x + a * ex + b * ux, ratio * y + a * ey + b * uy, ratio * z + a * ez + b * uz


def matrix(M: FloatArray) -> Matrix:
    """Return a matrix (3, 3) by plain numbers."""
    (a, b, c), (d, e, f), (p, q, r) = M.tolist()
    return (a, b, c), (d, e, f), (p, q, r)


def turned_by(M: Matrix, v: Vector[Value]) -> Vector[Value]:
    """Return M v."""
    (a, b, c), (d, e, f), (p, q, r) = M
    x, y, z = v
    return a * x + b * y + c * z, d * x + e * y + f * z, p * x + q * y + r * z


def bent(gap: Vector[Value], up: Vector[Value], depth: Value, index: float) -> Bent[Value]:
    """Return the ray to a point `gap` from the station, `depth` below the water with the normal `up`.

    `flat.incidence`, with the partials of its `Q` by what they are made of.
    """
    (x, y, z), (ux, uy, uz), h, n = gap, up, depth, index
    fall = -(x * ux + y * uy + z * uz)
    ex, ey, ez = x + ux * fall, y + uy * fall, z + uz * fall
    D = (ex * ex + ey * ey + ez * ez) ** 0.5
    one = 1.0 / (D + (D == 0.0))  # 0 at the nadir
    ex, ey, ez = ex * one, ey * one, ez * one
    H = fall - h
    t = tangent_of_equals(H, h, D, n)
    g2 = 1.0 / (n * n + (n * n - 1.0) * (t * t))
    g = g2**0.5
    # `flat` has cos^3 I and cos^3 theta here: cos I = n g cos theta
    kappa, ratio, Q = H / (H + (n * n) * h * (g2 * g)), H / (H + h * g), H * t
    return Bent(
        v=(ex * Q - ux * H, ey * Q - uy * H, ez * Q - uz * H), e=(ex, ey, ez), u=up,
        kappa=kappa, ratio=ratio, excess=kappa - ratio, t=t, under=t * g, tilt=t * g * kappa,
    )  # fmt: skip


def pictured(M: tuple[Numbers, Numbers, Numbers], focal_length: float, v: Vector[Value]) -> Image[Value]:
    """Return the image, from the principal point, of a vector in a photo M, and its partials by the vector.

    `collinearity.image_by_vector`.
    """
    (a, b, c), (d, e, f), (p, q, r) = M
    along, across, away = turned_by(M, v)
    scale = -focal_length / away
    right, up = scale * along, scale * across
    by = scale / focal_length
    k, m = right * by, up * by
    partials = (scale * a + k * p, scale * b + k * q, scale * c + k * r), (
        scale * d + m * p, scale * e + m * q, scale * f + m * r
    )  # fmt: skip
    return (right, up), partials
