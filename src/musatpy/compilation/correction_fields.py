"""The correction of a model as polynomials, for millions of points: what it does is smooth in place and height.

Within the ground that both photos show, below the water and above it, a correction is fitted at Chebyshev nodes and
held against itself at other places; where it is not reproduced there it is not used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from musatpy.arrays import FloatArray
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
_BLOCK = 1024  # points at a time: their polynomials stay in the cache
_MOVED, _SIGMA, _DEPTHS, _IMAGES = slice(0, 5), slice(5, 8), slice(8, 10), slice(10, 14)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Field:
    """Polynomials of 14 quantities in a box: shifts x, y, z, east, north; sigmas; depth, its sigma; four images."""

    low: FloatArray  # (3,)
    high: FloatArray
    coefficients: FloatArray  # (i, j, k, q)

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
        field = cls(low=low, high=high, coefficients=C)
        return field if field._reproduces(correction) else None

    def _reproduces(self, correction: Correction) -> bool:
        unit = np.random.default_rng(1).uniform(-1.0, 1.0, (_CHECKED, 3))
        places = _placed(unit, self.low, self.high)
        true, values = _quantities(correction, places), self.at(places)
        off = np.abs(values - true)
        frame, corners = correction.stereo.run.frame, np.stack([self.low, self.high])
        across = np.linalg.norm(np.diff(frame.from_level(correction.system.level(corners)), axis=0))
        units = (self.high - self.low)[:2] / across  # of the system, at most, in a metre
        limit = _CLOSE * np.array([*units, 1.0, 1.0, 1.0])
        same = (off[:, _MOVED] <= limit).all() and (off[:, _SIGMA] <= _ALIKE * true[:, _SIGMA]).all()
        wet = np.isfinite(true[:, _DEPTHS]).all()
        deep = not wet or ((off[:, 8] <= _CLOSE).all() and (off[:, 9] <= _ALIKE * true[:, 9]).all())
        return bool(same and deep and (off[:, _IMAGES] <= _SHARP).all())

    def at(self, places: FloatArray) -> FloatArray:
        """Return the quantities (k, 14) at places (k, 3)."""
        unit = (2.0 * places - (self.low + self.high)) / (self.high - self.low)
        flat = self.coefficients.reshape(-1, self.coefficients.shape[-1])
        out = np.empty((len(places), flat.shape[1]))
        for first in range(0, len(places), _BLOCK):
            part = unit[first : first + _BLOCK]
            x, y, z = (chebyshev.chebvander(part[:, axis], degree) for axis, degree in enumerate(_DEGREES))
            yz = (y[:, :, None] * z[:, None]).reshape(len(part), -1)
            out[first : first + _BLOCK] = (x[:, :, None] * yz[:, None]).reshape(len(part), -1) @ flat
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
                done.put(rows, self._by_field(field, apparent[rows]))
        done.put(near, self.correction(apparent[near]))
        return done

    def _by_field(self, field: _Field, apparent: FloatArray) -> Corrected:
        values, done = field.at(apparent), Corrected.nothing(len(apparent))
        images = values[:, _IMAGES].reshape(-1, 2, 2)
        off = np.flatnonzero(off_plate(self.correction.stereo, images).any(axis=1))
        done.xyz[:] = apparent + values[:, :3]
        done.moved[:], done.sigma[:] = values[:, 3:5], values[:, _SIGMA]
        done.depth[:], done.depth_sigma[:] = values[:, 8], values[:, 9]
        done.put(off, Corrected.nothing(len(off), REASONS.index(OFF_PLATE)))
        return done


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


def _placed(unit: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return places (k, 3) of coordinates (k, 3) from -1 to 1 in a box."""
    return np.asarray(0.5 * ((high - low) * unit + low + high))


def _quantities(correction: Correction, places: FloatArray) -> FloatArray:
    """Return the quantities (k, 14) of a field at places (k, 3), whatever the format of the plates."""
    done = correction(places, any_format=True)
    images = correction.images(places).reshape(-1, 4)
    depths = np.stack([done.depth, done.depth_sigma], axis=1)
    return np.concatenate([done.xyz - places, done.moved, done.sigma, depths, images], axis=1)
