"""Cameras: interior orientation, distortion and calibrated fiducial marks."""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.model.arrays import freeze

FOCAL_LENGTHS = (85.0, 88.5, 100.0, 115.0, 152.5, 210.0, 305.0, 610.0)  # mm, of aerial cameras
_ONE_TYPE = 0.02  # relative difference of focal lengths of one type of camera


def other_focal_length(focal: float, ratio: float, same: float) -> float:
    """Return the focal length (mm) of another type of camera that makes everything `ratio` times as wide, else 0.

    `focal` is the one given; ratios that differ from 1 by less than `same` are those of the camera itself.
    """
    if not abs(ratio - 1.0) > same:
        return 0.0
    others = (other for other in FOCAL_LENGTHS if abs(focal / ratio / other - 1.0) < max(_ONE_TYPE, 0.5 * same))
    return min(others, key=lambda other: abs(focal / ratio / other - 1.0), default=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cameras:
    """c cameras; plate millimetres. The image vector is (x - xp, y - yp, -f)."""

    ids: TextArray  # (c,)
    focal_length: FloatArray  # (c,) mm
    principal_point: FloatArray  # (c, 2) mm
    format_size: FloatArray  # (c, 2) mm, NaN where not given

    def __post_init__(self) -> None:
        freeze(self, "ids", str, -1)
        c = len(self.ids)
        freeze(self, "focal_length", float, c)
        freeze(self, "principal_point", float, c, 2)
        freeze(self, "format_size", float, c, 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Distortion:
    """d records of lens distortion, in the order of the deck, each of one kind and with three values.

    Kinds: `RADL` coefficients k1, k2, k3 of the odd radial polynomial, `DCEN` decentring p1, p2, p3, `TABL` one
    calibrated radius (mm) and its distortion (mm), the third value NaN.
    """

    camera: IntArray  # (d,) link to Cameras
    kind: TextArray  # (d,)
    values: FloatArray  # (d, 3), NaN where not given

    def __post_init__(self) -> None:
        freeze(self, "camera", int, -1)
        freeze(self, "kind", str, len(self.camera))
        freeze(self, "values", float, len(self.camera), 3)


@dataclass(frozen=True, kw_only=True, eq=False)
class Fiducials:
    """q calibrated fiducial marks of cameras, millimetres."""

    camera: IntArray  # (q,) link to Cameras
    ids: TextArray  # (q,)
    xy: FloatArray  # (q, 2) mm
    sigma: FloatArray  # (q, 2) mm, NaN where not given

    def __post_init__(self) -> None:
        freeze(self, "camera", int, -1)
        q = len(self.camera)
        freeze(self, "ids", str, q)
        freeze(self, "xy", float, q, 2)
        freeze(self, "sigma", float, q, 2)
