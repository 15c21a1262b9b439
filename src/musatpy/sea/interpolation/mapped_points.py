"""Files of mapped points of any size: each line comes out with its corrected height, or why it has none."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import CollocationError, Problem
from musatpy.files import whole_file
from musatpy.geometry.crs import Plan
from musatpy.pointfiles.csv_tables import ENCODING, Layout
from musatpy.sea.interpolation.control_tables import Mapped, RecordPoint, number_fault
from musatpy.sea.interpolation.interpolate import Interpolation

Progress = Callable[[int], None]  # told how many bytes more of a file are done

ADDED = ("z_corrected", "correction", "sigma", "reason")
CHUNK = 16384  # lines at a time
_MOST_PROBLEMS = 100


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrected:
    """Heights (m,) m as corrected, corrections and sigmas (m,) m, and why a point has none ('' where it has)."""

    z: FloatArray
    correction: FloatArray
    sigma: FloatArray
    reason: list[str]

    def texts(self) -> Iterator[str]:
        """Yield the values of `ADDED` of each point."""
        rows = zip(self.z.tolist(), self.correction.tolist(), self.sigma.tolist(), self.reason, strict=True)
        for z, correction, sigma, reason in rows:
            yield f",,,{reason}" if reason else f"{z:.4f},{correction:.4f},{sigma:.4f},"


@dataclass(frozen=True, kw_only=True)
class Tally:
    """How many points there were, and how many of them are corrected; sum of squares (m2) of the corrections."""

    points: int = 0
    corrected: int = 0
    squares: float = 0.0

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            points=self.points + other.points,
            corrected=self.corrected + other.corrected,
            squares=self.squares + other.squares,
        )

    def in_words(self) -> str:
        """Return the tally in a line."""
        size = (self.squares / self.corrected) ** 0.5 if self.corrected else 0.0
        return f"{self.points} points, {self.corrected} corrected, by {size:.3f} m RMS"


def correct(interpolation: Interpolation, mapped: FloatArray, plan: Plan | None = None) -> tuple[Corrected, Tally]:
    """Return corrected heights of mapped points (m, 3), or of a `plan`: mapped less the error predicted there.

    A point farther than the reach from the nearest control point used has none.
    """
    places = mapped if plan is None else plan.places(mapped)
    predicted = interpolation.uncertain.predict(places[:, :2])
    far = predicted.distance > interpolation.reach
    reason = [f"no control within {interpolation.reach:.1f} m" if is_far else "" for is_far in far.tolist()]
    good = ~far
    squares = float(np.square(predicted.value[good]).sum())
    corrected = Corrected(
        z=mapped[:, 2] - predicted.value,
        correction=-predicted.value,
        sigma=interpolation.sigma(predicted),
        reason=reason,
    )
    return corrected, Tally(points=len(mapped), corrected=int(good.sum()), squares=squares)


def correct_csv(
    source: Path,
    target: Path,
    interpolation: Interpolation,
    *,
    columns: Sequence[str] = ("x", "y", "z"),
    plan: Plan | None = None,
    progress: Progress | None = None,
) -> Tally:
    """Correct the points of a file whose first line names its columns; `progress` is told of bytes.

    `plan`: on which map points on the ellipsoid are. Raises `CollocationError` with every line that cannot be read,
    `SystemsError` and `OSError`; then no file is left.
    """
    tally, problems = Tally(), list[Problem]()
    with source.open(newline="", **ENCODING) as file, whole_file(target) as out:  # type: ignore[call-overload]
        layout = Layout.of(source, file.readline(), columns, ADDED, CollocationError)
        out.write(layout.header_with(ADDED))
        for lines, points in _chunks(layout, file, problems):
            if progress:
                progress(sum(len(line.encode(**ENCODING)) for _, line in lines))
            if problems:
                continue  # what else is wrong is still looked for
            corrected, part = correct(interpolation, points, plan)
            texts = zip(lines, corrected.texts(), strict=True)
            out.write("".join(f"{line.rstrip()},{text}\n" for (_, line), text in texts).encode(**ENCODING))
            tally += part
        if problems:
            raise CollocationError(problems)
    return tally


def read_mapped(path: Path, wanted: Iterable[str], columns: Sequence[str] = ("x", "y", "z")) -> Mapped:
    """Return the mapped points of a CSV file with the wanted ids. Raises as `correct_csv`, and for an id twice."""
    problems: list[Problem] = []
    looked_for, mapped = set(wanted), dict[str, tuple[float, float, float]]()
    with path.open(newline="", **ENCODING) as file:  # type: ignore[call-overload]
        layout = Layout.of(path, file.readline(), columns, ADDED, CollocationError)
        lower = [name.lower() for name in layout.names]
        if "id" not in lower:
            message = f"no column id among {', '.join(layout.names)}: control points are looked up by it"
            raise CollocationError([Problem(file=layout.source, line=1, message=message)])
        for lines, points in _chunks(layout, file, problems):
            for (number, line), (x, y, z) in zip(lines, points.tolist(), strict=False):
                name = next(csv.reader([line]))[lower.index("id")].strip()
                if name in mapped:
                    message = f"control point '{name}' is there a second time"
                    problems.append(Problem(file=layout.source, line=number, field="id", message=message))
                elif name in looked_for:
                    mapped[name] = (x, y, z)
    if problems:
        raise CollocationError(problems)
    return mapped


def _chunks(
    layout: Layout, file: Iterator[str], problems: list[Problem]
) -> Iterator[tuple[list[tuple[int, str]], FloatArray]]:
    """Yield lines with their numbers, and their points (m, 3); what is wrong is added to the problems."""
    numbered = ((number, line) for number, line in enumerate(file, 2) if line.strip())
    while lines := list(islice(numbered, CHUNK)):
        try:
            points = _numbers(layout, [line for _, line in lines])
        except ValueError:  # looked at one by one, which is slow
            faults = [problem for line in lines for problem in _faults(layout, *line)]
            problems += faults
            if len(problems) >= _MOST_PROBLEMS:
                raise CollocationError(problems[:_MOST_PROBLEMS]) from None
            points = np.empty((0, 3)) if faults else np.array([_coordinates(layout, line) for _, line in lines])
        yield lines, points


def _numbers(layout: Layout, lines: Sequence[str]) -> FloatArray:
    """Return the points (m, 3) of lines; raises `ValueError` where one has to be looked at by itself."""
    if any('"' not in line and line.count(",") != len(layout.names) - 1 for line in lines):
        raise ValueError
    points = np.loadtxt(lines, delimiter=",", usecols=layout.places, quotechar='"', comments=None, ndmin=2)
    if any('"' in line for line in lines) or not np.isfinite(points).all():
        raise ValueError
    return points


def _coordinates(layout: Layout, line: str) -> list[float]:
    values = next(csv.reader([line]))
    return [float(values[place]) for place in layout.places]


def _faults(layout: Layout, number: int, line: str) -> Iterator[Problem]:
    values = [value.strip() for value in next(csv.reader([line]))]
    if len(values) != len(layout.names):
        message = f"{len(values)} values for {len(layout.names)} columns"
        yield Problem(file=layout.source, line=number, message=message)
        return
    for place in layout.places:
        message = number_fault(values[place])
        if message:
            yield Problem(file=layout.source, line=number, field=layout.names[place], message=message)


def corrected_record(
    target: Path, interpolation: Interpolation, points: Sequence[RecordPoint], plan: Plan | None = None
) -> Tally:
    """Write the points of a record, corrected where they are to be, as CSV. Raises `OSError`."""
    wet = [point for point in points if point.position is not None and not point.reason]
    places = np.array([point.position for point in wet], dtype=float).reshape(len(wet), 3)
    corrected, tally = correct(interpolation, places, plan)
    texts = dict(zip((point.id for point in wet), corrected.texts(), strict=True))
    lines, decimals = [f"id,x,y,z,{','.join(ADDED)}"], (4, 4, 4) if plan is None else plan.system.decimals
    for point in points:
        place = ",," if point.position is None else _decimal(point.position, decimals)
        lines.append(f"{point.id},{place},{texts.get(point.id, f',,,{_quoted(point.reason)}')}")
    with whole_file(target) as out:
        out.write("".join(f"{line}\n" for line in lines).encode(**ENCODING))
    return tally + Tally(points=len(points) - len(wet))


def _decimal(place: tuple[float, float, float], decimals: tuple[int, int, int]) -> str:
    return ",".join(f"{value:.{number}f}" for value, number in zip(place, decimals, strict=True))


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if "," in text or '"' in text else text
