"""Cameras: interior orientation, distortion and calibrated fiducial marks."""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.model.arrays import FloatArray, IntArray, TextArray, freeze


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
