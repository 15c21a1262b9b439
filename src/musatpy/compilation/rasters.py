"""The bottom as a raster of depths, such as corrections and grids of posts leave; contours of rasters as files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import CompilationError, SystemsError
from musatpy.geometry.crs import system_of
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.projected import crs_of
from musatpy.geometry.systems import System
from musatpy.interchange import geotiff
from musatpy.interchange.any_file import write_layers
from musatpy.interchange.layers import LOCAL, LayerColumn, Lines, Posts
from musatpy.surfaces.contours import Contours, grid_contours, levels_between
from musatpy.surfaces.tin import EMPTY, INSIDE, OUTSIDE, SurfaceValues

_DEPTH, _SIGMA = "depth", "sigma"


@dataclass(frozen=True, kw_only=True, eq=False)
class RasterBottom:
    """Depths and sigmas (rows, columns) m at posts, NaN where there are none.

    system: of the posts, None of a local job; metres (2,): those of a unit of x and y. Places on it are metres from
    its south-western post.
    """

    posts: Posts
    depth: FloatArray
    sigma: FloatArray
    system: System | None
    metres: FloatArray

    @property
    def angular(self) -> bool:
        """Whether its job has latitude and longitude."""
        return self.system is not None

    def places(self, coordinates: FloatArray) -> FloatArray:
        """Return the places (k, 2) of latitudes and longitudes (k, 2) rad or, of a local job, x and y (m)."""
        xy = coordinates
        if self.system is not None:
            level = np.column_stack([coordinates, np.zeros(len(coordinates))])
            xy = self.system.coordinates(level)[:, :2]
        return np.asarray((xy - [self.posts.west, self.posts.south]) * self.metres)

    def at(self, places: FloatArray) -> SurfaceValues:
        """Return the bottom at places (k, 2), bilinear between posts; sigmas are as good as those of the posts."""
        rows, columns = self.posts.shape
        step = self.posts.spacing * self.metres
        node = places / step
        low = np.clip(np.floor(node).astype(np.int64), 0, [columns - 2, rows - 2])
        (u, v), (column, row) = (node - low).T, low.T
        corners = [(row, column), (row, column + 1), (row + 1, column), (row + 1, column + 1)]
        weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v]
        d00, d01, d10, d11 = (self.depth[corner] for corner in corners)
        value = sum(weight * self.depth[corner] for weight, corner in zip(weights, corners, strict=True))
        sigma = sum(weight * self.sigma[corner] for weight, corner in zip(weights, corners, strict=True))
        east = ((1.0 - v) * (d01 - d00) + v * (d11 - d10)) / step[0]
        north = ((1.0 - u) * (d10 - d00) + u * (d11 - d01)) / step[1]
        outside = (node < 0.0).any(axis=1) | (node > [columns - 1, rows - 1]).any(axis=1)
        reason = np.where(outside, OUTSIDE, np.where(np.isfinite(value), INSIDE, EMPTY))
        known = reason == INSIDE
        return SurfaceValues(
            value=np.where(known, value, np.nan),
            gradient=np.where(known[:, None], np.column_stack([east, north]), np.nan),
            sigma=np.where(known, sigma, np.nan),
            reason=reason,
        )

    def lines(self, level: float) -> list[FloatArray]:
        """Return the contours of a depth, each (k, 2) places. Raises `MusatError` where contourpy is missing."""
        drawn = grid_contours(self.depth, (0.0, 0.0), 1.0, [level])
        return [line.xy * self.posts.spacing * self.metres for line in drawn.lines]

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest depth, m."""
        return float(np.nanmin(self.depth)), float(np.nanmax(self.depth))


