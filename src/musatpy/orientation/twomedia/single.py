"""SINGLE-RAY and SINGLE-FERMAT: one photo from control, camera and plane of water unknown.

Okamoto and Mori (1974), (13) and (18)': four control points and a fifth with Z and one of X and Y at least.
"""

from __future__ import annotations

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.collinearity import attitude_from_matrix
from musatpy.model.options import PlaneTreatment
from musatpy.orientation.resection import resections
from musatpy.orientation.twomedia.conditions import fermat, refracted
from musatpy.orientation.twomedia.helmert import Group
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Method, Plane, Sights

_DEPTHS = (
    0.1,
    0.5,
    2.0,
    0.02,
)  # over the highest wet point, in radii of the control: trial levels, the first that does
_LEAST_ERROR = 1e-7  # of an image (tangent)
_UP = np.array([0.0, 0.0, 1.0])


def starts(sights: Sights, plane: Plane, base: float) -> Orientation:
    """Return starts (s,) of one photo, none where no resection has a solution.

    For trial levels the control stands at its apparent heights, and the resection for air does the rest.
    """
    rows = sights.rows((0,))[:, 0]
    seen = np.isfinite(sights.control).all(axis=1) & (rows >= 0)
    control, wet, image = sights.control[seen], sights.wet[seen], sights.image[rows[seen]]
    levels = trial_levels(control, wet, plane)
    apparent = np.array([lifted(control, wet, level, plane) for level in levels])
    photos = [
        (attitude_from_matrix(straight.M), straight.C, level)
        for straight, level in zip(
            resections(image, apparent, np.tile(_UP, (len(levels), 1)), _LEAST_ERROR), levels, strict=True
        )
        if straight is not None and straight.C[2] > level
    ]
    count = len(photos)
    return Orientation(
        attitude=np.array([angles for angles, _, _ in photos]).reshape(count, 1, 3),
        station=np.array([station for _, station, _ in photos]).reshape(count, 1, 3),
        slope=np.broadcast_to(plane.slope, (count, 2)),
        level=np.array([level for _, _, level in photos]),
        index=np.full(count, plane.index),
    )


def trial_levels(control: FloatArray, wet: BoolArray, plane: Plane) -> list[float]:
    """Return levels of the water over control (k, 3): the given one, and unless it holds some over wet points."""
    given = [] if plane.level is None else [plane.level]
    if not wet.any():
        return given or [float(control[:, 2].min())]
    if given and (plane.treatment is PlaneTreatment.KNOWN or plane.level_sigma is not None):
        return given
    radius = float(np.sqrt(np.mean(np.sum(np.square(control - control.mean(axis=0)), axis=1))))
    return given + [float(control[wet, 2].max()) + depth * radius for depth in _DEPTHS]


def lifted(control: FloatArray, wet: BoolArray, level: float, plane: Plane) -> FloatArray:
    """Return control (k, 3) at the heights where rays from above seem to meet it: depth over index."""
    water = level + control[:, :2] @ np.array(plane.slope)
    apparent = control.copy()
    apparent[wet, 2] = (water - (water - control[:, 2]) / plane.index)[wet]
    return apparent


def _rays(sights: Sights) -> tuple[Group, ...]:
    return _groups(sights, False)


def _paths(sights: Sights) -> tuple[Group, ...]:
    return _groups(sights, True)


def _groups(sights: Sights, by_fermat: bool) -> tuple[Group, ...]:
    """Return the conditions of the control: rays in air go by (13) in both methods."""
    rows = sights.rows((0,))
    used = sights.is_control & (rows[:, 0] >= 0)
    wet, dry = np.flatnonzero(used & sights.wet), np.flatnonzero(used & ~sights.wet)
    parts = [(fermat if by_fermat else refracted, wet), (refracted, dry)]
    return tuple(
        Group(condition=condition, photos=(0,), images=rows[points], control=points)
        for condition, points in parts
        if len(points)
    )


SINGLE_RAY = Method(name="SINGLE-RAY", photos=1, groups=_rays, unknown=(True,) * 6, starts=starts)
SINGLE_FERMAT = Method(
    name="SINGLE-FERMAT", photos=1, groups=_paths, approach=_rays, unknown=(True,) * 6, starts=starts
)
