"""Errors that no test finds: of single observations, and of parameters that many have in common; and their tests.

How far they may move a point is its external reliability (Baarda 1968).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model import HeldParameters, ObservationKind, PointStatus
from musatpy.model.ranking import falling
from musatpy.model.tables import Table, per_row
from musatpy.statistics.quality import POWER, TEST_DECIMALS, test_limit

if TYPE_CHECKING:
    from musatpy.statistics.analyses import Statistics

SEEN = 1e-8  # of the squares of a column: what the residuals show below is rounding
_DECIMALS = 1  # of sigmas, as they are printed
FAR = 5.0  # sigmas of a point: what moves it farther and stays hidden makes it weakly checked
_BELIEVED = 4.0  # sigmas: no error that one may believe moves anything by more


@dataclass(frozen=True, kw_only=True, eq=False)
class CommonErrors(Table):
    """The tests of h parameters that are held; NaN where there is none."""

    held: HeldParameters
    limit: float  # of the tests, together at the level of `quality.FAMILY_RISK`
    test: FloatArray = per_row()  # (h,) normal
    estimated: FloatArray = per_row()  # (h,) given minus true, in its unit
    smallest: FloatArray = per_row()  # (h,) error that the test finds with the power `quality.BETA`

    @property
    def tested(self) -> BoolArray:
        """(h,) True where there is a test."""
        return ~np.isnan(self.smallest)

    @property
    def beyond(self) -> IntArray:
        """The parameters beyond their tests, the worst first."""
        size = np.nan_to_num(np.abs(self.test))
        return falling(size, TEST_DECIMALS)[: np.count_nonzero(size > self.limit)]

    def moved_by(self, error: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return by how much errors (h,) move what they move most in its sigmas: (h, 3) m, and in sigmas."""
        return self.held.shift * error[:, None], self.held.sigmas * error[:, None]

    @property
    def untested(self) -> IntArray:
        """The parameters without a test an error of which may move something by over `_BELIEVED` of its sigmas.

        Those first whose reference error moves most.
        """
        reference = np.nan_to_num(self.moved_by(self.held.reference)[1]).max(axis=1, initial=0.0)
        most = reference / self.held.reference * self.held.limit
        named = ~self.tested & (most > _BELIEVED)
        return falling(np.where(named, reference, -1.0), _DECIMALS)[: np.count_nonzero(named)]


def common_errors(statistics: Statistics) -> CommonErrors | None:
    """Return the tests of the parameters of a solution that are held, None where it says nothing of them.

    A parameter has no test where residuals show less than `SEEN` of its error, or none that is smaller than what
    anybody would believe of it. The limit is that of those that have one.
    """
    from musatpy.statistics.verdict import by_sigma0, sigma_of_tests  # which read these statistics

    held = statistics.solution.held
    if held is None:
        return None
    seen = (
        (held.redundant >= SEEN * held.whole)
        & (held.redundant > 0.0)
        & (statistics.solution.degrees_of_freedom > 0)
    )
    redundant = np.where(seen, held.redundant, np.nan)
    deviation = np.sqrt(redundant + held.considered)  # of the pull
    sigma = sigma_of_tests(statistics) * deviation / redundant
    count = _tests(sigma / held.limit)
    limit = test_limit(count)
    smallest = (limit + POWER) * sigma
    with np.errstate(invalid="ignore"):
        smallest = np.where(smallest <= held.limit, smallest, np.nan)
    test = np.where(np.isnan(smallest), np.nan, held.pull / deviation)
    return CommonErrors(
        held=held,
        limit=limit,
        test=by_sigma0(statistics, test, np.zeros(len(test), dtype=bool)),
        estimated=np.where(np.isnan(smallest), np.nan, held.pull / redundant),
        smallest=smallest,
    )


def _tests(sigma: FloatArray) -> int:
    """Return how many tests there are: the most that find errors within the range of their parameters.

    `sigma` (h,) are those of the estimated errors, in these ranges, NaN where nothing shows; more tests have a
    higher limit.
    """
    ordered = np.sort(sigma)  # NaN last
    counts = [
        count for count in range(1, len(sigma) + 1) if (test_limit(count) + POWER) * ordered[count - 1] <= 1.0
    ]
    return max(counts, default=0)


@dataclass(frozen=True, kw_only=True, eq=False)
class HiddenErrors(Table):
    """What the largest error of an image or of the control of p points does to them while no test finds it."""

    shift: FloatArray = per_row()  # (p,) m, infinite where nothing checks an observation, NaN without a position
    sigmas: FloatArray = per_row()  # (p,) the same in sigmas of the coordinate that moves most of its own

    @property
    def worst_first(self) -> IntArray:
        """Rows of the points that have a shift, by falling sigmas."""
        return falling(self.sigmas, _DECIMALS)[: np.count_nonzero(~np.isnan(self.sigmas))]

    @property
    def weak(self) -> BoolArray:
        """(p,) True where a hidden error may move the point by more than `FAR` of its sigmas."""
        with np.errstate(invalid="ignore"):
            return self.sigmas > FAR


def hidden_errors(statistics: Statistics) -> HiddenErrors:
    """Return the errors of the points of a solution that stay hidden from the tests of the verdict."""
    block, observed = statistics.block, statistics.quality.observed
    testable = statistics.quality.testable
    detectable = test_limit(int(testable.sum())) + POWER
    with np.errstate(divide="ignore", invalid="ignore"):
        error = detectable * observed.sigma / np.where(testable, observed.visibility, 0.0)
        effect = np.where(observed.influence == 0.0, 0.0, np.abs(observed.influence) * error[:, None])
    shift, sigmas = np.full((2, len(block.points.ids)), np.nan)
    for kind, table in ((ObservationKind.PLATE, block.plates), (ObservationKind.CONTROL, block.control)):
        rows = np.flatnonzero(observed.kind == kind)
        point = table.point[observed.row[rows]]
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = effect[rows] / statistics.point_sigmas[point]
        np.fmax.at(shift, point, np.linalg.norm(effect[rows], axis=1))
        np.fmax.at(sigmas, point, np.nan_to_num(relative, nan=0.0, posinf=np.inf).max(axis=1))
    kept_out = statistics.solution.points.status == PointStatus.INTERSECTED  # no test has their images
    shift[kept_out] = sigmas[kept_out] = np.inf
    return HiddenErrors(shift=shift, sigmas=sigmas)
