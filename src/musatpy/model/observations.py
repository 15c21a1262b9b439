"""Measurements on the plates: refined plate coordinates, and fiducial marks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model.tables import Table, per_row


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateMeasurements(Table):
    """m plate measurements, in the order of the deck."""

    photo: IntArray = per_row(link="photos", key=True)  # (m,) link to Photos
    point: IntArray = per_row(link="points", key=True)  # (m,) link to Points
    xy: FloatArray = per_row(2, sort=True, unit="mm")  # (m, 2)
    sigma: FloatArray = per_row(2, noun="standard deviations", unit="mm", blank=np.nan)  # (m, 2) NaN: the job's
    triangulated: BoolArray = per_row(codes={"": True, "N": False}, blank=True)  # (m,) False: kept out

    def first_readings(self) -> BoolArray:
        """Return (m,) True for the first measurement of each point on a photo: raw plates may have several."""
        first = np.zeros(len(self.photo), dtype=bool)
        first[np.unique(np.stack([self.photo, self.point]), axis=1, return_index=True)[1]] = True
        return first


@dataclass(frozen=True, kw_only=True, eq=False)
class FiducialMeasurements(Table):
    """r measured fiducial marks, in the order of the deck, in the measuring system of the plate."""

    photo: IntArray = per_row(link="photos", key=True)  # (r,) link to Photos
    ids: TextArray = per_row(key=True, sort=True)  # (r,) id of the mark on the camera
    xy: FloatArray = per_row(2, sort=True, unit="mm")  # (r, 2)
    sigma: FloatArray = per_row(2, unit="mm")  # (r, 2) NaN where not given
