"""The lenses of computer vision, both ways: from the direction of a ray to its pixel, and back.

With (x, y) = (X/Z, Y/Z) of a ray, x right, y down, Z forward, and r^2 = x^2 + y^2:

    usual      x' = x g + 2 p1 x y + p2 (r^2 + 2 x^2),  g = (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8)
               y' = y g + p1 (r^2 + 2 y^2) + 2 p2 x y       / (1 + d1 r^2 + d2 r^4 + d3 r^6)
    fisheye    (x', y') = (x, y) t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8) / r,  t = atan r
    pixel      (cx + fx x' + s y', cy + fy y')

That is the model of OpenCV, with its order of p1 and p2, with k4 and the shear s of Metashape (its B2; its B1 is
fx - fy), and the denominator of OpenCV's rational model. Pixels count from the corner of the image, so that the
middle of the first one is (0.5, 0.5).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from musatpy.arrays import FloatArray

_STEPS, _AT_REST = 30, 1e-8  # of the inverse, in units of the focal length: one step more ends at rounding
_PIECE = 8192  # rays at a time, whose arrays stay in fast memory
_Radial = tuple[FloatArray, FloatArray]  # the factor g of rays, and its derivative by r^2


@dataclass(frozen=True, kw_only=True, eq=False)
class PixelLens:
    """The interior orientation of a digital camera, in pixels."""

    width: int
    height: int
    focal: tuple[float, float]  # fx, fy
    centre: tuple[float, float]  # cx, cy from the corner
    shear: float = 0.0
    k: tuple[float, ...] = ()  # up to four
    d: tuple[float, ...] = ()  # up to three, of the denominator
    p: tuple[float, float] = (0.0, 0.0)
    fisheye: bool = False

    @property
    def principal_distance(self) -> float:
        """That of the plane on which rays are ideal images, in pixels."""
        return self.focal[1]

    def steepest(self, pixels: FloatArray) -> float:
        """Return the largest angle (rad) off the axis of pixels (n, 2) of a fisheye lens, beyond 90 degrees too."""
        radius = np.linalg.norm((pixels - self._centre) @ np.linalg.inv(self._A).T, axis=1).max(initial=0.0)
        angle = np.linspace(0.0, np.pi, 2**12)
        image = polynomial.polyval(angle, self._of_angle)
        turn = int(np.argmax(np.append(np.diff(image) <= 0.0, True)))
        return float(np.interp(radius, image[: turn + 1], angle[: turn + 1]))

    def pixels(self, xy: FloatArray) -> FloatArray:
        """Return the pixels (..., 2) of rays (..., 2), as x = X/Z, y = Y/Z."""
        return self._centre + self.distorted(xy) @ self._A.T

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Return the rays (..., 2) of pixels (..., 2); NaN where the lens, within its `reach`, has none.

        By Newton's method from the ray that has no distortion, to 1e-13 focal lengths.
        """
        image = ((pixels - self._centre) @ np.linalg.inv(self._A).T).reshape(-1, 2)
        pieces = [self._undistorted(image[first : first + _PIECE]) for first in range(0, len(image), _PIECE)]
        return np.concatenate(pieces or [image]).reshape(pixels.shape)

    def _undistorted(self, image: FloatArray) -> FloatArray:
        """Return the rays (r, 2) of images (r, 2) on a plane one focal length off."""
        xy = self._first(image)
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            for _ in range(_STEPS):
                radial = self._radial(xy)
                u, v = (image - self.distorted(xy, radial)).T
                (a, b), (c, d) = self.partials(xy, radial).transpose(1, 2, 0)
                step = np.column_stack([d * u - b * v, a * v - c * u]) / (a * d - b * c)[:, None]
                xy = xy + step
                if not np.nanmax(np.abs(step), initial=0.0) > _AT_REST:
                    break
            off = np.abs(self.distorted(xy) - image).max(axis=-1)
            lost = ~(off < 1e-2 * _AT_REST) | (np.linalg.norm(xy, axis=-1) > self.reach)
        return np.where(lost[..., None], np.nan, xy)

    def distorted(self, xy: FloatArray, radial: _Radial | None = None) -> FloatArray:
        """Return the images (..., 2) of rays (..., 2) on a plane one focal length off."""
        out = xy * (radial or self._radial(xy))[0][..., None]
        if any(self.p) and not self.fisheye:
            (x, y), (p1, p2) = np.moveaxis(xy, -1, 0), self.p
            q = x * x + y * y
            out[..., 0] += 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x)
            out[..., 1] += p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y
        return out

    def partials(self, xy: FloatArray, radial: _Radial | None = None) -> FloatArray:
        """Return the partials (..., 2, 2) of `distorted`."""
        g, slope = radial or self._radial(xy)
        x, y = np.moveaxis(xy, -1, 0)
        p1, p2 = (0.0, 0.0) if self.fisheye else self.p
        mixed = 2.0 * slope * x * y + 2.0 * (p1 * x + p2 * y)
        rows = [
            [g + 2.0 * slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x, mixed],
            [mixed, g + 2.0 * slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x],
        ]
        return np.moveaxis(np.array(rows), (0, 1), (-2, -1))

    @cached_property
    def reach(self) -> float:
        """The largest tangent r to which images move outward as rays do; infinite where they always do."""
        if self.fisheye:
            turns = polynomial.polyder(self._of_angle)
            real = _positive(turns)
            return float(np.tan(min(real, default=np.pi / 2))) if min(real, default=np.pi) < np.pi / 2 else np.inf
        up, down = np.array([1.0, *self.k]), np.array([1.0, *self.d])
        # of r U(q)/D(q): U D + 2 q (U' D - U D') = 0
        slope = polynomial.polysub(
            polynomial.polymul(polynomial.polyder(up), down), polynomial.polymul(up, polynomial.polyder(down))
        )
        turn = polynomial.polyadd(polynomial.polymul(up, down), polynomial.polymulx(2.0 * slope))
        return float(np.sqrt(min([*_positive(turn), *_positive(down)], default=np.inf)))

    @cached_property
    def _A(self) -> FloatArray:
        return np.array([[self.focal[0], self.shear], [0.0, self.focal[1]]])

    @cached_property
    def _centre(self) -> FloatArray:
        return np.array(self.centre)

    @cached_property
    def _of_angle(self) -> FloatArray:
        """The polynomial of the angle: t + k1 t^3 + ..."""
        out = np.zeros(2 * len(self.k) + 2)
        out[1], out[3::2] = 1.0, self.k
        return out

    def _radial(self, xy: FloatArray) -> _Radial:
        """Return the factor g (...) of rays (..., 2), and its derivative by r^2."""
        q = np.sum(xy * xy, axis=-1)
        if not self.fisheye:
            U, dU = _polynomial(q, self.k)
            D, dD = _polynomial(q, self.d)
            return (U / D, (dU * D - U * dD) / (D * D)) if self.d else (U, dU)
        r = np.sqrt(q)
        t = np.arctan(r)
        at, slope = polynomial.polyval(t, self._of_angle), polynomial.polyval(t, polynomial.polyder(self._of_angle))
        small = r < 1e-4  # g = 1 + (k1 - 1/3) q there, to rounding
        safe = np.where(small, 1.0, r)
        k1 = self.k[0] if self.k else 0.0
        g = np.where(small, 1.0 + (k1 - 1.0 / 3.0) * q, at / safe)
        return g, np.where(small, k1 - 1.0 / 3.0, (slope / (1.0 + q) - at / safe) / (2.0 * safe * safe))

    def _first(self, image: FloatArray) -> FloatArray:
        """Return first rays (..., 2) of images (..., 2) one focal length off."""
        if not self.fisheye:
            return image
        r = np.linalg.norm(image, axis=-1, keepdims=True)
        return image * np.where(r > 0.0, np.tan(np.minimum(r, 1.5)) / np.where(r > 0.0, r, 1.0), 1.0)


