"""Apparent points in a table: its lines come out with the true points behind them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.depth.correction import NO_POINTS, Correction, CorrectionTally, Progress, in_order
from musatpy.depth.misplaced_points import attempted, require_sight
from musatpy.errors import DepthError, Problem
from musatpy.files import whole_file
from musatpy.pointfiles.columns import AXES, Wanted, place_columns
from musatpy.pointfiles.point_tables import ENCODING, Layout, read_chunks
from musatpy.refraction.apparent import REASONS, Fault, TruePoints
from musatpy.units import DEGREE

ADDED = (
    *("true_x", "true_y", "true_z", "depth", "factor"),
    *("cameras", "spread", "incidence", "largest_incidence", "reason"),
)
SIGMAS = ("sigma_east", "sigma_north", "sigma_height", "sigma_depth")  # where the stations have any

_Task = tuple[Layout, Sequence[str], FloatArray, int]  # rows of a file with their points (n, 3), and bytes of these
_Corrected = tuple[str, CorrectionTally, int]  # rows with the true points, what they are, and bytes of the file


def correct_csv(
    source: Path,
    target: Path,
    correction: Correction,
    *,
    columns: Sequence[str] = AXES,
    jobs: int = 1,
    progress: Progress | None = None,
) -> CorrectionTally:
    """Correct the points of a file with these columns; `progress` is told of bytes.

    Raises `DepthError` with every line that cannot be read, for points that their system does not reach and where
    no camera sees any, and `OSError`; then no file is left.
    """
    places = place_columns(columns, correction.ground.system.units, blank=True)
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
    names = _names(correction.cameras.names, seen)
    texts = _values(names, points, correction.ground.system.decimals, correction.errors is not None)
    values = zip(*texts, strict=True)
    return layout.rows_with(rows, values), CorrectionTally.of(points), size


def _values(
    names: Sequence[str], points: TruePoints, decimals: tuple[int, int, int], with_sigmas: bool
) -> list[Sequence[str]]:
    """Return the texts of the columns that are added; of points with a fault the names of the cameras alone."""
    numbers = (
        *points.position.T,
        points.depth,
        points.factor,
        points.spread,
        points.incidence / DEGREE,
        points.largest_incidence / DEGREE,
        *((*points.sigma.T, points.depth_sigma) if with_sigmas else ()),
    )
    good = (points.fault == Fault.NONE).tolist()
    forms = (f"%.{places}f" for places in (*decimals, 4, 5, 4, 2, 2, 4, 4, 4, 4))
    texts = [
        [form % value if is_good else "" for value, is_good in zip(values.tolist(), good, strict=True)]
        for values, form in zip(numbers, forms, strict=False)
    ]
    return [*texts[:5], names, *texts[5:8], [REASONS[Fault(fault)] for fault in points.fault.tolist()], *texts[8:]]


def _names(names: tuple[str, ...], seen: BoolArray) -> list[str]:
    """Return the names of the cameras that see each point, blanks between them."""
    bits = np.packbits(seen, axis=1)
    patterns = bits.view(f"V{bits.shape[1]}").ravel().tolist()
    texts: dict[bytes, str] = {}
    for pattern in set(patterns):
        chosen = np.unpackbits(np.frombuffer(pattern, dtype=np.uint8), count=len(names))
        texts[pattern] = " ".join(name for name, sees in zip(names, chosen.tolist(), strict=True) if sees)
    return [texts[pattern] for pattern in patterns]
