"""Files of mapped points of any size: each line comes out with its corrected height, or why it has none."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import CollocationError
from musatpy.files import whole_file
from musatpy.geometry.crs import Plan
from musatpy.geometry.systems import System
from musatpy.pointfiles.columns import AXES, Column, Wanted, place_columns
from musatpy.pointfiles.las_files import coordinates, rewritten
from musatpy.pointfiles.point_tables import ENCODING, quoted, read_chunks
from musatpy.sea.interpolation.control_tables import Mapped, RecordPoint
from musatpy.sea.interpolation.interpolate import Interpolation

Progress = Callable[[int], None]  # told how many bytes more of a file are done

ADDED = ("z_corrected", "correction", "sigma", "reason")
# Extra dimension -> type and what it is, in the 32 characters that a file has for it
_DIMENSIONS = {
    "mapped_z": ("f8", "height before the correction, m"),
    "correction": ("f4", "of the height, m"),
    "sigma": ("f4", "of the correction, m"),
    "reason": ("u1", "0 corrected, 1 no control near"),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrected:
    """Heights (m,) m as corrected, corrections and sigmas (m,) m, and why a point has none ('' where it has)."""

    z: FloatArray
    correction: FloatArray
    sigma: FloatArray
    reason: list[str]

    def texts(self) -> Iterator[tuple[str, str, str, str]]:
        """Yield the values of `ADDED` of each point."""
        rows = zip(self.z.tolist(), self.correction.tolist(), self.sigma.tolist(), self.reason, strict=True)
        for z, correction, sigma, reason in rows:
            yield ("", "", "", reason) if reason else (f"{z:.4f}", f"{correction:.4f}", f"{sigma:.4f}", "")


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
    columns: Sequence[str] = AXES,
    plan: Plan | None = None,
    progress: Progress | None = None,
) -> Tally:
    """Correct the points of a table with these columns; `progress` is told of bytes.

    `plan`: on which map points on the ellipsoid are. Raises `CollocationError` with every line that cannot be read,
    `SystemsError` and `OSError`; then no file is left.
    """
    tally, places = Tally(), place_columns(columns, plan.system.units if plan else ("m", "m", "m"))
    tables = read_chunks(source, Wanted(columns=places, bare=tuple(columns), added=ADDED), CollocationError)
    first = next(tables)
    with whole_file(target) as out:
        out.write(first.layout.header_with(ADDED).encode(**ENCODING))
        for table in chain([first], tables):
            if table.rows:
                points = table.numbers(*(place.name for place in places))
                corrected, part = correct(interpolation, points, plan)
                out.write(table.layout.rows_with(table.rows, corrected.texts()).encode(**ENCODING))
                tally += part
            if progress:
                progress(table.size)
    return tally


def correct_las(
    source: Path,
    target: Path,
    interpolation: Interpolation,
    *,
    plan: Plan | None = None,
    progress: Progress | None = None,
) -> Tally:
    """Correct the heights of a LAS or LAZ file, in extra dimensions; `progress` is told of points.

    A point that is not corrected keeps its height, and has 1 as the reason.

    Raises `InterchangeError` without laspy, for a file that is none, has an extra dimension already or cannot hold
    the heights; `OSError`.
    """
    tally = Tally()
    with rewritten(source, target, _DIMENSIONS) as (chunks, write):
        for given in chunks:
            corrected, part = correct(interpolation, coordinates(given), plan)
            good = np.array([not reason for reason in corrected.reason])
            values = {
                "mapped_z": given.z,
                "reason": ~good,
                "correction": np.where(good, corrected.correction, 0.0),
                "sigma": np.where(good, corrected.sigma, 0.0),
                "z": np.where(good, corrected.z, given.z),
            }
            write(given, values)
            tally += part
            if progress:
                progress(len(given))
    return tally


def read_mapped(path: Path, wanted: Iterable[str], columns: Sequence[str], system: System) -> Mapped:
    """Return the mapped points of a table with the wanted ids, places in a system. Raises as `correct_csv`.

    An id of one of them that is there a second time is a fault too.
    """
    looked_for, mapped = set(wanted), dict[str, tuple[float, float, float]]()
    places = place_columns(columns, system.units)
    names = Column(name="id", kind="text", blank=True)
    for table in read_chunks(path, Wanted(columns=(names, *places), added=ADDED), CollocationError):
        points = table.numbers(*(place.name for place in places)).tolist()
        for row, name in enumerate(table.texts("id")):
            if name in mapped:
                table.refuse(f"control point '{name}' is there a second time", row, "id")
            elif name in looked_for:
                x, y, z = points[row]
                mapped[name] = (x, y, z)
        table.require(CollocationError)
    return mapped


def corrected_record(
    target: Path, interpolation: Interpolation, points: Sequence[RecordPoint], plan: Plan | None = None
) -> Tally:
    """Write the points of a record, corrected where they are to be, as CSV. Raises `OSError`."""
    wet = [point for point in points if point.position is not None and not point.reason]
    places = np.array([point.position for point in wet], dtype=float).reshape(len(wet), 3)
    corrected, tally = correct(interpolation, places, plan)
    texts = dict(zip((point.id for point in wet), map(",".join, corrected.texts()), strict=True))
    lines, decimals = [f"id,x,y,z,{','.join(ADDED)}"], (4, 4, 4) if plan is None else plan.system.decimals
    for point in points:
        place = ",," if point.position is None else _decimal(point.position, decimals)
        lines.append(f"{point.id},{place},{texts.get(point.id, f',,,{quoted(point.reason)}')}")
    with whole_file(target) as out:
        out.write("".join(f"{line}\n" for line in lines).encode(**ENCODING))
    return tally + Tally(points=len(points) - len(wet))


def _decimal(place: tuple[float, float, float], decimals: tuple[int, int, int]) -> str:
    return ",".join(f"{value:.{number}f}" for value, number in zip(place, decimals, strict=True))
