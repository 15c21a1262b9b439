"""Photos: exposure station position, attitude and tide, each with its sigmas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.model.tables import Table, per_row


@dataclass(frozen=True, kw_only=True, eq=False)
class Photos(Table):
    """n photos, in the order of their station cards.

    Positions stand in the coordinate system of the job (`CoordinateSystem`): geographic ones are latitude and
    longitude in radians and ellipsoidal height in metres. Sigmas of positions are along east, north, up (X, Y, Z in
    local jobs), in metres, whatever the system. Attitudes are X-tilt, Y-tilt, heading (omega, phi, kappa), rad, in
    the local vertical frame of the given position. A sigma that is NaN means: not observed, approximate only.
    Positions and attitudes are NaN where initial values are to be computed and no card gives any.
    The tide is the height of the water surface at the exposure (ellipsoidal height, or Z in local jobs).
    """

    ids: TextArray = per_row(identity=True, key=True)  # (n,)
    camera: IntArray = per_row(link="cameras", role="stations")  # (n,) link to Cameras
    position: FloatArray = per_row(3, role="stations")  # (n, 3) in the job's system
    position_sigma: FloatArray = per_row(  # (n, 3) east north up
        3, role="stations", noun="standard deviations of the position", unit="m", blank=np.nan
    )
    attitude: FloatArray = per_row(3, role="attitudes", unit="rad")  # (n, 3)
    attitude_sigma: FloatArray = per_row(  # (n, 3)
        3, role="attitudes", noun="standard deviations of the attitude", unit="rad", blank=np.nan
    )
    tide: FloatArray = per_row(role="tides", blank=np.nan, unit="m")  # (n,) NaN where not given
    tide_sigma: FloatArray = per_row(role="tides", blank=np.nan, unit="m")  # (n,) NaN where not given
    tide_group: TextArray = per_row(role="tides", blank="")  # (n,) photos with a common correction; empty: none
    tide_day: TextArray = per_row(role="tides", blank="")  # (n,) day of the exposure; empty: not given
    time: FloatArray = per_row(role="tides", blank=np.nan, unit="s")  # (n,) of the exposure, on one clock
