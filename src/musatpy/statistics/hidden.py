"""Errors that no test finds: how far they may move a point (external reliability, Baarda 1968)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from musatpy.model import ObservationKind, PointStatus
from musatpy.model.arrays import BoolArray, FloatArray, IntArray, freeze
from musatpy.statistics.quality import DETECTABLE

if TYPE_CHECKING:
    from musatpy.statistics.analyses import Statistics

FAR = 5.0  # sigmas of a point: what moves it farther and stays hidden makes it weakly checked


@dataclass(frozen=True, kw_only=True, eq=False)
class HiddenErrors:
    """What the largest error of an image or of the control of p points does to them while no test finds it."""

    shift: FloatArray  # (p,) m, infinite where nothing checks an observation, NaN without a position
    sigma: FloatArray  # (p,) m, of the position

    def __post_init__(self) -> None:
        freeze(self, "shift", float, -1)
        freeze(self, "sigma", float, len(self.shift))

    @property
    def sigmas(self) -> FloatArray:
        """(p,) the shift over the sigma of the position."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.shift / self.sigma)

    @property
    def worst_first(self) -> IntArray:
        """Rows of the points that have a shift, by falling sigmas; rounding errors do not order them."""
        size = np.nan_to_num(self.sigmas, nan=-np.inf, posinf=np.inf)
        order = np.lexsort((np.arange(len(size)), -np.round(size, 6)))
        return np.asarray(order[: np.count_nonzero(size > -np.inf)])

    @property
    def weak(self) -> BoolArray:
        """(p,) True where a hidden error may move the point by more than `FAR` of its sigmas."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.shift > FAR * self.sigma)


def hidden_errors(statistics: Statistics) -> HiddenErrors:
    """Return the errors of the points of a solution that stay hidden."""
    block, quality = statistics.block, statistics.quality
    observed = quality.observed
    shift = np.full(len(block.points.ids), np.nan)
    with np.errstate(divide="ignore"):
        error = DETECTABLE * observed.sigma / np.sqrt(np.where(quality.testable, observed.redundancy, 0.0))
    effect = np.linalg.norm(observed.influence, axis=1)
    with np.errstate(invalid="ignore"):
        effect = np.where(effect > 0.0, effect * error, 0.0)
    for kind, table in ((ObservationKind.PLATE, block.plates), (ObservationKind.CONTROL, block.control)):
        rows = np.flatnonzero(observed.kind == kind)
        np.fmax.at(shift, table.point[observed.row[rows]], effect[rows])
    shift[statistics.solution.points.status == PointStatus.INTERSECTED] = np.inf  # no test has its images
    return HiddenErrors(shift=shift, sigma=np.sqrt(np.square(statistics.point_sigmas).sum(axis=1)))
