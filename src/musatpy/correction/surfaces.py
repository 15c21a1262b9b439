"""A raster of apparent heights as one of the true surface at the same posts: true points lie beside apparent ones.

Each post has the apparent place whose true point stands on it. A post that is not below the water keeps its height.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.correction.layers import DRY
from musatpy.correction.rasters import POSTS
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
from musatpy.interchange import geotiff
from musatpy.interchange.geotiff import Raster
from musatpy.interchange.layers import Posts
from musatpy.refraction.apparent import TruePoints

_BANDS = ("height", "depth", "sigma")  # m each, sigma of the height
_TURNS = 3  # times that the apparent place of a post is looked for; what is left is the cube of a slope
_BESIDE = 2  # rows about those that are corrected: apparent places are beside the posts


@dataclass(frozen=True, kw_only=True, eq=False)
class _Strip:
    """Rows of a raster with apparent heights (rows, columns), and the places (k, 2) of those that are wanted."""

    posts: Posts
    heights: FloatArray
    wanted: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class _Settled:
    """The apparent heights (k,) of posts, their true points, and the first and last row that they needed."""

    heights: FloatArray
    points: TruePoints
    low: float
    high: float


def correct_surface(
    raster: Raster,
    target: Path,
    band: str,
    correction: Correction,
    *,
    jobs: int = 1,
    progress: Progress | None = None,
) -> CorrectionTally:
    """Write heights, depths and sigmas of heights of the true surface at the posts of a raster.

    `progress` is told of posts. Raises as `correct_raster`.
    """
    posts, tally = raster.posts, NO_POINTS
    rows, columns = posts.shape
    step = max(1, POSTS // columns)
    firsts = range(0, rows, step)

    def strip(first: int, beside: int = _BESIDE) -> _Strip:
        last = min(first + step, rows)
        low, high = max(first - beside, 0), min(last + beside, rows)
        part = replace(posts, south=posts.south + posts.spacing * low, shape=(high - low, columns))
        return _Strip(posts=part, heights=raster.rows(band, low, high), wanted=posts.places(first, last))

    with geotiff.written(target, posts, dict.fromkeys(_BANDS, "m")) as writer:
        for first, done in zip(
            firsts, in_order(partial(_settled, correction), map(strip, firsts), jobs), strict=True
        ):
            beside = _BESIDE
            while not isinstance(done, Problem) and _outside(done, first, step, beside, rows):
                beside *= 8
                done = _settled(correction, strip(first, beside))
            if isinstance(done, Problem):
                raise DepthError([replace(done, file=str(raster.path))])
            points = done.points
            height = np.where(np.isin(points.fault, DRY), done.heights, points.position[:, 2])
            values = zip(_BANDS, (height, points.depth, points.sigma[:, 2]), strict=True)
            writer.put(first, {name: column.reshape(-1, columns) for name, column in values})
            tally = tally + CorrectionTally.of(points)
            if progress:
                progress(len(height))
        some = strip(0)
        require_sight(correction, tally, raster.path, np.column_stack([some.wanted, _bilinear(some, some.wanted)]))
    return tally


def _outside(done: _Settled, first: int, step: int, beside: int, rows: int) -> bool:
    """Tell whether apparent places lie outside the rows of a strip, which can have more."""
    low, high = max(first - beside, 0), min(first + step + beside, rows)
    return (done.low < 0.0 and low > 0) or (done.high > high - low - 1.0 and high < rows)


def _settled(correction: Correction, strip: _Strip) -> _Settled | Problem:
    """Return the true points over the wanted places; a function of the module: other processes call it.

    How far a true point lies beside its apparent one grows with the depth: what it is at each post, for the depth
    there, leads to the apparent places, and is asked of the rays no more than once.
    """
    apparent = np.column_stack([strip.wanted, _bilinear(strip, strip.wanted)])
    first = attempted(replace(correction, errors=None), "", apparent)
    if isinstance(first, Problem):
        return first
    beside, height = first[0].position[:, :2] - strip.wanted, apparent[:, 2].copy()
    with np.errstate(invalid="ignore"):  # of points without a true place
        apparent_depth = first[0].depth / first[0].factor
        for _ in range(_TURNS):
            share = 1.0 - (apparent[:, 2] - height) / apparent_depth
            moved = share > 0.0
            apparent[moved, :2] = (strip.wanted - beside * share[:, None])[moved]
            apparent[:, 2] = _bilinear(strip, apparent[:, :2])
    corrected = attempted(correction, "", apparent)
    if isinstance(corrected, Problem):
        return corrected
    row = (apparent[:, 1] - strip.posts.south) / strip.posts.spacing
    return _Settled(heights=apparent[:, 2], points=corrected[0], low=float(row.min()), high=float(row.max()))


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
