"""Apparent points in a LAS or LAZ file: a file with the true points, and what each is worth in extra dimensions.

A point that is not corrected keeps its coordinates, and has the number of the reason (`Fault`). Needs the package
laspy, the extra `las`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.depth.correction import NO_POINTS, Correction, Progress, Tally, in_order, unreached
from musatpy.errors import DepthError, Problem, SystemsError
from musatpy.pointfiles.las_files import rewrite
from musatpy.refraction.apparent import Fault, TruePoints
from musatpy.units import DEGREE

_WORD = 64  # cameras of one dimension of bits

# Extra dimension -> type and what it is, in the 32 characters that a file has for it
_ADDED = {
    "apparent_z": ("f8", "height before the correction, m"),
    "depth": ("f4", "below the mean tide, m"),
    "factor": ("f4", "depth / apparent depth"),
    "cameras": ("u2", "how many see the point"),
    "spread": ("f4", "of the depths of each camera, m"),
    "incidence": ("f4", "mean angle in air, degrees"),
    "largest_incidence": ("f4", "largest angle in air, degrees"),
    "reason": ("u1", "0 corrected, else why not"),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class _Corrected:
    """What came of some points."""

    points: TruePoints
    bits: Any  # (n, words) uint64


def correct_las(
    source: Path, target: Path, correction: Correction, *, jobs: int = 1, progress: Progress | None = None
) -> Tally:
    """Correct the points of a file; `progress` is told of points.

    Raises `DepthError` without laspy, for a file that is none or that cannot hold the true points, for points that
    their system does not reach, and where no camera sees any; `OSError`.
    """
    count = -(-len(correction.cameras.names) // _WORD)
    bits = {f"camera_bits_{word}": ("u8", "which see it, in their order") for word in range(count)}
    tally = NO_POINTS

    def work(chunks: Iterator[FloatArray]) -> Iterator[_Corrected]:
        nonlocal tally
        for done in in_order(partial(_correct_points, correction, count, str(source)), chunks, jobs):
            if isinstance(done, Problem):
                raise DepthError([done])
            tally = tally + Tally.of(done.points)
            yield done
        correction.require_sight(tally, source)

    rewrite(source, target, _ADDED | bits, work, _values, "true points", progress)
    return tally


def _correct_points(correction: Correction, count: int, source: str, apparent: FloatArray) -> _Corrected | Problem:
    """Return what comes of some points; a function of the module, because other processes call it."""
    try:
        points, seen = correction(apparent)
    except SystemsError as error:
        return unreached(source, error)
    full = np.zeros((len(seen), count * _WORD), dtype=bool)
    full[:, : seen.shape[1]] = seen
    bits = np.packbits(full, axis=1, bitorder="little").view("<u8")
    return _Corrected(points=points, bits=bits)


def _values(given: Any, done: _Corrected) -> Iterator[tuple[str, Any]]:
    """Yield coordinates and dimensions of given points and what they get."""
    points = done.points
    good = points.fault == Fault.NONE
    yield "apparent_z", given.z
    for axis, name in enumerate("xyz"):
        yield name, np.where(good, points.position[:, axis], given[name])
    yield "depth", points.depth
    yield "factor", points.factor
    yield "cameras", points.cameras
    yield "spread", points.spread
    yield "incidence", points.incidence / DEGREE
    yield "largest_incidence", points.largest_incidence / DEGREE
    yield "reason", points.fault
    for word in range(done.bits.shape[1]):
        yield f"camera_bits_{word}", done.bits[:, word]
