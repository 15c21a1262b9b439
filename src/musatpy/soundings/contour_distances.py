"""How far lines in a plane lie from other lines: sampled every metre, both ways, with the area between them.

Needs the package shapely, the extra `gis`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.interchange.packages import package

_STEP = 1.0  # m
_MOST = 0.95
_SAME = 1e-6  # m, of ends that join


@dataclass(frozen=True, kw_only=True, eq=False)
class Offsets:
    """n samples xy (n, 2) m of lines, each for an interval (n,) m, and their nearest places (n, 2) on others.

    beyond (n,): without a partner, past an open end of the other line, which is the nearest place, or too far.
    """

    xy: FloatArray
    interval: FloatArray
    nearest: FloatArray
    beyond: BoolArray

    @property
    def distance(self) -> FloatArray:
        """(n,) m."""
        return np.linalg.norm(self.nearest - self.xy, axis=1)

    def part(self, rows: BoolArray) -> Offsets:
        """Return some of the samples."""
        return Offsets(
            xy=self.xy[rows], interval=self.interval[rows], nearest=self.nearest[rows], beyond=self.beyond[rows]
        )


def offsets(
    lines: Sequence[FloatArray], others: Sequence[FloatArray], farthest: float = np.inf, step: float = _STEP
) -> Offsets:
    """Return how lines, each (k, 2) m, lie from others; a closed one ends where it begins.

    The samples are the middles of intervals of `step` at most; others `farthest` (m) away are no partners. Raises
    `InterchangeError` without shapely.
    """
    shapely = package("shapely", "distances of contours need")
    parts = [_samples(line, step) for line in lines]
    xy, interval = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    start, end, at_start, at_end = _segments(others)
    tree = shapely.STRtree(shapely.linestrings(np.stack([start, end], axis=1)))
    _, segment = tree.query_nearest(shapely.points(xy), all_matches=False)
    along = end[segment] - start[segment]
    t = np.sum((xy - start[segment]) * along, axis=1) / np.sum(np.square(along), axis=1)
    nearest = start[segment] + np.clip(t, 0.0, 1.0)[:, None] * along
    past_end = ((t < 0.0) & at_start[segment]) | ((t > 1.0) & at_end[segment])
    too_far = np.linalg.norm(nearest - xy, axis=1) > farthest
    return Offsets(xy=xy, interval=interval, nearest=nearest, beyond=past_end | too_far)


def area_between(forward: Offsets, backward: Offsets) -> float:
    """Return the area (m2) between lines that were sampled both ways, NaN where one has no samples.

    The mean of both integrals of the distance d along a line: where one has the curvature k the other is 1 + k d
    times as long, and the strip between them d (1 + k d / 2) of the first.
    """
    if not len(forward.xy) or not len(backward.xy):
        return np.nan
    return float(0.5 * (forward.interval @ forward.distance + backward.interval @ backward.distance))


def largest_of_most(values: FloatArray, weight: FloatArray) -> float:
    """Return the least value (n,) that 95 % of the weight (n,) does not exceed."""
    order = np.argsort(values)
    share = np.cumsum(weight[order]) / weight.sum()
    return float(values[order[min(int(np.searchsorted(share, _MOST)), len(values) - 1)]])


def _samples(line: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Return places (n, 2) in the middle of equal intervals along a line (k, 2), and these (n,)."""
    station = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    count = max(int(np.ceil(station[-1] / step)), 1)
    at = (np.arange(count) + 0.5) * station[-1] / count
    xy = np.stack([np.interp(at, station, line[:, axis]) for axis in range(2)], axis=1)
    return xy, np.full(count, station[-1] / count)


def _segments(lines: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray]:
    """Return start and end (s, 2) of all segments, and which (s,) of these are open ends: no line goes on."""
    apart = [line[np.concatenate([[True], np.diff(line, axis=0).any(axis=1)])] for line in lines]
    apart = [line for line in apart if len(line) > 1]
    start, end = (np.concatenate([line[part] for line in apart]) for part in (slice(0, -1), slice(1, None)))
    last = np.cumsum([len(line) - 1 for line in apart]) - 1
    first = np.concatenate([[0], last[:-1] + 1])
    ends = np.round(np.concatenate([start[first], end[last]]) / _SAME)
    _, place, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    is_open = count[place.reshape(-1)] == 1
    at_start, at_end = np.zeros((2, len(start)), dtype=bool)
    at_start[first], at_end[last] = np.split(is_open, 2)
    return start, end, at_start, at_end
