"""A solution as frames of pandas, or as a dataset of xarray: the tables of its record."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.errors import MusatError
from musatpy.extras import package
from musatpy.model import CoordinateSystem, Solution
from musatpy.reports import record
from musatpy.reports.fields import Each, Field, FieldGroup, Node, Rows
from musatpy.reports.values import array_of
from musatpy.statistics import Statistics
from musatpy.units import DEGREE

_JOB = "record"  # of what stands in no table
_AXES = ("row", "component")  # of a field of several components, the last of them first
Owners = tuple[Field[Any], Sequence[Any]]  # what the rows of a table within a table belong to
Column = tuple[str, Field[Any], Any]  # name, field, and values (n, ...): a list where they are not equally long


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordTable:
    """A table of a record, or an object of it: one row, that has no number."""

    name: str  # as in the record, with points between the names: `plate_statistics.frames`
    columns: Sequence[Column]
    is_object: bool


def tables_of(statistics: Statistics) -> Iterator[RecordTable]:
    """Yield the tables of the record of a solution at full precision, those without rows too."""
    return _tables(record.document(as_read=True).whole, "", [statistics], None)


def _tables(
    nodes: Sequence[Node[Any]], path: str, items: Sequence[Any], owners: Owners | None
) -> Iterator[RecordTable]:
    """Yield what stands at a path: the fields of objects, or of the rows of a table, and the tables in them.

    `items` are what they are made of, none where there is nothing; `owners` those of rows, None of an object. In
    front of the columns of a table in a row stands what the row is called: its first field.
    """
    plain = [node for node in nodes if isinstance(node, Field) and node.kind]
    if plain:
        columns = chain.from_iterable(_columns(field, [field.of(item) for item in items]) for field in plain)
        yield RecordTable(name=path or _JOB, columns=[*_owner(owners), *columns], is_object=owners is None)
    for node in nodes:
        name = f"{path}.{node.name}" if path else node.name
        if isinstance(node, FieldGroup):
            inside = [inner for item in items if (inner := node.of(item)) is not None]
            yield from _tables(node.fields, name, inside, None)
        elif isinstance(node, Each):
            rows = [list(node.of(item)) for item in items]
            inner = _within(plain, items, [len(of) for of in rows], owners)
            yield from _tables(node.fields, name, list(chain.from_iterable(rows)), inner)
        elif isinstance(node, Rows):
            parts = [dict(node.columns(item)) for item in items]
            counts = [len(next(iter(part.values()))) for part in parts]
            columns = chain.from_iterable(
                _columns(
                    field,
                    parts[0][field] if len(parts) == 1 else list(chain.from_iterable(p[field] for p in parts)),
                )
                for field in node.recorded
            )
            inner = _within(plain, items, counts, owners)
            yield RecordTable(name=name, columns=[*_owner(inner), *columns], is_object=False)


def _within(
    plain: Sequence[Field[Any]], items: Sequence[Any], counts: Sequence[int], owners: Owners | None
) -> Owners:
    """Return the owners of `counts` of rows in each of some items, of objects none."""
    if owners is None:
        return Field(""), ()
    return plain[0], [plain[0].of(item) for item, count in zip(items, counts, strict=True) for _ in range(count)]


def _owner(owners: Owners | None) -> Iterator[Column]:
    if owners is not None and owners[0].name:
        yield from _columns(*owners)


def _columns(field: Field[Any], values: Any) -> Iterator[Column]:
    """Yield the column of a field; of numbers by names one for each name."""
    if field.kind == "map":
        for name in dict.fromkeys(chain.from_iterable(values)):
            yield f"{field.name}[{name}]", field, np.array([row.get(name, 0) for row in values], dtype=np.int64)
    else:
        yield field.name, field, array_of(field.kind, values)


def to_pandas(solution: Solution, table: str = "") -> Any:
    """Return the tables of the record of a solution as frames, by their names: `stations`, `tests.check_points`.

    Fields of several components have as many columns, called as in the manual of the record: `position[2]`, and
    objects (`options`, `solution`) one row. Missing numbers are NaN. `attrs["units"]` of a frame has the units of
    its columns.

    Of one `table`, its frame alone, with plain names: `x`, `y`, `z`, `sigma_x`, `given_x`, `x_tilt`. Angles are
    degrees; places of a geographic job are longitude, latitude, height. Sigmas and differences are along east,
    north, up, and called so in a geocentric job. `attrs["meanings"]` says what columns are.

    Raises `MusatError` where pandas is not installed, and for a table that the record does not have.
    """
    pandas = _package("pandas")
    if table:
        return _plain_frame(pandas, solution, table)
    frames = {}
    for each in tables_of(Statistics(solution)):
        parts = [(field.unit, _components(name, values)) for name, field, values in each.columns]
        frames[each.name] = pandas.DataFrame({name: part for _, named in parts for name, part in named.items()})
        frames[each.name].attrs["units"] = {name: unit for unit, named in parts if unit for name in named}
    return frames


def _components(name: str, values: Any) -> dict[str, Any]:
    """Return a column by its name; of several components one for each: `position[0]`, `covariance[1][2]`."""
    if isinstance(values, list) or values.ndim == 1:
        return {name: values}
    flat = values.reshape(len(values), math.prod(values.shape[1:])).T
    places = product(*map(range, values.shape[1:]))
    return {f"{name}{''.join(f'[{n}]' for n in place)}": part for place, part in zip(places, flat, strict=True)}


# --- one table, with plain names ---


FIRST = (  # that people use first
    "points", "stations", "control", "bathymetric_points", "plates", "observations", "findings", "cameras",
    "tests.check_points", "iterations",
)  # fmt: skip
_XYZ, _LEVEL, _TILTS = ("x", "y", "z"), ("east", "north", "up"), ("x_tilt", "y_tilt", "heading")
_MIXED = "deg, deg, m"  # unit of places of a globe
_UNSAID = ("position", "xy", "attitude")  # words of names that those of components say
_GEOCENTRIC = ("no_refraction", "predicted", "refraction")  # vectors of any job


def _plain_frame(pandas: Any, solution: Solution, name: str) -> Any:
    """Return the frame of a table with plain names. Raises `MusatError` where there is none."""
    nodes = [n for n in record.document(as_read=True).whole if n.name == name.partition(".")[0]]
    tables = {table.name: table for table in _tables(nodes, "", [Statistics(solution)], None)}
    if name not in tables:
        raise MusatError(f"no table '{name}'; there are {', '.join(FIRST)}, and the others of the record")
    system = "" if name.startswith("stated.") else str(solution.block.options.system)
    columns: dict[str, Any] = {}
    units: dict[str, str] = {}
    meanings: dict[str, str] = {}
    for field_name, field, values in tables[name].columns:
        unit, values = _in_degrees(field_name, field.unit, values, system)
        named = _plain_components(field_name, values, system)
        columns |= named
        units |= dict(zip(named, unit.split(", ") if unit == _MIXED else [unit] * len(named), strict=True))
        meanings |= dict.fromkeys(named, field.text)
    frame = pandas.DataFrame(columns)
    frame.attrs |= {"units": {name: unit for name, unit in units.items() if unit}, "meanings": meanings}
    return frame


def _in_degrees(name: str, unit: str, values: Any, system: str) -> tuple[str, Any]:
    """Return the unit and the values of a column, angles as degrees, places of a globe as x, y, z."""
    if unit == "rad" and not isinstance(values, list):
        return "deg", values / DEGREE
    if not system or not name.endswith("position"):
        return unit, values
    if system == CoordinateSystem.GEOGRAPHIC:
        return _MIXED, values[:, [1, 0, 2]] / [DEGREE, DEGREE, 1.0]
    return "m", values


def _plain_components(name: str, values: Any, system: str) -> dict[str, Any]:
    """Return a column by its name, or its components by those of their axes: `x`, `sigma_x`, `covariance_x_y`."""
    if isinstance(values, list) or values.ndim == 1:
        return {name: values}
    is_place = values.shape[1] == 2 or name.endswith("position") or name in _GEOCENTRIC
    axes: tuple[str, ...] = _XYZ if is_place or system != CoordinateSystem.GEOCENTRIC else _LEVEL
    if "attitude" in name:
        axes = _TILTS
    elif values.shape[1] > len(axes):
        axes = (*axes, *_TILTS)
    if values.dtype.kind in "UO" or values.shape[1] > len(axes):
        axes = tuple(str(number + 1) for number in range(values.shape[1]))
    words = [word for word in name.split("_") if word not in _UNSAID]
    places = product(*(axes[:size] for size in values.shape[1:]))
    flat = values.reshape(len(values), -1).T
    return {"_".join([*words, *place]): part for place, part in zip(places, flat, strict=True)}


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
        prefix, first = table.name.replace(".", "_"), table.columns[0][2]
        if not table.is_object and isinstance(first, np.ndarray) and first.dtype.kind in "UO" and first.ndim == 1:
            names = first.astype(np.str_)
            if len(names) and len(np.unique(names)) == len(names):
                ids[prefix] = names
        if len(first):
            variables |= {f"{prefix}_{column[0]}": _variable(table, prefix, column) for column in table.columns}
    return xarray.Dataset(variables, coords=ids)


def _variable(table: RecordTable, prefix: str, column: Column) -> tuple[Any, ...]:
    """Return dimensions, values and attributes of a column."""
    name, field, given = column
    ragged = isinstance(given, list)
    values: NDArray[Any] = _rectangular(given) if ragged else given
    if values.dtype.kind in "UO":
        values = np.where(values == None, "", values).astype(np.str_)  # noqa: E711 - of each element
    if ragged and values.ndim > 1:
        dimensions = [f"{prefix}_{name}_number"]
    else:
        axes = zip(_AXES[3 - values.ndim :], values.shape[1:], strict=True)
        dimensions = [f"{axis}_{size}" for axis, size in axes]
    attributes = {"units": field.unit, "long_name": field.text}
    if table.is_object:
        return dimensions, values[0], attributes
    return [prefix, *dimensions], values, attributes


def _rectangular(rows: Sequence[Sequence[Any]]) -> Any:
    """Return lists of texts as one text each, lists of numbers as an array whose shorter rows end in NaN."""
    if any(isinstance(value, str) for row in rows for value in row) or not any(map(len, rows)):
        return np.array([" ".join(row) for row in rows], dtype=object)
    out = np.full((len(rows), max(map(len, rows))), np.nan)
    for number, row in enumerate(rows):
        out[number, : len(row)] = [np.nan if value is None else value for value in row]
    return out


def _package(name: str) -> Any:
    return package("notebook", name, f"tables as those of {name} need")
