"""Mapped points in a LAS or LAZ file: a file with corrected heights, and what each is worth in extra dimensions.

A point that is not corrected keeps its height, and has 1 as the reason. Needs the package laspy, the extra `las`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.geometry.crs import Plan
from musatpy.pointfiles.las_files import rewrite
from musatpy.sea.interpolation.interpolate import Interpolation
from musatpy.sea.interpolation.mapped_points import Corrected, Progress, Tally, correct

# Extra dimension -> type and what it is, in the 32 characters that a file has for it
_ADDED = {
    "mapped_z": ("f8", "height before the correction, m"),
    "correction": ("f4", "of the height, m"),
    "sigma": ("f4", "of the correction, m"),
    "reason": ("u1", "0 corrected, 1 no control near"),
}


def correct_las(
    source: Path,
    target: Path,
    interpolation: Interpolation,
    *,
    plan: Plan | None = None,
    progress: Progress | None = None,
) -> Tally:
    """Correct the heights of a file; `progress` is told of points.

    Raises `DepthError` without laspy, for a file that is none, has an extra dimension already or cannot hold the
    heights; `OSError`.
    """
    tally = Tally()

    def work(chunks: Iterator[FloatArray]) -> Iterator[Corrected]:
        nonlocal tally
        for mapped in chunks:
            corrected, part = correct(interpolation, mapped, plan)
            tally += part
            yield corrected

    rewrite(source, target, _ADDED, work, _values, "corrected heights", progress)
    return tally


def _values(given: Any, corrected: Corrected) -> Iterator[tuple[str, Any]]:
    """Yield dimensions of given points and what they get."""
    good = np.array([not reason for reason in corrected.reason])
    yield "mapped_z", given.z
    yield "reason", ~good
    yield "correction", np.where(good, corrected.correction, 0.0)
    yield "sigma", np.where(good, corrected.sigma, 0.0)
    yield "z", np.where(good, corrected.z, given.z)
