"""A solution as frames of pandas, or as a dataset of xarray: the tables of its record."""

from __future__ import annotations

import math
from importlib import import_module
from itertools import product
from typing import Any

import numpy as np

from musatpy.errors import MusatError
from musatpy.model import Solution
from musatpy.notebook.columns import RecordTable, TableColumn, tables_of
from musatpy.statistics import Statistics

_AXES = ("row", "component")  # of a field of several components, the last of them first


def to_pandas(solution: Solution) -> dict[str, Any]:
    """Return the tables of the record of a solution as frames, by their names: `stations`, `tests.check_points`.

    Fields of several components have as many columns, called as in the manual of the record: `position[2]`, and
    objects (`options`, `solution`) one row. Missing numbers are NaN. `attrs["units"]` of a frame has the units of
    its columns. Raises `MusatError` where pandas is not installed.
    """
    pandas = _package("pandas")
    frames = {}
    for table in tables_of(Statistics(solution)):
        columns: dict[str, Any] = {}
        units: dict[str, str] = {}
        for column in table.columns:
            parts = _components(column)
            columns |= parts
            units |= {name: column.unit for name in parts if column.unit}
        frames[table.name] = pandas.DataFrame(columns)
        frames[table.name].attrs["units"] = units
    return frames


def _components(column: TableColumn) -> dict[str, Any]:
    """Return a column by its name; of several components one for each: `position[0]`, `covariance[1][2]`."""
    values = column.values
    if isinstance(values, list) or values.ndim == 1:
        return {column.name: values}
    flat = values.reshape(len(values), math.prod(values.shape[1:])).T
    places = product(*map(range, values.shape[1:]))
    return {
        f"{column.name}{''.join(f'[{n}]' for n in place)}": part for place, part in zip(places, flat, strict=True)
    }


def to_xarray(solution: Solution) -> Any:
    """Return the record of a solution as one dataset, its variables called by table and field: `stations_position`.

    Each table has a dimension of its name, with the ids of its rows where these are one each (photos, points);
    objects (`options`, `solution`) have none, and tables without rows are left out. Attributes of a variable are
    `units`, as the record has them, and `long_name`. Lists of numbers that are not of one length end in NaN; lists
    of texts are one text with blanks between. Raises `MusatError` where xarray is not installed.
    """
    xarray = _package("xarray")
    variables: dict[str, Any] = {}
    ids: dict[str, Any] = {}
    for table in tables_of(Statistics(solution)):
        prefix = table.name.replace(".", "_")
        if table.ids is not None:
            ids[prefix] = table.ids
        if table.count:
            variables |= {f"{prefix}_{column.name}": _variable(table, prefix, column) for column in table.columns}
    return xarray.Dataset(variables, coords=ids)


def _variable(table: RecordTable, prefix: str, column: TableColumn) -> tuple[Any, ...]:
    """Return dimensions, values and attributes of a column."""
    values = _rectangular(column.values) if isinstance(column.values, list) else column.values
    if values.dtype.kind in "UO":
        values = np.where(values == None, "", values).astype(np.str_)  # noqa: E711 - of each element
    ragged = isinstance(column.values, list) and values.ndim > 1
    names = [f"{prefix}_{column.name}_number"] if ragged else _AXES[3 - values.ndim :]
    sizes = values.shape[1:]
    dimensions = names if ragged else [f"{name}_{size}" for name, size in zip(names, sizes, strict=True)]
    attributes = {"units": column.unit, "long_name": column.text}
    if table.is_object:
        return dimensions, values[0], attributes
    return [prefix, *dimensions], values, attributes


def _rectangular(rows: list[list[Any]]) -> Any:
    """Return lists of texts as one text each, lists of numbers as an array whose shorter rows end in NaN."""
    if any(isinstance(value, str) for row in rows for value in row) or not any(rows):
        return np.array([" ".join(row) for row in rows], dtype=object)
    out = np.full((len(rows), max(map(len, rows))), np.nan)
    for number, row in enumerate(rows):
        out[number, : len(row)] = [np.nan if value is None else value for value in row]
    return out


def _package(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        message = f"tables as those of {name} need the package {name}: pip install 'musatpy[notebook]'"
        raise MusatError(message) from error
