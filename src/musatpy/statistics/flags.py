"""Flags against heights: what the answer says of points that are flagged as submerged, and of those that are not.

A point without the flag B that lies below the water of all its photos, or one with it that stands above all of it,
contradicts its flag, which v'Pv cannot: without the refraction of its rays the point fits as well, elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, falling
from musatpy.model import Block, OtherFlags, Program, Refraction, Solution
from musatpy.model.tables import Table, per_row
from musatpy.probability import test_limit
from musatpy.statistics.differences import elevations

LEAST_LIMIT = 4.0  # sigmas
FEW = 3  # flagged points that say less together than each
NO_BETTER = 16.0  # of v'Pv over sigma0 squared: smaller differences choose no flag
FINEST = 0.001  # m, sigma of heights that are without error: no card gives more


@dataclass(frozen=True, kw_only=True, eq=False)
class FlagTests(Table):
    """t points with a height, its sigma and a tide, but for those that are dry for certain."""

    point: IntArray = per_row(link="points")  # (t,)
    flagged: BoolArray = per_row()  # (t,)
    height: FloatArray = per_row()  # (t,) m
    water: FloatArray = per_row()  # (t,) m, lowest over a point that is not flagged, highest over one that is
    mixed: BoolArray = per_row()  # (t,) not flagged, and a sigma or more below some of its water, not below all
    shore: BoolArray = per_row()  # (t,) of a group of equal elevations: on the water line
    straight: FloatArray = per_row()  # (t,) m, height where its rays meet without refraction
    sigma: FloatArray = per_row()  # (t,) m, of the height above the water
    other_height: FloatArray = per_row()  # (t,) m, when all in doubt have the other flag; NaN where not known
    limit: float  # sigmas

    @property
    def wrong_side(self) -> FloatArray:
        """(t,) m, on the wrong side of all its water: depth without the flag, height above the water with it."""
        return np.where(self.flagged, self.height - self.water, self.water - self.height)

    @property
    def sigmas(self) -> FloatArray:
        """(t,) sigmas on the wrong side of the water."""
        return self.wrong_side / self.sigma

    @property
    def doubted(self) -> IntArray:
        """Rows of the points that contradict their flags, the worst first."""
        rows = np.flatnonzero(self.sigmas > self.limit)
        return rows[falling(self.sigmas[rows], 1)]

    @property
    def near(self) -> BoolArray:
        """(t,) True where a point, not on the shore, is a sigma or more on the wrong side, and not in doubt."""
        return ~self.shore & (self.mixed | ((self.sigmas > 1.0) & (self.sigmas <= self.limit)))

    def doubted_of(self, flagged: bool) -> IntArray:
        """Return the rows of the points that contradict their flags and have the flag, or do not."""
        return self.doubted[self.flagged[self.doubted] == flagged]

    def is_of_the_whole(self, other: OtherFlags | None) -> bool:
        """Return whether so many contradict their flags that water and heights may be of two datums.

        That half of those without it lie below the water is no such sign where flags were forgotten: where `other`
        ones are consistent.
        """
        flagged, unflagged = int(self.flagged.sum()), int((~self.flagged).sum())
        above, below = len(self.doubted_of(True)), len(self.doubted_of(False))
        forgotten = other is not None and other.consistent
        return (flagged >= FEW and 2 * above >= flagged) or (
            flagged > 0 and below > 0 and 2 * below >= unflagged and not forgotten
        )

    @property
    def offset(self) -> tuple[float, float]:
        """Between what and what (m) the water would have to stand higher for no point to contradict its flag.

        Of flagged points that is asked where their straight rays meet, above the water or below it as the point is.
        Infinite without any point on a side; the first is above the second where no one offset will do.
        """
        reach = self.limit * self.sigma
        flagged = self.flagged & np.isfinite(self.straight)
        least = (self.straight - self.water - reach)[flagged].max(initial=-np.inf)
        most = (self.height - self.water + reach)[~self.flagged].min(initial=np.inf)
        return float(least), float(most)


def flag_tests(solution: Solution, point_sigmas: FloatArray) -> FlagTests:
    """Return the flags of a solution held against its heights; of no point where nothing is refracted.

    `point_sigmas` (p, 3) m: those of the heights come last.
    """
    block, points, wet = solution.block, solution.points, solution.block.points.bathymetric
    height, other = elevations(block, points.position), np.full(len(wet), np.nan)
    if solution.other_flags is not None:
        other[solution.other_flags.point] = solution.other_flags.height
    sigma = np.hypot(point_sigmas[:, 2], points.water_sigma)
    tested = refracts(block) & ~block.points.dry & np.isfinite(height) & np.isfinite(points.water[:, 0])
    rows = np.flatnonzero(tested & np.isfinite(sigma))
    straight = height.copy()
    straight[solution.bathymetric.point] = elevations(block, solution.bathymetric.apparent)
    lowest, highest = points.water[rows].T
    return FlagTests(
        point=rows,
        flagged=wet[rows],
        height=height[rows],
        water=np.where(wet[rows], highest, lowest),
        mixed=~wet[rows] & (height[rows] + sigma[rows] < highest) & (height[rows] >= lowest),
        shore=np.isin(rows, block.equal_elevations.point),
        straight=straight[rows],
        sigma=np.maximum(sigma[rows], FINEST),
        other_height=other[rows],
        limit=flag_limit(len(rows)),
    )


def squares_choose(solution: Solution) -> bool:
    """Return whether the other flags make v'Pv larger or smaller by more than chance does."""
    other = solution.other_flags
    return other is not None and abs(other.sum_of_squares - solution.sum_of_squares) > NO_BETTER


def flag_limit(count: int) -> float:
    """Return how many sigmas on the wrong side of the water contradict a flag, where `count` points are tested."""
    return max(LEAST_LIMIT, test_limit(count))


def refracts(block: Block) -> bool:
    """Return whether the program of a block bends the rays of submerged points."""
    return block.options.program is not Program.IIA or block.options.refraction is not Refraction.NONE
