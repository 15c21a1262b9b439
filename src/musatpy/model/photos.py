"""Photographs: cameras, exposure stations, ground points, what was measured on the plates, what is known besides.

That is control points, equal elevations, air bases, distances and height differences.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Points(Table):
    """p points, in the order of their first appearance in the deck (plate cards before control cards)."""

    ids: TextArray = per_row(identity=True)  # (p,)
    bathymetric: BoolArray = per_row(codes={"": False, "B": True}, noun="submerged flag", blank=False)  # (p,)
    # (p,) for certain, though the point may lie below the water: behind a dike, in a polder or a sump
    dry: BoolArray = per_row(codes={"": False, "D": True}, noun="flag of certainly dry points", blank=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.bathymetric & self.dry).any():
            raise ValueError("points that are submerged and dry")

    @property
    def letters(self) -> TextArray:
        """(p,) the flags as cards have them: B submerged, D dry for certain, blank neither."""
        return np.where(self.bathymetric, "B", np.where(self.dry, "D", ""))


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


class ControlKind(IntEnum):
    """Which components of a control point are known to the adjustment."""

    FULL = 0
    HORIZONTAL = 1
    VERTICAL = 2
    CHECK = 3  # none: compared with the result only


_LETTERS = {
    "": ControlKind.CHECK,
    "F": ControlKind.FULL,
    "H": ControlKind.HORIZONTAL,
    "V": ControlKind.VERTICAL,
    "C": ControlKind.CHECK,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Control(Table):
    """k control points.

    Positions stand in the coordinate system of the job (see `Photos`), NaN in components that the card leaves
    blank; sigmas are along east, north, up (X, Y, Z in local jobs), metres. A `fixed` point holds its known
    components without error, whatever its sigmas.
    """

    point: IntArray = per_row(link="points", key=True)  # (k,) link to Points
    kind: IntArray = per_row(sort=True, codes=_LETTERS)  # (k,) ControlKind
    fixed: BoolArray = per_row(codes={"": False, "X": True}, noun="fixed flag", blank=False)  # (k,)
    position: FloatArray = per_row(3, sort=True)  # (k, 3) in the job's system
    sigma: FloatArray = per_row(  # (k, 3) east north up, or NaN
        3, noun="standard deviations", unit="m", blank=np.nan
    )

    @property
    def known(self) -> BoolArray:
        """(k, 3) True where the east, north, up component enters the adjustment."""
        horizontal = (self.kind == ControlKind.FULL) | (self.kind == ControlKind.HORIZONTAL)
        vertical = (self.kind == ControlKind.FULL) | (self.kind == ControlKind.VERTICAL)
        return np.stack([horizontal, horizontal, vertical], axis=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class EqualElevations(Table):
    """g groups of points that share one unknown level (a shore line, a lake), and their members."""

    ids: TextArray = per_row(identity=True)  # (g,)
    sigma: FloatArray = per_row(unit="m")  # (g,) of each point about the level
    group: IntArray = per_row(link="equal_elevations", rows="members")  # (e,) link to ids
    point: IntArray = per_row(link="points", rows="members")  # (e,) link to Points

    def with_members(self, stays: BoolArray) -> EqualElevations:
        """Return the groups with some of their members (e,), without the groups that have none left."""
        group, point = self.group[stays], self.point[stays]
        used = np.isin(np.arange(len(self.ids)), group)
        number = np.cumsum(used) - 1
        return EqualElevations(ids=self.ids[used], sigma=self.sigma[used], group=number[group], point=point)


@dataclass(frozen=True, kw_only=True, eq=False)
class AirBases(Table):
    """b known distances between two exposure stations."""

    photo: IntArray = per_row(2, link="photos")  # (b, 2) links to Photos
    length: FloatArray = per_row(unit="m")  # (b,)
    sigma: FloatArray = per_row(unit="m")  # (b,)


@dataclass(frozen=True, kw_only=True, eq=False)
class Distances(Table):
    """d measured distances between two ground points, along the straight line (IIIA)."""

    point: IntArray = per_row(2, link="points")  # (d, 2) links to Points
    length: FloatArray = per_row(unit="m")  # (d,)
    sigma: FloatArray = per_row(unit="m")  # (d,)


@dataclass(frozen=True, kw_only=True, eq=False)
class HeightDifferences(Table):
    """d measured height differences between two ground points, the second minus the first (IIIA)."""

    point: IntArray = per_row(2, link="points")  # (d, 2) links to Points
    difference: FloatArray = per_row(unit="m")  # (d,)
    sigma: FloatArray = per_row(unit="m")  # (d,)
