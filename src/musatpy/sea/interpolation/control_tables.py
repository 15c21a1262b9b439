"""Files that are read whole: control points, and mapped points of the record of a run.

Control points are a table with columns `id`, `sigma` (m) where
known, and either `dz` or `z_mapped,z_true` with `x,y`, or `z_true` alone, for points that are mapped in another
file. Errors are mapped minus true.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import CollocationError, Problem
from musatpy.geometry.crs import LongitudeLatitude, Plan
from musatpy.geometry.systems import System
from musatpy.model import Block, ControlKind
from musatpy.pointfiles.columns import PLAN, Column, Wanted, place_columns
from musatpy.pointfiles.point_tables import read_table
from musatpy.records.json_files import read_record
from musatpy.records.run_tables import SYSTEM, job_system, level_positions
from musatpy.records.tables import Tables, flags, numbers, texts
from musatpy.sea.interpolation.prediction import Observed
from musatpy.systems.blocks import level_of
from musatpy.systems.statement import own_statement

_HEIGHTS = (
    Column(name="id", kind="text", unique=True, expected="a name"),
    *(Column(name=name, unit="m") for name in ("dz", "z_mapped", "z_true")),
    Column(
        name="sigma", unit="m", required=False, blank=True, least=0.0, expected="a number of 0 or more, or nothing"
    ),
)
_FORMS = ((*PLAN, "dz", "z_true"), (*PLAN, "dz"), (*PLAN, "z_mapped", "z_true"), ("z_true",))
Mapped = Mapping[str, tuple[float, float, float]]  # id -> x, y, z as mapped


@dataclass(frozen=True, kw_only=True)
class ControlRow:
    """A control point as it stands in a file: its numbers by column (m), and its line where it has one."""

    id: str
    numbers: Mapping[str, float]
    line: int | None = None


@dataclass(frozen=True, kw_only=True)
class ControlTable:
    """The control points of a file."""

    source: str
    rows: tuple[ControlRow, ...]

    @property
    def needs_mapped(self) -> bool:
        """True where only true heights are given: the mapped points stand in another file."""
        return bool(self.rows) and not {"dz", "z_mapped"} & self.rows[0].numbers.keys()


@dataclass(frozen=True, kw_only=True, eq=False)
class Control:
    """Control points with the errors of their mapped heights."""

    ids: tuple[str, ...]
    observed: Observed


@dataclass(frozen=True, kw_only=True)
class RecordPoint:
    """A point of the record of a run; `reason` says why it is not one to be corrected."""

    id: str
    position: tuple[float, float, float] | None
    reason: str = ""


def read_control(path: Path, system: System) -> ControlTable:
    """Return the control points of a table, its places in a system.

    Raises `CollocationError` with every row's problem, and `OSError`.
    """
    columns = (*_HEIGHTS, *place_columns(units=system.units)[:2])
    table = read_table(path, Wanted(columns=columns, forms=_FORMS))
    table.require(CollocationError, empty="no control point")
    numbers = [dict(zip(table.values, row, strict=True)) for row in zip(*table.values.values(), strict=True)]
    rows = [
        ControlRow(
            id=name, numbers={key: float(value) for key, value in of.items() if not math.isnan(value)}, line=line
        )
        for name, of, line in zip(table.texts("id"), numbers, table.lines, strict=True)
    ]
    return ControlTable(source=str(path), rows=tuple(rows))


def control_of(
    table: ControlTable, mapped: Mapped, mapped_in: str = "", default_sigma: float | None = None
) -> Control:
    """Return control points with their errors, mapped minus true.

    `mapped` has those that the file gives true heights of; `default_sigma` (m) is that of points without, 0 where
    not given. Raises `CollocationError` with every point that is not there, and where a sigma is given for none.
    """
    if default_sigma is not None and table.rows and all("sigma" in row.numbers for row in table.rows):
        message = "there are sigmas, and one is given too: no control point is without its own"
        raise CollocationError([Problem(file=table.source, message=message)])
    if table.needs_mapped:
        problems = [
            Problem(file=table.source, line=row.line, field="id", message=f"no point '{row.id}' in {mapped_in}")
            for row in table.rows
            if row.id not in mapped
        ]
        if problems:
            raise CollocationError(problems)
    place, value = [], []
    for row in table.rows:
        x, y, z = mapped[row.id] if table.needs_mapped else (row.numbers["x"], row.numbers["y"], 0.0)
        place.append((x, y))
        value.append(_error(row.numbers, z))
    sigma = [row.numbers.get("sigma", default_sigma or 0.0) for row in table.rows]
    observed = Observed(place=np.array(place), value=np.array(value), sigma=np.array(sigma))
    return Control(ids=tuple(row.id for row in table.rows), observed=observed)


def _error(numbers: Mapping[str, float], z: float) -> float:
    if "dz" in numbers:
        return numbers["dz"]
    return numbers.get("z_mapped", z) - numbers["z_true"]


def run_tables(path: Path) -> dict[str, Any]:
    """Return the tables of the record that a run left. Raises `RecordError` where it is none, and `OSError`."""
    return read_record(path, (*SYSTEM, "points", "control"))


def record_system(record: Tables) -> System:
    """Return the system in which heights of a job are interpolated: that of its points, if their third is a height.

    Raises `SystemsError` where it cannot be had again.
    """
    system = job_system(record)
    if system.ellipsoid is None or system.plane_alone:
        return system
    return LongitudeLatitude(system.ellipsoid)


def record_points(record: Tables, system: System) -> list[RecordPoint]:
    """Return the points of a record in a system: those with a position under water are to be corrected."""
    table, points = record["points"], []
    position = numbers(table, "position", 3)
    known = np.isfinite(position[:, 0])
    places = iter(system.coordinates(level_positions(record, position[known])).tolist())
    columns = (table[name] for name in ("point", "bathymetric", "reason"))
    for name, submerged, why, is_known in zip(*columns, known.tolist(), strict=True):
        if not is_known:
            points.append(RecordPoint(id=name, position=None, reason=f"not determined: {why or 'no position'}"))
        else:
            x, y, z = next(places)
            points.append(RecordPoint(id=name, position=(x, y, z), reason="" if submerged else "not under water"))
    return points


def record_control(record: Tables, source: str, system: System) -> ControlTable:
    """Return the check points under water of a record, as control of its mapped points: heights of a system."""
    points, control = record["points"], record["control"]
    wet, names = texts(points, "point")[flags(points, "bathymetric")], texts(control, "point")
    rows = (texts(control, "kind") == "check") & np.isin(names, wet)
    given, sigma = (numbers(control, name, 3)[rows] for name in ("given_position", "given_sigma"))
    heights = _heights(level_positions(record, given), system)
    return _checks(names[rows].tolist(), heights, sigma[:, 2].tolist(), source)


def deck_system(block: Block) -> System:
    """Return the system in which heights of a deck are interpolated. Raises `SystemsError`."""
    system = own_statement(block).system
    return system if system.ellipsoid is None else LongitudeLatitude(system.ellipsoid)


def deck_control(block: Block, source: str, system: System) -> ControlTable:
    """Return the check points under water of a deck: heights of a system.

    Raises `CollocationError` where there are none, `SystemsError` where the system does not reach one.
    """
    control = block.control
    rows = np.flatnonzero((control.kind == ControlKind.CHECK) & block.points.bathymetric[control.point])
    heights = _heights(level_of(own_statement(block).system, control.position[rows]), system)
    ids = block.points.ids[control.point[rows]].tolist()
    return _checks(ids, heights, control.sigma[rows, 2].tolist(), source)


def _heights(level: FloatArray, system: System) -> FloatArray:
    """Return heights (n,) in a system of level positions (n, 3), NaN where it needs a place that is not known."""
    if system.ellipsoid is None or system.height_alone:
        return level[:, 2]
    whole = np.isfinite(level).all(axis=1)
    out = np.full(len(level), np.nan)
    out[whole] = system.coordinates(level[whole])[:, 2]
    return out


def _checks(ids: Sequence[str], heights: FloatArray, sigmas: Sequence[float], source: str) -> ControlTable:
    rows = [
        ControlRow(id=str(name), numbers={"z_true": z} | ({} if math.isnan(sigma) else {"sigma": sigma}))
        for name, z, sigma in zip(ids, heights.tolist(), sigmas, strict=True)
        if math.isfinite(z)
    ]
    if not rows:
        raise CollocationError([Problem(file=source, message="no check point under water has a height")])
    return ControlTable(source=source, rows=tuple(rows))


def on_plan(control: Control, system: System) -> tuple[Control, Plan | None]:
    """Return control points with their places on a map, and the plan of it; on no ellipsoid as they are.

    Raises `SystemsError` where the system does not reach one.
    """
    if system.ellipsoid is None:
        return control, None
    observed = control.observed
    coordinates = np.column_stack([observed.place, np.zeros(len(observed.place))])
    plan = Plan.about(system, coordinates)
    return replace(control, observed=replace(observed, place=plan.places(coordinates)[:, :2])), plan
