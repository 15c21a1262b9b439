"""Contours of a raster of depths or heights, for other programs (`musat as11 contours`)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import CompilationError, Problem
from musatpy.geometry.projected import crs_of
from musatpy.interchange import geotiff
from musatpy.interchange.any_file import write_layers
from musatpy.interchange.layers import LOCAL, Column, Lines, Posts
from musatpy.surfaces.contours import Contours, levels_between
from musatpy.surfaces.grid_contours import grid_contours

_DEPTH = "depth"


@dataclass(frozen=True, kw_only=True)
class ContourWish:
    """Contours at multiples of an interval (m), or at `levels`; every `index`th is thick, shorter ones left out.

    Of a band of heights, `datum` (m): contours are depths below that height; None: they are heights.
    """

    interval: float = 0.0
    levels: tuple[float, ...] = ()
    index: int = 5
    shortest: float = 0.0
    datum: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class ContouredRaster:
    """The contours of a raster, and what its values are: depths or heights."""

    contours: Contours
    what: str


def contour_raster(
    source: Path, targets: Iterable[Path], wish: ContourWish, *, band: str = "", crs: str = ""
) -> ContouredRaster:
    """Draw contours of a band of a raster, and write them as 3-D lines at their heights to files by their suffixes.

    The band is `depth` where there are several and none is named. Raises `CompilationError`, `InterchangeError`,
    `SurfaceError`, `SystemsError` and `MusatError` for what cannot be drawn; `OSError`. Each file is written whole
    or not at all.
    """
    with geotiff.opened(source, crs_of(crs or LOCAL)) as raster:
        name = _band(source, raster.names, band)
        values, posts = raster.rows(name, 0, raster.posts.shape[0]), raster.posts
    is_depth = name == _DEPTH or wish.datum is not None
    if wish.datum is not None:
        values = wish.datum - values
    drawn = _drawn(source, values, posts, wish)
    layers = {"contours": _lines(drawn, posts, is_depth, wish.datum or 0.0)}
    for target in targets:
        write_layers(target, layers)
    return ContouredRaster(contours=drawn, what="depths" if is_depth else "heights")


def _band(source: Path, names: Sequence[str], wanted: str) -> str:
    """Return the band that is wanted, else the only one or that of depths. Raises `CompilationError`."""
    name = wanted or (names[0] if len(names) == 1 else _DEPTH)
    if name not in names:
        message = f"which band has the depths? --band is one of {', '.join(names)}"
        raise CompilationError([Problem(file=str(source), message=message)])
    return name


def _drawn(source: Path, values: FloatArray, posts: Posts, wish: ContourWish) -> Contours:
    if not np.isfinite(values).any():
        raise CompilationError([Problem(file=str(source), message="all of its posts are empty")])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    levels = np.array(wish.levels) if wish.levels else levels_between(low, high, wish.interval)
    multiples = np.rint(levels / wish.interval) if wish.interval else np.arange(len(levels))
    index = levels[multiples % wish.index == 0].tolist()
    drawn = grid_contours(values, (posts.west, posts.south), posts.spacing, levels.tolist(), index, wish.shortest)
    if not drawn.lines:
        message = f"there is no contour between {low:.2f} and {high:.2f} m"
        raise CompilationError([Problem(file=str(source), message=message)])
    return drawn


def _lines(drawn: Contours, posts: Posts, is_depth: bool, datum: float) -> Lines:
    """Return contours as a layer of lines at their heights; depths are below the height `datum`."""
    levels = np.array([line.level for line in drawn.lines])
    heights = datum - levels if is_depth else levels
    paths = [
        np.column_stack([line.xy, np.full(len(line.xy), height)])
        for line, height in zip(drawn.lines, heights.tolist(), strict=True)
    ]
    for line, path in zip(drawn.lines, paths, strict=True):
        if line.closed:
            path[-1] = path[0]
    columns = {
        "depth" if is_depth else "height": Column.of(levels, "m"),
        "index_line": Column.of([int(line.index) for line in drawn.lines]),
    }
    return Lines.of_paths(paths, columns=columns, crs=posts.crs, heights=posts.heights)
