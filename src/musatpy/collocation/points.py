"""Files of mapped points of any size: each line comes out with its corrected height, or why it has none."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from musatpy.collocation.interpolation import Interpolation
from musatpy.collocation.tables import Mapped, RecordPoint, number_fault
from musatpy.errors import CollocationError, Problem
from musatpy.files import whole_file

FloatArray = NDArray[np.float64]
Progress = Callable[[int], None]  # told how many bytes more of a file are done

ADDED = ("z_corrected", "correction", "sigma", "reason")
CHUNK = 16384  # lines at a time
_MOST_PROBLEMS = 100
_ENCODING = {"encoding": "utf-8", "errors": "surrogateescape"}  # whatever the texts are, they come out as they were


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


def correct(found: Interpolation, mapped: FloatArray) -> tuple[Corrected, Tally]:
    """Return corrected heights of mapped points (m, 3): mapped less the error predicted there.

    A point farther than the reach from the nearest control point used has none. The estimated noise counts in the
    sigmas: it is what no function explains and what mapping by itself errs by, at these points as at control.
    """
    predicted = found.uncertain.predict(mapped[:, :2])
    far = predicted.distance > found.reach
    reason = [f"no control within {found.reach:.1f} m" if one else "" for one in far.tolist()]
    good = ~far
    squares = float(np.square(predicted.value[good]).sum())
    sigma = np.sqrt(predicted.sigma**2 + found.best.estimate.covariance.noise)
    corrected = Corrected(z=mapped[:, 2] - predicted.value, correction=-predicted.value, sigma=sigma, reason=reason)
    return corrected, Tally(points=len(mapped), corrected=int(good.sum()), squares=squares)


@dataclass(frozen=True, kw_only=True)
class _Layout:
    """Where the columns of a file of points stand."""

    source: str
    header: str
    names: tuple[str, ...]  # as given
    places: tuple[int, int, int]


def correct_csv(
    source: Path,
    target: Path,
    found: Interpolation,
    *,
    columns: Sequence[str] = ("x", "y", "z"),
    progress: Progress | None = None,
) -> Tally:
    """Correct the points of a file whose first line names its columns; `progress` is told of bytes.

    Raises `CollocationError` with every line that cannot be read, and `OSError`; then no file is left.
    """
    tally, problems = Tally(), list[Problem]()
    with source.open(newline="", **_ENCODING) as file, whole_file(target) as out:  # type: ignore[call-overload]
        layout = _layout(source, file.readline(), columns)
        out.write(f"{layout.header},{','.join(ADDED)}\n".encode(**_ENCODING))
        for lines, points in _chunks(layout, file, problems):
            if progress:
                progress(sum(len(line.encode(**_ENCODING)) for _, line in lines))
            if problems:
                continue  # what else is wrong is still looked for
            corrected, part = correct(found, points)
            texts = zip(lines, corrected.texts(), strict=True)
            out.write("".join(f"{line.rstrip()},{text}\n" for (_, line), text in texts).encode(**_ENCODING))
            tally += part
        if problems:
            raise CollocationError(problems)
    return tally


def read_mapped(path: Path, wanted: Iterable[str], columns: Sequence[str] = ("x", "y", "z")) -> Mapped:
    """Return the mapped points of a CSV file with the wanted ids. Raises as `correct_csv`, and for an id twice."""
    problems: list[Problem] = []
    looked_for, mapped = set(wanted), dict[str, tuple[float, float, float]]()
    with path.open(newline="", **_ENCODING) as file:  # type: ignore[call-overload]
        layout = _layout(path, file.readline(), columns)
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


def _layout(source: Path, first: str, columns: Sequence[str]) -> _Layout:
    header = first.removeprefix("\ufeff").rstrip("\r\n")
    names = tuple(name.strip() for name in next(csv.reader([header]), []))
    lower = [name.lower() for name in names]
    messages = [
        f"{'no' if name.lower() not in lower else 'more than one'} column {name} among {', '.join(names)}"
        for name in columns
        if lower.count(name.lower()) != 1
    ]
    messages += [f"there is a column {name} already" for name in names if name.lower() in ADDED]
    if messages:
        raise CollocationError([Problem(file=str(source), line=1, message=message) for message in messages])
    x, y, z = (lower.index(name.lower()) for name in columns)
    return _Layout(source=str(source), header=header, names=names, places=(x, y, z))


def _chunks(
    layout: _Layout, file: Iterator[str], problems: list[Problem]
) -> Iterator[tuple[list[tuple[int, str]], FloatArray]]:
    """Yield lines with their numbers, and their points (m, 3); what is wrong is added to the problems."""
    numbered = ((number, line) for number, line in enumerate(file, 2) if line.strip())
    while lines := list(islice(numbered, CHUNK)):
        try:
            texts = [line for _, line in lines]
            points = np.loadtxt(texts, delimiter=",", usecols=layout.places, quotechar='"', comments=None, ndmin=2)
            if not np.isfinite(points).all():
                raise ValueError
        except ValueError:
            points = np.empty((0, 3))
            problems += [problem for line in lines for problem in _faults(layout, *line)]
            if len(problems) >= _MOST_PROBLEMS:
                raise CollocationError(problems[:_MOST_PROBLEMS]) from None
        yield lines, points


def _faults(layout: _Layout, number: int, line: str) -> Iterator[Problem]:
    values = [value.strip() for value in next(csv.reader([line]))]
    for place in layout.places:
        message = "is missing" if place >= len(values) else number_fault(values[place])
        if message:
            yield Problem(file=layout.source, line=number, field=layout.names[place], message=message)


def corrected_record(target: Path, found: Interpolation, points: Sequence[RecordPoint]) -> Tally:
    """Write the points of a record, corrected where they are to be, as CSV. Raises `OSError`."""
    wet = [point for point in points if point.position is not None and not point.reason]
    places = np.array([point.position for point in wet], dtype=float).reshape(len(wet), 3)
    corrected, tally = correct(found, places)
    texts = dict(zip((point.id for point in wet), corrected.texts(), strict=True))
    lines = [f"id,x,y,z,{','.join(ADDED)}"]
    for point in points:
        place = ",," if point.position is None else ",".join(f"{value:.4f}" for value in point.position)
        lines.append(f"{point.id},{place},{texts.get(point.id, f',,,{_quoted(point.reason)}')}")
    with whole_file(target) as out:
        out.write("".join(f"{line}\n" for line in lines).encode(**_ENCODING))
    return tally + Tally(points=len(points) - len(wet))


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if "," in text or '"' in text else text
