"""Errors that no test finds: how far they may move a point (external reliability, Baarda 1968)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model import ObservationKind, PointStatus
from musatpy.model.ranking import falling
from musatpy.model.tables import Table, per_row
from musatpy.statistics.quality import POWER, test_limit

if TYPE_CHECKING:
    from musatpy.statistics.analyses import Statistics

FAR = 5.0  # sigmas of a point: what moves it farther and stays hidden makes it weakly checked
_DECIMALS = 1  # of sigmas, as they are printed


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
