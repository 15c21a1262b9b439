"""Mapped points in a LAS or LAZ file: a file with corrected heights, and what each is worth in extra dimensions.

A point that is not corrected keeps its height, and has 1 as the reason. Needs the package laspy, the extra `las`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from musatpy.collocation.interpolation import Interpolation
from musatpy.collocation.points import CHUNK, Progress, Tally, correct
from musatpy.depth.las_points import SUFFIXES, copied, extended_header, load_laspy
from musatpy.errors import CollocationError, Problem
from musatpy.files import whole_file

# Extra dimension -> type and what it is, in the 32 characters that a file has for it
_ADDED = {
    "mapped_z": ("f8", "height before the correction, m"),
    "correction": ("f4", "of the height, m"),
    "sigma": ("f4", "of the correction, m"),
    "reason": ("u1", "0 corrected, 1 no control near"),
}


def correct_las(source: Path, target: Path, found: Interpolation, *, progress: Progress | None = None) -> Tally:
    """Correct the heights of a file; `progress` is told of points.

    Raises `DepthError` without laspy or where an extra dimension is there already, `CollocationError` for a file
    that is none or that cannot hold the heights; `OSError`.
    """
    laspy = load_laspy()
    tally = Tally()
    try:
        with laspy.open(source) as reader, whole_file(target) as file:
            header = extended_header(laspy, reader.header, _ADDED, source)
            compress = target.suffix.lower() == SUFFIXES[1]
            with laspy.open(file, mode="w", header=header, do_compress=compress, closefd=False) as writer:
                for given in reader.chunk_iterator(CHUNK):
                    mapped = np.column_stack([np.asarray(given[name]) for name in ("x", "y", "z")])
                    corrected, part = correct(found, mapped)
                    good = np.array([not reason for reason in corrected.reason])
                    record = copied(laspy, header, given)
                    record["mapped_z"], record["reason"] = mapped[:, 2], ~good
                    record["correction"] = np.where(good, corrected.correction, 0.0)
                    record["sigma"] = np.where(good, corrected.sigma, 0.0)
                    record.z = np.where(good, corrected.z, mapped[:, 2])
                    writer.write_points(record)
                    tally += part
                    if progress:
                        progress(len(mapped))
    except (laspy.LaspyException, OverflowError) as error:
        raise CollocationError([Problem(file=str(source), message=f"cannot be corrected: {error}")]) from error
    return tally
