"""Measurements on the plates: refined plate coordinates, and fiducial marks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model.arrays import freeze


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateMeasurements:
    """m plate measurements, in the order of the deck."""

    photo: IntArray  # (m,) link to Photos
    point: IntArray  # (m,) link to Points
    xy: FloatArray  # (m, 2) mm
    sigma: FloatArray  # (m, 2) mm, NaN where the job's plate sigma holds
    triangulated: BoolArray  # (m,) False: kept out of the solution by its flag

    def __post_init__(self) -> None:
        freeze(self, "photo", int, -1)
        m = len(self.photo)
        freeze(self, "point", int, m)
        freeze(self, "xy", float, m, 2)
        freeze(self, "sigma", float, m, 2)
        freeze(self, "triangulated", bool, m)


@dataclass(frozen=True, kw_only=True, eq=False)
class FiducialMeasurements:
    """r measured fiducial marks, in the order of the deck, in the measuring system of the plate."""

    photo: IntArray  # (r,) link to Photos
    ids: TextArray  # (r,) id of the mark on the camera
    xy: FloatArray  # (r, 2) mm
    sigma: FloatArray  # (r, 2) mm, NaN where not given

    def __post_init__(self) -> None:
        freeze(self, "photo", int, -1)
        r = len(self.photo)
        freeze(self, "ids", str, r)
        freeze(self, "xy", float, r, 2)
        freeze(self, "sigma", float, r, 2)


def no_fiducial_measurements() -> FiducialMeasurements:
    """Return no measured marks at all."""
    return FiducialMeasurements(
        photo=np.zeros(0, dtype=int), ids=np.zeros(0, dtype=np.str_), xy=np.zeros((0, 2)), sigma=np.zeros((0, 2))
    )
