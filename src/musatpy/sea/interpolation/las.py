"""Mapped points in a LAS or LAZ file: a file with corrected heights, and what each is worth in extra dimensions.

A point that is not corrected keeps its height, and has 1 as the reason. Needs the package laspy, the extra `las`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from musatpy.files import whole_file
from musatpy.geometry.plan import Plan
from musatpy.pointfiles.las_files import (
    chunks,
    copied,
    extended_header,
    opened,
    opened_for_writing,
    unusable,
    write_last_records,
)
from musatpy.sea.interpolation.interpolate import Interpolation
from musatpy.sea.interpolation.points import CHUNK, Corrected, Progress, Tally, correct

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
    found: Interpolation,
    *,
    plan: Plan | None = None,
    progress: Progress | None = None,
) -> Tally:
    """Correct the heights of a file; `progress` is told of points.

    Raises `DepthError` without laspy, for a file that is none, has an extra dimension already or cannot hold the
    heights; `OSError`.
    """
    tally = Tally()
    with opened(source) as reader, whole_file(target) as file:
        header = extended_header(reader.header, _ADDED, source)
        with opened_for_writing(file, header, target) as writer:
            for given in chunks(reader, CHUNK, source):
                mapped = np.column_stack([np.asarray(given[name]) for name in ("x", "y", "z")])
                corrected, part = correct(found, mapped, plan)
                try:
                    writer.write_points(_completed(header, given, corrected))
                except OverflowError as error:
                    raise unusable(source, "corrected heights do not fit its scale and offset") from error
                tally += part
                if progress:
                    progress(len(mapped))
            write_last_records(reader, writer)
    return tally


def _completed(header: Any, given: Any, corrected: Corrected) -> Any:
    """Return given points as those of the new file."""
    good = np.array([not reason for reason in corrected.reason])
    record = copied(header, given)
    record["mapped_z"], record["reason"] = given.z, ~good
    record["correction"] = np.where(good, corrected.correction, 0.0)
    record["sigma"] = np.where(good, corrected.sigma, 0.0)
    record.z = np.where(good, corrected.z, given.z)
    return record
