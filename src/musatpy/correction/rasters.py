"""A raster of apparent heights: each post is a point, whose true place, depth and sigmas are bands of another one.

A post that cannot be corrected has its apparent height, no true place, and the number of its reason (`Fault`).

Or the true surface at the same posts: true points lie beside apparent ones, and each post has the apparent place
whose true point stands on it. There a post that is not below the water keeps its height.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.correction.layers import DRY
from musatpy.correction.methods import TRUE, Method, Tally
from musatpy.depth.correction import Progress, in_order
from musatpy.errors import DepthError, Problem
from musatpy.interchange import geotiff
from musatpy.interchange.geotiff import Raster
from musatpy.interchange.layers import Grid, Posts

POSTS = 16384  # at a time
_SURFACE = ("height", "depth", "sigma")  # m each, sigma of the height
_TURNS = 3  # times that the apparent place of a post is looked for; what is left is the cube of a slope
_BESIDE = 2  # rows about those that are corrected: apparent places are beside the posts


def band_of(source: Path, names: Sequence[str], wanted: str) -> str:
    """Return the band of heights: the one that is wanted, or the only one. Raises `DepthError`."""
    if wanted in names or (not wanted and len(names) == 1):
        return wanted or names[0]
    message = f"which band has the heights? --band is one of {', '.join(names)}"
    raise DepthError([Problem(file=str(source), message=message)])


def only_band(source: Path, grid: Grid, wanted: str) -> Grid:
    """Return a grid of the heights alone. Raises `DepthError`."""
    name = band_of(source, tuple(grid.bands), wanted)
    return replace(grid, bands={name: grid.bands[name]}, units={})


@dataclass(frozen=True, kw_only=True, eq=False)
class _Strip:
    """Rows of a raster with apparent heights (rows, columns), and the places (k, 2) of those that are wanted."""

    posts: Posts
    heights: FloatArray
    wanted: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class _Bands:
    """The values (k,) of bands at the wanted places, and the first and last row of the strip that they needed."""

    values: Mapping[str, FloatArray | IntArray]
    tally: Tally
    low: float = 0.0
    high: float = 0.0


def correct_raster(
    raster: Raster,
    target: Path,
    band: str,
    method: Method,
    *,
    surface: bool = False,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Tally:
    """Correct the heights of a band of an open raster, or write the true surface; `progress` is told of posts.

    Raises the error of the method for posts that their system does not reach, and where no camera sees any,
    `InterchangeError` and `OSError`; then no file is left.
    """
    posts, tally = raster.posts, Tally()
    rows, columns = posts.shape
    step = max(1, POSTS // columns)
    firsts = range(0, rows, step)

    def strip(first: int, beside: int = _BESIDE * surface) -> _Strip:
        last = min(first + step, rows)
        low, high = max(first - beside, 0), min(last + beside, rows)
        part = replace(posts, south=posts.south + posts.spacing * low, shape=(high - low, columns))
        return _Strip(posts=part, heights=raster.rows(band, low, high), wanted=posts.places(first, last))

    work = partial(_settled if surface else _corrected, method, str(raster.path))
    of_posts = {"apparent": "m", **dict.fromkeys(TRUE, ""), **method.in_layers}
    bands = dict.fromkeys(_SURFACE, "m") if surface else of_posts
    with geotiff.written(target, posts, bands) as writer:
        for first, done in zip(firsts, in_order(work, map(strip, firsts), jobs), strict=True):
            beside = _BESIDE
            while surface and not isinstance(done, Problem) and _outside(done, first, step, beside, rows):
                beside *= 8
                done = work(strip(first, beside))
            if isinstance(done, Problem):
                raise method.error([done])
            writer.put(first, {name: np.asarray(done.values[name], float).reshape(-1, columns) for name in bands})
            tally = tally + done.tally
            if progress:
                progress(columns * (min(first + step, rows) - first))
        some = strip(0)
        method.require_use(raster.path, tally, np.column_stack([some.wanted, _bilinear(some, some.wanted)]))
    return tally


def _corrected(method: Method, source: str, strip: _Strip) -> _Bands | Problem:
    """Return what comes of posts; a function of the module: other processes call it."""
    apparent = np.column_stack([strip.wanted, strip.heights.ravel()])
    points = method(source, apparent)
    if isinstance(points, Problem):
        return points
    values = {"apparent": apparent[:, 2], **dict(zip(TRUE, points.true.T, strict=True)), **points.values}
    return _Bands(values=values, tally=Tally.of(points, method.reasons))


def _outside(done: _Bands, first: int, step: int, beside: int, rows: int) -> bool:
    """Tell whether apparent places lie outside the rows of a strip, which can have more."""
    low, high = max(first - beside, 0), min(first + step + beside, rows)
    return (done.low < 0.0 and low > 0) or (done.high > high - low - 1.0 and high < rows)


def _settled(method: Method, source: str, strip: _Strip) -> _Bands | Problem:
    """Return the true surface over the wanted places; a function of the module: other processes call it.

    How far a true point lies beside its apparent one grows with the depth: what it is at each post, for the depth
    there, leads to the apparent places, and is asked of the rays no more than once.
    """
    apparent = np.column_stack([strip.wanted, _bilinear(strip, strip.wanted)])
    first = method.without_sigmas(source, apparent)
    if isinstance(first, Problem):
        return first
    beside, height = first.true[:, :2] - strip.wanted, apparent[:, 2].copy()
    with np.errstate(invalid="ignore"):  # of points without a true place
        apparent_depth = first.values["depth"] / first.values["factor"]
        for _ in range(_TURNS):
            share = 1.0 - (apparent[:, 2] - height) / apparent_depth
            moved = share > 0.0
            apparent[moved, :2] = (strip.wanted - beside * share[:, None])[moved]
            apparent[:, 2] = _bilinear(strip, apparent[:, :2])
    points = method(source, apparent)
    if isinstance(points, Problem):
        return points
    row = (apparent[:, 1] - strip.posts.south) / strip.posts.spacing
    height = np.where(np.isin(points.fault, DRY), apparent[:, 2], points.true[:, 2])
    return _Bands(
        values={"height": height, "depth": points.values["depth"], "sigma": points.values["sigma_height"]},
        tally=Tally.of(points, method.reasons),
        low=float(row.min()),
        high=float(row.max()),
    )


def _bilinear(strip: _Strip, place: FloatArray) -> FloatArray:
    """Return heights (k,) between the posts of a strip, NaN outside and beside an empty one."""
    posts, values = strip.posts, strip.heights
    rows, columns = posts.shape
    at = (place - [posts.west, posts.south]) / posts.spacing
    at = np.where(np.abs(at - np.rint(at)) < 1e-9, np.rint(at), at)
    low = np.clip(np.floor(at).astype(np.int64), 0, [max(columns - 2, 0), max(rows - 2, 0)])
    high = np.minimum(low + 1, [columns - 1, rows - 1])
    u, v = (at - low).T
    out = np.zeros(len(place))
    for row, weight_v in ((low[:, 1], 1.0 - v), (high[:, 1], v)):
        for column, weight_u in ((low[:, 0], 1.0 - u), (high[:, 0], u)):
            weight = weight_u * weight_v
            out += np.where(weight == 0.0, 0.0, weight * values[row, column])
    outside = (at < 0.0).any(axis=1) | (at > [columns - 1, rows - 1]).any(axis=1)
    return np.where(outside, np.nan, out)
