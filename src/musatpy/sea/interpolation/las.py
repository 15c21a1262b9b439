"""Mapped points in a LAS or LAZ file: a file with corrected heights, and what each is worth in extra dimensions.

A point that is not corrected keeps its height, and has 1 as the reason. Needs the package laspy, the extra `las`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from musatpy.geometry.crs import Plan
from musatpy.pointfiles.las_files import coordinates, rewritten
from musatpy.sea.interpolation.interpolate import Interpolation
from musatpy.sea.interpolation.mapped_points import Progress, Tally, correct

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

    Raises `InterchangeError` without laspy, for a file that is none, has an extra dimension already or cannot hold
    the heights; `OSError`.
    """
    tally = Tally()
    with rewritten(source, target, _ADDED) as (chunks, write):
        for given in chunks:
            corrected, part = correct(interpolation, coordinates(given), plan)
            good = np.array([not reason for reason in corrected.reason])
            values = {
                "mapped_z": given.z,
                "reason": ~good,
                "correction": np.where(good, corrected.correction, 0.0),
                "sigma": np.where(good, corrected.sigma, 0.0),
                "z": np.where(good, corrected.z, given.z),
            }
            write(given, values)
            tally += part
            if progress:
                progress(len(given))
    return tally
