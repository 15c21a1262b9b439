"""LAS and LAZ files (ASPRS, LAS 1.4 R15): read by chunks, and written again with other coordinates and dimensions.

Of one that is written again all else is kept: header, coordinate system, records behind the points, dimensions.
Needs the package laspy, the extra `las`.
"""

from __future__ import annotations

import os
import struct
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from musatpy import extras
from musatpy.arrays import FloatArray, IntArray
from musatpy.errors import InterchangeError, MissingPackageError
from musatpy.files import whole_file

SUFFIXES = (".las", ".laz")
CHUNK = 16384  # points at a time
_OCTREE = "copc"  # user of the records of cloud-optimised files: where the points were
_SYSTEM = "LASF_Projection"  # user of those of coordinate systems
# The length of a record before the points, and behind them
_RECORD, _RECORD_BEHIND = struct.Struct("<20xH32x"), struct.Struct("<20xQ32x")
_COMPRESSED = 0xC0  # bits of the point format
_DENSEST = 10_000  # compressed points in a byte: more than any are alike


@contextmanager
def opened(source: Path) -> Iterator[Any]:
    """Open a file for reading by a reader of laspy; whatever its bytes upset in packages ends as a problem.

    Raises `InterchangeError` without laspy and for a file that is none; `OSError`.
    """
    laspy = package()
    with source.open("rb") as file:
        with upsets(source, "is no LAS file"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what laspy puts right by itself
            _require_room(file)
            reader = laspy.open(file, closefd=False)
            if not np.isfinite(reader.header.offsets).all() or not (np.abs(reader.header.scales) < np.inf).all():
                raise ValueError("its scales or offsets are no numbers")
        with reader:
            yield reader


def chunks(reader: Any, source: Path) -> Iterator[Any]:
    """Yield the points of an open file, `CHUNK` at a time. Raises `InterchangeError` where it ends before them."""
    left = int(reader.header.point_count)
    while left:
        with upsets(source, "its points cannot be read"):
            points = reader.read_points(min(CHUNK, left))
        if not len(points):
            raise _unusable(source, f"the file ends {left} points before its end")
        left -= len(points)
        yield points


def coordinates(points: Any) -> FloatArray:
    """Return the coordinates (n, 3) of points."""
    return np.column_stack([points.x, points.y, points.z])


def classes(points: Any) -> IntArray:
    """Return the classes (n,) of points."""
    return np.array(points.classification, dtype=np.int64)


def point_count(source: Path) -> int:
    """Return the number of points of a file. Raises as `opened`."""
    with opened(source) as reader:
        return int(reader.header.point_count)


def crs_definition(source: Path) -> str:
    """Return the coordinate system that a file states, as WKT, '' where it states none. Raises as `opened`."""
    with opened(source) as reader, upsets(source, "its coordinate system cannot be read; --crs says it"):
        crs = reader.header.parse_crs()
        return "" if crs is None else str(crs.to_wkt())


@contextmanager
def rewritten(
    source: Path, target: Path, added: Mapping[str, tuple[str, str]], crs: Any = None
) -> Iterator[tuple[Iterator[Any], Callable[[Any, Mapping[str, Any]], None]]]:
    """Give the points of a file by chunks, and what writes them into `target` with other values by their names.

    These are x, y, z and the dimensions `added`: name -> type, description (32 characters). A `crs` of pyproj
    stands instead of what the file states; before LAS 1.4 one without a code cannot, then the target states none.
    Raises `InterchangeError` without laspy, for a file that is none, has such a dimension already or cannot hold
    the coordinates; `OSError`. Then there is no target.
    """
    laspy = package()
    with opened(source) as reader, whole_file(target) as file:
        header = _extended(reader.header, added, source)
        if crs is not None:
            with suppress(RuntimeError):
                header.add_crs(crs)
        with written(file, header, target) as writer:

            def write(given: Any, values: Mapping[str, Any]) -> None:
                with upsets(source, "cannot have more dimensions"):
                    points = laspy.ScaleAwarePointRecord.zeros(len(given), header=header)
                    for name in given.array.dtype.names:
                        points.array[name] = given.array[name]
                    with upsets(source, "the coordinates do not fit its scale and offset"):
                        for name, value in values.items():
                            setattr(points, name, value)
                    writer.write_points(points)

            yield chunks(reader, source), write
            if reader.evlrs:
                left = (_OCTREE,) if crs is None else (_OCTREE, _SYSTEM)
                kept = [record for record in reader.evlrs if record.user_id not in left]
                writer.write_evlrs(laspy.vlrs.vlrlist.VLRList(kept))


def written(file: BinaryIO, header: Any, target: Path) -> Any:
    """Return a writer of laspy into an open file that is to be `target`, compressed where its name says so.

    Raises `InterchangeError`.
    """
    with upsets(target, "cannot be written with this header"):  # which a compressor may not know
        compress = target.suffix.lower() == SUFFIXES[1]
        how = {"do_compress": compress, "closefd": False, "encoding_errors": "ignore"}  # names as they are
        return package().open(file, mode="w", header=header, **how)


def _extended(given: Any, added: Mapping[str, tuple[str, str]], source: Path) -> Any:
    """Return a header with more dimensions than a given one, none of which is there already."""
    if existing := {*given.point_format.dimension_names} & added.keys():
        raise _unusable(source, f"there is a dimension {', '.join(sorted(existing))} already")
    extra = package().ExtraBytesParams
    with upsets(source, "cannot have more dimensions"):  # beside those without a size
        header = given.copy()
        header.vlrs = [record for record in header.vlrs if record.user_id != _OCTREE]
        header.add_extra_dims([extra(name=name, type=kind, description=of) for name, (kind, of) in added.items()])
    return header


def _require_room(file: BinaryIO) -> None:
    """Raise `ValueError` where a header counts more than fits into its file: laspy believes it, and goes on."""
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    header = file.read(375).ljust(375, b"\0")  # of LAS 1.4
    header_size, points, records, form, length, count = struct.unpack_from("<HIIBHI", header, 94)
    _require(points <= size, "its header", size)
    _require_records(file, header_size, records, _RECORD, points, "records before its points")
    if header[25] >= 4:
        place, behind, count = struct.unpack_from("<QIQ", header, 235)
        _require_records(file, place * (behind > 0), behind, _RECORD_BEHIND, size, "records behind its points")
    if form & _COMPRESSED:
        _require_chunks(file, points, size, count)
    else:
        _require(points + count * length <= size, f"{count} points of {length} bytes", size)
    file.seek(0)


def _require_records(file: BinaryIO, place: int, count: int, head: struct.Struct, end: int, what: str) -> None:
    """Raise `ValueError` where so many records from a place on do not end before another."""
    for _ in range(count):
        _require(place + head.size <= end, f"{count} {what}", end)
        file.seek(place)
        place += head.size + head.unpack(file.read(head.size))[0]
    _require(place <= end, what, end)


def _require_chunks(file: BinaryIO, points: int, size: int, count: int) -> None:
    """Raise `ValueError` where the table of the chunks of compressed points would not fit into a file."""
    file.seek(points)
    (table,) = struct.unpack("<q", file.read(8).ljust(8, b"\0"))
    if table == -1:  # it was not known yet when they were written
        file.seek(-8, os.SEEK_END)
        (table,) = struct.unpack("<q", file.read(8))
    _require(points <= table <= size - 8, "the table of its chunks", size)
    file.seek(table + 4)
    (number,) = struct.unpack("<I", file.read(4))
    _require(number <= size and count <= size * _DENSEST, f"{count} points in {number} chunks", size)


def _require(fits: bool, what: str, size: int) -> None:
    if not fits:
        raise ValueError(f"{what} would not fit into {size} bytes")


@contextmanager
def upsets(path: Path, what: str) -> Iterator[None]:
    """Turn what packages raise over a file, errors of no common kind, into an `InterchangeError`.

    Errors of the system (`OSError` with its number) stay. Raises `MissingPackageError` without what compresses.
    """
    try:
        yield
    except Exception as error:
        if isinstance(error, InterchangeError) or (isinstance(error, OSError) and error.errno is not None):
            raise
        if "LazBackend" in str(error):
            raise MissingPackageError("LAZ files need", "lazrs", "las") from error
        raise _unusable(path, f"{what}: {error}") from error


def _unusable(path: Path, message: str) -> InterchangeError:
    return InterchangeError.of(message, file=path)


package = partial(extras.package, "las", "laspy", "LAS files need")
