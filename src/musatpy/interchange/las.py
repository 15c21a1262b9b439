"""LAS and LAZ files (ASPRS, LAS 1.4 R15): points, their columns as extra bytes with the unit as description.

Needs the package laspy, the extra `las`. Files of any size come and go in chunks.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path

import pyproj

from musatpy.errors import DepthError, InterchangeError
from musatpy.interchange.layers import Column, Points, joined, placed
from musatpy.interchange.packages import refuse, require_content
from musatpy.pointfiles.las_files import Table, crs_definition, record_of
from musatpy.pointfiles.las_files import read_chunks as read_tables
from musatpy.pointfiles.las_files import write_chunks as write_tables

CHUNK = 65536  # points at a time

_RECORD = "musatpy"  # user of the record with the words for heights
_SCALE, _DEGREE_SCALE = 1e-4, 1e-9  # 0.1 mm


def write(path: Path, points: Points) -> None:
    """Write points to 0.1 mm, compressed in a `.laz` file.

    Raises `InterchangeError` without laspy, for columns of texts and for what a file cannot hold; `OSError`.
    """
    write_chunks(path, [points])


def write_chunks(path: Path, chunks: Iterable[Points]) -> None:
    """Write points that come in chunks, one or more, of the same columns, as `write` does."""
    rest = iter(chunks)
    first = next(rest)
    plan = _DEGREE_SCALE if first.crs is not None and first.crs.is_geographic else _SCALE
    records = {_RECORD: first.heights.encode()} if first.heights else {}
    tables = (_table(path, points) for points in chain([first], rest))
    with _exchanged():
        write_tables(path, tables, (plan, plan, _SCALE), first.crs, records)


def _table(path: Path, points: Points) -> Table:
    texts = [name for name, column in points.columns.items() if column.is_text]
    if texts:
        raise refuse(path, f"columns {', '.join(texts)}", "texts", "numbers: extra bytes hold nothing else")
    return points.xyz, {name: (column.values, column.unit) for name, column in points.columns.items()}


def read(path: Path, crs: pyproj.CRS | None = None, heights: str = "") -> Points:
    """Read points and their extra bytes of one number; `crs` and `heights` stand in for what the file does not say.

    Raises `InterchangeError` without laspy, and for a file that is none or has no points; `OSError`.
    """
    return joined(list(read_chunks(path, crs, heights)))


def read_chunks(path: Path, crs: pyproj.CRS | None = None, heights: str = "") -> Iterator[Points]:
    """Yield the points of a file in chunks, as `read` returns them."""
    require_content(path)
    with _exchanged():
        definition = crs_definition(path)
        words = record_of(path, _RECORD).decode(errors="replace")
        system = placed(pyproj.CRS.from_wkt(definition) if definition else crs)
        count = 0
        for xyz, columns in read_tables(path, CHUNK):
            count += len(xyz)
            known = {name: Column.of(values, unit) for name, (values, unit) in columns.items()}
            yield Points(xyz=xyz, columns=known, crs=system, heights=words or heights)
    if not count:
        raise refuse(path, "", "there are no points", "points")


@contextmanager
def _exchanged() -> Iterator[None]:
    """Let errors of the room of LAS files be those of this one."""
    try:
        yield
    except DepthError as error:
        raise InterchangeError(error.problems) from error
