"""The correction of a model as polynomials, for millions of points: what it does is smooth in place and height.

Within the ground that both photos show, below the water and above it, a correction is fitted at Chebyshev nodes and
held against itself at other places; where it is not reproduced there it is not used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from musatpy.arrays import FloatArray, IntArray
from musatpy.compilation.compiled import OFF_PLATE
from musatpy.compilation.correcting import REASONS, Corrected, Correction
from musatpy.compilation.stereomodels import off_plate
from musatpy.geometry.systems import Geocentric

_DEGREES = (12, 12, 3)
_CHECKED = 300  # places at which a field is held against the correction
_CLOSE = 1e-4  # m, of positions and depths
_ALIKE = 1e-3  # of sigmas, relative
_SHARP = 1e-4  # mm, of images
_BESIDE = 0.02  # of the extent of the ground, added to each side
_BLOCK = 512  # points at a time: their polynomials stay in the cache
_FADED = 1e-2  # of what a field is held to: terms below are left out
_MOVED, _SIGMA, _DEPTHS, _IMAGES = slice(0, 5), slice(5, 8), slice(8, 10), slice(10, 14)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Field:
    """Polynomials of 14 quantities in a box: shifts x, y, z, east, north; sigmas; depth, its sigma; four images.

    A term is the product of Chebyshev polynomials of the `plan` (p, 2) and of the `height` (t,), by their degrees;
    t terms have the coefficients (t, 14), and each its row of the plan, `place` (t,).
    """

    low: FloatArray  # (3,)
    high: FloatArray
    plan: IntArray
    place: IntArray
    height: IntArray
    coefficients: FloatArray

    @classmethod
    def of(cls, correction: Correction, low: FloatArray, high: FloatArray) -> _Field | None:
        """Return the polynomials of a correction between two corners, None where they do not reproduce it."""
        nodes = [chebyshev.chebpts1(degree + 1) for degree in _DEGREES]
        unit = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1)
        values = _quantities(correction, _placed(unit.reshape(-1, 3), low, high))
        if not np.isfinite(values[:, _MOVED]).all():
            return None
        C = values.reshape(*unit.shape[:3], -1)
        for axis, (node, degree) in enumerate(zip(nodes, _DEGREES, strict=True)):
            solve = np.linalg.inv(chebyshev.chebvander(node, degree))
            C = np.moveaxis(np.tensordot(solve, C, axes=(1, axis)), 0, axis)
        limits = _limits(correction, low, high, values)
        degrees = np.argwhere((np.abs(C) > _FADED * limits.min(axis=0)).any(axis=3))
        plan, place = np.unique(degrees[:, :2], axis=0, return_inverse=True)
        field = cls(
            low=low,
            high=high,
            plan=plan,
            place=place.reshape(-1),
            height=degrees[:, 2],
            coefficients=C[tuple(degrees.T)],
        )
        return field if field._reproduces(correction) else None

    def _reproduces(self, correction: Correction) -> bool:
        unit = np.random.default_rng(1).uniform(-1.0, 1.0, (_CHECKED, 3))
        places = _placed(unit, self.low, self.high)
        true = _quantities(correction, places)
        kept = np.abs(self.at(places) - true) <= _limits(correction, self.low, self.high, true)
        if np.isnan(true[:, _DEPTHS]).all():  # dry
            kept[:, _DEPTHS] = True
        return bool(kept.all())

    def at(self, places: FloatArray) -> FloatArray:
        """Return the quantities (k, 14) at places (k, 3)."""
        unit = (2.0 * places - (self.low + self.high)) / (self.high - self.low)
        out = np.empty((len(places), self.coefficients.shape[1]))
        for first in range(0, len(places), _BLOCK):
            part = unit[first : first + _BLOCK]
            x, y, z = (chebyshev.chebvander(part[:, axis], degree).T for axis, degree in enumerate(_DEGREES))
            terms = (x[self.plan[:, 0]] * y[self.plan[:, 1]])[self.place] * z[self.height]
            out[first : first + _BLOCK] = terms.T @ self.coefficients
        return out


@dataclass(frozen=True, kw_only=True, eq=False)
class SmoothCorrection:
    """A correction of which polynomials stand for the ground of the model, wet and dry where there are any."""

    correction: Correction
    low: FloatArray  # (2,) corners of the ground that both photos can show
    high: FloatArray
    tides: tuple[float, float]  # m, the lower and the higher
    wet: _Field | None
    dry: _Field | None

    def __call__(self, apparent: FloatArray) -> Corrected:
        """Return the true points of apparent ones (k, 3)."""
        done = Corrected.nothing(len(apparent), REASONS.index(OFF_PLATE))
        near = np.flatnonzero(((apparent[:, :2] >= self.low) & (apparent[:, :2] <= self.high)).all(axis=1))
        height = apparent[near, 2]
        for field, below in ((self.wet, True), (self.dry, False)):
            if field is not None:
                side = height < self.tides[0] if below else height > self.tides[1]
                within = side & (height >= field.low[2]) & (height <= field.high[2])
                rows, near, height = near[within], near[~within], height[~within]
                if len(rows) == len(apparent):
                    return self._by_field(field, apparent)
                done.put(rows, self._by_field(field, apparent[rows]))
        done.put(near, self.correction(apparent[near]))
        return done

    def _by_field(self, field: _Field, apparent: FloatArray) -> Corrected:
        values = field.at(apparent)
        off = off_plate(self.correction.stereo, values[:, _IMAGES].reshape(-1, 2, 2)).any(axis=1)
        values[off] = np.nan
        return Corrected(
            xyz=apparent + values[:, :3],
            sigma=values[:, _SIGMA],
            depth=values[:, 8],
            depth_sigma=values[:, 9],
            moved=values[:, 3:5],
            reason=np.where(off, REASONS.index(OFF_PLATE), 0).astype(np.int8),
        )


def smooth(correction: Correction, heights: tuple[float, float]) -> SmoothCorrection | None:
    """Return a correction by polynomials for points between two heights (m), None where there is none.

    Heights of the points must be those over the ellipsoid, and the water level, without waves.
    """
    stereo, system = correction.stereo, correction.system
    water, tides = stereo.run.block.water, stereo.tides
    if water is None or not np.isfinite(tides).all() or water.tilt_east or water.tilt_north:
        return None
    if stereo.run.sea is not None:
        return None
    if isinstance(system, Geocentric) or system.geoid is not None:
        return None
    low, high = _ground(correction, heights)
    if (high <= low).any():
        return None
    lower, higher = float(tides.min()), float(tides.max())
    wet = dry = None
    if heights[0] < lower - _CLOSE:
        wet = _Field.of(correction, np.append(low, heights[0]), np.append(high, min(heights[1], lower)))
    if heights[1] > higher + _CLOSE:
        dry = _Field.of(correction, np.append(low, max(heights[0], higher)), np.append(high, heights[1]))
    if wet is None and dry is None:
        return None
    return SmoothCorrection(correction=correction, low=low, high=high, tides=(lower, higher), wet=wet, dry=dry)


def _ground(correction: Correction, heights: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return corners (2,) of the ground that both photos can show at these heights, in the system of the points."""
    stereo, frame = correction.stereo, correction.stereo.run.frame
    half = 0.5 * stereo.camera("format_size")
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    rays = stereo.rays(signs[:, None] * half)  # (4, 2, 3)
    ground = float(frame.height(stereo.origin[None])[0])
    lows, highs = [], []
    for photo in range(2):
        places = []
        for height in heights:
            reach = (height - ground - stereo.stations[photo, 2]) / rays[:, photo, 2]
            places.append(stereo.stations[photo] + reach[:, None] * rays[:, photo])
        plane = correction.system.coordinates(frame.level(stereo.working(np.concatenate(places))))[:, :2]
        beside = _BESIDE * np.ptp(plane, axis=0)
        lows.append(plane.min(axis=0) - beside)
        highs.append(plane.max(axis=0) + beside)
    return np.maximum(*lows), np.minimum(*highs)


