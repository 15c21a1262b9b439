"""LAS and LAZ files (ASPRS, LAS 1.4 R15): points, their columns as extra bytes with the unit as description.

Needs the package laspy, the extra `las`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pyproj

from musatpy.errors import DepthError, InterchangeError
from musatpy.interchange.layers import Column, Points, placed
from musatpy.interchange.packages import refuse, require_content
from musatpy.pointfiles.las_files import crs_definition, read_columns, record_of, write_columns

_RECORD = "musatpy"  # user of the record with the words for heights
_SCALE, _DEGREE_SCALE = 1e-4, 1e-9  # 0.1 mm


def write(path: Path, points: Points) -> None:
    """Write points to 0.1 mm, compressed in a `.laz` file.

    Raises `InterchangeError` without laspy, for columns of texts and for what a file cannot hold; `OSError`.
    """
    texts = [name for name, column in points.columns.items() if column.is_text]
    if texts:
        raise refuse(path, f"columns {', '.join(texts)}", "texts", "numbers: extra bytes hold nothing else")
    plan = _DEGREE_SCALE if points.crs is not None and points.crs.is_geographic else _SCALE
    columns = {name: (column.values, column.unit) for name, column in points.columns.items()}
    records = {_RECORD: points.heights.encode()} if points.heights else {}
    with _exchanged():
        write_columns(path, points.xyz, columns, (plan, plan, _SCALE), points.crs, records)


def read(path: Path, crs: pyproj.CRS | None = None, heights: str = "") -> Points:
    """Read points and their extra bytes of one number; `crs` and `heights` stand in for what the file does not say.

    Raises `InterchangeError` without laspy, and for a file that is none or has no points; `OSError`.
    """
    require_content(path)
    with _exchanged():
        definition = crs_definition(path)
        xyz, columns = read_columns(path)
        words = record_of(path, _RECORD).decode(errors="replace")
    if not len(xyz):
        raise refuse(path, "", "there are no points", "points")
    return Points(
        xyz=xyz,
        columns={name: Column.of(values, unit) for name, (values, unit) in columns.items()},
        crs=placed(pyproj.CRS.from_wkt(definition) if definition else crs),
        heights=words or heights,
    )


@contextmanager
def _exchanged() -> Iterator[None]:
    """Let errors of the room of LAS files be those of this one."""
    try:
        yield
    except DepthError as error:
        raise InterchangeError(error.problems) from error
