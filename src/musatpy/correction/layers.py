"""Points and lines of drawing and GIS files, or of one format that becomes another, with their true places.

Points keep their columns and get the apparent place, depth, sigmas and reason; one that is not corrected stays
where it is. Lines have no values of a vertex: what is not below the water stays where it is, and a line is cut
where another vertex has no true place.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.depth.correction import NO_POINTS, Correction, CorrectionTally, in_order
from musatpy.depth.csv_points import SIGMAS
from musatpy.depth.misplaced_points import attempted, require_sight
from musatpy.errors import DepthError, Problem
from musatpy.interchange.any_file import Layers
from musatpy.interchange.layers import Column, Grid, Lines, Points
from musatpy.refraction.apparent import REASONS, Fault, TruePoints

DRY = (Fault.ABOVE_WATER, Fault.BETWEEN_TIDES)
_CHUNK = 16384  # points at a time


def correct_layers(
    layers: Layers, correction: Correction, source: Path, *, numbered: bool = False, jobs: int = 1
) -> tuple[Layers, CorrectionTally]:
    """Return layers with the true places, the posts of a grid as points; reasons are `numbered`, or texts.

    The heights of a grid are its only band. Raises `DepthError` for points that their system does not reach,
    and where no camera sees any.
    """
    true: Layers = {}
    tally, apparent = NO_POINTS, np.empty((0, 3))
    for name, layer in layers.items():
        part = _posts(layer) if isinstance(layer, Grid) else layer
        apparent = part.xyz if isinstance(part, Points) else np.concatenate(part.vertices)
        points = _corrected(correction, str(source), apparent, jobs)
        tally = tally + CorrectionTally.of(points)
        good = points.fault == Fault.NONE
        place = np.where(good[:, None], points.position, apparent)
        if isinstance(part, Points):
            columns = _columns(apparent, points, numbered, with_sigmas=correction.errors is not None)
            true["points" if part is not layer else name] = replace(
                part, xyz=place, columns={**part.columns, **columns}
            )
        else:
            true[name] = _cut(part, place, good | np.isin(points.fault, DRY))
    require_sight(correction, tally, source, apparent)
    return true, tally


def _posts(grid: Grid) -> Points:
    (heights,) = grid.bands.values()
    xyz = np.column_stack([grid.posts.places(0, grid.shape[0]), heights.ravel()])
    return Points(xyz=xyz[np.isfinite(xyz[:, 2])], crs=grid.crs, heights=grid.heights)


def _corrected(correction: Correction, source: str, apparent: FloatArray, jobs: int) -> TruePoints:
    chunks = np.array_split(apparent, max(1, -(-len(apparent) // _CHUNK)))
    parts = []
    for done in in_order(partial(attempted, correction, source), chunks, jobs if len(chunks) > 1 else 1):
        if isinstance(done, Problem):
            raise DepthError([done])
        parts.append(done[0])
    return TruePoints(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])})


def _columns(apparent: FloatArray, points: TruePoints, numbered: bool, *, with_sigmas: bool) -> dict[str, Column]:
    """Return what points get, by the names that tables and clouds have."""
    columns = {f"apparent_{axis}": Column.of(values) for axis, values in zip("xyz", apparent.T, strict=True)}
    columns["depth"] = Column.of(points.depth, "m")
    if with_sigmas:
        sigmas = (*points.sigma.T, points.depth_sigma)
        columns |= {name: Column.of(values, "m") for name, values in zip(SIGMAS, sigmas, strict=True)}
    columns["cameras"] = Column.of(points.cameras)
    faults = points.fault.tolist()
    columns["reason"] = Column.of(faults if numbered else [REASONS[Fault(fault)] for fault in faults])
    return columns


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
