"""LAS and LAZ files: written again with other coordinates and more dimensions, or read and written as columns.

Of one that is written again all else is kept: header, coordinate system, records behind the points, dimensions.
Needs the package laspy, the extra `las`.
"""

from __future__ import annotations

import datetime
import io
import uuid
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import DepthError, Problem
from musatpy.files import whole_file
from musatpy.pointfiles.las_headers import Headed, checked_head, name_all

SUFFIXES = (".las", ".laz")
CHUNK = 16384  # points at a time
_AXES = ("x", "y", "z")
_OCTREE = "copc"  # user of the records of cloud-optimised files
_EXTENDED = (1, 4)  # version from which a file has records behind its points
_NEW = {"version": "1.4", "point_format": 6}  # the plainest form that says its system as WKT
_FIRST_DAY = datetime.date(2011, 11, 14)  # of LAS 1.4; equal points make equal files
Done = TypeVar("Done")


@contextmanager
def opened(source: Path) -> Iterator[Any]:
    """Open a file for reading; whatever its bytes upset in the packages that read it ends as a problem.

    Raises `DepthError` without laspy and for a file that is none; `OSError`.
    """
    laspy = _laspy()
    with source.open("rb") as file:
        try:
            head = checked_head(file)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of what laspy puts right by itself
                reader = laspy.open(io.BufferedReader(Headed(file, head)), closefd=False)
        except Exception as error:  # of several packages, and of no common kind
            raise _unusable(source, f"is no LAS file: {error}") from error
        name_all(reader.header)
        with reader:
            yield reader


def point_count(source: Path) -> int:
    """Return the number of points of a file. Raises as `opened`."""
    with opened(source) as reader:
        return int(reader.header.point_count)


def crs_definition(source: Path) -> str:
    """Return the coordinate system that a file states, as WKT, '' where it states none. Raises as `opened`."""
    with opened(source) as reader:
        try:
            crs = reader.header.parse_crs()
        except Exception as error:  # of pyproj, and of whatever its texts upset in laspy
            raise _unusable(source, f"its coordinate system cannot be read: {error}; --crs says it") from error
    return "" if crs is None else str(crs.to_wkt())


def rewrite(
    source: Path,
    target: Path,
    added: Mapping[str, tuple[str, str]],
    work: Callable[[Iterator[FloatArray]], Iterator[Done]],
    values: Callable[[Any, Done], Iterable[tuple[str, Any]]],
    what: str,
    progress: Callable[[int], None] | None = None,
    kept: Callable[[Done], BoolArray] | None = None,
) -> None:
    """Write a file anew, its points with other coordinates and the dimensions `added`: name -> type, description.

    `work` yields what comes of coordinates (n, 3), chunk by chunk in their order; `kept` tells which (n,) of the
    points stay, all without it; `values` names coordinates and dimensions of these and what they get by it.
    `progress` is told of points. Raises `DepthError` without laspy, for a file that is none, has such a dimension
    already or cannot hold the coordinates (`what` they are); `OSError`.
    """
    with opened(source) as reader, whole_file(target) as file:
        header = _extended_header(reader.header, added, source)
        with _opened_for_writing(file, header, target) as writer:
            records: deque[Any] = deque()  # those at work: they stay in this process

            def coordinates() -> Iterator[FloatArray]:
                for record in _chunks(reader, CHUNK, source):
                    records.append(record)
                    yield np.column_stack([np.asarray(record[name]) for name in _AXES])

            for done in work(coordinates()):
                read = records.popleft()
                given = read if kept is None else read[kept(done)]
                record = _copied(header, given)
                try:
                    for name, value in values(given, done):
                        if name in _AXES:
                            setattr(record, name, value)
                        else:
                            record[name] = value
                    writer.write_points(record)
                except OverflowError as error:
                    raise _unusable(source, f"{what} do not fit its scale and offset") from error
                if progress:
                    progress(len(read))
            _write_last_records(reader, writer)


Table = tuple[FloatArray, dict[str, tuple[Any, str]]]  # coordinates (n, 3); column -> values (n,) and description


def read_chunks(source: Path, size: int) -> Iterator[Table]:
    """Yield the coordinates of so many points at a time and their extra dimensions of one number.

    Raises as `opened`.
    """
    with opened(source) as reader:
        extra = [d for d in reader.header.point_format.extra_dimensions if d.num_elements == 1]
        for record in _chunks(reader, size, source):
            columns = {d.name: (np.array(record[d.name]), d.description) for d in extra}
            yield np.column_stack([np.asarray(record[name]) for name in _AXES]), columns


def write_chunks(
    target: Path,
    chunks: Iterable[Table],
    scales: tuple[float, float, float],
    crs: Any = None,
    records: Mapping[str, bytes] | None = None,
) -> None:
    """Write a new file of chunks of points with the same columns, coordinates to their `scales`.

    `crs`: of pyproj; `records`: further ones before the points, by their users. The same points give the same
    bytes. Raises `DepthError` without laspy, and for what a file cannot hold; `OSError`.
    """
    rest = iter(chunks)
    first = next(rest)
    with _refused(target, "cannot hold the points"):
        header = _new_header(first, scales, crs, records or {})
    with whole_file(target) as file, _opened_for_writing(file, header, target) as writer:
        for coordinates, columns in chain([first], rest):
            with _refused(target, "cannot hold the points"):
                record = _new_points(header, coordinates, columns)
            writer.write_points(record)


