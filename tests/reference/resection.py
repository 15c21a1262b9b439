"""Rough stations of near-vertical photographs from control, by a plane similarity: to start an adjustment."""

import numpy as np


def near_vertical(xy: np.ndarray, ground: np.ndarray, focal_length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (position (3,), (omega, phi, kappa)) of a photo taken straight down over nearly flat ground.

    `xy` (k, 2) plate mm from the principal point, `ground` (k, 3) local coordinates, `focal_length` mm. With no
    tilt, E + iN = (E0 + iN0) + s exp(i kappa) (x + iy), where s is the scale number times 1/1000.
    """
    plate = xy[:, 0] + 1j * xy[:, 1]
    plan = ground[:, 0] + 1j * ground[:, 1]
    terms, *_ = np.linalg.lstsq(np.stack([np.ones_like(plate), plate], axis=1), plan, rcond=None)
    height = ground[:, 2].mean() + abs(terms[1]) * focal_length
    return np.array([terms[0].real, terms[0].imag, height]), np.array([0.0, 0.0, np.angle(terms[1])])
