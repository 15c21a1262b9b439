"""Points as text: comma-separated values under a line of names (`.csv`), or bare x, y, z apart by blanks.

A name has its unit in brackets behind it: `depth [m]`. What the bare form has besides coordinates are numbers, by
their places: `column4` and so on. Neither form says its coordinate system. Files of any size come and go in chunks.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from io import StringIO
from itertools import islice
from pathlib import Path

import numpy as np
import pyproj

from musatpy.arrays import FloatArray
from musatpy.errors import InterchangeError, Problem
from musatpy.files import whole_file
from musatpy.interchange.layers import Column, Points, joined, with_numbers
from musatpy.interchange.packages import fault, refuse, require_content
from musatpy.pointfiles.csv_tables import ENCODING, FAR, Layout, common_name, names_of, number

CHUNK = 65536  # lines at a time
_NAMED = ".csv"
_AXES = ("x", "y", "z")
_ALIKE = (("x", "lon"), ("y", "lat"), ("height",))  # what else they may be
_WITH_UNIT = re.compile(r"(.*\S)\s*\[([^\[\]]*)\]")
_DECIMALS, _DEGREE_DECIMALS = 4, 9  # 0.1 mm


@dataclass(frozen=True, kw_only=True)
class _Form:
    """The columns of a file: names, units, places of x, y and z among them; parted by commas where `named`."""

    path: Path
    named: bool
    names: tuple[str, ...]
    units: tuple[str, ...]
    places: tuple[int, ...]

    def values(self, line: str) -> list[str]:
        """Return the values of a line."""
        return next(csv.reader([line.rstrip("\r\n")])) if self.named else line.split()

    @property
    def others(self) -> list[int]:
        """Places of the columns that are no coordinates."""
        return [place for place in range(len(self.names)) if place not in self.places]


def write(path: Path, points: Points) -> None:
    """Write points, named columns where the file is a `.csv`: numbers to 0.1 mm, nothing where there is none.

    Raises `InterchangeError` for texts in the bare form; `OSError`.
    """
    write_chunks(path, [points])


def write_chunks(path: Path, chunks: Iterable[Points]) -> None:
    """Write points that come in chunks of the same columns, as `write` does."""
    named = path.suffix.lower() == _NAMED
    with whole_file(path) as file:
        for position, points in enumerate(chunks):
            file.write(_text(path, points, named, with_names=named and position == 0).encode(**ENCODING))


def read(path: Path, columns: Sequence[str] = _AXES, crs: pyproj.CRS | None = None, heights: str = "") -> Points:
    """Read points, of a `.csv` file by the names of the columns of x, y and z, in any case.

    Raises `InterchangeError` with every line that cannot be read; `OSError`.
    """
    return with_numbers(joined(list(read_chunks(path, columns, crs, heights))))


def read_chunks(
    path: Path,
    columns: Sequence[str] = _AXES,
    crs: pyproj.CRS | None = None,
    heights: str = "",
    *,
    alone: bool = False,
) -> Iterator[Points]:
    """Yield the points of a file in chunks; their further columns are texts, as they stand in the file.

    `alone` leaves these out, for who needs coordinates only. Raises `InterchangeError` after the last chunk with
    every line that cannot be read; `OSError`.
    """
    require_content(path)
    problems: list[Problem] = []
    count = 0
    with path.open(newline="", **ENCODING) as file:  # type: ignore[call-overload]
        named = path.suffix.lower() == _NAMED
        form = _named_form(path, file.readline().rstrip("\r\n"), columns) if named else None
        first = 2 if named else 1  # line of the next chunk
        while chunk := list(islice(file, CHUNK)):
            texts = [line for line in map(_unmarked, chunk) if line and not line.isspace()]
            if texts:
                form = form or _bare_form(path, texts[0])
                xyz = _numbers(form, texts)
                if xyz is None:
                    xyz, faults = _checked_numbers(form, first, chunk)
                    problems += faults
                count += len(texts)
                if not problems:
                    others = {} if alone else _others(form, texts)
                    yield Points(xyz=xyz, columns=others, crs=crs, heights=heights)
            first += len(chunk)
    if problems:
        raise InterchangeError(problems)
    if not count:
        raise refuse(path, "", "there are no points", "a line of each point")


def _unmarked(line: str) -> str:
    """Return a line without the mark of an encoding, which the first line of a file may have."""
    return line.removeprefix("\ufeff")


def _named_form(path: Path, header: str, columns: Sequence[str]) -> _Form:
    plain = _without_units(header)
    layout = Layout.of(path, plain, _axes_among(names_of(plain), columns), (), InterchangeError)
    units = tuple(_parted(name)[1] for name in names_of(header))
    return _Form(path=path, named=True, names=layout.names, units=units, places=layout.places)


def _axes_among(names: Sequence[str], wanted: Sequence[str]) -> Sequence[str]:
    """Return the names of x, y and z: as they are wanted, or, where nothing else is, by other names of theirs."""
    if tuple(wanted) != _AXES or {*_AXES} <= {name.lower() for name in names}:
        return wanted
    return [
        next((name for name in names if common_name(name) in alike), axis)
        for axis, alike in zip(_AXES, _ALIKE, strict=True)
    ]


def _bare_form(path: Path, first: str) -> _Form:
    width = len(first.split())
    names = (*_AXES, *(f"column{place}" for place in range(4, width + 1)))
    return _Form(path=path, named=False, names=names, units=("",) * len(names), places=(0, 1, 2))


def _numbers(form: _Form, lines: Sequence[str]) -> FloatArray | None:
    """Return the coordinates (n, 3) of lines, None where one of them has to be looked at by itself."""
    width = len(form.names)
    if form.named and any(line.count(",") != width - 1 or '"' in line for line in lines):
        return None
    delimiter, wanted = (",", form.places) if form.named else (None, range(width))
    try:
        table = np.loadtxt(lines, delimiter=delimiter, usecols=wanted, comments=None, ndmin=2)
    except ValueError:
        return None
    return table[:, :3] if (np.abs(table[:, :3]) <= FAR).all() else None


def _checked_numbers(form: _Form, first: int, lines: Sequence[str]) -> tuple[FloatArray, list[Problem]]:
    """Return the coordinates (n, 3) of lines from the number of the first on, and what is wrong with them."""
    problems: list[Problem] = []
    rows = [(line, text) for line, text in enumerate(map(_unmarked, lines), first) if text.strip()]
    names, xyz = form.names, np.full((len(rows), 3), np.nan)
    for i, (line, text) in enumerate(rows):
        values = form.values(text)
        if len(values) != len(names):
            problems.append(
                fault(form.path, "", f"{len(values)} values", f"{len(names)}: {', '.join(names)}", line)
            )
            continue
        xyz[i] = [number(values[place]) for place in form.places]
        for axis in np.flatnonzero(~np.isfinite(xyz[i])).tolist():
            place = form.places[axis]
            problems.append(fault(form.path, names[place], f"'{values[place].strip()}'", "a coordinate", line))
    return xyz, problems


def _others(form: _Form, lines: Sequence[str]) -> dict[str, Column]:
    """Return what lines have besides coordinates, as texts."""
    if not form.others:
        return {}
    plain = form.named and not any('"' in line for line in lines)
    rows = csv.reader(lines) if plain else (form.values(line) for line in lines)
    columns = list(zip(*rows, strict=True))
    return {
        form.names[place]: Column(values=np.array(columns[place], dtype=np.str_), unit=form.units[place])
        for place in form.others
    }


def _text(path: Path, points: Points, named: bool, with_names: bool) -> str:
    """Return the lines of points. Raises `InterchangeError`."""
    texts = [name for name, column in points.columns.items() if column.is_text]
    if texts and not named:
        raise refuse(path, f"columns {', '.join(texts)}", "texts in a file of bare numbers", f"a {_NAMED} file")
    plan = _DEGREE_DECIMALS if points.crs is not None and points.crs.is_geographic else _DECIMALS
    values = [_fixed(axis, decimals) for axis, decimals in zip(points.xyz.T, (plan, plan, _DECIMALS), strict=True)]
    values += [_texts(column, empty="" if named else "nan") for column in points.columns.values()]
    out = StringIO()
    writer = csv.writer(out, delimiter="," if named else " ", lineterminator="\n")
    if with_names:
        units = [f"{name} [{column.unit}]" if column.unit else name for name, column in points.columns.items()]
        writer.writerow([*_AXES, *units])
    writer.writerows(zip(*values, strict=True))
    return out.getvalue()


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
