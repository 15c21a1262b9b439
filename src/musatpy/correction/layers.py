"""Points and lines of drawing and GIS files, or of one format that becomes another, with their true places.

Points keep their columns and get the apparent place, depth, sigmas and reason; one that is not corrected stays
where it is. Lines have no values of a vertex: what is not below the water stays where it is, and a line is cut
where another vertex has no true place.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.correction.methods import APPARENT, CorrectedPoints, Method, Tally
from musatpy.depth.correction import in_order
from musatpy.errors import Problem
from musatpy.interchange.any_file import RASTERS, Layers
from musatpy.interchange.layers import Grid, LayerColumn, Lines, Points
from musatpy.pointfiles.las_files import SUFFIXES
from musatpy.refraction.apparent import Fault

DRY = (Fault.ABOVE_WATER, Fault.BETWEEN_TIDES)
NAMED, BARE = (".csv",), (".xyz", ".txt")  # tables under a line of names, and without
_CHUNK = 16384  # points at a time


def kind_of(source: Path, target: Path) -> tuple[str, ...]:
    """Return the suffixes of the kind that both files are of, none where one format becomes another."""
    suffixes = {source.suffix.lower(), target.suffix.lower()}
    return next((kind for kind in (NAMED, BARE, SUFFIXES, RASTERS) if suffixes <= {*kind}), ())


def correct_layers(
    layers: Layers,
    method: Method,
    source: Path,
    *,
    classes: IntArray | None = None,
    numbered: bool = False,
    jobs: int = 1,
) -> tuple[Layers, Tally]:
    """Return layers with the true places, and what came of their points; reasons are `numbered`, or texts.

    `classes` are those of the points of a cloud. The posts of a grid become points, by its only band. Raises the
    error of the method.
    """
    true: Layers = {}
    tally, apparent = Tally(), np.empty((0, 3))
    for name, layer in layers.items():
        part = _posts(layer) if isinstance(layer, Grid) else layer
        apparent = part.xyz if isinstance(part, Points) else np.concatenate(part.vertices)
        points = _corrected(method, str(source), apparent, classes, jobs)
        tally = tally + Tally.of(points, method.reasons)
        place = points.kept(apparent)
        if isinstance(part, Points):
            columns = dict(part.columns) | {
                column: LayerColumn.of(values) for column, values in zip(APPARENT, apparent.T, strict=True)
            }
            for column, unit in method.in_layers.items():
                columns[column] = LayerColumn.of(points.values[column], unit)
            if not numbered:
                columns["reason"] = LayerColumn.of([method.reasons[fault] for fault in points.fault.tolist()])
            true["points" if part is not layer else name] = replace(part, xyz=place, columns=columns)
        else:
            true[name] = _cut(part, place, points.good | np.isin(points.fault, DRY))
    method.require_use(source, tally, apparent)
    return true, tally


def _posts(grid: Grid) -> Points:
    (heights,) = grid.bands.values()
    xyz = np.column_stack([grid.places(0, grid.shape[0]), heights.ravel()])
    return Points(xyz=xyz[np.isfinite(xyz[:, 2])], crs=grid.crs, heights=grid.heights)


def _corrected(
    method: Method, source: str, apparent: FloatArray, classes: IntArray | None, jobs: int
) -> CorrectedPoints:
    number = max(1, -(-len(apparent) // _CHUNK))
    given = np.zeros(len(apparent), dtype=np.int64) if classes is None else classes
    chunks = zip(np.array_split(apparent, number), np.array_split(given, number), strict=True)
    parts = []
    for done in in_order(partial(_of_chunk, method, source), chunks, jobs if number > 1 else 1):
        if isinstance(done, Problem):
            raise method.error([done])
        parts.append(done)
    return CorrectedPoints(
        true=np.concatenate([part.true for part in parts]),
        fault=np.concatenate([part.fault for part in parts]),
        values={name: np.concatenate([part.values[name] for part in parts]) for name in parts[0].values},
        seen=None if parts[0].seen is None else np.concatenate([part.seen for part in parts]),
        lacking=sum(part.lacking for part in parts),
        taken=sum((part.taken for part in parts), Counter()),
    )


def _of_chunk(method: Method, source: str, chunk: tuple[FloatArray, IntArray]) -> CorrectedPoints | Problem:
    return method(source, chunk[0], classes=chunk[1])


def _cut(lines: Lines, place: FloatArray, kept: BoolArray) -> Lines:
    """Return lines with places (n, 3) of all their vertices, cut where these are not kept (n,)."""
    first = np.concatenate([[0], np.cumsum([len(path) for path in lines.vertices])])
    pieces: list[FloatArray] = []
    source: list[int] = []
    closed: list[bool] = []
    for line, is_ring in enumerate(lines.closed.tolist()):
        rows = np.arange(first[line], first[line + 1])
        runs = [run for run in np.split(rows, np.flatnonzero(np.diff(kept[rows])) + 1) if kept[run[0]]]
        longer = [run for run in runs if len(run) > 1]
        pieces += [place[run] for run in longer]
        source += [line] * len(longer)
        closed += [is_ring and len(run) == len(rows) for run in longer]
    rows_of = np.array(source, dtype=np.int64)
    columns = {name: replace(column, values=column.values[rows_of]) for name, column in lines.columns.items()}
    return replace(lines, vertices=pieces, closed=np.array(closed, dtype=bool), columns=columns)
