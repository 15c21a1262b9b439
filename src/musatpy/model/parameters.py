"""Parameters of cameras, of lines and the like that an adjustment estimated, and whether it could."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model.kinds import ObservationKind
from musatpy.model.tables import Table, per_row

_LEARNT, _KEPT = 0.5, 0.95  # of the sigma that was given


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
    most: FloatArray = per_row()  # (x,) sigma beyond which nothing is determined
    effect: FloatArray = per_row()  # (x,) mm that one unit does to an image in the corner; NaN: not to images
    partner: TextArray = per_row()  # (x,) the unknown of something else with the strongest correlation; empty: none
    correlation: FloatArray = per_row()  # (x,) with it; NaN: none reaches 0.95

    @property
    def determined(self) -> BoolArray:
        """(x,) whether anything determines a parameter, be it only what was given."""
        return np.asarray(self.spread <= self.most)

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
        tied = [
            f"{text}: {partner}, correlation {value:.3f}" if partner else text
            for text, partner, value in zip(
                verdict.tolist(), self.partner.tolist(), self.correlation.tolist(), strict=True
            )
        ]
        return np.array(tied, dtype=np.str_)

    @property
    def undetermined(self) -> Iterator[str]:
        """The names of what is not determined, with what it is correlated."""
        for row in np.flatnonzero(~self.determined).tolist():
            tie = (
                f" (correlation {self.correlation[row]:.3f} with {self.partner[row]})" if self.partner[row] else ""
            )
            yield f"{self.parameter[row]} of {self.noun[row]} {self.owner[row]}{tie}"

    def owners(self, kind: ObservationKind) -> list[list[str]]:
        """Return owner and name of the parameters of one kind, in their order."""
        rows = self.kind == kind
        return [list(pair) for pair in zip(self.owner[rows].tolist(), self.parameter[rows].tolist(), strict=True)]
