"""Cameras of a simultaneous adjustment: unknown parameters of lenses and ports, flat ports before cameras.

These are the planes of glass behind which cameras are, under water or in air over it.
"""

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

# Distance and thickness, index of the glass and of the water, tilts about x and y: as CAL cards call and mean them.
PORT_PARAMETERS = ("PD", "PT", "PG", "PW", "PX", "PY")
PORT_SIZES = ("distance", "thickness", "glass_index", "water_index")  # the columns of the first four
PORT_UNITS = ("mm", "mm", "", "", "deg", "deg")


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Ports(Table):
    """f flat ports of cameras (IIIA): parallel planes, fixed to the camera.

    The normal is the axis of the camera, turned about image x and then about image y, right-handed.
    """

    camera: IntArray = per_row(link="cameras", key=True)  # (f,) link to Cameras
    distance: FloatArray = per_row(unit="mm")  # (f,) of the inner face of the glass from the projection centre
    thickness: FloatArray = per_row(unit="mm")  # (f,)
    glass_index: FloatArray = per_row()  # (f,) relative to the air in the housing
    water_index: FloatArray = per_row()  # (f,) likewise; 1: a camera in air
    tilt: FloatArray = per_row(2, unit="rad", blank=0.0)  # (f, 2)
