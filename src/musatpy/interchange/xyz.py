"""Points as text: comma-separated values under a line of names (`.csv`), or bare x, y, z apart by blanks.

A name has its unit in brackets behind it: `depth [m]`. What the bare form has besides coordinates are numbers, by
their places: `column4` and so on. Neither form says its coordinate system. Files of any size come and go in chunks.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from io import StringIO
from pathlib import Path

import numpy as np
import pyproj

from musatpy.arrays import FloatArray
from musatpy.errors import InterchangeError
from musatpy.files import whole_file
from musatpy.interchange.layers import LayerColumn, Points, joined, refuse, require_content, with_numbers
from musatpy.pointfiles.columns import AXES, Wanted, place_columns
from musatpy.pointfiles.point_tables import ENCODING
from musatpy.pointfiles.point_tables import read_chunks as read_tables

_NAMED = ".csv"
_DECIMALS, _DEGREE_DECIMALS = 4, 9  # 0.1 mm


def write(path: Path, points: Points) -> None:
    """Write points, named columns where the file is a `.csv`: numbers to 0.1 mm, nothing where there is none.

    Raises `InterchangeError` for texts in the bare form; `OSError`.
    """
    with whole_file(path) as file:
        file.write(_text(path, points, path.suffix.lower() == _NAMED).encode(**ENCODING))


def read(path: Path, columns: Sequence[str] = AXES, crs: pyproj.CRS | None = None, heights: str = "") -> Points:
    """Read points by the names of the columns of x, y and z; x, y, z alone may have others, or none.

    Raises `InterchangeError` with every line that cannot be read; `OSError`.
    """
    return with_numbers(joined(list(read_chunks(path, columns, crs, heights))))


def read_chunks(
    path: Path, columns: Sequence[str] = AXES, crs: pyproj.CRS | None = None, heights: str = ""
) -> Iterator[Points]:
    """Yield the points of a file in chunks; their further columns are texts, as they stand in the file.

    Raises `InterchangeError` after the last chunk with every line that cannot be read; `OSError`.
    """
    require_content(path)
    unit = "" if crs is None else crs.axis_info[0].unit_name  # degrees are no eastings, metres no longitudes
    places = place_columns(columns, (unit, unit, "m"))
    count = 0
    for table in read_tables(path, Wanted(columns=places, bare=tuple(columns)), InterchangeError):
        if not table.rows:
            continue
        count += len(table.rows)
        others = table.others()
        yield Points(
            xyz=table.numbers(*(place.name for place in places)),
            columns={
                name: LayerColumn(values=np.array(of, dtype=np.str_), unit=unit)
                for name, (of, unit) in others.items()
            },
            crs=crs,
            heights=heights,
        )
    if not count:
        raise refuse(path, "", "there are no points", "a line of each point")


def _text(path: Path, points: Points, named: bool) -> str:
    """Return the lines of points. Raises `InterchangeError`."""
    texts = [name for name, column in points.columns.items() if column.is_text]
    if texts and not named:
        raise refuse(path, f"columns {', '.join(texts)}", "texts in a file of bare numbers", f"a {_NAMED} file")
    plan = _DEGREE_DECIMALS if points.crs is not None and points.crs.is_geographic else _DECIMALS
    values = [_fixed(axis, decimals) for axis, decimals in zip(points.xyz.T, (plan, plan, _DECIMALS), strict=True)]
    values += [_texts(column, empty="" if named else "nan") for column in points.columns.values()]
    out = StringIO()
    writer = csv.writer(out, delimiter="," if named else " ", lineterminator="\n")
    if named:
        units = [f"{name} [{column.unit}]" if column.unit else name for name, column in points.columns.items()]
        writer.writerow([*AXES, *units])
    writer.writerows(zip(*values, strict=True))
    return out.getvalue()


def _fixed(values: FloatArray, decimals: int) -> list[str]:
    form = f"%.{decimals}f"
    return [form % value for value in (np.round(values, decimals) + 0.0).tolist()]  # no zero has a sign


def _texts(column: LayerColumn, empty: str) -> list[str]:
    values = column.values
    if column.is_text or column.is_whole:
        return [str(value) for value in values.tolist()]
    texts = _fixed(values.astype(float), _DECIMALS)
    return [empty if text == "nan" else text for text in texts]
