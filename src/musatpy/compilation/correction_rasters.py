"""Grids of apparent heights corrected: the true surface, read off at the same posts again.

True points lie beside the apparent ones: each post has the apparent place whose true point stands on it. Grids of
any size go through in rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.correcting import CHUNK, Corrected
from musatpy.compilation.correction_layers import Corrector, Tally, measures, total
from musatpy.interchange.layers import Grid, Points, Posts

BANDS = ("height", "depth", "sigma")  # m each, sigma of the height
_TURNS = 3  # times that posts are looked for; what is left is the cube of a slope of the correction
_STILL = 1e-4  # of the spacing: posts found within it are not looked for again
_BESIDE = 2  # rows about those that are corrected: apparent places are beside the posts

RowsOfHeights = Callable[[int, int], FloatArray]  # apparent heights of rows from one to before another


@dataclass(frozen=True, kw_only=True, eq=False)
class TrueRows:
    """Rows of a grid from `first` on: `values` (rows, columns) of each band, NaN where there is none."""

    first: int
    values: dict[str, FloatArray]
    tally: Tally


def apparent_posts(posts: Posts, heights: RowsOfHeights) -> Iterator[FloatArray]:
    """Yield the apparent points (k, 3) of posts that have a height, some rows at a time."""
    step = max(1, CHUNK // posts.shape[1])
    for first in range(0, posts.shape[0], step):
        last = min(first + step, posts.shape[0])
        apparent = np.column_stack([posts.places(first, last), heights(first, last).ravel()])
        yield apparent[np.isfinite(apparent[:, 2])]


def true_posts(
    correction: Corrector, posts: Posts, heights: RowsOfHeights, tallies: list[Tally]
) -> Iterator[Points]:
    """Yield the posts of the true surface as points with depths and sigmas, and tally them."""
    for first, done in _strips(correction, posts, heights):
        last = first + len(done.xyz) // posts.shape[1]
        known = done.known
        tallies.append(Tally.of(done))
        xyz = np.column_stack([posts.places(first, last)[known], done.xyz[known, 2]])
        yield Points(xyz=xyz, columns=measures(done, known), crs=posts.crs, heights=posts.heights)


def corrected_rows(correction: Corrector, posts: Posts, heights: RowsOfHeights) -> Iterator[TrueRows]:
    """Yield the true surface of apparent heights at the posts, some rows at a time, from the north."""
    for first, done in _strips(correction, posts, heights):
        bands = (done.xyz[:, 2], done.depth, done.sigma[:, 2])
        values = {name: column.reshape(-1, posts.shape[1]) for name, column in zip(BANDS, bands, strict=True)}
        yield TrueRows(first=first, values=values, tally=Tally.of(done))


def _strips(correction: Corrector, posts: Posts, heights: RowsOfHeights) -> Iterator[tuple[int, Corrected]]:
    """Yield the first row of some rows and what came of their posts, from the north."""
    rows, columns = posts.shape
    step = max(1, CHUNK // columns)
    for last in range(rows, 0, -step):
        first = max(last - step, 0)
        yield first, _posts(correction, posts, heights, first, last)


def corrected_grid(correction: Corrector, grid: Grid, band: str) -> tuple[Grid, Tally]:
    """Return the true surface of a band of apparent heights at the posts of the same grid, and their tally."""
    apparent = grid.bands[band]
    parts = list(corrected_rows(correction, grid.posts, lambda first, last: apparent[first:last]))[::-1]
    values = {name: np.concatenate([part.values[name] for part in parts]) for name in BANDS}
    return replace(grid, bands=values, units=dict.fromkeys(values, "m")), total([part.tally for part in parts])


def _posts(correction: Corrector, posts: Posts, heights: RowsOfHeights, first: int, last: int) -> Corrected:
    """Return what came of the posts of some rows; as many rows about them are read as their places need."""
    beside, rows = _BESIDE, posts.shape[0]
    while True:
        low, high = max(first - beside, 0), min(last + beside, rows)
        part = replace(posts, south=posts.south + posts.spacing * low, shape=(high - low, posts.shape[1]))
        done, reached = _settled(correction, part, heights(low, high), posts.places(first, last))
        outside = (reached[0] < 0.0 and low > 0) or (reached[1] > high - low - 1.0 and high < rows)
        if not outside:
            return done
        beside *= 8


def _settled(
    correction: Corrector, posts: Posts, apparent: FloatArray, wanted: FloatArray
) -> tuple[Corrected, tuple[float, float]]:
    """Return the true points over places (k, 2), and between which rows their apparent ones were looked for."""
    place, done = wanted.copy(), Corrected.nothing(len(wanted))
    active, reached = np.arange(len(wanted)), (np.inf, -np.inf)
    for _ in range(_TURNS):
        row = (place[active, 1] - posts.south) / posts.spacing
        reached = (min(reached[0], float(row.min())), max(reached[1], float(row.max())))
        height = _bilinear(posts, apparent, place[active])
        given = np.isfinite(height)
        done.put(active[~given], Corrected.nothing(int(np.count_nonzero(~given))))
        active = active[given]
        done.put(active, correction(np.column_stack([place[active], height[given]])))
        gap = np.nan_to_num(done.xyz[active, :2] - wanted[active])
        place[active] -= gap
        active = active[np.abs(gap).max(axis=1, initial=0.0) > _STILL * posts.spacing]
        if not len(active):
            break
    return done, reached


def _bilinear(posts: Posts, values: FloatArray, place: FloatArray) -> FloatArray:
    """Return values (k,) of a grid between its posts, NaN outside and beside an empty one."""
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