def _limits(correction: Correction, low: FloatArray, high: FloatArray, values: FloatArray) -> FloatArray:
    """Return by how much quantities (k, 14) may be missed: those of places between two corners."""
    frame = correction.stereo.run.frame
    working = frame.from_level(correction.system.level(np.stack([low, high])))
    units = (high - low)[:2] / np.linalg.norm(working[1] - working[0])  # of the system, at most, in a metre
    limits = np.full(values.shape, _CLOSE)
    limits[:, :2] *= units
    limits[:, _SIGMA], limits[:, 9] = _ALIKE * values[:, _SIGMA], _ALIKE * values[:, 9]
    limits[:, _IMAGES] = _SHARP
    return limits


def _placed(unit: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return places (k, 3) of coordinates (k, 3) from -1 to 1 in a box."""
    return np.asarray(0.5 * ((high - low) * unit + low + high))


def _quantities(correction: Correction, places: FloatArray) -> FloatArray:
    """Return the quantities (k, 14) of a field at places (k, 3), whatever the format of the plates."""
    done = correction(places, any_format=True)
    images = correction.images(places).reshape(-1, 4)
    depths = np.stack([done.depth, done.depth_sigma], axis=1)
    return np.concatenate([done.xyz - places, done.moved, done.sigma, depths, images], axis=1)
