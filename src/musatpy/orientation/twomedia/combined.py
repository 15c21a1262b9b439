"""COMBINED: two photos by control, and by intersection of the rays of all other points.

Okamoto and Mori (1974), (13) with (29). The printed condition (29) of control that both photos show depends on
(13) of its two rays: with full weights it is left out.
"""

from __future__ import annotations

import numpy as np

from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix
from musatpy.geometry.similarity import fit_robust
from musatpy.orientation.relative import model_points
from musatpy.orientation.twomedia.conditions import intersection, refracted
from musatpy.orientation.twomedia.helmert import Group
from musatpy.orientation.twomedia.pair import SHARED, independent_starts
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Method, Plane, Sights
from musatpy.orientation.twomedia.single import lifted, trial_levels

_LEAST_ERROR = 1e-6  # of the extent of the control


def starts(sights: Sights, plane: Plane, base: float) -> Orientation:
    """Return starts (s,): the model of the pair for air, fitted to the control at its apparent heights."""
    points, (first, second) = sights.common((0, 1))
    model = independent_starts(sights, plane, 1.0)
    known = np.isfinite(sights.control[points]).all(axis=1)
    control, wet = sights.control[points[known]], sights.wet[points[known]]
    parts = []
    for row in np.unique(model.attitude.reshape(len(model.level), -1), axis=0, return_index=True)[1]:
        M, station = attitude_matrix(model.attitude[row]), model.station[row]
        X, _ = model_points(
            first[None], second[None], (M[1] @ M[0].T)[None], (M[0] @ (station[1] - station[0]))[None]
        )
        X = X[0][known] @ M[0] + station[0]
        for level in trial_levels(control, wet, plane):
            apparent = lifted(control, wet, level, plane)
            floor = _LEAST_ERROR * float(np.ptp(apparent, axis=0).max())
            similarity, _ = fit_robust(X, apparent, np.ones(len(X)), floor)
            parts.append((attitude_from_matrix(similarity.turn(M)), similarity.apply(station), level))
    count = len(parts)
    return Orientation(
        attitude=np.array([part[0] for part in parts]).reshape(count, 2, 3),
        station=np.array([part[1] for part in parts]).reshape(count, 2, 3),
        slope=np.broadcast_to(plane.slope, (count, 2)),
        level=np.array([part[2] for part in parts]),
        index=np.full(count, plane.index),
    )


def groups(sights: Sights) -> tuple[Group, ...]:
    """Return (13) of the control on both photos or on one, and (29) of the other points."""
    rows = sights.rows((0, 1))
    seen = rows >= 0
    both = seen.all(axis=1)
    cases = [
        (refracted, (0, 1), sights.is_control & both, True),
        (refracted, (0,), sights.is_control & seen[:, 0] & ~both, True),
        (refracted, (1,), sights.is_control & seen[:, 1] & ~both, True),
        (intersection, (0, 1), ~sights.is_control & both, False),
    ]
    return tuple(
        Group(
            condition=condition,
            photos=photos,
            images=rows[points][:, photos],
            control=np.flatnonzero(points) if by_control else None,
        )
        for condition, photos, points, by_control in cases
        if points.any()
    )


COMBINED = Method(name="COMBINED", photos=2, groups=groups, unknown=(True,) * 12, starts=starts, shared=SHARED)