def read_raster_bottom(source: Path, job: Ellipsoid | None) -> RasterBottom:
    """Return the bands `depth` and `sigma` of a raster, on the ellipsoid of a job: None for a local one.

    Without the band `sigma` depths are without error. Raises `CompilationError` for a raster that has no depths or
    is not in a system of the job, `InterchangeError` and `OSError`.
    """
    import pyproj

    with geotiff.opened(source, pyproj.CRS.from_wkt(LOCAL)) as raster:
        posts, names = raster.posts, raster.names
        if _DEPTH not in names:
            raise CompilationError.of(f"it has no band {_DEPTH} but {', '.join(names)}", file=source)
        if min(posts.shape) < 2:
            raise CompilationError.of("a bottom has two rows and columns at least", file=source)
        depth, sigma = (
            raster.rows(name, 0, posts.shape[0]) if name in names else None for name in (_DEPTH, _SIGMA)
        )
    assert depth is not None
    if not np.isfinite(depth).any():
        raise CompilationError.of("all of its posts are empty", file=source)
    if (posts.crs is None) != (job is None):
        stated = "no coordinate system" if posts.crs is None else f"the system {posts.crs.name}"
        job_is = "a local one" if job is None else "one of the globe"
        raise CompilationError.of(f"it has {stated}, and the job {job_is}", file=source)
    system, metres = None, np.ones(2)
    if posts.crs is not None and job is not None:
        try:
            system = system_of(posts.crs.to_wkt(), job)
        except SystemsError as error:
            raise CompilationError.of(error.problems[0].message, file=source) from error
        metres = _metres(posts, system, job)
    sigma = np.zeros(depth.shape) if sigma is None else sigma
    return RasterBottom(posts=posts, depth=depth, sigma=sigma, system=system, metres=metres)


def _metres(posts: Posts, system: System, job: Ellipsoid) -> FloatArray:
    """Return how many metres (2,) a unit of x and y is in the middle of posts."""
    rows, columns = posts.shape
    middle = np.array([posts.west, posts.south, 0.0]) + posts.spacing * np.array([columns - 1, rows - 1, 0]) / 2.0
    beside = middle + posts.spacing * np.eye(3)[:2]
    places = job.geocentric(system.level(np.vstack([middle, beside])))
    return np.asarray(np.linalg.norm(places[1:] - places[0], axis=1) / posts.spacing)


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


def contour_raster(
    source: Path, targets: Iterable[Path], wish: ContourWish, *, band: str = "", crs: str = ""
) -> tuple[Contours, str]:
    """Draw contours of a band of a raster, and write them as 3-D lines at their heights to files by their suffixes.

    Returns them, and what they are of: `depths` or `heights`.
    The band is `depth` where there are several and none is named. Raises `CompilationError`, `InterchangeError`,
    `SurfaceError`, `SystemsError` and `MusatError` for what cannot be drawn; `OSError`. Each file is written whole
    or not at all.
    """
    with geotiff.opened(source, crs_of(crs or LOCAL)) as raster:
        names = raster.names
        name = band or (names[0] if len(names) == 1 else _DEPTH)
        if name not in names:
            raise CompilationError.of(
                f"which band has the depths? --band is one of {', '.join(names)}", file=source
            )
        values, posts = raster.rows(name, 0, raster.posts.shape[0]), raster.posts
    is_depth = name == _DEPTH or wish.datum is not None
    if wish.datum is not None:
        values = wish.datum - values
    drawn = _drawn(source, values, posts, wish)
    layers = {"contours": _lines(drawn, posts, is_depth, wish.datum or 0.0)}
    for target in targets:
        write_layers(target, layers)
    return drawn, "depths" if is_depth else "heights"


def _drawn(source: Path, values: FloatArray, posts: Posts, wish: ContourWish) -> Contours:
    if not np.isfinite(values).any():
        raise CompilationError.of("all of its posts are empty", file=source)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    levels = np.array(wish.levels) if wish.levels else levels_between(low, high, wish.interval)
    multiples = np.rint(levels / wish.interval) if wish.interval else np.arange(len(levels))
    index = levels[multiples % wish.index == 0].tolist()
    drawn = grid_contours(values, (posts.west, posts.south), posts.spacing, levels.tolist(), index, wish.shortest)
    if not drawn.lines:
        raise CompilationError.of(f"there is no contour between {low:.2f} and {high:.2f} m", file=source)
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
        "depth" if is_depth else "height": LayerColumn.of(levels, "m"),
        "index_line": LayerColumn.of([int(line.index) for line in drawn.lines]),
    }
    return Lines.of_paths(paths, columns=columns, crs=posts.crs, heights=posts.heights)
