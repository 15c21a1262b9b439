"""Where straight rays through the lenses of a file meet: control points, and points that a file does not have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.similarity import TO_SIGMA, cauchy
from musatpy.model.tables import finite_rows
from musatpy.sfm.model import Model

_ROUNDS = 8
_LEAST_ANGLE = 0.01  # rad, between two rays
_LEAST_ERROR = 0.5  # px, that counts as one


def directions(model: Model, photo: IntArray, pixel: FloatArray) -> FloatArray:
    """Return the unit vectors (m, 3) of rays of pixels (m, 2) in the coordinates of a model; NaN without a ray."""
    rays, camera = np.ones((len(photo), 3)), model.camera[photo]
    for number, lens in enumerate(model.lenses):
        of = np.flatnonzero(camera == number)
        rays[of, :2] = lens.rays(pixel[of])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return np.einsum("mji,mj->mi", model.rotation[photo], rays)


def of_placed_points(model: Model) -> Model:
    """Return a model without the points that have no place, and their images, which is said."""
    there = finite_rows(model.position)
    if there.all():
        return model
    left = f"{np.count_nonzero(~there)} points whose rays do not meet at .01 rad or more are left out"
    return replace(model.of_points(np.flatnonzero(there)), notes=(*model.notes, left))


def of_good_images(model: Model, limit: float, dry: BoolArray) -> tuple[Model, list[str]]:
    """Return a model without the images of `dry` points (p,) that miss these by more than a limit, px, and a note.

    Tracks of OpenSfM have those that its bundle has left out. Of others the water itself bends rays that far.
    """
    good = np.flatnonzero((model.misses <= limit) | ~dry[model.point])
    if len(good) == len(model.photo):
        return model, []
    note = f"{len(model.photo) - len(good)} images that miss dry points by more than {limit:.1f} px are left out"
    return replace(model, **{name: getattr(model, name)[good] for name in ("photo", "point", "pixel")}), [note]


def intersections(model: Model, photo: IntArray, point: IntArray, pixel: FloatArray, count: int) -> FloatArray:
    """Return the places (count, 3) that m rays come nearest to, in angles; NaN where none is determined.

    Least squares of the distances across the rays, each divided by the length of its ray, with Cauchy's weights
    where a point has three rays or more, so that one wrong image is not believed. Determined are points of two rays
    at an angle of 0.01 rad or more.
    """
    ray, focal = directions(model, photo, pixel), np.array([lens.focal[0] for lens in model.lenses])
    seen = np.isfinite(ray).all(axis=1)
    photo, point, ray = photo[seen], point[seen], ray[seen]
    middle = model.centre.mean(axis=0) if len(model.centre) else np.zeros(3)
    foot, scale = model.centre[photo] - middle, focal[model.camera[photo]]
    across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
    rays = np.bincount(point, minlength=count)
    weight, out = np.ones(len(ray)), np.full((count, 3), np.nan)
    for _ in range(_ROUNDS):
        N = _sums(point, (weight[:, None, None] * across).reshape(-1, 9), count).reshape(-1, 3, 3)
        right = _sums(point, weight[:, None] * np.einsum("mij,mj->mi", across, foot), count)
        # The smallest eigenvalue of two rays at an angle a is about a^2 / 4 of their weights; of one it is 0.
        total = np.bincount(point, weight, count)
        good = np.linalg.eigvalsh(N)[:, 0] > 0.25 * _LEAST_ANGLE**2 * total
        out[good] = np.linalg.solve(N[good], right[good][..., None])[..., 0]
        out[~good] = np.nan
        length = np.linalg.norm(out[point] - foot, axis=1)
        error = np.linalg.norm(np.einsum("mij,mj->mi", across, out[point] - foot), axis=1) / length * scale
        usual = max(_LEAST_ERROR, TO_SIGMA * float(np.nanmedian(error))) if np.isfinite(error).any() else 1.0
        robust = np.where(rays[point] > 2, cauchy(error, usual), 1.0)
        weight = np.nan_to_num(robust * np.square(scale / length), nan=0.0, posinf=0.0)
    return out + middle


def _sums(index: IntArray, values: FloatArray, size: int) -> FloatArray:
    """Return the sums (size, k) of rows (m, k) by their index."""
    return np.stack([np.bincount(index, column, size) for column in values.T], axis=1)
