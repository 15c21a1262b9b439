"""Antenna positions of a satellite receiver at the exposures, and what is known of antenna, lines and clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model.correlations import correlations_of
from musatpy.model.tables import POSITION_UNIT, Table, per_row

AXES = (
    "X",
    "Y",
    "Z",
)  # of a lever arm: along the image axes x, y and their third axis, from the ground to the camera
DIRECTIONS = ("E", "N", "U")  # of shifts and drifts: east, north, up at the antenna; X, Y, Z of a local job
_FREE = {"": False, "F": True}


@dataclass(frozen=True, kw_only=True, eq=False)
class AntennaPositions(Table, noun="antenna position"):
    """a observed antenna positions, in the coordinate system of the job (IIIA).

    observed = station + M' lever arm + shift + drift (t - mean t of the line), M from the ground to the photo.
    """

    photo: IntArray = per_row(link="photos", key=True)  # (a,)
    position: FloatArray = per_row(3, role="antenna_positions", unit=POSITION_UNIT)  # (a, 3)
    line: TextArray = per_row(role="antenna_positions", sort=True, blank="")  # (a,) flight line; empty: of none
    sigma: FloatArray = per_row(3, noun="standard deviations", unit="m")  # (a, 3) east north up
    correlation: FloatArray = per_row(  # (a, 3) east north, east up, north up; NaN without a card of covariances
        3, role="antenna_covariances", noun="correlations", blank=np.nan
    )

    @property
    def correlated(self) -> BoolArray:
        """(a,) True where correlations are given."""
        return np.asarray(np.isfinite(self.correlation).all(axis=1))

    @property
    def covariance(self) -> FloatArray:
        """(a, 3, 3) m2, of east, north, up."""
        return correlations_of(np.nan_to_num(self.correlation)) * self.sigma[:, :, None] * self.sigma[:, None, :]


@dataclass(frozen=True, kw_only=True, eq=False)
class ExposureTimes(Table, noun="time", about="antenna_positions"):
    """e times of exposures, on one clock."""

    photo: IntArray = per_row(link="photos", key=True)  # (e,)
    time: FloatArray = per_row(unit="s")  # (e,)


@dataclass(frozen=True, kw_only=True, eq=False)
class LeverArms(Table, about="antenna_positions"):
    """l vectors from the projection centre to the antenna, along the axes of the photo."""

    camera: IntArray = per_row(link="cameras", key=True)  # (l,)
    offset: FloatArray = per_row(3, unit="m")  # (l, 3)
    sigma: FloatArray = per_row(3, unit="m", blank=np.nan)  # (l, 3) NaN: held, or free
    free: BoolArray = per_row(codes=_FREE, blank=False)  # (l,) components without a sigma are free

    @property
    def unknown(self) -> BoolArray:
        """(l, 3) the component is an unknown."""
        return np.isfinite(self.sigma) | self.free[:, None]


@dataclass(frozen=True, kw_only=True, eq=False)
class AntennaLines(Table, noun="line", about="antenna_positions"):
    """g flight lines whose antenna positions have a shift and a drift linear in time, both zero as given."""

    line: TextArray = per_row(key=True, sort=True, used_by="antenna_positions.line")  # (g,)
    shift_sigma: FloatArray = per_row(3, unit="m", blank=np.nan)  # (g, 3) NaN: held, or free
    shift_free: BoolArray = per_row(codes=_FREE, blank=False)  # (g,) components without a sigma are free
    drift_sigma: FloatArray = per_row(3, unit="m/s", blank=np.nan)  # (g, 3) likewise
    drift_free: BoolArray = per_row(codes=_FREE, blank=False)  # (g,)

    @property
    def shifted(self) -> BoolArray:
        """(g, 3) the component of the shift is an unknown."""
        return np.isfinite(self.shift_sigma) | self.shift_free[:, None]

    @property
    def drifting(self) -> BoolArray:
        """(g, 3) the component of the drift is an unknown."""
        return np.isfinite(self.drift_sigma) | self.drift_free[:, None]
