"""Apparent points in a file of comma-separated values: its lines come out with the true points behind them."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.depth.correction import CHUNK, NO_POINTS, Correction, Progress, Tally, in_order, unreached
from musatpy.errors import DepthError, Problem, SystemsError
from musatpy.files import whole_file
from musatpy.pointfiles.csv_tables import ENCODING, Layout, number
from musatpy.refraction.apparent import REASONS, Fault, TruePoints
from musatpy.units import DEGREE

ADDED = (
    *("true_x", "true_y", "true_z", "depth", "factor"),
    *("cameras", "spread", "incidence", "largest_incidence", "reason"),
)


_Lines = tuple[int, list[str]]  # the number of the first of some lines of a file, and these


@dataclass(frozen=True, kw_only=True, eq=False)
class _Corrected:
    """What came of some lines: their text with the true points, or what is wrong with one of them."""

    text: bytes
    tally: Tally
    size: int
    problem: Problem | None = None


def correct_csv(
    source: Path,
    target: Path,
    correction: Correction,
    *,
    columns: Sequence[str] = ("x", "y", "z"),
    jobs: int = 1,
    progress: Progress | None = None,
) -> Tally:
    """Correct the points of a file whose first line names its columns; `progress` is told of bytes.

    Raises `DepthError` with the line that cannot be read, for points that their system does not reach and where no
    camera sees any, and `OSError`; then no file is left.
    """
    with source.open(newline="", **ENCODING) as file:  # type: ignore[call-overload]
        first = file.readline()
        layout = Layout.of(source, first, columns, ADDED, DepthError)
        tally = NO_POINTS
        work = partial(_correct_lines, correction, layout)
        with whole_file(target) as out:
            if progress:
                progress(len(first.encode(**ENCODING)))
            out.write(layout.header_with(ADDED))
            for done in in_order(work, _tasks(file), jobs):
                if done.problem is not None:
                    raise DepthError([done.problem])
                out.write(done.text)
                tally = tally + done.tally
                if progress:
                    progress(done.size)
            correction.require_sight(tally, source)
    return tally


def _tasks(file: Iterator[str]) -> Iterator[_Lines]:
    first = 2
    while lines := list(islice(file, CHUNK)):
        yield first, lines
        first += len(lines)


def _correct_lines(correction: Correction, layout: Layout, task: _Lines) -> _Corrected:
    """Return what comes of some lines; a function of the module, because other processes call it."""
    size = len("".join(task[1]).encode(**ENCODING))
    lines = [line.rstrip("\r\n") for line in task[1] if line.strip()]
    nothing = _Corrected(text=b"", tally=NO_POINTS, size=size)
    if not lines:
        return nothing
    try:
        apparent = _numbers(lines, layout)
    except (ValueError, csv.Error):
        return replace(nothing, problem=_bad_line(layout, *task))
    try:
        points, seen = correction(apparent)
    except SystemsError as error:
        return replace(nothing, problem=unreached(layout.source, error))
    names = _names(correction.cameras.names, seen)
    text = "".join(_texts(lines, names, points, correction.ground.system.decimals))
    return _Corrected(text=text.encode(**ENCODING), tally=Tally.of(points), size=size)


def _numbers(lines: Sequence[str], layout: Layout) -> FloatArray:
    """Return the coordinates (n, 3) of lines, NaN for blank ones.

    Raises `ValueError` or `csv.Error` for a line that has not the values it should.
    """
    plain = [line for line in lines if '"' not in line]
    if not {line.count(",") for line in plain} <= {len(layout.names) - 1}:
        raise ValueError("a line has not as many values as there are names")
    try:
        if len(plain) < len(lines):
            raise ValueError("values in quotes are looked at one by one")
        return np.loadtxt(lines, delimiter=",", usecols=layout.places, comments=None, ndmin=2)
    except ValueError:  # a coordinate that is missing, perhaps; few lines have one, and few files quotes
        return np.array([_coordinates(line, layout) for line in lines])


def _coordinates(line: str, layout: Layout) -> list[float]:
    """Return the coordinates of a line, NaN for a blank one; raises `ValueError` that says what is wrong."""
    values = next(csv.reader([line], strict=True), [])
    if len(values) != len(layout.names):
        raise ValueError(f"{len(values)} values for {len(layout.names)} names")
    return [_coordinate(values[place], place) for place in layout.places]


def _coordinate(text: str, place: int) -> float:
    value = number(text)
    if math.isnan(value) and text.strip().lower() not in ("", "nan"):
        raise ValueError(f"value {place + 1}: '{text.strip()}' is no number")
    return value


def _bad_line(layout: Layout, first: int, lines: Sequence[str]) -> Problem:
    """Return the problem of the first line that has not the values it should."""
    for place, line in enumerate(lines, first):
        try:
            if line.strip():
                _coordinates(line.rstrip("\r\n"), layout)
        except csv.Error:
            return Problem(file=layout.source, line=place, message="a text in quotes does not end on its line")
        except ValueError as error:
            return Problem(file=layout.source, line=place, message=str(error))
    raise AssertionError("one of the lines is bad")


def _texts(
    lines: Sequence[str], names: Sequence[str], points: TruePoints, decimals: tuple[int, int, int]
) -> list[str]:
    """Return lines with the true points behind them, the names of the cameras alone of one with a fault."""
    columns = (
        *points.position.T,
        points.depth,
        points.factor,
        names,
        points.spread,
        points.incidence / DEGREE,
        points.largest_incidence / DEGREE,
    )
    listed = (column.tolist() if isinstance(column, np.ndarray) else column for column in columns)
    places = ",".join(f"%.{places}f" for places in (*decimals, 4, 5))
    # of points with a fault the numbers are NaN, and those few texts are made anew
    texts = list(map(f"%s,{places},%s,%.4f,%.2f,%.2f,\n".__mod__, zip(lines, *listed, strict=True)))
    for row in np.flatnonzero(points.fault != Fault.NONE).tolist():
        texts[row] = f"{lines[row]},,,,,,{names[row]},,,,{REASONS[Fault(points.fault[row])]}\n"
    return texts


def _names(names: tuple[str, ...], seen: BoolArray) -> list[str]:
    """Return the names of the cameras that see each point, blanks between them."""
    bits = np.packbits(seen, axis=1)
    patterns = bits.view(f"V{bits.shape[1]}").ravel().tolist()
    texts: dict[bytes, str] = {}
    for pattern in set(patterns):
        chosen = np.unpackbits(np.frombuffer(pattern, dtype=np.uint8), count=len(names))
        texts[pattern] = " ".join(name for name, sees in zip(names, chosen.tolist(), strict=True) if sees)
    return [texts[pattern] for pattern in patterns]
