"""Points as text: comma-separated values under a line of names (`.csv`), or bare x, y, z apart by blanks.

A name has its unit in brackets behind it: `depth [m]`. What the bare form has besides coordinates are numbers, by
their places: `column4` and so on. Neither form says its coordinate system.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from io import StringIO
from pathlib import Path

import numpy as np
import pyproj

from musatpy.arrays import FloatArray
from musatpy.errors import InterchangeError, Problem
from musatpy.files import write_file
from musatpy.interchange.layers import Column, Points
from musatpy.interchange.packages import fault, refuse, require_content
from musatpy.pointfiles.csv_tables import ENCODING, Layout, names_of, number

_NAMED = ".csv"
_AXES = ("x", "y", "z")
_WITH_UNIT = re.compile(r"(.*\S)\s*\[([^\]]*)\]")
_DECIMALS, _DEGREE_DECIMALS = 4, 9  # 0.1 mm


def write(path: Path, points: Points) -> None:
    """Write points, named columns where the file is a `.csv`: numbers to 0.1 mm, nothing where there is none.

    Raises `InterchangeError` for texts in the bare form; `OSError`.
    """
    named = path.suffix.lower() == _NAMED
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
        writer.writerow([*_AXES, *units])
    writer.writerows(zip(*values, strict=True))
    write_file(path, out.getvalue().encode(**ENCODING))


def read(path: Path, columns: Sequence[str] = _AXES, crs: pyproj.CRS | None = None, heights: str = "") -> Points:
    """Read points, of a `.csv` file by the names of the columns of x, y and z, in any case.

    Raises `InterchangeError` with every line that cannot be read; `OSError`.
    """
    require_content(path)
    with path.open(newline="", **ENCODING) as file:  # type: ignore[call-overload]
        lines = [line.rstrip("\r") for line in file.read().removeprefix("\ufeff").split("\n")]
    if path.suffix.lower() == _NAMED:
        layout = Layout.of(path, _without_units(lines[0]), columns, (), InterchangeError)
        names, places = layout.names, layout.places
        units = [_parted(name)[1] for name in names_of(lines[0])]
        rows = [(place, next(csv.reader([line]))) for place, line in enumerate(lines[1:], 2) if line.strip()]
    else:
        rows = [(place, line.split()) for place, line in enumerate(lines, 1) if line.strip()]
        width = len(rows[0][1]) if rows else 0
        names = (*_AXES, *(f"column{place}" for place in range(4, width + 1)))
        places, units = (0, 1, 2), [""] * len(names)
    xyz = _coordinates(path, rows, places, names)
    others = {
        name: _column([row[place] for _, row in rows], units[place])
        for place, name in enumerate(names)
        if place not in places
    }
    return Points(xyz=xyz, columns=others, crs=crs, heights=heights)


def _fixed(values: FloatArray, decimals: int) -> list[str]:
    form = f"%.{decimals}f"
    return [form % value for value in (np.round(values, decimals) + 0.0).tolist()]  # no zero has a sign


def _texts(column: Column, empty: str) -> list[str]:
    values = column.values
    if column.is_text or column.is_whole:
        return [str(value) for value in values.tolist()]
    texts = _fixed(values.astype(float), _DECIMALS)
    return [empty if text == "nan" else text for text in texts]


def _parted(name: str) -> tuple[str, str]:
    """Return the name and the unit of what stands above a column."""
    parts = _WITH_UNIT.fullmatch(name)
    return (parts[1], parts[2]) if parts else (name, "")


def _without_units(header: str) -> str:
    out = StringIO()
    csv.writer(out, lineterminator="").writerow([_parted(name)[0] for name in names_of(header)])
    return out.getvalue()


def _coordinates(
    path: Path, rows: Sequence[tuple[int, list[str]]], places: Sequence[int], names: Sequence[str]
) -> FloatArray:
    """Return the coordinates (n, 3) of rows with the numbers of their lines. Raises `InterchangeError`."""
    if not rows:
        raise refuse(path, "", "there are no points", "a line of each point")
    problems: list[Problem] = []
    xyz = np.full((len(rows), 3), np.nan)
    for i, (line, values) in enumerate(rows):
        if len(values) != len(names):
            problems.append(fault(path, "", f"{len(values)} values", f"{len(names)}: {', '.join(names)}", line))
            continue
        xyz[i] = [number(values[place]) for place in places]
        for axis in np.flatnonzero(~np.isfinite(xyz[i])).tolist():
            place = places[axis]
            problems.append(fault(path, names[place], f"'{values[place].strip()}'", "a coordinate", line))
    if problems:
        raise InterchangeError(problems)
    return xyz


def _column(texts: Sequence[str], unit: str) -> Column:
    """Return a column of numbers where all texts are numbers or missing, else of texts."""
    values = np.array([number(text) for text in texts])
    missing = [text.strip().lower() in ("", "nan") for text in texts]
    if np.isfinite(values[~np.array(missing)]).all() and not all(missing):
        return Column.of(values, unit)
    return Column.of([text.strip() for text in texts], unit)
