"""The paper's axes and symbols beside those of the house.

Okamoto and Mori (1974) have Z down, image vectors (x, y, c), the water at a X + b Y + Z + d = 0 and R = R_phi
R_omega R_kappa (2) from the photo to the ground. The house turned by 180 degrees about X, on the ground and in the
photo, is the paper: Y, Z and y change their signs.
"""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix, attitude_matrix_partials
from musatpy.orientation.twomedia.rays import PHOTO, Orientation

TURN = np.array([1.0, -1.0, -1.0])  # signs of X, Y, Z; of x, y, c in the photo
SYMBOLS = ("phi", "omega", "kappa", "X0", "Y0", "Z0")  # of a photo
PLANE_SYMBOLS = ("a", "b", "d", "N")


def paper_vector(at: Orientation) -> FloatArray:
    """Return (..., 6 m + 4) phi, omega, kappa, X0, Y0, Z0 of each photo, then a, b, d and N."""
    R = TURN[:, None] * np.swapaxes(attitude_matrix(at.attitude), -1, -2) * TURN
    angles = np.stack(
        [
            np.arctan2(R[..., 0, 2], R[..., 2, 2]),
            np.arcsin(np.clip(-R[..., 1, 2], -1.0, 1.0)),
            np.arctan2(R[..., 1, 0], R[..., 1, 1]),
        ],
        axis=-1,
    )
    photos = np.concatenate([angles, at.station * TURN], axis=-1)
    flat = photos.reshape(*photos.shape[:-2], PHOTO * at.photos)
    plane = np.stack([at.slope[..., 0], -at.slope[..., 1], at.level, at.index], axis=-1)
    return np.concatenate([flat, plane], axis=-1)


def from_paper(vector: FloatArray) -> Orientation:
    """Return the orientations of such vectors (..., 6 m + 4)."""
    house = Orientation.of(vector)
    M = np.swapaxes(TURN[:, None] * paper_rotation(house.attitude) * TURN, -1, -2)
    return Orientation(
        attitude=attitude_from_matrix(M),
        station=house.station * TURN,
        slope=house.slope * TURN[:2],
        level=house.level,
        index=house.index,
    )


def paper_rotation(angles: FloatArray) -> FloatArray:
    """Return R (..., 3, 3) of phi, omega, kappa (..., 3): (2)."""
    phi, omega, kappa = np.moveaxis(angles, -1, 0)
    zero = np.zeros_like(phi)
    R_phi = attitude_matrix(np.stack([zero, phi, zero], axis=-1))
    R_omega = attitude_matrix(np.stack([omega, zero, zero], axis=-1))
    R_kappa = attitude_matrix(np.stack([zero, zero, kappa], axis=-1))
    return np.swapaxes(R_kappa @ R_omega @ R_phi, -1, -2)


def paper_partials(at: Orientation) -> FloatArray:
    """Return the partials (..., 6 m + 4, 6 m + 4) of `paper_vector` by the vector of the orientations."""
    size = at.vector.shape[-1]
    J = np.zeros((*at.level.shape, size, size))
    R = TURN[:, None] * np.swapaxes(attitude_matrix(at.attitude), -1, -2) * TURN
    dR = (
        TURN[:, None] * np.swapaxes(attitude_matrix_partials(at.attitude), -1, -2) * TURN
    )  # angle third from the end
    cos_omega = np.sqrt(1.0 - np.square(R[..., 1, 2]))[..., None]
    by_angle = np.stack(
        [
            (R[..., 2, 2, None] * dR[..., :, 0, 2] - R[..., 0, 2, None] * dR[..., :, 2, 2]) / cos_omega**2,
            -dR[..., :, 1, 2] / cos_omega,
            (R[..., 1, 1, None] * dR[..., :, 1, 0] - R[..., 1, 0, None] * dR[..., :, 1, 1]) / cos_omega**2,
        ],
        axis=-2,
    )
    for photo in range(at.photos):
        angles = slice(PHOTO * photo, PHOTO * photo + 3)
        places = np.arange(angles.stop, angles.stop + 3)
        J[..., angles, angles] = by_angle[..., photo, :, :]
        J[..., places, places] = TURN
    plane = np.arange(size - 4, size)
    J[..., plane, plane] = (1.0, -1.0, 1.0, 1.0)
    return J
