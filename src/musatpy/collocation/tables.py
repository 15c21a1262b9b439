"""Files that are read whole: control points, and mapped points of the record of a run.

Control points are comma-separated values under a line of names, in any order and case: `id`, `sigma` (m) where
known, and either `dz` or `z_mapped,z_true` with `x,y`, or `z_true` alone, for points that are mapped in another
file. Errors are mapped minus true.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.collocation.prediction import Observed
from musatpy.csv_tables import number, separator_faults
from musatpy.errors import CollocationError, Problem
from musatpy.json_files import read_record as record_of_run
from musatpy.model import Block, ControlKind, CoordinateSystem

FloatArray = NDArray[np.float64]

_NEEDS = {  # of the record of a run
    "options": ("system",),
    "points": ("point", "bathymetric", "position", "reason"),
    "control": ("point", "kind", "given_position", "given_sigma"),
}
_KNOWN = ("id", "x", "y", "dz", "z_mapped", "z_true", "sigma")
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


def read_control(path: Path) -> ControlTable:
    """Return the control points of a CSV file.

    Raises `CollocationError` with every row's problem, and `OSError`.
    """
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        lines = [(number, row) for number, row in enumerate(csv.reader(file), 1) if any(map(str.strip, row))]
    source = str(path)
    if not lines:
        raise CollocationError([Problem(file=source, message="no line of names")])
    number, names = lines[0][0], [name.strip().lower() for name in lines[0][1]]
    problems = [Problem(file=source, line=number, message=message) for message in header_faults(names)]
    if problems:
        raise CollocationError(problems)
    wanted = wanted_columns(names)
    rows: list[ControlRow] = []
    seen: dict[str, int] = {}
    for number, values in lines[1:]:
        faults = list(_row_faults(names, wanted, values, seen))
        problems += [Problem(file=source, line=number, field=field, message=text) for field, text in faults]
        if not faults:
            texts = dict(zip(names, (value.strip() for value in values), strict=True))
            seen[texts["id"]] = number
            numbers = {name: float(texts[name]) for name in wanted if texts[name]}
            rows.append(ControlRow(id=texts["id"], numbers=numbers, line=number))
    if not problems and not rows:
        problems = [Problem(file=source, message="no control point")]
    if problems:
        raise CollocationError(problems)
    return ControlTable(source=source, rows=tuple(rows))


def header_faults(names: Sequence[str]) -> Iterator[str]:
    """Yield what is wrong with the names of the columns of control points."""
    if found := separator_faults(names):
        yield from found
        return
    listed = ", ".join(names)
    for name in _KNOWN:
        if names.count(name) > 1:
            yield f"more than one column {name} among {listed}"
    if "id" not in names:
        yield f"no column id among {listed}"
    if "dz" in names and "z_mapped" in names:
        yield "dz and z_mapped say the same: one of them"
    if "z_mapped" in names and "z_true" not in names:
        yield f"z_mapped without z_true among {listed}"
    if not {"dz", "z_true"} & set(names):
        yield f"neither dz nor z_true among {listed}"
    if {"dz", "z_mapped"} & set(names):
        for name in ("x", "y"):
            if name not in names:
                yield f"no column {name} among {listed}"


def wanted_columns(names: Sequence[str]) -> tuple[str, ...]:
    """Return the columns with numbers that are used."""
    if "dz" in names:
        wanted: tuple[str, ...] = ("x", "y", "dz")
    elif "z_mapped" in names:
        wanted = ("x", "y", "z_mapped", "z_true")
    else:
        wanted = ("z_true",)
    return (*wanted, "sigma") if "sigma" in names else wanted


def _row_faults(
    names: Sequence[str], wanted: Sequence[str], values: Sequence[str], seen: Mapping[str, int]
) -> Iterator[tuple[str | None, str]]:
    """Yield column and fault of a row."""
    if len(values) != len(names):
        yield None, f"{len(values)} values for {len(names)} columns"
        return
    texts = dict(zip(names, (value.strip() for value in values), strict=True))
    if not texts["id"]:
        yield "id", "is missing"
    elif texts["id"] in seen:
        yield "id", f"'{texts['id']}' stands in line {seen[texts['id']]} already"
    for name in wanted:
        fault = number_fault(texts[name], may_be_empty=name == "sigma", least=0.0 if name == "sigma" else None)
        if fault:
            yield name, fault


def number_fault(text: str, *, may_be_empty: bool = False, least: float | None = None) -> str:
    """Return what is wrong with a text that should be a finite number, '' where nothing is."""
    if not text:
        return "" if may_be_empty else "is missing"
    value = number(text)
    if math.isnan(value) and text.lower() != "nan":
        return f"'{text}' is not a number"
    if not math.isfinite(value):
        return f"'{text}' is not finite"
    return f"'{text}' is less than {least:g}" if least is not None and value < least else ""


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


def read_record(path: Path) -> dict[str, Any]:
    """Return the record that a run left.

    Raises `RecordError` where it is none, `CollocationError` where it is not in local axes, `OSError`.
    """
    record = record_of_run(path, _NEEDS)
    _check_system(record["options"]["system"], str(path))
    return record


def _check_system(system: str, source: str) -> None:
    if system != CoordinateSystem.LOCAL:
        message = f"is a {system} job: heights are interpolated in rectangular axes (LOCL), or from CSV files"
        raise CollocationError([Problem(file=source, message=message)])


def record_points(record: Mapping[str, Any]) -> list[RecordPoint]:
    """Return the points of a record: those with a position under water are to be corrected."""
    found = []
    for row in record["points"]:
        place = row["position"]
        if place[0] is None:
            reason = f"not determined: {row.get('reason') or 'no position'}"
            found.append(RecordPoint(id=row["point"], position=None, reason=reason))
        else:
            reason = "" if row["bathymetric"] else "not under water"
            found.append(RecordPoint(id=row["point"], position=(place[0], place[1], place[2]), reason=reason))
    return found


def record_control(record: Mapping[str, Any], source: str) -> ControlTable:
    """Return the check points under water of a record, as control of its mapped points: true heights."""
    wet = {row["point"] for row in record["points"] if row["bathymetric"]}
    rows = []
    for row in record["control"]:
        z, sigma = row["given_position"][2], row["given_sigma"][2]
        if row["kind"] == "check" and z is not None and row["point"] in wet:
            numbers = {"z_true": z} | ({} if sigma is None else {"sigma": sigma})
            rows.append(ControlRow(id=row["point"], numbers=numbers))
    return _checks(rows, source)


def deck_control(block: Block, source: str) -> ControlTable:
    """Return the check points under water of a deck. Raises `CollocationError` where there are none."""
    _check_system(block.options.system, source)
    control, rows = block.control, list[ControlRow]()
    for row in np.flatnonzero((control.kind == ControlKind.CHECK) & np.isfinite(control.position[:, 2])):
        point, z, sigma = control.point[row], float(control.position[row, 2]), float(control.sigma[row, 2])
        if block.points.bathymetric[point]:
            numbers = {"z_true": z} | ({} if math.isnan(sigma) else {"sigma": sigma})
            rows.append(ControlRow(id=str(block.points.ids[point]), numbers=numbers))
    return _checks(rows, source)


def _checks(rows: Sequence[ControlRow], source: str) -> ControlTable:
    if not rows:
        raise CollocationError([Problem(file=source, message="no check point under water has a height")])
    return ControlTable(source=source, rows=tuple(rows))
