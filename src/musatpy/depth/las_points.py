"""Apparent points in a LAS or LAZ file: a file with the true points, and what each is worth in extra dimensions.

A point that is not corrected keeps its coordinates, and has the number of the reason (`Fault`). Needs the package
laspy, the extra `las`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.depth.correction import CHUNK, NO_POINTS, Correction, Progress, Tally, in_order, unreached
from musatpy.errors import DepthError, Problem, SystemsError
from musatpy.files import whole_file
from musatpy.pointfiles.las_files import (
    chunks,
    copied,
    extended_header,
    opened,
    opened_for_writing,
    unusable,
    write_last_records,
)
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
    words = -(-len(correction.cameras.names) // _WORD)
    tally = NO_POINTS
    with opened(source) as reader, whole_file(target) as file:
        bits = {f"camera_bits_{word}": ("u8", "which see it, in their order") for word in range(words)}
        header = extended_header(reader.header, _ADDED | bits, source)
        with opened_for_writing(file, header, target) as writer:
            records: deque[Any] = deque()  # those that are being corrected: they stay in this process
            tasks = _tasks(chunks(reader, CHUNK, source), records)
            work = partial(_correct_points, correction, words, str(source))
            for done in in_order(work, tasks, jobs):
                if isinstance(done, Problem):
                    raise DepthError([done])
                try:
                    writer.write_points(_completed(header, records.popleft(), done))
                except OverflowError as error:
                    raise unusable(source, "true points do not fit its scale and offset") from error
                tally = tally + Tally.of(done.points)
                if progress:
                    progress(len(done.points.fault))
            write_last_records(reader, writer)
        correction.require_sight(tally, source)
    return tally


def _tasks(chunks: Iterable[Any], records: deque[Any]) -> Iterator[FloatArray]:
    """Yield the coordinates (n, 3) of chunks, and put these where they can be taken from."""
    for record in chunks:
        records.append(record)
        yield np.column_stack([np.asarray(record[name]) for name in ("x", "y", "z")])


def _correct_points(correction: Correction, words: int, source: str, apparent: FloatArray) -> _Corrected | Problem:
    """Return what comes of some points; a function of the module, because other processes call it."""
    try:
        points, seen = correction(apparent)
    except SystemsError as error:
        return unreached(source, error)
    full = np.zeros((len(seen), words * _WORD), dtype=bool)
    full[:, : seen.shape[1]] = seen
    bits = np.packbits(full, axis=1, bitorder="little").view("<u8")
    return _Corrected(points=points, bits=bits)


def _completed(header: Any, given: Any, done: _Corrected) -> Any:
    """Return given points as those of the new file."""
    points = done.points
    record = copied(header, given)
    good = points.fault == Fault.NONE
    record["apparent_z"] = given.z
    for axis, name in enumerate("xyz"):
        setattr(record, name, np.where(good, points.position[:, axis], given[name]))
    for name, values in _values(points):
        record[name] = values
    for word in range(done.bits.shape[1]):
        record[f"camera_bits_{word}"] = done.bits[:, word]
    return record


def _values(points: TruePoints) -> Iterator[tuple[str, Any]]:
    yield "depth", points.depth
    yield "factor", points.factor
    yield "cameras", points.cameras
    yield "spread", points.spread
    yield "incidence", points.incidence / DEGREE
    yield "largest_incidence", points.largest_incidence / DEGREE
    yield "reason", points.fault
