"""Flat ports: what cards say of the planes of glass behind which cameras are, under water or in air over it."""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.arrays import FloatArray, IntArray
from musatpy.model.tables import Table, per_row

# Distance and thickness, index of the glass and of the water, tilts about x and y: as CAL cards call and mean them.
PORT_PARAMETERS = ("PD", "PT", "PG", "PW", "PX", "PY")
PORT_SIZES = ("distance", "thickness", "glass_index", "water_index")  # the columns of the first four
PORT_UNITS = ("mm", "mm", "", "", "deg", "deg")


@dataclass(frozen=True, kw_only=True, eq=False)
class Ports(Table):
    """f flat ports of cameras (IIIA): parallel planes, fixed to the camera.

    The normal is the axis of the camera, turned about image x and then about image y, right-handed.
    """

    camera: IntArray = per_row(link="cameras", key=True)  # (f,) link to Cameras
    distance: FloatArray = per_row(unit="mm")  # (f,) of the inner face of the glass from the projection centre
    thickness: FloatArray = per_row(unit="mm")  # (f,)
    glass_index: FloatArray = per_row()  # (f,) relative to the air in the housing
    water_index: FloatArray = per_row()  # (f,) likewise; 1: a camera in air
    tilt: FloatArray = per_row(2, unit="rad", blank=0.0)  # (f, 2)
