"""Apparent points in a LAS or LAZ file: a file with the true points, and what each is worth in extra dimensions.

A point that is not corrected keeps its coordinates, and has the number of the reason (`Fault`). Needs the package
laspy, the extra `las`.
"""

from __future__ import annotations

from functools import partial
from itertools import tee
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.depth.correction import NO_POINTS, Correction, CorrectionTally, Progress, in_order
from musatpy.depth.misplaced_points import attempted, require_sight
from musatpy.errors import DepthError, Problem
from musatpy.pointfiles.las_files import coordinates, rewritten
from musatpy.refraction.apparent import Fault, TruePoints
from musatpy.units import DEGREE

_WORD = 64  # cameras of one dimension of bits

# Extra dimension -> type and what it is, in the 32 characters that a file has for it
_ADDED = {
    "apparent_x": ("f8", "before the correction"),
    "apparent_y": ("f8", "before the correction"),
    "apparent_z": ("f8", "height before the correction, m"),
    "depth": ("f4", "below the mean tide, m"),
    "factor": ("f4", "depth / apparent depth"),
    "cameras": ("u2", "how many see the point"),
    "spread": ("f4", "of the depths of each camera, m"),
    "incidence": ("f4", "mean angle in air, degrees"),
    "largest_incidence": ("f4", "largest angle in air, degrees"),
    "reason": ("u1", "0 corrected, else why not"),
}
_SIGMAS = {
    "sigma_east": ("f4", "of the true place, m"),
    "sigma_north": ("f4", "of the true place, m"),
    "sigma_height": ("f4", "of the true place, m"),
    "sigma_depth": ("f4", "m"),
}


_Corrected = tuple[TruePoints, Any]  # n points, and the cameras that see them as bits (n, words) uint64


def correct_las(
    source: Path, target: Path, correction: Correction, *, jobs: int = 1, progress: Progress | None = None
) -> CorrectionTally:
    """Correct the points of a file; `progress` is told of points.

    Raises `InterchangeError` without laspy, for a file that is none or that cannot hold the true points,
    `DepthError` for points that their system does not reach, and where no camera sees any; `OSError`.
    """
    count = -(-len(correction.cameras.names) // _WORD)
    bits = {f"camera_bits_{word}": ("u8", "which see it, in their order") for word in range(count)}
    tally, some = NO_POINTS, np.empty((0, 3))
    sigmas = {} if correction.errors is None else _SIGMAS
    with rewritten(source, target, _ADDED | sigmas | bits) as (chunks, write):
        given, waiting = tee(chunks)  # these stay in this process
        work = in_order(partial(_correct_points, correction, count, str(source)), map(coordinates, waiting), jobs)
        for points, done in zip(given, work, strict=True):
            if isinstance(done, Problem):
                raise DepthError([done])
            tally, some = tally + CorrectionTally.of(done[0]), coordinates(points) if not tally.seen else some
            values = _values(points, *done)
            if sigmas:
                values |= zip(sigmas, (*done[0].sigma.T, done[0].depth_sigma), strict=True)
            write(points, values)
            if progress:
                progress(len(points))
        require_sight(correction, tally, source, some)
    return tally


def _correct_points(correction: Correction, count: int, source: str, apparent: FloatArray) -> _Corrected | Problem:
    """Return what comes of some points; a function of the module, because other processes call it."""
    done = attempted(correction, source, apparent)
    if isinstance(done, Problem):
        return done
    points, seen = done
    full = np.zeros((len(seen), count * _WORD), dtype=bool)
    full[:, : seen.shape[1]] = seen
    return points, np.packbits(full, axis=1, bitorder="little").view("<u8")


def _values(given: Any, points: TruePoints, bits: Any) -> dict[str, Any]:
    """Return coordinates and dimensions of given points."""
    good = points.fault == Fault.NONE
    return {
        **{f"apparent_{name}": given[name] for name in "xyz"},
        **{name: np.where(good, points.position[:, axis], given[name]) for axis, name in enumerate("xyz")},
        "depth": points.depth,
        "factor": points.factor,
        "cameras": points.cameras,
        "spread": points.spread,
        "incidence": points.incidence / DEGREE,
        "largest_incidence": points.largest_incidence / DEGREE,
        "reason": points.fault,
        **{f"camera_bits_{word}": bits[:, word] for word in range(bits.shape[1])},
    }
