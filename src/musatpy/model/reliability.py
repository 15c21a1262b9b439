"""How well the observations of an adjustment check each other, and how its unknowns depend on one another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.model.tables import Table, per_row


@dataclass(frozen=True, kw_only=True, eq=False)
class Observations(Table):
    """The o scalar observations that took part in an adjustment, in the units of their kinds.

    `influence` is what an error of one unit does to the position that the observation belongs to, east, north, up
    in metres: that of its ground point, or of its exposure station; of the second end of a base, distance or height
    difference; NaN for the water.
    """

    kind: IntArray = per_row()  # (o,) ObservationKind
    row: IntArray = per_row()  # (o,) link to the table of the kind
    component: IntArray = per_row()  # (o,)
    residual: FloatArray = per_row()  # (o,) adjusted minus observed
    sigma: FloatArray = per_row()  # (o,) a priori
    redundancy: FloatArray = per_row()  # (o,) share of an error that shows in the residual
    influence: FloatArray = per_row(3)  # (o, 3)
    considered: FloatArray = per_row(blank=0.0)  # (o,) variance of the residual from considered water

    @property
    def share(self) -> FloatArray:
        """(o,) variance that the residual should have, over that of the observation: the redundancy number.

        Considered parameters add to it.
        """
        return self.redundancy + self.considered / np.square(self.sigma)

    @property
    def visibility(self) -> FloatArray:
        """(o,) sigmas of the residual by which an error of one sigma of the observation moves it."""
        share = np.maximum(self.share, 0.0)
        return np.divide(self.redundancy, np.sqrt(share), out=np.zeros_like(share), where=share > 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ConsideredWater(Table):
    """c parameters of the water that have a sigma and were not adjusted; their errors are in all sigmas."""

    names: TextArray = per_row()  # (c,)
    units: TextArray = per_row()  # (c,) in which a sigma is read: m, arc sec, deg, or none for the index
    sigma: FloatArray = per_row()  # (c,) m, rad, or none for the index
    explained: float  # of the weighted sum of squares: what errors of such sigmas explain best


@dataclass(frozen=True, kw_only=True, eq=False)
class Dependence(Table):
    """How the unknowns of the normal equations depend on one another.

    The variance inflation factor of an unknown is the diagonal element of the normal matrix, before any point is
    eliminated, times its cofactor: 1/(1 - R^2) of its column against all others. Correlations are those of 0.95 and
    more between unknowns of a photo, of photos that have a point in common, and of the globals with all others.
    """

    station_inflation: FloatArray = per_row(6)  # (n, 6) NaN where a parameter was held
    names: TextArray = per_row(rows="globals")  # (g,) the global unknowns: levels, water, kept points
    sigma: FloatArray = per_row(rows="globals")  # (g,) a posteriori, in m, rad, or none for the index
    inflation: FloatArray = per_row(rows="globals")  # (g,)
    first: TextArray = per_row(rows="pairs")  # (c,) names of correlated unknowns, the most correlated ones first
    second: TextArray = per_row(rows="pairs")  # (c,)
    correlation: FloatArray = per_row(rows="pairs")  # (c,)


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldParameters(Table):
    """The h parameters that an adjustment holds and that many observations have in common, each with what it does.

    An error e of one (given minus true) adds c e to the residuals, of which the adjustment leaves r e: c'Pc is the
    `whole` column, r'Pr its `redundant` part, v'Pr the `pull` of the residuals v. What moves most in its own sigmas
    goes by `shift` metres and `sigmas` for an error of one unit: of the stations, the points, the depths; -1, and
    NaN, where nothing has a sigma.
    """

    names: TextArray = per_row()  # (h,)
    units: TextArray = per_row()  # (h,) of the errors: mm, m, or none
    reference: FloatArray = per_row()  # (h,) error by which movements are stated
    limit: FloatArray = per_row()  # (h,) error beyond which nobody believes the parameter
    pull: FloatArray = per_row()
    redundant: FloatArray = per_row()
    whole: FloatArray = per_row()
    considered: FloatArray = per_row()  # (h,) variance of the pull from considered parameters
    moved: IntArray = per_row(3)  # (h, 3) links to photos, points, points
    shift: FloatArray = per_row(3)  # (h, 3) m
    sigmas: FloatArray = per_row(3)  # (h, 3)
    adjusted: int  # parameters of the kind that are unknowns
    known_with_sigma: int  # those that are considered
