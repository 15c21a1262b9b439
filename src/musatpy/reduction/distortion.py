"""Lens distortion: radial by an odd polynomial or a calibrated table, and decentring (Conrady).

Distortion is measured minus ideal place, outward positive, about the principal point of best symmetry. With (x,
y) from that point and r^2 = x^2 + y^2:

    radial       d = (x, y) (k0 + k1 r^2 + k2 r^4 + k3 r^6)          Brown 1966; k0 changes the focal length
    balanced     the same with r^2 - R^2, r^4 - R^4, r^6 - R^6       zero at the radius R, another focal length
    table        d = (x, y) D(r) / r, D linear between the calibrated radii and from 0 at r = 0
    decentring   dx = (p1 (r^2 + 2 x^2) + 2 p2 x y) (1 + p3 r^2)     Conrady 1919, Brown 1966
                 dy = (2 p1 x y + p2 (r^2 + 2 y^2)) (1 + p3 r^2)

The side says whose radius that is: `MEASURED`, ideal = measured - d(measured), as polynomials of bundle
adjustments are meant; `IDEAL`, measured = ideal + d(ideal), as certificates are meant that tabulate distortion by
field angle, r = f tan(angle); there the ideal place, which has no closed form, is iterated.

A table is interpolated linearly: that is how such tables are used by hand, it does not overshoot, and between radii
10 mm apart it is within 0.2 um of the smooth curve of a mapping lens. Beyond its last radius the last interval is
continued, and `beyond_table` says so.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property, partial
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.reduction.planar import inverse, invert

PARAMETERS = ("xs", "ys", "k0", "k1", "k2", "k3", "p1", "p2", "p3")


class Side(StrEnum):
    """The place at which the distortion is evaluated."""

    MEASURED = "MEASURED"
    IDEAL = "IDEAL"


@dataclass(frozen=True, kw_only=True, eq=False)
class Lens:
    """The distortion of a lens; what is not given is zero. Millimetres, coefficients by powers of them.

    Raises `ValueError` where the radii of the table are not positive and increasing (a first one of zero, with its
    zero distortion, is allowed).
    """

    centre: FloatArray  # (2,) principal point of best symmetry in the fiducial system
    side: Side
    k: FloatArray = field(default_factory=partial(np.zeros, 4))  # (4,) k0, k1, k2, k3
    zero: float = 0.0  # R, where the polynomial is zero without k0
    p: FloatArray = field(default_factory=partial(np.zeros, 3))  # (3,) p1, p2, p3
    radius: FloatArray = field(default_factory=partial(np.zeros, 0))  # (t,) calibrated radii
    radial: FloatArray = field(default_factory=partial(np.zeros, 0))  # (t,) and their distortion

    def __post_init__(self) -> None:
        radius, radial = np.asarray(self.radius, dtype=float), np.asarray(self.radial, dtype=float)
        if radius.size and radius[0] == 0.0 and radial[0] == 0.0:
            radius, radial = radius[1:], radial[1:]
        if radius.size and not (radius[0] > 0.0 and np.all(np.diff(radius) > 0.0)):
            raise ValueError("the radii of a distortion table must be positive and increase")
        object.__setattr__(self, "radius", radius)
        object.__setattr__(self, "radial", radial)

    def distortion(self, xy: FloatArray) -> FloatArray:
        """Return the distortion d (..., 2) mm at plate coordinates xy (..., 2)."""
        x, y = xy[..., 0] - self.centre[0], xy[..., 1] - self.centre[1]
        q = x * x + y * y
        g = _polynomial(self._k, q) + self._table(q)[0]
        p1, p2, p3 = self._p
        c = 1.0 + p3 * q
        out = np.empty_like(xy)
        out[..., 0] = x * g + (p1 * (q + 2 * x * x) + 2 * p2 * x * y) * c
        out[..., 1] = y * g + (2 * p1 * x * y + p2 * (q + 2 * y * y)) * c
        return out

    def distortion_partials(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (..., 2, 2) of the distortion by xy; at a radius of the table, the outer ones."""
        x, y = xy[..., 0] - self.centre[0], xy[..., 1] - self.centre[1]
        q = x * x + y * y
        table, slope = self._table(q)
        g = _polynomial(self._k, q) + table
        _, k1, k2, k3 = self._k
        dg = 2.0 * (k1 + q * (2.0 * k2 + q * 3.0 * k3) + slope)  # dg/dx = dg x, dg/dy = dg y
        p1, p2, p3 = self._p
        c, ex, ey = 1.0 + p3 * q, p1 * (q + 2 * x * x) + 2 * p2 * x * y, 2 * p1 * x * y + p2 * (q + 2 * y * y)
        mixed = 2 * (p1 * y + p2 * x)  # d ex/dy = d ey/dx
        out = np.empty((*xy.shape, 2), dtype=xy.dtype)
        out[..., 0, 0] = g + dg * x * x + (6 * p1 * x + 2 * p2 * y) * c + ex * 2 * p3 * x
        out[..., 0, 1] = dg * x * y + mixed * c + ex * 2 * p3 * y
        out[..., 1, 0] = dg * x * y + mixed * c + ey * 2 * p3 * x
        out[..., 1, 1] = g + dg * y * y + (2 * p1 * x + 6 * p2 * y) * c + ey * 2 * p3 * y
        return out

    def coefficient_partials(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (..., 2, 5) of the distortion by k1, k2, k3, p1, p2."""
        x, y = xy[..., 0] - self.centre[0], xy[..., 1] - self.centre[1]
        q = x * x + y * y
        c = 1.0 + self._p[2] * q
        zero = self.zero * self.zero
        powers = [q - zero, q * q - zero**2, q * q * q - zero**3]
        of_x = [*(x * power for power in powers), (q + 2 * x * x) * c, 2 * x * y * c]
        of_y = [*(y * power for power in powers), of_x[4], (q + 2 * y * y) * c]
        return np.moveaxis(np.stack([np.stack(of_x), np.stack(of_y)], axis=-1), 0, -1)

    def apply(self, xy: FloatArray) -> FloatArray:
        """Return the ideal places (..., 2) of measured ones."""
        if self.side is Side.MEASURED:
            return xy - self.distortion(xy)
        return invert(lambda at: at + self.distortion(at), lambda at: np.eye(2) + self.distortion_partials(at), xy)

    def partials(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (..., 2, 2) of the ideal places by the measured ones xy."""
        if self.side is Side.MEASURED:
            return np.eye(2) - self.distortion_partials(xy)
        return inverse(np.eye(2) + self.distortion_partials(self.apply(xy)))

    def beyond_table(self, xy: FloatArray) -> BoolArray:
        """Return whether points (..., 2) lie beyond the last radius of the table, if there is one."""
        if not self.radius.size:
            return np.zeros(xy.shape[:-1], dtype=bool)
        return np.linalg.norm(xy - self.centre, axis=-1) > self.radius[-1]

    @cached_property
    def _k(self) -> tuple[float, ...]:
        """Those by plain numbers, of powers of r alone."""
        k0, *k = self.k.tolist()
        return (k0 - self.zero**2 * _polynomial((*k, 0.0), self.zero**2), *k)

    @cached_property
    def _p(self) -> tuple[float, ...]:
        """Those by plain numbers."""
        return tuple(self.p.tolist())

    @cached_property
    def _intervals(self) -> tuple[FloatArray, FloatArray]:
        """Start and slope (t,) of the lines between radii: D = start + slope r, start 0 in the first."""
        knots, values = np.concatenate([[0.0], self.radius]), np.concatenate([[0.0], self.radial])
        slope = np.diff(values) / np.diff(knots)
        return values[:-1] - slope * knots[:-1], slope

    def _table(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return D(r)/r and its derivative by q = r^2."""
        if not self.radius.size:
            return np.zeros_like(q), np.zeros_like(q)
        # the interval of each radius; the last one goes on
        starts, slopes = self._intervals
        i = np.minimum(np.searchsorted(self.radius, np.sqrt(q).real, side="right"), len(starts) - 1)
        start, slope = starts[i], slopes[i]
        r = np.sqrt(np.where(i > 0, q, 1.0))
        return slope + start / r, -0.5 * start / r**3


def _polynomial(k: tuple[float, ...], q: Any) -> Any:
    return k[0] + q * (k[1] + q * (k[2] + q * k[3]))
