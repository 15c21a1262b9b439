"""The methods of Okamoto and Mori (1974): which conditions, which unknowns, and the directions of their steps."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.rotations import attitude_matrix, attitude_matrix_partials
from musatpy.orientation.twomedia.conditions import Misclosure, single_fermat, single_ray
from musatpy.orientation.twomedia.rays import COLUMNS, PHOTO, WATER, Orientation, Rays


def control_rays(rays: Rays, control: FloatArray, at: Orientation) -> Misclosure:
    """Return (13) for each of the rays (..., k, r) of control points (..., k, 3): 2 r conditions."""
    count = rays.origin.shape[-2]
    values, by_rays, by_control = [], [], []
    for number in range(count):
        part = single_ray(ray_of(rays, number), control)
        columns = np.zeros((*part.value.shape, count, COLUMNS))
        columns[..., number, :] = part.by_rays[..., 0, :]
        values.append(part.value)
        by_rays.append(columns)
        by_control.append(part.by_control)
    return Misclosure(
        value=np.concatenate(values, axis=-1),
        by_rays=np.concatenate(by_rays, axis=-3),
        by_control=np.concatenate(by_control, axis=-2),
    )


def ray_of(rays: Rays, number: int) -> Rays:
    """Return one of the rays of each point."""
    return Rays(
        origin=rays.origin[..., number, :],
        direction=rays.direction[..., number, :],
        partials=rays.partials[..., number, :, :],
        station=rays.station[..., number, :],
        real=rays.real[..., number],
    )


def control_fermat(rays: Rays, control: FloatArray, at: Orientation) -> Misclosure:
    """Return (18)' for the ray of control points (..., k, 3)."""
    return single_fermat(ray_of(rays, 0), control, at)


def basis(at: Orientation, unknown: BoolArray, middle: FloatArray | None, shallow: bool) -> FloatArray:
    """Return the directions (..., 6 m + 4, u) in which the unknowns are nearly independent.

    A tilt of the water turns rays as a prism does, so that phi and omega go with it by 1 - 1/n; the apparent bottom
    rises with the level, and the station with it, by 1 - 1/n; the station goes so that the axis of the photo meets
    the bottom at one place; and the level is that over the `middle` (3,) of the control, or of where the axes meet
    the water.
    """
    size = PHOTO * at.photos + WATER
    T = np.broadcast_to(np.eye(size), (*at.index.shape, size, size)).copy()
    slope, level = size - WATER, size - WATER + 2
    bend = 1.0 - 1.0 / at.index
    M, dM = attitude_matrix(at.attitude), attitude_matrix_partials(at.attitude)
    axis, by_attitude = -M[..., 2, :], -dM[..., 2, :]  # (..., m, 3), (..., m, 3 angles, 3)
    run = axis[..., :2] / axis[..., 2:]
    run_by = (by_attitude[..., :2] - run[..., None, :] * by_attitude[..., 2:]) / axis[..., None, 2:]
    water = _water_at(at, at.station[..., :2])
    if middle is None:
        place = np.mean(at.station[..., :2] + run * (water - at.station[..., 2])[..., None], axis=-2)
        foot = _water_at(at, place[..., None, :])[..., 0]
    else:
        place = np.broadcast_to(middle[:2], (*at.index.shape, 2))
        over = _water_at(at, place[..., None, :])[..., 0]
        foot = over - (over - middle[2]) / at.index
    T[..., level, slope : slope + 2] = -place
    for photo in range(at.photos):
        first = PHOTO * photo
        omega, phi, X, Z = first, first + 1, first + 3, first + 5
        # angles by the tilt, then the station by angles, level and its own height
        if shallow:
            T[..., phi, slope] = -bend
            T[..., omega, slope + 1] = bend
        T[..., Z, level] = bend
        T[..., Z, slope : slope + 2] = bend[..., None] * (at.station[..., photo, :2] - place)
        drop = foot - at.station[..., photo, 2]
        shift = np.zeros((*at.index.shape, 2, size))
        shift -= drop[..., None, None] * np.einsum("...ax,...as->...xs", run_by[..., photo, :, :], T[..., first : first + 3, :])
        T[..., X : X + 2, :] += shift
    T[..., ~unknown, :] = 0.0
    return T[..., unknown]


def _water_at(at: Orientation, place: FloatArray) -> FloatArray:
    """Return the heights (..., k) of the water at places (..., k, 2)."""
    return at.level[..., None] + np.einsum("...kx,...x->...k", place, at.slope)
