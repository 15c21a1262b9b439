"""What a plane costs when the sea is wavy: the experiment of Okamoto (1982) for any stereo pair and any surface.

Points on the bottom are imaged through the wavy surface, as it is at each exposure, and intersected again from
their images as if the water were level. The attitudes of the photos do not matter: they turn an image ray into
plate coordinates and back. Model axes: x along the flight, y across it, z up, m.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.refraction import bending, fermat
from musatpy.refraction.surface import Plane, Surface

_PART = 4096  # points at a time: what a pair of rays needs on the way would fill the memory for a million


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment:
    """A stereo pair over waves: cameras (2, 3) and points (m, 3) m, times (2,) s of the exposures, index of water.

    `level` (m) is that of the plane which mapping takes for the water.
    """

    cameras: FloatArray
    times: FloatArray
    points: FloatArray
    index: float
    surface: Surface
    level: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Errors (m, 3) m of points (m, 3), mapped minus true; y-parallax (m,) m, right ray minus left.

    number (m, 2): refraction points of the ray to each photo, of which the principal one counts; complete (m, 2):
    whether these are all (see `refraction.search`).
    """

    points: FloatArray
    error: FloatArray
    parallax: FloatArray
    number: IntArray
    complete: BoolArray


def run(experiment: Experiment) -> Errors:
    """Return the errors of mapping through waves as if the water were level.

    Raises `ValueError` where a point is not under water, a camera not above it, or the surface not known.
    """
    for time in experiment.times:
        dry = experiment.surface.relief(experiment.points[:, :2], time).height <= experiment.points[:, 2]
        if dry.any():
            raise ValueError(f"point {int(np.argmax(dry)) + 1} stands above the water in a trough")
    parts = [_part(experiment, start) for start in range(0, len(experiment.points), _PART)]
    return Errors(
        **{field.name: np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Errors)}
    )


def _part(experiment: Experiment, start: int) -> Errors:
    points, cameras = experiment.points[start : start + _PART], experiment.cameras[:, None, :]
    rays = fermat.incidence(experiment.surface, cameras, points, experiment.index, experiment.times[:, None])
    air = rays.v / np.linalg.norm(rays.v, axis=-1, keepdims=True)
    bent = bending.refracted_ray(Plane(level=experiment.level), cameras, air, experiment.index)
    mapped, parallax = intersect(bent.origin, bent.direction)
    return Errors(
        points=points,
        error=mapped - points,
        parallax=parallax,
        number=rays.number.T,
        complete=rays.complete.T,
    )


def intersect(origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points (m, 3) where two rays (2, m, 3) have no x-parallax, and the y-parallax (m,) left there.

    Okamoto (1982), eq. 36; y is the mean of both rays. Raises `ValueError` where the rays never are so: a base
    across the flight.
    """
    slope = direction / direction[..., 2:]
    at_zero = origin - slope * origin[..., 2:]  # where the rays are at z = 0
    denominator = slope[0, :, 0] - slope[1, :, 0]
    if (np.abs(denominator) < 1e-9).any():
        raise ValueError("the base has no component along x, the flight: x-parallax gives no height")
    Z = (at_zero[1, :, 0] - at_zero[0, :, 0]) / denominator
    left, right = at_zero + slope * Z[:, None]
    return np.stack([left[:, 0], (left[:, 1] + right[:, 1]) / 2.0, Z], axis=1), right[:, 1] - left[:, 1]


@dataclass(frozen=True, kw_only=True, eq=False)
class Spread:
    """Of each coordinate (3,): the signed error that is largest, its point (row), mean, and standard error.

    The standard error is the root of the mean square, as in the paper, not about the mean.
    """

    largest: FloatArray
    point: IntArray
    mean: FloatArray
    sigma: FloatArray


def spread(error: FloatArray) -> Spread:
    """Return how errors (m, 3) are spread."""
    row = np.argmax(np.abs(error), axis=0)
    return Spread(
        largest=error[row, np.arange(3)],
        point=row,
        mean=error.mean(axis=0),
        sigma=np.sqrt(np.mean(np.square(error), axis=0)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Histogram:
    """How many errors (3, bins) of each coordinate lie between edges (3, bins + 1) m, symmetrical about zero."""

    edges: FloatArray
    count: IntArray


def histogram(error: FloatArray, bins: int = 21) -> Histogram:
    """Return the histograms of errors (m, 3), each up to its largest; an odd number of bins has one about zero."""
    reach = np.maximum(np.abs(error).max(axis=0), 1e-12)  # no errors at all still need a width
    edges = np.linspace(-reach, reach, bins + 1, axis=1)
    count = [np.histogram(error[:, axis], edges[axis])[0] for axis in range(3)]
    return Histogram(edges=edges, count=np.array(count))


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdict:
    """The accuracy asked of a map, (3,) m, and whether the standard errors due to waves keep within it."""

    allowed: FloatArray
    kept: BoolArray


def verdict(sigma: FloatArray, flying_height: float, plan: float = 10000.0, height: float = 5000.0) -> Verdict:
    """Return the verdict on standard errors (3,) m from a flying height (m) above the bottom.

    Allowed are 1/`plan` of it in x and y, 1/`height` in z: Okamoto (1982), below Table 6.
    """
    allowed = flying_height / np.array([plan, plan, height])
    return Verdict(allowed=allowed, kept=sigma < allowed)
