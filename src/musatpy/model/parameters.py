"""Parameters of cameras, of lines and the like that an adjustment estimated, and whether it could."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model.kinds import ObservationKind
from musatpy.model.tables import Table, per_row

TIES = ("another parameter", "a station", "an attitude", "the water or else", "mean depth")
GRID_PLACES = 9  # of a grid of the distortion, along x and along y
_LEARNT, _KEPT = 0.5, 0.95  # of the sigma that was given
_TIED = 0.95  # correlations from here on are told of in verdicts


@dataclass(frozen=True, kw_only=True, eq=False)
class AdjustedParameters(Table):
    """x parameters after the adjustment, kind by kind, in the order of the unknowns."""

    kind: IntArray = per_row()  # (x,) ObservationKind
    noun: TextArray = per_row()  # (x,) of what they are: `camera`
    owner: TextArray = per_row()  # (x,) ids
    parameter: TextArray = per_row()  # (x,)
    unit: TextArray = per_row()  # (x,)
    given: FloatArray = per_row()  # (x,)
    prior_sigma: FloatArray = per_row()  # (x,) NaN: free
    value: FloatArray = per_row()  # (x,)
    spread: FloatArray = per_row()  # (x,) a posteriori sigma, whatever it is worth
    kept: FloatArray = per_row()  # (x,) a priori sigma after the adjustment over that given; NaN: free
    inflation: FloatArray = per_row()  # (x,) variance inflation factor
    determined: BoolArray = per_row()  # (x,) whether anything determines it, be it only what was given
    most: FloatArray = per_row()  # (x,) sigma up to which observations alone determine it
    effect: FloatArray = per_row()  # (x,) mm that one unit does to an image in the corner; NaN: not to images
    tied: TextArray = per_row(4)  # (x, 4) of each of the first `TIES` the unknown with the strongest correlation
    correlation: FloatArray = per_row(5)  # (x, 5) with these and with the mean depth of submerged points; NaN: none
    products: FloatArray = per_row(rows="pairs")  # (x x,) their joint covariance, row by row

    @property
    def covariance(self) -> FloatArray:
        """(x, x) a posteriori, whatever it is worth."""
        return self.products.reshape(self.count, self.count)

    @property
    def correlations(self) -> FloatArray:
        """(x, x) among the parameters."""
        return np.clip(self.covariance / np.outer(self.spread, self.spread), -1.0, 1.0)

    @property
    def sigma(self) -> FloatArray:
        """(x,) a posteriori, NaN for what is not determined."""
        return np.where(self.determined, self.spread, np.nan)

    @property
    def test(self) -> FloatArray:
        """(x,) change in its sigma, as Student's t; for a parameter that starts at zero, whether it is needed."""
        return (self.value - self.given) / self.sigma

    @cached_property
    def verdicts(self) -> TextArray:
        """(x,) whether each parameter was determined, and with what it is correlated."""
        verdict = np.where(self.kept > _LEARNT, "weakly determined", "determined")
        verdict = np.where(self.kept >= _KEPT, "only by its prior", verdict)
        verdict = np.where(self.determined, verdict, "not determined")
        partners = [
            f": {', correlation '.join(pair)}" if (pair := self._partner(row)) else "" for row in range(self.count)
        ]
        return np.char.add(verdict, np.array(partners, dtype=np.str_))

    def _partner(self, row: int) -> tuple[str, str] | None:
        """Return the unknown of something else that a parameter cannot be told from, and their correlation."""
        size = np.nan_to_num(np.abs(self.correlation[row, 1:4]))
        group = 1 + int(size.argmax())
        if size.max() < _TIED:
            return None
        return str(self.tied[row, group]), f"{self.correlation[row, group]:.3f}"

    @property
    def undetermined(self) -> Iterator[str]:
        """The names of what is not determined, with what it is correlated."""
        for row in np.flatnonzero(~self.determined).tolist():
            pair = self._partner(row)
            tie = f"correlation {pair[1]} with {pair[0]}; " if pair else ""
            tie = f" ({tie}a sigma of {self.most[row]:.1g} {self.unit[row]} would do)"
            yield f"{self.parameter[row]} of {self.noun[row]} {self.owner[row]}{tie}"

    def owners(self, kind: ObservationKind) -> list[list[str]]:
        """Return owner and name of the parameters of one kind, in their order."""
        rows = self.kind == kind
        return [list(pair) for pair in zip(self.owner[rows].tolist(), self.parameter[rows].tolist(), strict=True)]


@dataclass(frozen=True, kw_only=True, eq=False)
class DistortionGrid(Table):
    """What adjusted lenses do at g places of their plates, mm; the focal length does nothing to these."""

    camera: TextArray = per_row()  # (g,) ids
    place: FloatArray = per_row(2)  # (g, 2) measured, from the principal point
    distortion: FloatArray = per_row(2)  # (g, 2) measured minus ideal
    sigma: FloatArray = per_row(2)  # (g, 2) by the joint covariance; NaN where a parameter is not determined
