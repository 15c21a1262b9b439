"""Soundings from a file of comma-separated values under a line of names, in any order and case.

Places are `lat` and `lon` (degrees), or `x` and `y` (m); the value is `depth`, positive down, or `height`; `sigma`
of it and `name` may be given.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.errors import Problem, SoundingError
from musatpy.pointfiles.csv_tables import number, separator_faults
from musatpy.units import DEGREE

_WORDS = {"latitude": "lat", "longitude": "lon", "z": "height", "east": "x", "north": "y", "id": "name"}
_PLACES = (("lat", "lon"), ("x", "y"))
_VALUES = ("depth", "height")
_DEGREES = {"lat": 90.0, "lon": 360.0}


@dataclass(frozen=True, kw_only=True, eq=False)
class Soundings:
    """n soundings: place (n, 2), latitude and longitude (rad) where `angular`, else m; depth (n,) m, positive down.

    sigma (n,) m of the depth, NaN where the file gives none. Values that are heights have the opposite sign here.
    """

    names: TextArray
    place: FloatArray
    angular: bool
    depth: FloatArray
    sigma: FloatArray


def read_soundings(source: Path) -> Soundings:
    """Return the soundings of a file. Raises `SoundingError` with every line that cannot be used, and `OSError`."""
    with source.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        header, *lines = list(csv.reader(file)) or [[]]
    names = [common_name(name) for name in header]
    wanted, faults = _columns(names)
    if faults:
        raise SoundingError([Problem(file=str(source), line=1, message=fault) for fault in faults])
    rows, problems, texts = [], [], []
    for line, cells in enumerate(lines, 2):
        if not any(cells):
            continue
        values = [number(cells[names.index(name)]) if names.index(name) < len(cells) else np.nan for name in wanted]
        for name, value in zip(wanted, values, strict=True):
            cell = cells[names.index(name)].strip() if names.index(name) < len(cells) else ""
            if expected := _expected(name, value, cell):
                problems.append(Problem(file=str(source), line=line, field=name, found=cell, expected=expected))
        rows.append(values)
        texts.append(
            cells[names.index("name")] if "name" in names and len(cells) > names.index("name") else str(line)
        )
    if not rows and not problems:
        problems.append(Problem(file=str(source), message="no sounding"))
    if problems:
        raise SoundingError(problems)
    table, angular = np.array(rows), wanted[0] == "lat"
    return Soundings(
        names=np.array(texts, dtype=np.str_),
        place=table[:, :2] * (DEGREE if angular else 1.0),
        angular=angular,
        depth=table[:, 2] * (1.0 if wanted[2] == "depth" else -1.0),
        sigma=table[:, 3] if len(wanted) > 3 else np.full(len(table), np.nan),
    )


def common_name(name: str) -> str:
    """Return the name of a column by which all its names are known: `lat` for `Latitude`."""
    lower = name.strip().lower()
    return _WORDS.get(lower, lower)


def _expected(name: str, value: float, cell: str) -> str:
    """Return what should stand in a cell, empty where it does: a sigma may be blank."""
    if name == "sigma":
        return "" if not cell or value >= 0.0 else "a number of 0 or more, or nothing"
    if not np.isfinite(value):
        return "a number"
    largest = _DEGREES.get(name, np.inf)
    return "" if abs(value) <= largest else f"{-largest:g} to {largest:g} degrees"


def _columns(names: list[str]) -> tuple[list[str], list[str]]:
    """Return the columns to be read, two of the place, the value, and its sigma if any; and what is missing."""
    if faults := separator_faults(names):
        return [], faults
    twice = [name for name in (*sum(_PLACES, ()), *_VALUES, "sigma", "name") if names.count(name) > 1]
    both = [" and ".join(pair) for pair in (_VALUES, ("lat", "x")) if set(pair) <= set(names)]
    if twice or both:
        return [], [f"more than one column {name}" for name in twice] + [
            f"columns {pair}: one is meant" for pair in both
        ]
    place = next((pair for pair in _PLACES if set(pair) <= set(names)), None)
    value = next((name for name in _VALUES if name in names), None)
    among = f"among {', '.join(names)}"
    faults = [] if place else [f"no columns lat and lon, or x and y, {among}"]
    faults += [] if value else [f"no column depth or height {among}"]
    if place is None or value is None:
        return [], faults
    return [*place, value, *(["sigma"] if "sigma" in names else [])], []
