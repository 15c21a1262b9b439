"""Parameters of cameras as unknowns of a simultaneous adjustment: what cards say of lenses and ports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.model.tables import Table, per_row, taken

# Focal length, principal point (mm), radial and decentring coefficients (powers of mm), affinity and shear.
LENS_PARAMETERS = ("F", "XP", "YP", "K1", "K2", "K3", "P1", "P2", "B1", "B2")
LENS_UNITS = ("mm", "mm", "mm", "1/mm2", "1/mm4", "1/mm6", "1/mm", "1/mm", "", "")


@dataclass(frozen=True, kw_only=True, eq=False)
class LensUnknowns(Table):
    """l parameters of cameras that the simultaneous adjustment estimates: `LENS_PARAMETERS` or `PORT_PARAMETERS`.

    Polynomials are as the reduction means them (`ReductionOptions`): distortion or correction, of the measured or
    of the ideal place.
    """

    camera: IntArray = per_row(link="cameras", key=True)  # (l,) link to Cameras
    parameter: TextArray = per_row(sort=True)  # (l,)
    value: FloatArray = per_row(blank=np.nan)  # (l,) NaN: that of camera, distortion and port, or zero
    sigma: FloatArray = per_row(blank=np.nan)  # (l,) NaN: free

    def of(self, names: Sequence[str]) -> Self:
        """Return the rows of some parameters: those of lenses, or of ports."""
        return taken(self, np.isin(self.parameter, names))