def _polynomial(q: FloatArray, k: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Return 1 + k1 q + k2 q^2 + ... and its derivative."""
    at, slope = np.zeros_like(q), np.zeros_like(q)
    for coefficient in (*k[::-1], 1.0):
        slope = slope * q + at
        at = at * q + coefficient
    return at, slope


@dataclass(frozen=True, kw_only=True, eq=False)
class CorrectedLens(PixelLens):
    """A lens whose rays are images of another one, on a plane one focal length off: `correction`, of no format."""

    correction: PixelLens

    @property
    def principal_distance(self) -> float:
        """That of the plane on which rays are ideal images, in pixels."""
        return self.focal[1] * self.correction.focal[1]

    def pixels(self, xy: FloatArray) -> FloatArray:
        """Return the pixels (..., 2) of rays (..., 2)."""
        return super().pixels(self.correction.pixels(xy))

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Return the rays (..., 2) of pixels (..., 2); NaN where there is none."""
        return self.correction.rays(super().rays(pixels))


def _positive(coefficients: NDArray[np.floating]) -> list[float]:
    """Return the positive real roots of a polynomial, its lowest power first."""
    roots = polynomial.polyroots(np.trim_zeros(coefficients, "b")) if np.any(coefficients[1:]) else np.zeros(0)
    real = np.abs(roots.imag) < 1e-9 * np.maximum(1.0, np.abs(roots))
    return sorted(root for root in roots.real[real].tolist() if root > 0.0)