def _new_header(table: Table, scales: tuple[float, float, float], crs: Any, records: Mapping[str, bytes]) -> Any:
    """Return the header of a file that begins with some points."""
    laspy, (coordinates, columns) = _laspy(), table
    header = laspy.LasHeader(**_NEW)
    header.creation_date, header.uuid = _FIRST_DAY, uuid.UUID(int=0)
    header.system_identifier, header.generating_software = "OTHER", "musatpy"
    header.scales = np.array(scales)
    header.offsets = np.floor(coordinates.min(axis=0)) if len(coordinates) else np.zeros(3)
    kinds = {name: np.asarray(values).dtype.str[1:] for name, (values, _) in columns.items()}
    header.add_extra_dims(
        [laspy.ExtraBytesParams(name=name, type=kinds[name], description=columns[name][1]) for name in columns]
    )
    if crs is not None:
        header.add_crs(crs)
    header.vlrs.extend(laspy.VLR(user, 1, record_data=data) for user, data in records.items())
    return header


def _new_points(header: Any, coordinates: FloatArray, columns: Mapping[str, tuple[Any, str]]) -> Any:
    """Return points in the form of a header."""
    points = _laspy().ScaleAwarePointRecord.zeros(len(coordinates), header=header)
    for name, values in zip(_AXES, coordinates.T, strict=True):
        setattr(points, name, values)
    for name, (values, _) in columns.items():
        points[name] = values
    for name in ("return_number", "number_of_returns"):
        points[name] = np.ones(len(coordinates), dtype=np.uint8)
    return points


@contextmanager
def _refused(path: Path, what: str) -> Iterator[None]:
    """Turn what laspy raises over names, kinds and coordinates, of no common kind, into a `DepthError`."""
    try:
        yield
    except DepthError:
        raise
    except Exception as error:
        raise _unusable(path, f"{what}: {error}") from error


def record_of(source: Path, user: str) -> bytes:
    """Return the first record of a user before the points of a file, empty for none. Raises as `opened`."""
    with opened(source) as reader:
        records = [record.record_data_bytes() for record in reader.header.vlrs if record.user_id == user]
    return records[0] if records else b""


def _opened_for_writing(file: BinaryIO, header: Any, target: Path) -> Any:
    """Return a writer into an open file that is to be `target`, compressed where its name says so.

    Raises `DepthError`.
    """
    compress = target.suffix.lower() == SUFFIXES[1]
    laspy = _laspy()
    try:
        return laspy.open(file, mode="w", header=header, do_compress=compress, closefd=False)
    except Exception as error:  # a compressor that the header upsets
        raise _unusable(target, f"cannot be written with the header of its source: {error}") from error


def _chunks(reader: Any, size: int, source: Path) -> Iterator[Any]:
    """Yield the points of a file, so many at a time. Raises `DepthError` where it ends too soon."""
    left = int(reader.header.point_count)
    while left:
        try:
            record = reader.read_points(min(size, left))
        except Exception as error:  # of several packages, and of no common kind
            raise _unusable(source, f"its points cannot be read: {error}") from error
        if not len(record):
            raise _unusable(source, f"the file ends {left} points before its end")
        left -= len(record)
        yield record


def _extended_header(given: Any, added: Mapping[str, tuple[str, str]], source: Path) -> Any:
    """Return a header like a given one with more dimensions: name -> type and description.

    Raises `DepthError` where one of them is there already.
    """
    laspy = _laspy()
    existing = set(given.point_format.dimension_names) & set(added)
    if existing:
        raise _unusable(source, f"there is a dimension {', '.join(sorted(existing))} already")
    more = [laspy.ExtraBytesParams(name=name, type=kind, description=text) for name, (kind, text) in added.items()]
    try:
        header = given.copy()
        # the octree of a cloud-optimised file is that of the points where they were
        header.vlrs = [vlr for vlr in header.vlrs if vlr.user_id != _OCTREE]
        header.add_extra_dims(more)
    except Exception as error:  # of dimensions without a size, and of no common kind
        raise _unusable(source, f"cannot have more dimensions: {error}") from error
    return header


def _copied(header: Any, given: Any) -> Any:
    """Return a record of given points with room for the dimensions that a header has besides."""
    record = _laspy().ScaleAwarePointRecord.zeros(len(given), header=header)
    for name in given.array.dtype.names:
        record.array[name] = given.array[name]
    return record


def _write_last_records(reader: Any, writer: Any) -> None:
    """Write the records behind the points, among which that of the coordinate system may be."""
    version = reader.header.version
    if (version.major, version.minor) >= _EXTENDED and reader.evlrs:
        kept = [record for record in reader.evlrs if record.user_id != _OCTREE]
        writer.write_evlrs(_laspy().vlrs.vlrlist.VLRList(kept))


def _unusable(source: Path, message: str) -> DepthError:
    """Return the error of a file that cannot be used."""
    return DepthError([Problem(file=str(source), message=message)])


def _laspy() -> Any:
    try:
        import laspy
    except ImportError as error:
        message = "LAS files need the package laspy: pip install 'musatpy[las]'"
        raise DepthError([Problem(message=message)]) from error
    return laspy
