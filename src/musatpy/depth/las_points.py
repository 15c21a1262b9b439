"""Apparent points in a LAS or LAZ file: a file with the true points, and what each is worth in extra dimensions.

A point that is not corrected keeps its coordinates, and has the number of the reason (`Fault`). Needs the package
laspy, the extra `las`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.depth.correction import CHUNK, NO_POINTS, Correction, Progress, Tally, in_order
from musatpy.errors import DepthError, Problem
from musatpy.files import whole_file
from musatpy.refraction.apparent import Fault, TruePoints
from musatpy.units import DEGREE

FloatArray = NDArray[np.float64]

SUFFIXES = (".las", ".laz")
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

    Raises `DepthError` without laspy, for a file that is none or that cannot hold the true points; `OSError`.
    """
    laspy = load_laspy()
    words = -(-len(correction.cameras.names) // _WORD)
    tally = NO_POINTS
    try:
        with laspy.open(source) as reader, whole_file(target) as file:
            bits = {f"camera_bits_{word}": ("u8", "which see it, in their order") for word in range(words)}
            header = extended_header(laspy, reader.header, _ADDED | bits, source)
            compress = target.suffix.lower() == SUFFIXES[1]
            with laspy.open(file, mode="w", header=header, do_compress=compress, closefd=False) as writer:
                records: deque[Any] = deque()  # those that are being corrected: they stay in this process
                tasks = _tasks(reader.chunk_iterator(CHUNK), records)
                for done in in_order(partial(_correct_points, correction, words), tasks, jobs):
                    writer.write_points(_completed(laspy, header, records.popleft(), done))
                    tally = tally + Tally.of(done.points)
                    if progress:
                        progress(len(done.points.fault))
    except (laspy.LaspyException, OverflowError) as error:
        raise DepthError([Problem(file=str(source), message=f"cannot be corrected: {error}")]) from error
    return tally


def point_count(source: Path) -> int:
    """Return the number of points of a file. Raises as `correct_las`."""
    laspy = load_laspy()
    try:
        with laspy.open(source) as reader:
            return int(reader.header.point_count)
    except laspy.LaspyException as error:
        raise DepthError([Problem(file=str(source), message=f"is no LAS file: {error}")]) from error


def load_laspy() -> Any:
    """Return the package laspy. Raises `DepthError` where it is missing."""
    try:
        import laspy
    except ImportError as error:
        message = "LAS files need the package laspy: pip install 'musatpy[las]'"
        raise DepthError([Problem(message=message)]) from error
    return laspy


def extended_header(laspy: Any, given: Any, added: Mapping[str, tuple[str, str]], source: Path) -> Any:
    """Return a header like a given one with more dimensions: name -> type and description.

    Raises `DepthError` where one of them is there already.
    """
    there = set(given.point_format.dimension_names) & set(added)
    if there:
        message = f"there is a dimension {', '.join(sorted(there))} already"
        raise DepthError([Problem(file=str(source), message=message)])
    header = given.__class__(version=given.version, point_format=laspy.PointFormat(given.point_format.id))
    header.scales, header.offsets, header.global_encoding = given.scales, given.offsets, given.global_encoding
    header.vlrs.extend(vlr for vlr in given.vlrs if vlr.user_id != "LASF_Spec" or vlr.record_id != 4)
    header.add_extra_dims(
        [
            laspy.ExtraBytesParams(name=one.name, type=one.dtype, description=one.description)
            for one in given.point_format.extra_dimensions
        ]
    )
    header.add_extra_dims(
        [laspy.ExtraBytesParams(name=name, type=kind, description=text) for name, (kind, text) in added.items()]
    )
    return header


def _tasks(chunks: Iterable[Any], records: deque[Any]) -> Iterator[FloatArray]:
    """Yield the coordinates (n, 3) of chunks, and put these where they can be taken from."""
    for record in chunks:
        records.append(record)
        yield np.column_stack([np.asarray(record[name]) for name in ("x", "y", "z")])


def _correct_points(correction: Correction, words: int, apparent: FloatArray) -> _Corrected:
    """Return what comes of some points; a function of the module, because other processes call it."""
    points, seen = correction(apparent)
    full = np.zeros((len(seen), words * _WORD), dtype=bool)
    full[:, : seen.shape[1]] = seen
    bits = np.packbits(full, axis=1, bitorder="little").view("<u8")
    return _Corrected(points=points, bits=bits)


def _completed(laspy: Any, header: Any, given: Any, done: _Corrected) -> Any:
    """Return given points as those of the new file."""
    points = done.points
    record = copied(laspy, header, given)
    good = points.fault == Fault.NONE
    record["apparent_z"] = given.z
    for axis, name in enumerate("xyz"):
        setattr(record, name, np.where(good, points.position[:, axis], given[name]))
    for name, values in _values(points):
        record[name] = values
    for word in range(done.bits.shape[1]):
        record[f"camera_bits_{word}"] = done.bits[:, word]
    return record


def copied(laspy: Any, header: Any, given: Any) -> Any:
    """Return a record of given points with room for the dimensions that a header has besides."""
    record = laspy.ScaleAwarePointRecord.zeros(len(given), header=header)
    for name in given.array.dtype.names:
        record.array[name] = given.array[name]
    return record


def _values(points: TruePoints) -> Iterator[tuple[str, Any]]:
    yield "depth", points.depth
    yield "factor", points.factor
    yield "cameras", points.cameras
    yield "spread", points.spread
    yield "incidence", points.incidence / DEGREE
    yield "largest_incidence", points.largest_incidence / DEGREE
    yield "reason", points.fault
