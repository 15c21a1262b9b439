"""Plates to reduce: a camera with eight marks, a comparator, film, lens and air whose true values are known."""

import numpy as np

from musatpy.geometry.collinearity import attitude_matrix
from musatpy.reduction.displacements import DOWN, View
from musatpy.reduction.distortion import Lens, Side
from musatpy.reduction.fiducials import Marks
from musatpy.reduction.planar import Comparator
from musatpy.reduction.reseau import Reseau

IDS = np.array(["1", "2", "3", "4", "5", "6", "7", "8"])
CORNERS = np.array([[106.004, 106.008], [-106.000, 106.009], [-105.997, -105.995], [106.012, -105.995]])
SIDES = np.array([[112.006, 0.007], [0.005, 112.007], [-112.000, 0.007], [0.002, -111.998]])
MARKS = np.concatenate([CORNERS, SIDES])

PRINCIPAL_POINT = np.array([0.012, -0.007])
F = 152.3
RADII = np.array([20.0, 45.0, 70.0, 100.0, 130.0, 155.0])
TABLE = np.array([0.002, 0.0045, 0.003, -0.004, -0.011, -0.006])


def points(seed: int = 3, count: int = 40) -> np.ndarray:
    """Points all over a plate, none at its centre or on a radius of the table."""
    return np.random.default_rng(seed).uniform(-105.0, 105.0, (count, 2))


def lens(side: Side, *, table: bool = True) -> Lens:
    return Lens(
        centre=np.array([0.02, 0.03]),
        side=side,
        k=np.array([1e-5, 1.5e-8, -5e-13, 2e-18]),
        p=np.array([1.3e-7, -0.6e-7, 3e-6]),
        radius=RADII if table else np.zeros(0),
        radial=TABLE if table else np.zeros(0),
    )


def comparator() -> Comparator:
    return Comparator(scale=(0.999, 1.0015), non_orthogonality=2e-4, rotation=0.9, left_handed=True)


def view(attitude: tuple[float, float, float] = (0.03, -0.05, 1.2)) -> View:
    nadir = attitude_matrix(np.array(attitude)) @ DOWN
    return View(focal_length=F, principal_point=PRINCIPAL_POINT, nadir=nadir)


def reseau() -> Reseau:
    """5 by 6 crosses on film that shrank unevenly, by up to 0.05 mm."""
    x, y = np.linspace(-110.0, 110.0, 6), np.linspace(-100.0, 100.0, 5)
    calibrated = np.stack(np.meshgrid(x, y), axis=-1)
    return Reseau(calibrated=calibrated, measured=calibrated + deformation(calibrated))


def deformation(xy: np.ndarray) -> np.ndarray:
    """A smooth deformation of film, up to 0.05 mm."""
    x, y = xy[..., 0] / 110.0, xy[..., 1] / 110.0
    return 0.02 * np.stack([x + 0.8 * x * y - 0.5 * y**2, -0.5 * y + x**2 * y], axis=-1)


def marks(xy: np.ndarray, ids: np.ndarray = IDS, sigma: float = 0.003) -> Marks:
    return Marks(ids=ids[: len(xy)], xy=xy, sigma=np.full(xy.shape, sigma))
