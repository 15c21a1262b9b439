"""Parameters of lenses as unknowns of a simultaneous adjustment: what cards say of them, and what came out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model.tables import Table, per_row

# Focal length, principal point (mm), radial and decentring coefficients (powers of mm), affinity and shear.
LENS_PARAMETERS = ("F", "XP", "YP", "K1", "K2", "K3", "P1", "P2", "B1", "B2")
LENS_UNITS = ("mm", "mm", "mm", "1/mm2", "1/mm4", "1/mm6", "1/mm", "1/mm", "", "")
_MOST = 0.02  # of the distance of an image from the principal point: beyond such a sigma, nothing is determined
_LEARNT, _KEPT = 0.5, 0.95  # of the sigma that was given


@dataclass(frozen=True, kw_only=True, eq=False)
class LensUnknowns(Table):
    """l parameters of cameras that the simultaneous adjustment estimates, by their names in `LENS_PARAMETERS`.

    Polynomials are as the reduction means them (`ReductionOptions`): distortion or correction, of the measured or
    of the ideal place.
    """

    camera: IntArray = per_row(link="cameras", key=True)  # (l,) link to Cameras
    parameter: TextArray = per_row(sort=True)  # (l,)
    value: FloatArray = per_row(blank=np.nan)  # (l,) NaN: that of the camera and its distortion, or zero
    sigma: FloatArray = per_row(blank=np.nan)  # (l,) NaN: free


@dataclass(frozen=True, kw_only=True, eq=False)
class AdjustedLenses(Table):
    """l parameters of lenses after the adjustment, camera by camera in the order of `LENS_PARAMETERS`."""

    camera: TextArray = per_row()  # (l,) ids
    parameter: TextArray = per_row()  # (l,)
    given: FloatArray = per_row()  # (l,)
    prior_sigma: FloatArray = per_row()  # (l,) NaN: free
    value: FloatArray = per_row()  # (l,)
    spread: FloatArray = per_row()  # (l,) a posteriori sigma, whatever it is worth
    kept: FloatArray = per_row()  # (l,) a priori sigma after the adjustment over that given; NaN: free
    inflation: FloatArray = per_row()  # (l,) variance inflation factor
    effect: FloatArray = per_row()  # (l,) mm that one unit does to the image farthest from the principal point
    reach: FloatArray = per_row()  # (l,) mm, the distance of that image
    partner: TextArray = per_row()  # (l,) the unknown of something else with the strongest correlation; empty: none
    correlation: FloatArray = per_row()  # (l,) with it; NaN: none reaches 0.95

    @property
    def determined(self) -> BoolArray:
        """(l,) whether anything determines a parameter, be it only what was given."""
        return np.asarray(self.spread * self.effect <= _MOST * self.reach)

    @property
    def sigma(self) -> FloatArray:
        """(l,) a posteriori, NaN for what is not determined."""
        return np.where(self.determined, self.spread, np.nan)

    @property
    def test(self) -> FloatArray:
        """(l,) change in its sigma, as Student's t; for a parameter that starts at zero, whether it is needed."""
        return (self.value - self.given) / self.sigma

    @cached_property
    def verdicts(self) -> TextArray:
        """(l,) whether each parameter was determined, and with what it is correlated."""
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
            yield f"{self.parameter[row]} of camera {self.camera[row]}{tie}"
