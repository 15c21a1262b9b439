"""PAIR-INDEPENDENT and PAIR-SUCCESSIVE: relative orientation of two photos, the plane of water a part of it.

Okamoto and Mori (1974), (23) and (28): eight points at least, no control. The model stands in the axes of the base,
with omega of photo 1 at 0, or in those of photo 1; the base along X has the length that is given.
"""

from __future__ import annotations

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix
from musatpy.model.options import PlaneTreatment
from musatpy.orientation.relative import model_points, solutions
from musatpy.orientation.twomedia.conditions import intersection
from musatpy.orientation.twomedia.helmert import Group
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Method, Plane, Sights

SHARED = 5  # points of a relative orientation for air
_SHARES = (0.35, 0.1, 0.7)  # of the way from the highest apparent point to the lowest station: trial levels
_HIGHEST = 0.9  # quantile of the points that counts as the highest: false ones stand above
_LEAST_ERROR = 1e-7  # of an image (tangent)
_ALONG = 0.85  # cosine of the angle between the axes of the photos and a bottom that may be parallel to the water
_STEEP = 0.2  # cosine of the angle between the water and the model's axes, where no slope can be stated


def independent_starts(sights: Sights, plane: Plane, base: float) -> Orientation:
    """Return starts (s,) in the axes of the base."""
    return pair_starts(sights, plane, base, along_base=True)


def successive_starts(sights: Sights, plane: Plane, base: float) -> Orientation:
    """Return starts (s,) in the axes of photo 1, with the base's X as the scale."""
    return pair_starts(sights, plane, base, along_base=False)


def pair_starts(sights: Sights, plane: Plane, base: float, *, along_base: bool) -> Orientation:
    """Return models (s,) of photos 0 and 1: the relative orientations for air, each with trial planes of water.

    The X of the second station is `base`. Homographies are not to be trusted through water: both of their solutions
    are tried, and the vertical pair.
    """
    points, (first, second) = sights.common((0, 1))
    parts = []
    for minimum in solutions(first[None], second[None], np.ones((1, len(points))), _LEAST_ERROR):
        X, _ = model_points(first[None], second[None], minimum.rotation, minimum.base)
        direction, R = minimum.base[0], minimum.rotation[0]
        M = along_axes(direction) if along_base else np.eye(3)
        scale = base / (direction @ M)[0]
        if minimum.front[0] < 0.5 or not np.isfinite(X).all() or scale <= 0.0:
            continue
        attitude = attitude_from_matrix(np.stack([M, R @ M]))
        station = scale * np.stack([np.zeros(3), direction @ M])
        for slope, level in _planes(scale * X[0] @ M, sights.wet[points], station, M[2] + (R @ M)[2], plane):
            parts.append((attitude, station, slope, level))
    count = len(parts)
    return Orientation(
        attitude=np.array([part[0] for part in parts]).reshape(count, 2, 3),
        station=np.array([part[1] for part in parts]).reshape(count, 2, 3),
        slope=np.array([part[2] for part in parts]).reshape(count, 2),
        level=np.array([part[3] for part in parts]),
        index=np.full(count, plane.index),
    )


def along_axes(base: FloatArray) -> FloatArray:
    """Return M of photo 1, from axes with X along a unit base in its own axes and omega 0."""
    return attitude_matrix(np.array([0.0, np.arcsin(np.clip(base[2], -1.0, 1.0)), np.arctan2(-base[1], base[0])]))


def _planes(
    X: FloatArray, wet: BoolArray, station: FloatArray, axes: FloatArray, plane: Plane
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


def intersections(sights: Sights) -> tuple[Group, ...]:
    """Return the condition of all points that both photos show."""
    points, _ = sights.common((0, 1))
    return (Group(condition=intersection, photos=(0, 1), images=sights.rows((0, 1))[points]),)


_PHI_KAPPA = (False, True, True)
_ALL, _NONE = (True,) * 3, (False,) * 3
PAIR_INDEPENDENT = Method(
    name="PAIR-INDEPENDENT",
    photos=2,
    groups=intersections,
    unknown=_PHI_KAPPA + _NONE + _ALL + _NONE,
    starts=independent_starts,
    shared=SHARED,
)
PAIR_SUCCESSIVE = Method(
    name="PAIR-SUCCESSIVE",
    photos=2,
    groups=intersections,
    unknown=_NONE + _NONE + _ALL + (False, True, True),
    starts=successive_starts,
    shared=SHARED,
)
