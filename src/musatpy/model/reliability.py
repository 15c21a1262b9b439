"""How well the observations of an adjustment check each other, and how its unknowns depend on one another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.model.arrays import freeze


@dataclass(frozen=True, kw_only=True, eq=False)
class Observations:
    """The o scalar observations that took part in an adjustment, in the units of their kinds.

    `influence` is what an error of one unit does to the position that the observation belongs to, east, north, up
    in metres: that of its ground point, or of its exposure station; of the second end of a base, distance or height
    difference; NaN for the water.
    """

    kind: IntArray  # (o,) ObservationKind
    row: IntArray  # (o,) link to the table of the kind
    component: IntArray  # (o,)
    residual: FloatArray  # (o,) adjusted minus observed
    sigma: FloatArray  # (o,) a priori
    redundancy: FloatArray  # (o,) share of an error that shows in the own residual; they add up to the redundancy
    influence: FloatArray  # (o, 3)
    considered: FloatArray | None = None  # (o,) variance of the residual from considered water; None: no such

    def __post_init__(self) -> None:
        freeze(self, "kind", int, -1)
        o = len(self.kind)
        freeze(self, "row", int, o)
        freeze(self, "component", int, o)
        for name in ("residual", "sigma", "redundancy"):
            freeze(self, name, float, o)
        freeze(self, "influence", float, o, 3)
        if self.considered is not None:
            freeze(self, "considered", float, o)

    @property
    def share(self) -> FloatArray:
        """(o,) variance that the residual should have, over that of the observation: the redundancy number.

        Considered parameters add to it.
        """
        if self.considered is None:
            return self.redundancy
        return self.redundancy + self.considered / np.square(self.sigma)

    @property
    def visibility(self) -> FloatArray:
        """(o,) sigmas of the residual by which an error of one sigma of the observation moves it."""
        share = np.maximum(self.share, 0.0)
        return np.divide(self.redundancy, np.sqrt(share), out=np.zeros_like(share), where=share > 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ConsideredWater:
    """c parameters of the water that have a sigma and were not adjusted; their errors are in all sigmas."""

    names: TextArray  # (c,)
    units: TextArray  # (c,) in which a sigma is read: m, arc sec, deg, or none for the index
    sigma: FloatArray  # (c,) m, rad, or none for the index
    explained: float  # of the weighted sum of squares: what errors of such sigmas explain best

    def __post_init__(self) -> None:
        freeze(self, "names", str, -1)
        freeze(self, "units", str, len(self.names))
        freeze(self, "sigma", float, len(self.names))


@dataclass(frozen=True, kw_only=True, eq=False)
class Dependence:
    """How the unknowns of the normal equations depend on one another.

    The variance inflation factor of an unknown is the diagonal element of the normal matrix, before any point is
    eliminated, times its cofactor: 1/(1 - R^2) of its column against all others. Correlations are those of 0.95 and
    more between unknowns of a photo, of photos that have a point in common, and of the globals with all others.
    """

    station_inflation: FloatArray  # (n, 6) NaN where a parameter was held
    names: TextArray  # (g,) the global unknowns: levels, water, kept points
    sigma: FloatArray  # (g,) a posteriori, in m, rad, or none for the index
    inflation: FloatArray  # (g,)
    first: TextArray  # (c,) names of correlated unknowns, the most correlated ones first
    second: TextArray  # (c,)
    correlation: FloatArray  # (c,)

    def __post_init__(self) -> None:
        freeze(self, "station_inflation", float, -1, 6)
        freeze(self, "names", str, -1)
        for name in ("sigma", "inflation"):
            freeze(self, name, float, len(self.names))
        freeze(self, "first", str, -1)
        freeze(self, "second", str, len(self.first))
        freeze(self, "correlation", float, len(self.first))
