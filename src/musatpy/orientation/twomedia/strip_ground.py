"""A strip put to its control, and to the plane of water where its tilt is known: absolute orientation."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.geometry.collinearity import skew
from musatpy.geometry.similarity import Similarity, by_change, fit_robust, small
from musatpy.model.options import PlaneTreatment
from musatpy.orientation.twomedia.oriented import OrientationError
from musatpy.orientation.twomedia.sights import Plane

MOTIONS = ("scale", "tilt about X", "tilt about Y", "heading", "X", "Y", "Z")
_STEPS = 20
_STILL = 1e-9  # of a change of the similarity, relative to the size of the ground
_FREE = 1e-9  # eigenvalue of the scaled normals up to which a motion is free
_FLAT = 0.05  # of the extent along, that across the control from which it fixes the tilts


def placed(place: FloatArray, known: FloatArray, water: FloatArray, plane: Plane) -> Similarity:
    """Return the similarity of a strip to the ground.

    place (c, 3) in the axes of the strip and known (c, 3), NaN for what is not, of control; water (k, 3) points of
    the water in these axes, of which `plane` is known on the ground. All count alike; where control that is known
    in full fixes the strip nothing else is taken, and gross errors of it do not draw the strip. Raises
    `OrientationError` where a motion is left free.
    """
    full = np.isfinite(known).all(axis=1)
    if full.sum() >= 3:
        extent = np.linalg.svd(known[full] - known[full].mean(axis=0), compute_uv=False)
        if extent[1] > _FLAT * extent[0]:
            floor = 1e-6 * float(extent[0])
            return fit_robust(place[full], known[full], np.ones(full.sum()), floor)[0]
    given = np.isfinite(known)
    size = max(1.0, float(np.nanmax(np.abs(known))))
    move = _level_start(place, known, water)
    for _ in range(_STEPS):
        there = move.apply(place)
        of_water, misfit = _of_water(move.apply(water), plane)
        G = np.concatenate([by_change(there)[given], of_water])
        _require_rank(G.T @ G, there)
        change = np.linalg.lstsq(G, np.append((known - there)[given], misfit), rcond=None)[0]
        move = small(change).after(move)
        if np.abs(change).max() <= _STILL * size:
            break
    return move


def _of_water(water: FloatArray, plane: Plane) -> tuple[FloatArray, FloatArray]:
    """Return by how much points of the water (k, 3) on the ground stand under its known plane, with partials.

    Partials (k, 7) by a change of the similarity, heights (k,): about their mean where the level is not known, and
    none where the tilt is not.
    """
    if plane.treatment is PlaneTreatment.ADJUST and plane.slope_sigma is None:
        return np.zeros((0, 7)), np.zeros(0)
    normal = np.append(-np.asarray(plane.slope), 1.0)
    partials, heights = normal @ by_change(water), water @ normal
    if plane.level is None or (plane.treatment is not PlaneTreatment.KNOWN and plane.level_sigma is None):
        return partials - partials.mean(axis=0), heights.mean() - heights
    return partials, plane.level - heights


def _require_rank(N: FloatArray, places: FloatArray) -> None:
    """Raise `OrientationError` where normals (7, 7) leave a motion free, named about the middle of places."""
    middle = places.mean(axis=0)
    centred = np.eye(7)
    centred[4:, 0], centred[4:, 1:4] = -middle, skew(middle)
    N = centred.T @ N @ centred
    diagonal = np.sqrt(np.diagonal(N))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    values, vectors = np.linalg.eigh(N / np.outer(scale, scale))
    free = [MOTIONS[int(np.argmax(np.abs(vectors[:, row])))] for row in np.flatnonzero(values < _FREE)]
    if free:
        raise OrientationError(
            f"STRIP: control and water leave {', '.join(dict.fromkeys(free))} of the strip free; three full "
            "control points off a line hold it, or two where the tilt of the water is known (LEVEL)"
        )


def _level_start(place: FloatArray, known: FloatArray, water: FloatArray) -> Similarity:
    """Return the similarity that makes the water level; the rest by X and Y, and by Z."""
    middle = water.mean(axis=0)
    normal = np.linalg.svd(water - middle)[2][2]
    normal = normal if normal[2] > 0.0 else -normal
    across = np.cross(normal, [0.0, 0.0, 1.0])
    K = skew(across)
    upright = Similarity(scale=1.0, rotation=np.eye(3) + K + K @ K / (1.0 + normal[2]), shift=np.zeros(3))
    there = upright.apply(place)
    plan = np.flatnonzero(np.isfinite(known[:, :2]).all(axis=1))
    z, w = (part[plan] @ np.array([1.0, 1j]) for part in (there[:, :2], known[:, :2]))
    if len(z) < 2 or not np.ptp(np.abs(z - z[:1])) > 0.0:
        raise OrientationError("STRIP: two control points of known X and Y at least give it scale and heading")
    a = np.vdot(z - z.mean(), w - w.mean()) / np.vdot(z - z.mean(), z - z.mean())
    angle, scale = float(np.angle(a)), float(np.abs(a))
    about = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    heights = np.isfinite(known[:, 2])
    Z = float(np.mean(known[heights, 2] - scale * there[heights, 2])) if heights.any() else 0.0
    shift = w.mean() - a * z.mean()
    return Similarity(scale=scale, rotation=about, shift=np.array([shift.real, shift.imag, Z])).after(upright)
