"""What motions of a block as a whole do to the plane of its water: z = level + slopes . (east, north).

The slopes are those in the level axes, the level is that at the working origin, about which the plane tilts. With
the point P of the plane over the origin and its downhill covector n = (-slopes, 1), a velocity v of space lifts the
level by n . v(P), and changes each slope by n times the change of v along the tangent of the plane.
"""

from __future__ import annotations

import numpy as np

from musatpy.adjustment.network import Network
from musatpy.arrays import FloatArray
from musatpy.geometry.similarity import Similarity


def slope_motions(slopes: FloatArray) -> FloatArray:
    """Return what the seven similarity motions do to slopes (2,): (2, 7)."""
    tangents = np.column_stack([np.eye(2), slopes])
    motions = np.zeros((2, 7))
    motions[:, 3:6] = _turned(tangents) @ _covector(slopes)
    return motions


def level_motions(network: Network, centre: FloatArray, slopes: FloatArray, level: FloatArray) -> FloatArray:
    """Return what the seven similarity motions about `centre` (3,) do to levels (c,) of the water: (c, 7)."""
    arm, n = _over_origin(network, centre, level), _covector(slopes)
    shifts = np.broadcast_to(n, (len(level), 3))
    return np.concatenate([shifts, _turned(arm) @ n, (arm @ n)[:, None]], axis=1)


def turned_slopes(slopes: FloatArray, rotation: FloatArray) -> FloatArray:
    """Return slopes (2,) after a finite rotation of the level axes (3, 3)."""
    normal = rotation @ _covector(slopes)
    return -normal[:2] / normal[2]


def moved_levels(
    network: Network, centre: FloatArray, slopes: FloatArray, level: FloatArray, move: Similarity
) -> FloatArray:
    """Return levels (c,) of the water after a finite similarity in the level axes at `centre` (3,)."""
    arm = _over_origin(network, centre, level)
    lift = move.apply(arm) - arm
    return level + lift @ _covector(turned_slopes(slopes, move.rotation))


def _over_origin(network: Network, centre: FloatArray, level: FloatArray) -> FloatArray:
    """Return points (c, 3) of planes with levels (c,), over the working origin, in the level axes at `centre`."""
    east, north, _ = network.frame.axes(centre) @ -centre
    height = level - float(network.frame.height(centre))
    return np.stack([np.full_like(height, east), np.full_like(height, north), height], axis=1)


def _turned(arm: FloatArray) -> FloatArray:
    """Return the velocities (k, 3 axes, 3) of places (k, 3) under unit turns about east, north and up."""
    return np.cross(np.eye(3), arm[:, None])


def _covector(slopes: FloatArray) -> FloatArray:
    """Return (3,) what the height over the plane gains along east, north and up."""
    return np.array([*-slopes, 1.0])
