"""Cameras: interior orientation, distortion and calibrated fiducial marks."""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.model.tables import Table, per_row

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
class Cameras(Table):
    """c cameras; plate millimetres. The image vector is (x - xp, y - yp, -f)."""

    ids: TextArray = per_row(identity=True, key=True)  # (c,)
    focal_length: FloatArray = per_row(unit="mm")  # (c,)
    principal_point: FloatArray = per_row(2, unit="mm")  # (c, 2)
    format_size: FloatArray = per_row(2, unit="mm")  # (c, 2) NaN where not given


@dataclass(frozen=True, kw_only=True, eq=False)
class Distortion(Table):
    """d records of lens distortion, in the order of the deck, each of one kind and with three values.

    Kinds: `RADL` coefficients k1, k2, k3 of the odd radial polynomial, `DCEN` decentring p1, p2, p3, `TABL` one
    calibrated radius (mm) and its distortion (mm), the third value NaN.
    """

    camera: IntArray = per_row(link="cameras")  # (d,) link to Cameras
    kind: TextArray = per_row(sort=True)  # (d,)
    values: FloatArray = per_row(3, sort=True)  # (d, 3), NaN where not given


@dataclass(frozen=True, kw_only=True, eq=False)
class Fiducials(Table):
    """q calibrated fiducial marks of cameras, millimetres."""

    camera: IntArray = per_row(link="cameras", key=True)  # (q,) link to Cameras
    ids: TextArray = per_row(key=True, sort=True)  # (q,)
    xy: FloatArray = per_row(2, unit="mm")  # (q, 2)
    sigma: FloatArray = per_row(2, unit="mm")  # (q, 2) NaN where not given
