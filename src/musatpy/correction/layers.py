"""Points and lines of drawing and GIS files, or of one format that becomes another, with their true places.

Points keep their columns and get the apparent place, depth, sigmas and reason; one that is not corrected stays
where it is. Lines have no values of a vertex: what is not below the water stays where it is, and a line is cut
where another vertex has no true place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyproj

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.correction.rasters import only_band
from musatpy.depth.corrected_files import SIGMAS
from musatpy.depth.correction import NO_POINTS, Correction, CorrectionTally, attempted, in_order, require_sight
from musatpy.errors import DepthError, Problem
from musatpy.interchange.any_file import RASTERS, Layers, read_layers
from musatpy.interchange.layers import Grid, LayerColumn, Lines, Points, placed
from musatpy.pointfiles.las_files import SUFFIXES
from musatpy.refraction.apparent import REASONS, Fault, TruePoints

DRY = (Fault.ABOVE_WATER, Fault.BETWEEN_TIDES)
NAMED, BARE = (".csv",), (".xyz", ".txt")  # tables under a line of names, and without
_CHUNK = 16384  # points at a time


def kind_of(source: Path, target: Path) -> tuple[str, ...]:
    """Return the suffixes of the kind that both files are of, none where one format becomes another."""
    suffixes = {source.suffix.lower(), target.suffix.lower()}
    return next((kind for kind in (NAMED, BARE, SUFFIXES, RASTERS) if suffixes <= {*kind}), ())


def read_heights(
    source: Path, stand_in: pyproj.CRS | None, layer: str, columns: Sequence[str], band: str
) -> tuple[Layers, pyproj.CRS | None]:
    """Return the layers of a file, of a grid the band of heights alone, and what system they state."""
    layers = read_layers(source, stand_in, layer, columns)
    for name, part in layers.items():
        layers[name] = only_band(source, part, band) if isinstance(part, Grid) else part
    return layers, placed(next((part.crs for part in layers.values() if part.crs is not None), None))


@dataclass(frozen=True, kw_only=True, eq=False)
class CorrectedPoints:
    """What comes of n points: true places (n, 3), NaN where lost, why (n,), and other columns, m or counts."""

    true: FloatArray
    fault: IntArray
    columns: Mapping[str, FloatArray | IntArray]

    @property
    def good(self) -> BoolArray:
        """(n,) which points are corrected."""
        return self.fault == Fault.NONE


def correct_layers(
    layers: Layers,
    correct: Callable[[FloatArray], CorrectedPoints],
    reasons: Mapping[Any, str] = REASONS,
    *,
    numbered: bool = False,
) -> Layers:
    """Return layers with the true places, the posts of a grid as points; reasons are `numbered`, or texts.

    The heights of a grid are its only band; `correct` is asked once for each layer.
    """
    true: Layers = {}
    for name, layer in layers.items():
        part = _posts(layer) if isinstance(layer, Grid) else layer
        apparent = part.xyz if isinstance(part, Points) else np.concatenate(part.vertices)
        points = correct(apparent)
        place = np.where(points.good[:, None], points.true, apparent)
        if isinstance(part, Points):
            columns = dict(part.columns) | {
                f"apparent_{axis}": LayerColumn.of(values) for axis, values in zip("xyz", apparent.T, strict=True)
            }
            for column, values in points.columns.items():
                columns[column] = LayerColumn.of(values, "m" if values.dtype.kind == "f" else "")
            faults = points.fault.tolist()
            columns["reason"] = LayerColumn.of(faults if numbered else [reasons[fault] for fault in faults])
            true["points" if part is not layer else name] = replace(part, xyz=place, columns=columns)
        else:
            true[name] = _cut(part, place, points.good | np.isin(points.fault, DRY))
    return true


def correct_by_photographs(
    layers: Layers, correction: Correction, source: Path, *, numbered: bool = False, jobs: int = 1
) -> tuple[Layers, CorrectionTally]:
    """Return layers with the true places by all photographs that see their points, and what came of these.

    Raises `DepthError` for points that their system does not reach, and where no camera sees any.
    """
    tally, apparent = NO_POINTS, np.empty((0, 3))

    def correct(given: FloatArray) -> CorrectedPoints:
        nonlocal tally, apparent
        points = _corrected(correction, str(source), given, jobs)
        tally, apparent = tally + CorrectionTally.of(points), given
        sigmas = () if correction.errors is None else (*points.sigma.T, points.depth_sigma)
        columns = {"depth": points.depth, **dict(zip(SIGMAS, sigmas, strict=False)), "cameras": points.cameras}
        return CorrectedPoints(true=points.position, fault=points.fault.astype(np.int64), columns=columns)

    true = correct_layers(layers, correct, numbered=numbered)
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
