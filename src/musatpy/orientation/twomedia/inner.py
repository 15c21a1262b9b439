"""Directions in which the unknowns of an orientation through water are nearly independent."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.collinearity import attitude_matrix, attitude_matrix_partials
from musatpy.orientation.twomedia.rays import PHOTO, WATER, Orientation

_SHALLOW = 0.1  # of the height of the cameras: over shallower water tilt and attitude go together


def directions(at: Orientation, unknown: BoolArray, bottom: FloatArray) -> FloatArray:
    """Return directions (s, 6 m + 4, u) of the u unknowns: changes of the vector of orientations (s,).

    `bottom` (s, 3) is the middle of the points. The level is that over it. The apparent bottom rises with the
    level by 1 - 1/n, and the station with it; the station changes with the attitude so that the axis of the photo
    stays on the apparent bottom; and over shallow water a tilt turns rays as a prism does, by 1 - 1/n, which phi
    and omega follow.
    """
    size = PHOTO * at.photos + WATER
    T = np.broadcast_to(np.eye(size), (len(at.level), size, size)).copy()
    slope, level = slice(size - WATER, size - WATER + 2), size - WATER + 2
    bend = 1.0 - 1.0 / at.index
    M, dM = attitude_matrix(at.attitude), attitude_matrix_partials(at.attitude)
    axis, axis_by = -M[..., 2, :], -dM[..., 2, :]  # (s, m, 3), and by the angles (s, m, angles, 3)
    run = axis[..., :2] / axis[..., 2:]
    run_by = (axis_by[..., :2] - run[..., None, :] * axis_by[..., 2:]) / axis[..., None, 2:]
    water = at.water_at(bottom[:, None, :2])[:, 0]
    apparent = water - (water - bottom[:, 2]) / at.index
    shallow = np.abs(water - bottom[:, 2]) < _SHALLOW * np.abs(at.station[..., 2].mean(axis=-1) - water)
    prism = np.where(shallow, bend, 0.0)
    T[:, level, slope] = -bottom[:, :2]
    for photo in range(at.photos):
        angles = slice(PHOTO * photo, PHOTO * photo + 3)
        omega, phi, Z = angles.start, angles.start + 1, angles.stop + 2
        T[:, phi, slope.start], T[:, omega, slope.start + 1] = -prism, prism
        T[:, Z, level] = bend
        T[:, Z, slope] = bend[:, None] * (at.station[:, photo, :2] - bottom[:, :2])
        drop = (apparent - at.station[:, photo, 2])[:, None, None]
        T[:, angles.stop : Z] -= drop * np.einsum("sax,sau->sxu", run_by[:, photo], T[:, angles])
    T[:, ~unknown] = 0.0
    return T[..., unknown]
