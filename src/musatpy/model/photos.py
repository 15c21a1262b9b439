"""Photos: exposure station position, attitude and tide, each with its sigmas."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.model.arrays import freeze


def _nobody() -> TextArray:
    return np.zeros(0, dtype=np.str_)


def _never() -> FloatArray:
    return np.zeros(0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Photos:
    """n photos, in the order of their station cards.

    Positions stand in the coordinate system of the job (`CoordinateSystem`): geographic ones are latitude and
    longitude in radians and ellipsoidal height in metres. Sigmas of positions are along east, north, up (X, Y, Z in
    local jobs), in metres, whatever the system. Attitudes are X-tilt, Y-tilt, heading (omega, phi, kappa), rad, in
    the local vertical frame of the given position. A sigma that is NaN means: not observed, approximate only.
    Positions and attitudes are NaN where initial values are to be computed and no card gives any.
    The tide is the height of the water surface at the exposure (ellipsoidal height, or Z in local jobs).
    """

    ids: TextArray  # (n,)
    camera: IntArray  # (n,) link to Cameras
    position: FloatArray  # (n, 3) in the job's system
    position_sigma: FloatArray  # (n, 3) m, east north up
    attitude: FloatArray  # (n, 3) rad
    attitude_sigma: FloatArray  # (n, 3) rad
    tide: FloatArray  # (n,) m, NaN where not given
    tide_sigma: FloatArray  # (n,) m, NaN where not given
    tide_group: TextArray = field(default_factory=_nobody)  # (n,) photos with a common correction; empty: none
    tide_day: TextArray = field(default_factory=_nobody)  # (n,) day of the exposure; empty: not given
    time: FloatArray = field(
        default_factory=_never
    )  # (n,) s of the exposure, on one clock for waves; NaN: not given

    def __post_init__(self) -> None:
        freeze(self, "ids", str, -1)
        n = len(self.ids)
        freeze(self, "camera", int, n)
        for name in ("position", "position_sigma", "attitude", "attitude_sigma"):
            freeze(self, name, float, n, 3)
        for name in ("tide", "tide_sigma"):
            freeze(self, name, float, n)
        for name in ("tide_group", "tide_day"):
            if np.size(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.full(n, ""))
            freeze(self, name, str, n)
        if np.size(self.time) == 0:
            object.__setattr__(self, "time", np.full(n, np.nan))
        freeze(self, "time", float, n)
