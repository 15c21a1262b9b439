"""Attitudes of inertial units that are fixed to cameras: what cards say of them (IIIA)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model.tables import InCommon, Table, per_row

MISALIGNMENT_ANGLES = ("OMEGA", "PHI", "KAPPA")


@dataclass(frozen=True, kw_only=True)
class InertialConvention(InCommon):
    """What the angles of inertial attitudes are: a `geometry.body.BodyAngles`."""

    angles: str = "RPY"


@dataclass(frozen=True, kw_only=True, eq=False)
class InertialAttitudes(Table, noun="inertial attitude"):
    """a attitudes of the body at exposures, in the local vertical of the station.

    Sigmas are those of small rotations about the axes of the body: of roll, pitch, heading where it is level.
    """

    photo: IntArray = per_row(link="photos", key=True)  # (a,)
    angles: FloatArray = per_row(3, unit="rad", starts="attitudes")  # (a, 3)
    sigma: FloatArray = per_row(3, unit="rad")  # (a, 3)


@dataclass(frozen=True, kw_only=True, eq=False)
class Misalignments(Table, about="inertial_attitudes"):
    """c misalignments: omega, phi, kappa of the rotation R3(kappa) R2(phi) R1(omega) from camera to body axes.

    An angle with a sigma is unknown; one without is held, or `free`.
    """

    camera: IntArray = per_row(link="cameras", key=True)  # (c,)
    angles: FloatArray = per_row(3, unit="rad")  # (c, 3)
    sigma: FloatArray = per_row(3, unit="rad", blank=np.nan)  # (c, 3) NaN: none
    free: BoolArray = per_row(codes={"": False, "F": True}, blank=False)  # (c,)
