"""Files of apparent points, written again with the true ones: tables, and clouds in LAS or LAZ (the extra `las`).

A line of a table has the true point behind it. A point of a cloud has its true place, and in extra dimensions what
it is worth; one that is not corrected keeps its coordinates, and has the number of the reason (`Fault`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import chain, tee
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.depth.correction import (
    NO_POINTS,
    Correction,
    CorrectionTally,
    Progress,
    attempted,
    in_order,
    require_sight,
)
from musatpy.errors import DepthError, Problem
from musatpy.files import whole_file
from musatpy.pointfiles.columns import AXES, Wanted, place_columns
from musatpy.pointfiles.las_files import coordinates, rewritten
from musatpy.pointfiles.point_tables import ENCODING, Layout, read_chunks
from musatpy.refraction.apparent import REASONS, Fault, TruePoints
from musatpy.units import DEGREE

# What is said of a point: decimals in a table, where it is a number; type in a cloud, and what it is, in the 32
# characters that a LAS file has for it.
_SAID: dict[str, tuple[int, str, str]] = {
    "depth": (4, "f4", "below the mean tide, m"),
    "factor": (5, "f4", "depth / apparent depth"),
    "cameras": (0, "u2", "how many see the point"),
    "spread": (4, "f4", "of the depths of each camera, m"),
    "incidence": (2, "f4", "mean angle in air, degrees"),
    "largest_incidence": (2, "f4", "largest angle in air, degrees"),
    "reason": (0, "u1", "0 corrected, else why not"),
}
_SIGMAS: dict[str, tuple[int, str, str]] = {  # where the stations have any
    "sigma_east": (4, "f4", "of the true place, m"),
    "sigma_north": (4, "f4", "of the true place, m"),
    "sigma_height": (4, "f4", "of the true place, m"),
    "sigma_depth": (4, "f4", "m"),
}
_APPARENT = {
    "apparent_x": ("f8", "before the correction"),
    "apparent_y": ("f8", "before the correction"),
    "apparent_z": ("f8", "height before the correction, m"),
}
ADDED, SIGMAS = ("true_x", "true_y", "true_z", *_SAID), tuple(_SIGMAS)  # columns of a table
_WORD = 64  # cameras of one dimension of bits

_Task = tuple[Layout, Sequence[str], FloatArray, int]  # rows of a file with their points (n, 3), and bytes of these
_Corrected = tuple[str, CorrectionTally, int]  # rows with the true points, what they are, and bytes of the file


def _said(points: TruePoints, correction: Correction) -> dict[str, Any]:
    """Return what is said of points, in the order of the columns."""
    sigmas = () if correction.errors is None else (*points.sigma.T, points.depth_sigma)
    return {
        "depth": points.depth,
        "factor": points.factor,
        "cameras": points.cameras,
        "spread": points.spread,
        "incidence": points.incidence / DEGREE,
        "largest_incidence": points.largest_incidence / DEGREE,
        "reason": points.fault,
        **dict(zip(SIGMAS, sigmas, strict=False)),
    }


def correct_csv(
    source: Path,
    target: Path,
    correction: Correction,
    *,
    columns: Sequence[str] = AXES,
    jobs: int = 1,
    progress: Progress | None = None,
) -> CorrectionTally:
    """Correct the points of a table with these columns; `progress` is told of bytes.

    Raises `DepthError` with every line that cannot be read, for points that their system does not reach and where
    no camera sees any, and `OSError`; then no file is left.
    """
    places = place_columns(columns, correction.points_in.units, blank=True)
    added = ADDED if correction.errors is None else (*ADDED, *SIGMAS)
    tables = read_chunks(source, Wanted(columns=places, bare=tuple(columns), added=added), DepthError)
    first, tally = next(tables), NO_POINTS
    names = [place.name for place in places]
    tasks = ((t.layout, t.rows, t.numbers(*names), t.size) for t in chain([first], tables))
    with whole_file(target) as out:
        out.write(first.layout.header_with(added).encode(**ENCODING))
        for done in in_order(partial(_correct_rows, correction), tasks, jobs):
            if isinstance(done, Problem):
                raise DepthError([done])
            text, part, size = done
            out.write(text.encode(**ENCODING))
            tally = tally + part
            if progress:
                progress(size)
        require_sight(correction, tally, source, first.numbers(*names))
    return tally


def _correct_rows(correction: Correction, task: _Task) -> _Corrected | Problem:
    """Return what comes of some rows; a function of the module, because other processes call it."""
    layout, rows, apparent, size = task
    if not rows:
        return "", NO_POINTS, size
    done = attempted(correction, layout.source, apparent)
    if isinstance(done, Problem):
        return done
    points, seen = done
    values = zip(*_texts(correction, points, seen), strict=True)
    return layout.rows_with(rows, values), CorrectionTally.of(points), size


def _texts(correction: Correction, points: TruePoints, seen: BoolArray) -> Iterator[Sequence[str]]:
    """Yield the texts of the columns that are added; of points with a fault the names of the cameras alone."""
    good = (points.fault == Fault.NONE).tolist()

    def numbers(values: FloatArray, decimals: int) -> list[str]:
        form = f"%.{decimals}f"
        return [form % value if is_good else "" for value, is_good in zip(values.tolist(), good, strict=True)]

    for values, decimals in zip(points.position.T, correction.points_in.decimals, strict=True):
        yield numbers(values, decimals)
    for name, said in _said(points, correction).items():
        if name == "cameras":
            yield _names(correction.cameras.names, seen)
        elif name == "reason":
            yield [REASONS[Fault(fault)] for fault in said.tolist()]
        else:
            yield numbers(said, (_SAID | _SIGMAS)[name][0])


def _names(names: tuple[str, ...], seen: BoolArray) -> list[str]:
    """Return the names of the cameras that see each point, blanks between them."""
    patterns, which = np.unique(seen, axis=0, return_inverse=True)
    texts = [" ".join(name for name, sees in zip(names, row, strict=True) if sees) for row in patterns.tolist()]
    return [texts[row] for row in which.ravel().tolist()]


def correct_las(
    source: Path, target: Path, correction: Correction, *, jobs: int = 1, progress: Progress | None = None
) -> CorrectionTally:
    """Correct the points of a cloud; `progress` is told of points.

    Raises `InterchangeError` without laspy, for a file that is none or that cannot hold the true points,
    `DepthError` for points that their system does not reach, and where no camera sees any; `OSError`.
    """
    said = _SAID if correction.errors is None else _SAID | _SIGMAS
    words = [f"camera_bits_{word}" for word in range(-(-len(correction.cameras.names) // _WORD))]
    dimensions = _APPARENT | {name: (kind, what) for name, (_, kind, what) in said.items()}
    dimensions |= dict.fromkeys(words, ("u8", "which see it, in their order"))
    tally, some = NO_POINTS, np.empty((0, 3))
    with rewritten(source, target, dimensions) as (chunks, write):
        given, waiting = tee(chunks)  # these stay in this process
        work = in_order(partial(attempted, correction, str(source)), map(coordinates, waiting), jobs)
        for points, done in zip(given, work, strict=True):
            if isinstance(done, Problem):
                raise DepthError([done])
            true, seen = done
            tally, some = tally + CorrectionTally.of(true), coordinates(points) if not tally.seen else some
            place = np.where((true.fault == Fault.NONE)[:, None], true.position, coordinates(points))
            bits = np.pad(seen, ((0, 0), (0, _WORD * len(words) - seen.shape[1])))
            values = {f"apparent_{name}": points[name] for name in AXES} | dict(zip(AXES, place.T, strict=True))
            values |= _said(true, correction)
            values |= dict(zip(words, np.packbits(bits, axis=1, bitorder="little").view("<u8").T, strict=True))
            write(points, values)
            if progress:
                progress(len(points))
        require_sight(correction, tally, source, some)
    return tally
