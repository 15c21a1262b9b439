"""Apparent points in a LAS or LAZ file: a file with the true points, and what each is worth in extra dimensions.

A point that is not corrected keeps its coordinates, and has the number of the reason (`Fault`). Needs the package
laspy, the extra `las`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
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
_OCTREE = "copc"  # user of the records of cloud-optimised files
_EXTENDED = (1, 4)  # version from which a file has records behind its points

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
    laspy = _laspy()
    words = -(-len(correction.cameras.names) // _WORD)
    tally = NO_POINTS
    with _opened(laspy, source) as reader, whole_file(target) as file:
        header = _header(laspy, reader.header, words, source)
        compress = target.suffix.lower() == SUFFIXES[1]
        with laspy.open(file, mode="w", header=header, do_compress=compress, closefd=False) as writer:
            records: deque[Any] = deque()  # those that are being corrected: they stay in this process
            tasks = _tasks(_chunks(reader, source), records)
            for done in in_order(partial(_correct_points, correction, words), tasks, jobs):
                try:
                    writer.write_points(_completed(laspy, header, records.popleft(), done))
                except OverflowError as error:
                    raise _unusable(source, "true points do not fit its scale and offset") from error
                tally = tally + Tally.of(done.points)
                if progress:
                    progress(len(done.points.fault))
            _write_last_records(laspy, reader, writer)
    return tally


@contextmanager
def _opened(laspy: Any, source: Path) -> Iterator[Any]:
    """Open a file for reading; whatever its bytes upset in the packages that read it ends as a problem."""
    with source.open("rb") as file:
        try:
            reader = laspy.open(file, closefd=False)
        except Exception as error:  # of several packages, and of no common kind
            raise _unusable(source, f"is no LAS file: {error}") from error
        with reader:
            yield reader


def _chunks(reader: Any, source: Path) -> Iterator[Any]:
    """Yield the points of a file in chunks; one that ends too soon is a problem."""
    left = int(reader.header.point_count)
    while left:
        try:
            record = reader.read_points(min(CHUNK, left))
        except Exception as error:  # of several packages, and of no common kind
            raise _unusable(source, f"its points cannot be read: {error}") from error
        if not len(record):
            raise _unusable(source, f"the file ends {left} points before its end")
        left -= len(record)
        yield record


def _write_last_records(laspy: Any, reader: Any, writer: Any) -> None:
    """Write the records behind the points, among which that of the coordinate system may be."""
    version = reader.header.version
    if (version.major, version.minor) >= _EXTENDED and reader.evlrs:
        writer.write_evlrs(laspy.vlrs.vlrlist.VLRList([one for one in reader.evlrs if one.user_id != _OCTREE]))


def _unusable(source: Path, message: str) -> DepthError:
    return DepthError([Problem(file=str(source), message=message)])


def point_count(source: Path) -> int:
    """Return the number of points of a file. Raises as `correct_las`."""
    with _opened(_laspy(), source) as reader:
        return int(reader.header.point_count)


def _laspy() -> Any:
    try:
        import laspy
    except ImportError as error:
        message = "LAS files need the package laspy: pip install 'musatpy[las]'"
        raise DepthError([Problem(message=message)]) from error
    return laspy


def _header(laspy: Any, given: Any, words: int, source: Path) -> Any:
    """Return the header of the file with true points: the given one, with more dimensions."""
    added = _ADDED | {f"camera_bits_{word}": ("u8", "which see it, in their order") for word in range(words)}
    there = set(given.point_format.dimension_names) & set(added)
    if there:
        message = f"there is a dimension {', '.join(sorted(there))} already"
        raise _unusable(source, message)
    header = given.copy()
    # the octree of a cloud-optimised file is that of the points where they were
    header.vlrs = [vlr for vlr in header.vlrs if vlr.user_id != _OCTREE]
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
    record = laspy.ScaleAwarePointRecord.zeros(len(given), header=header)
    for name in given.array.dtype.names:
        record.array[name] = given.array[name]
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
