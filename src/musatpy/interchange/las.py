"""LAS and LAZ files (ASPRS, LAS 1.4 R15): points, their columns as extra bytes with the unit as description.

Needs the package laspy, the extra `las`. Files of any size come and go in chunks.
"""

from __future__ import annotations

import datetime
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyproj

from musatpy.files import whole_file
from musatpy.interchange.layers import LayerColumn, Points, joined, placed, refuse, require_content
from musatpy.pointfiles.las_files import chunks, coordinates, crs_definition, opened, package, upsets, written

_RECORD = "musatpy"  # user of the record with the words for heights
_SCALE, _DEGREE_SCALE = 1e-4, 1e-9  # 0.1 mm
_NEW = {"version": "1.4", "point_format": 6}  # the plainest form that says its system as WKT
_FIRST_DAY = datetime.date(2011, 11, 14)  # of LAS 1.4; equal points make equal files


def write(path: Path, points: Points) -> None:
    """Write points to 0.1 mm, compressed in a `.laz` file.

    Raises `InterchangeError` without laspy, for columns of texts and for what a file cannot hold; `OSError`.
    """
    header = _header(path, points)
    with whole_file(path) as file, written(file, header, path) as writer:
        with upsets(path, "cannot hold the points"):
            record = package().ScaleAwarePointRecord.zeros(len(points.xyz), header=header)
            record.x, record.y, record.z = points.xyz.T
            for name, column in points.columns.items():
                record[name] = column.values
            record["return_number"] = record["number_of_returns"] = np.ones(len(points.xyz), dtype=np.uint8)
        writer.write_points(record)


def _header(path: Path, points: Points) -> Any:
    """Return the header of a file that begins with some points. Raises `InterchangeError`."""
    if texts := [name for name, column in points.columns.items() if column.is_text]:
        raise refuse(path, f"columns {', '.join(texts)}", "texts", "numbers: extra bytes hold nothing else")
    laspy, plan = package(), _DEGREE_SCALE if points.crs is not None and points.crs.is_geographic else _SCALE
    with upsets(path, "cannot hold the points"):
        header = laspy.LasHeader(**_NEW)
        header.creation_date, header.uuid = _FIRST_DAY, uuid.UUID(int=0)
        header.system_identifier, header.generating_software = "OTHER", "musatpy"
        header.scales = np.array([plan, plan, _SCALE])
        header.offsets = np.floor(points.xyz.min(axis=0)) if len(points.xyz) else np.zeros(3)
        header.add_extra_dims(
            [
                laspy.ExtraBytesParams(name=name, type=column.values.dtype.str[1:], description=column.unit)
                for name, column in points.columns.items()
            ]
        )
        if points.crs is not None:
            header.add_crs(points.crs)
        if points.heights:
            header.vlrs.append(laspy.VLR(_RECORD, 1, record_data=points.heights.encode()))
    return header


def read(path: Path, crs: pyproj.CRS | None = None, heights: str = "") -> Points:
    """Read points and their extra bytes of one number; `crs` and `heights` stand in for what the file does not say.

    Raises `InterchangeError` without laspy, and for a file that is none or has no points; `OSError`.
    """
    return joined(list(read_chunks(path, crs, heights)))


def read_chunks(path: Path, crs: pyproj.CRS | None = None, heights: str = "") -> Iterator[Points]:
    """Yield the points of a file in chunks, as `read` returns them."""
    require_content(path)
    definition = crs_definition(path)
    system = placed(pyproj.CRS.from_wkt(definition) if definition else crs)
    with opened(path) as reader:
        words = [record.record_data_bytes() for record in reader.header.vlrs if record.user_id == _RECORD]
        heights = words[0].decode(errors="replace") if words else heights
        extra = [d for d in reader.header.point_format.extra_dimensions if d.num_elements == 1]
        if not reader.header.point_count:
            raise refuse(path, "", "there are no points", "points")
        for record in chunks(reader, path):
            with upsets(path, "its points cannot be read"):
                columns = {d.name: LayerColumn.of(np.array(record[d.name]), d.description) for d in extra}
            yield Points(xyz=coordinates(record), columns=columns, crs=system, heights=heights)
