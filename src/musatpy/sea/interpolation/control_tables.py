"""Files that are read whole: control points, and mapped points of the record of a run.

Control points are a table with columns `id`, `sigma` (m) where known, and either `dz` or `z_mapped,z_true` with
`x,y`, or `z_true` alone, for points that are mapped in another file. Errors are mapped minus true.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import CollocationError, Problem
from musatpy.geometry.crs import LongitudeLatitude, MapPlan
from musatpy.geometry.systems import System
from musatpy.model import Block, ControlKind
from musatpy.pointfiles.columns import PLAN, SIGMA, FileColumn, Wanted, place_columns
from musatpy.pointfiles.point_tables import read_chunks, read_table
from musatpy.records.json_files import read_record
from musatpy.records.run_tables import SYSTEM, job_system, level_positions
from musatpy.records.tables import Tables, flags, numbers, texts
from musatpy.sea.interpolation.prediction import Observed
from musatpy.systems.blocks import level_of
from musatpy.systems.statement import own_statement

_HEIGHTS = (
    FileColumn(name="id", kind="text", unique=True, expected="a name"),
    *(FileColumn(name=name, unit="m") for name in ("dz", "z_mapped", "z_true")),
    SIGMA,
)
_FORMS = ((*PLAN, "dz", "z_true"), (*PLAN, "dz"), (*PLAN, "z_mapped", "z_true"), ("z_true",))
Mapped = Mapping[str, tuple[float, float, float]]  # id -> x, y, z as mapped


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlTable:
    """n control points of a file: ids, numbers (n,) m by column, NaN where not given, and their lines if any."""

    source: str
    ids: tuple[str, ...]
    values: Mapping[str, FloatArray]
    lines: Sequence[int] | None = None

    @property
    def needs_mapped(self) -> bool:
        """True where only true heights are given: the mapped points stand in another file."""
        return not {"dz", "z_mapped"} & self.values.keys()


def read_control(path: Path, system: System) -> ControlTable:
    """Return the control points of a table, its places in a system.

    Raises `CollocationError` with every row's problem, and `OSError`.
    """
    columns = (*_HEIGHTS, *place_columns(units=system.units)[:2])
    table = read_table(path, Wanted(columns=columns, forms=_FORMS))
    table.require(CollocationError, empty="no control point")
    return ControlTable(source=str(path), ids=tuple(table.texts("id")), values=table.values, lines=table.lines)


def control_of(
    table: ControlTable, mapped: Mapped, mapped_in: str = "", default_sigma: float | None = None
) -> Observed:
    """Return the errors at control points, mapped minus true.

    `mapped` has those that the file gives true heights of; `default_sigma` (m) is that of points without, 0 where
    not given. Raises `CollocationError` with every point that is not there, and where a sigma is given for none.
    """
    values = table.values
    sigma = values.get("sigma", np.full(len(table.ids), np.nan))
    if default_sigma is not None and len(sigma) and np.isfinite(sigma).all():
        message = "all control points have sigmas of their own, so none can be given"
        raise CollocationError.of(message, file=table.source)
    if table.needs_mapped:
        lines: Sequence[int | None] = table.lines or [None] * len(table.ids)
        problems = [
            Problem(file=table.source, line=line, field="id", message=f"no point '{name}' in {mapped_in}")
            for name, line in zip(table.ids, lines, strict=True)
            if name not in mapped
        ]
        if problems:
            raise CollocationError(problems)
        x, y, z = np.array([mapped[name] for name in table.ids]).reshape(-1, 3).T
    else:
        x, y, z = values["x"], values["y"], values.get("z_mapped", np.full(len(sigma), np.nan))
    value = values["dz"] if "dz" in values else z - values["z_true"]
    known = np.where(np.isnan(sigma), default_sigma or 0.0, sigma)
    return Observed(place=np.column_stack([x, y]), value=value, sigma=known)


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


def record_mapped(path: Path, system: System) -> Mapped:
    """Return the points of a record with their places in a system."""
    record = run_tables(path)
    table = record["points"]
    position = numbers(table, "position", 3)
    known = np.isfinite(position).all(axis=1)
    places = system.coordinates(level_positions(record, position[known])).tolist()
    names = [table["point"][row] for row in np.flatnonzero(known).tolist()]
    return {name: (x, y, z) for name, (x, y, z) in zip(names, places, strict=True)}


def read_mapped(path: Path, wanted: Iterable[str], columns: Sequence[str], system: System) -> Mapped:
    """Return the mapped points of a table with the wanted ids, places in a system.

    Raises `CollocationError` with every line that cannot be read, or has such an id a second time; `OSError`.
    """
    looked_for, mapped = set(wanted), dict[str, tuple[float, float, float]]()
    places = place_columns(columns, system.units)
    names = FileColumn(name="id", kind="text", blank=True)
    for table in read_chunks(path, Wanted(columns=(names, *places)), CollocationError):
        points = table.numbers(*(place.name for place in places)).tolist()
        for row, name in enumerate(table.texts("id")):
            if name in mapped:
                table.refuse(f"control point '{name}' is there a second time", row, "id")
            elif name in looked_for:
                x, y, z = points[row]
                mapped[name] = (x, y, z)
        table.require(CollocationError)
    return mapped


def record_control(record: Tables, source: str, system: System) -> ControlTable:
    """Return the check points under water of a record, as control of its mapped points: heights of a system."""
    points, control = record["points"], record["control"]
    wet, names = texts(points, "point")[flags(points, "bathymetric")], texts(control, "point")
    rows = (texts(control, "kind") == "check") & np.isin(names, wet)
    given, sigma = (numbers(control, name, 3)[rows] for name in ("given_position", "given_sigma"))
    heights = _heights(level_positions(record, given), system)
    return _checks(names[rows].tolist(), heights, sigma[:, 2], source)


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
    return _checks(ids, heights, control.sigma[rows, 2], source)


def _heights(level: FloatArray, system: System) -> FloatArray:
    """Return heights (n,) in a system of level positions (n, 3), NaN where it needs a place that is not known."""
    if system.ellipsoid is None or system.height_alone:
        return level[:, 2]
    whole = np.isfinite(level).all(axis=1)
    out = np.full(len(level), np.nan)
    out[whole] = system.coordinates(level[whole])[:, 2]
    return out


def _checks(ids: Sequence[str], heights: FloatArray, sigma: FloatArray, source: str) -> ControlTable:
    known = np.isfinite(heights)
    if not known.any():
        raise CollocationError.of("no check point under water has a height", file=source)
    names = tuple(str(name) for name, is_known in zip(ids, known.tolist(), strict=True) if is_known)
    return ControlTable(source=source, ids=names, values={"z_true": heights[known], "sigma": sigma[known]})


def on_plan(observed: Observed, system: System) -> tuple[Observed, MapPlan | None]:
    """Return the errors with their places on a map, and the plan of it; on no ellipsoid as they are.

    Raises `SystemsError` where the system does not reach one.
    """
    if system.ellipsoid is None:
        return observed, None
    coordinates = np.column_stack([observed.place, np.zeros(len(observed.place))])
    plan = MapPlan.about(system, coordinates)
    return replace(observed, place=plan.places(coordinates)[:, :2]), plan
