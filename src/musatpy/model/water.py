"""The water of a job: refractive index and tilt of its surface; its level is the tide of each photo."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Water:
    """Refractive index of water relative to air, tilt of the surface, and their sigmas (None where not given).

    The tilts are the slopes of the surface (rad) towards east and north, rising positive, against the level surface
    through the tide; they turn it about the middle of the exposure stations, where the tides hold. None is level.
    """

    index: float = 1.340  # sea water; fresh water is 1.3333 (docs/theory.md, Errata)
    sigma: float | None = None
    tilt_east: float | None = None
    tilt_north: float | None = None
    tilt_sigma: float | None = None
