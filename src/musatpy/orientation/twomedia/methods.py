"""The methods of Okamoto and Mori (1974): conditions of their rays, what is unknown, and starts from nothing.

SINGLE-RAY and SINGLE-FERMAT, (13) and (18)': four control points and a fifth with Z and one of X and Y at least.
PAIR-INDEPENDENT and PAIR-SUCCESSIVE, (23) and (28): eight points at least, no control; the model stands in the axes
of the base, with omega of photo 1 at 0, or in those of photo 1, and the base along X has the length that is given.
COMBINED, (13) with (29): two photos by control, and by intersection of the rays of all other points; (29) of
control that both photos show depends on (13) of its two rays and is left out. TRIPLET, (31) to (33) and (46): five
points on all three photos, or more on two; the model is that of the first pair, with one scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix
from musatpy.geometry.similarity import fit_robust
from musatpy.model.options import OrientationMethod, PlaneTreatment
from musatpy.orientation.relative import model_points, solutions
from musatpy.orientation.resection import resections
from musatpy.orientation.twomedia import rays
from musatpy.orientation.twomedia.sights import Method, Sights, WaterPlane

_PAIRS = ((0, 1), (1, 2), (0, 2))
_DEPTHS = (0.1, 0.5, 2.0, 0.02)  # over the highest wet point, in radii of the control: trial levels, in turn
_SHARES = (0.35, 0.1, 0.7)  # of the way from the highest apparent point to the lowest station: trial levels
_HIGHEST = 0.9  # quantile of the points that counts as the highest: false ones stand above
_LEAST_ERROR = 1e-7  # of an image (tangent)
_LEAST_MISFIT = 1e-6  # of a model on its control, of the extent of that
_ALONG = 0.85  # cosine of the angle between the axes of the photos and a bottom that may be parallel to the water
_STEEP = 0.2  # cosine of the angle between the water and the model's axes, where no slope can be stated
_UP = np.array([0.0, 0.0, 1.0])


# --- conditions ---


def _groups(
    sights: Sights, *cases: tuple[rays.Condition, tuple[int, ...], BoolArray]
) -> tuple[rays.ConditionGroup, ...]:
    """Return the conditions of points (p,) on some photos each, without those that have no points."""
    return tuple(
        rays.ConditionGroup(
            condition=condition,
            photos=photos,
            images=sights.rows[points][:, photos],
            control=np.flatnonzero(points) if condition in (rays.refracted, rays.fermat) else None,
        )
        for condition, photos, points in cases
        if points.any()
    )


def _of_control(sights: Sights, of_wet: rays.Condition = rays.refracted) -> tuple[rays.ConditionGroup, ...]:
    """Return the conditions of the control on one photo: rays in air go by (13) in both methods."""
    used = sights.is_control & sights.seen[:, 0]
    return _groups(sights, (of_wet, (0,), used & sights.wet), (rays.refracted, (0,), used & ~sights.wet))


def _intersections(sights: Sights) -> tuple[rays.ConditionGroup, ...]:
    """Return the coplanarities of all pairs of photos: of three the scale is none until the rays nearly meet."""
    pairs = [pair for pair in _PAIRS if max(pair) < len(sights.photos)]
    return _groups(sights, *((rays.intersection, pair, sights.on_all(pair)) for pair in pairs))


def _combined(sights: Sights) -> tuple[rays.ConditionGroup, ...]:
    """Return (13) of the control on both photos or on one, and (29) of the other points."""
    known, both = sights.is_control, sights.on_all((0, 1))
    alone = [(rays.refracted, (photo,), known & sights.seen[:, photo] & ~both) for photo in (0, 1)]
    return _groups(
        sights, (rays.refracted, (0, 1), known & both), *alone, (rays.intersection, (0, 1), ~known & both)
    )


def _triplet(sights: Sights) -> tuple[rays.ConditionGroup, ...]:
    """Return two coplanarities and one scale of points on three photos, one coplanarity of those on two."""
    count = sights.seen.sum(axis=1)
    pairs = [(rays.intersection, pair, sights.on_all(pair) & (count == 2)) for pair in _PAIRS]
    return _groups(sights, (rays.triple, (0, 1, 2), count == 3), *pairs)


# --- starts ---


def _orientations(
    trials: Sequence[tuple[FloatArray, FloatArray, Sequence[float] | FloatArray, float]], photos: int, index: float
) -> rays.Orientation:
    """Return the orientations (s,) of trials: attitudes and stations (m, 3), slope and level of the water."""
    vectors = [
        [*np.hstack([attitude.reshape(-1, 3), station.reshape(-1, 3)]).ravel(), *slope, level, index]
        for attitude, station, slope, level in trials
    ]
    return rays.Orientation.of(np.array(vectors).reshape(len(trials), 6 * photos + 4))


def _resected(sights: Sights, plane: WaterPlane, base: float) -> rays.Orientation:
    """Return starts (s,) of one photo, none where no resection has a solution.

    For trial levels the control stands at its apparent heights, and the resection for air does the rest.
    """
    seen = np.isfinite(sights.control).all(axis=1) & sights.seen[:, 0]
    control, wet, image = sights.control[seen], sights.wet[seen], sights.image[sights.rows[seen, 0]]
    levels = _trial_levels(control, wet, plane)
    apparent = np.array([_lifted(control, wet, level, plane) for level in levels])
    straight = resections(image, apparent, np.tile(_UP, (len(levels), 1)), _LEAST_ERROR)
    trials = [
        (attitude_from_matrix(photo.M), photo.C, plane.slope, level)
        for photo, level in zip(straight, levels, strict=True)
        if photo is not None and photo.C[2] > level
    ]
    return _orientations(trials, 1, plane.index)


def _trial_levels(control: FloatArray, wet: BoolArray, plane: WaterPlane) -> list[float]:
    """Return levels of the water over control (k, 3): the given one, and unless it holds some over wet points."""
    given = [] if plane.level is None else [plane.level]
    if not wet.any():
        return given or [float(control[:, 2].min())]
    if given and (plane.treatment is PlaneTreatment.KNOWN or plane.level_sigma is not None):
        return given
    radius = float(np.sqrt(np.mean(np.sum(np.square(control - control.mean(axis=0)), axis=1))))
    return given + [float(control[wet, 2].max()) + depth * radius for depth in _DEPTHS]


def _lifted(control: FloatArray, wet: BoolArray, level: float, plane: WaterPlane) -> FloatArray:
    """Return control (k, 3) at the heights where rays from above seem to meet it: depth over index."""
    water = level + control[:, :2] @ np.array(plane.slope)
    apparent = control.copy()
    apparent[wet, 2] = (water - (water - control[:, 2]) / plane.index)[wet]
    return apparent


def _relative(sights: Sights, plane: WaterPlane, base: float, *, along_base: bool = True) -> rays.Orientation:
    """Return models (s,) of photos 0 and 1: the relative orientations for air, each with trial planes of water.

    In the axes of the base, or of photo 1; the X of the second station is `base`. Homographies are not to be
    trusted through water: both of their solutions are tried, and the vertical pair.
    """
    points, (first, second) = sights.common((0, 1))
    trials = []
    minima = solutions(first[None], second[None], np.ones((1, len(points))), _LEAST_ERROR)
    for direction, R, front in zip(minima.base, minima.rotation, minima.front, strict=True):
        X, _ = model_points(first, second, R, direction)
        M = along_axes(direction) if along_base else np.eye(3)
        scale = base / (direction @ M)[0]
        if front < 0.5 or not np.isfinite(X).all() or scale <= 0.0:
            continue
        attitude = attitude_from_matrix(np.stack([M, R @ M]))
        station = scale * np.stack([np.zeros(3), direction @ M])
        planes = _trial_planes(scale * X @ M, sights.wet[points], station, M[2] + (R @ M)[2], plane)
        trials += [(attitude, station, slope, level) for slope, level in planes]
    return _orientations(trials, 2, plane.index)


def along_axes(base: FloatArray) -> FloatArray:
    """Return M of photo 1, from axes with X along a unit base in its own axes and omega 0."""
    return attitude_matrix(np.array([0.0, np.arcsin(np.clip(base[2], -1.0, 1.0)), np.arctan2(-base[1], base[0])]))


def _trial_planes(
    X: FloatArray, wet: BoolArray, station: FloatArray, axes: FloatArray, plane: WaterPlane
) -> list[tuple[FloatArray, float]]:
    """Return trial slopes and levels over apparent points X (k, 3): across the axes, and along the bottom.

    Of a plane that is not to be adjusted the one that is given.
    """
    if not wet.any():  # no ray meets it: as far below the lowest point as the stations are above
        return [(np.zeros(2), float(2.0 * X[:, 2].min() - station[:, 2].max()))]
    if plane.treatment is PlaneTreatment.KNOWN:
        return [(np.array(plane.slope), plane.level or 0.0)]
    centred = X - X.mean(axis=0)
    bottom = np.linalg.eigh(centred.T @ centred)[1][:, 0]
    bottom = bottom * np.sign(bottom @ axes)
    normals = [axes / np.linalg.norm(axes)]
    if bottom @ normals[0] > _ALONG:
        normals.append(bottom)
    trials = []
    for normal in normals:
        if normal[2] > _STEEP:
            slope = -normal[:2] / normal[2]
            top = float(np.quantile((X[:, 2] - X[:, :2] @ slope)[wet], _HIGHEST))
            over = float((station[:, 2] - station[:, :2] @ slope).min())
            trials += [(slope, top + share * (over - top)) for share in _SHARES]
    return trials


def _model_places(pair: rays.Orientation, images: FloatArray) -> FloatArray:
    """Return the apparent places (s, k, 3) of points in models (s,) of photos 0 and 1, from images (2, k, 2)."""
    M = attitude_matrix(pair.attitude)
    first, second = M[:, 0], M[:, 1]
    base = first @ (pair.station[:, 1] - pair.station[:, 0])[..., None]
    X, _ = model_points(images[:1], images[1:2], second @ np.swapaxes(first, 1, 2), base[..., 0])
    return X @ first + pair.station[:, :1]


def _fitted(sights: Sights, plane: WaterPlane, base: float) -> rays.Orientation:
    """Return starts (s,): the model of the pair for air, fitted to the control at its apparent heights."""
    points, images = sights.common((0, 1))
    models = _relative(sights, plane, 1.0)
    models = models[np.unique(models.attitude.reshape(-1, 6), axis=0, return_index=True)[1]]
    known = np.isfinite(sights.control[points]).all(axis=1)
    control, wet = sights.control[points[known]], sights.wet[points[known]]
    trials = []
    places = _model_places(models, images[:, known])
    for X, M, station in zip(places, attitude_matrix(models.attitude), models.station, strict=True):
        for level in _trial_levels(control, wet, plane):
            apparent = _lifted(control, wet, level, plane)
            floor = _LEAST_MISFIT * float(np.ptp(apparent, axis=0).max())
            move, _ = fit_robust(X, apparent, np.ones(len(X)), floor)
            trials.append((attitude_from_matrix(move.turn(M)), move.apply(station), plane.slope, level))
    return _orientations(trials, 2, plane.index)


def _with_third(sights: Sights, plane: WaterPlane, base: float) -> rays.Orientation:
    """Return starts (s,): the pair of photos 1 and 2 for air, and photo 3 by resection from its apparent points."""
    pair = _relative(sights, plane, base)
    _, images = sights.common((0, 1, 2))
    models = pair.attitude.reshape(-1, 6)
    _, first, model = np.unique(models, axis=0, return_index=True, return_inverse=True)
    up = attitude_matrix(pair.attitude[first, 0])[:, 2]
    thirds = resections(images[2], _model_places(pair[first], images), up, _LEAST_ERROR)
    trials = [
        (np.vstack([attitude, attitude_from_matrix(third.M)]), np.vstack([station, third.C]), slope, level)
        for attitude, station, slope, level, row in zip(
            pair.attitude, pair.station, pair.slope, pair.level, model.ravel(), strict=True
        )
        if (third := thirds[row]) is not None
    ]
    return _orientations(trials, 3, plane.index)


# --- methods ---

_ALL, _NONE = (True,) * 3, (False,) * 3
_SHARED = 5  # points of a relative orientation for air
_INDEPENDENT = (False, True, True, *_NONE, *_ALL, *_NONE)
_SUCCESSIVE = (*_NONE, *_NONE, *_ALL, False, True, True)
_ONE_PHOTO: dict[str, Any] = {"photos": 1, "unknown": _ALL * 2, "starts": _resected}
_PAIR: dict[str, Any] = {"photos": 2, "groups": _intersections, "shared": _SHARED}
SINGLE_RAY = Method(name="SINGLE-RAY", groups=_of_control, **_ONE_PHOTO)
SINGLE_FERMAT = Method(
    name="SINGLE-FERMAT", groups=partial(_of_control, of_wet=rays.fermat), approach=_of_control, **_ONE_PHOTO
)
PAIR_INDEPENDENT = Method(name="PAIR-INDEPENDENT", unknown=_INDEPENDENT, starts=_relative, **_PAIR)
PAIR_SUCCESSIVE = Method(
    name="PAIR-SUCCESSIVE", unknown=_SUCCESSIVE, starts=partial(_relative, along_base=False), **_PAIR
)
COMBINED = Method(name="COMBINED", photos=2, groups=_combined, unknown=_ALL * 4, starts=_fitted, shared=_SHARED)
TRIPLET = Method(
    name="TRIPLET", photos=3, groups=_triplet, approach=_intersections, unknown=_INDEPENDENT + _ALL * 2,
    starts=_with_third, shared=4,  # three for the resection of photo 3, and one that tells its solutions apart
)  # fmt: skip
METHODS = {
    OrientationMethod(method.name): method
    for method in (SINGLE_RAY, SINGLE_FERMAT, PAIR_INDEPENDENT, PAIR_SUCCESSIVE, COMBINED, TRIPLET)
}
