"""Stations and control that are where they cannot be: wrong signs, coordinates exchanged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import Problem
from musatpy.formats.checks.check import check
from musatpy.formats.checks.systems import fits_system
from musatpy.formats.draft import Draft
from musatpy.formats.job_tables import ROLES
from musatpy.model import CoordinateSystem

_EARTH = 6.371e6  # m
_FAR = 10.0  # extents and heights of the stations, beyond which no photo shows a point
_LEAST = 1000.0  # m, more than these
_CARDS = ("stations", "control")


@check(of_job=True, follows=_CARDS)
def far_places(draft: Draft) -> Iterator[Problem]:
    """Yield the stations and control points far from all others that a wrong sign, or an exchange, puts there."""
    geographic = draft.system is CoordinateSystem.GEOGRAPHIC
    positions = {role: draft.rows[role][ROLES[role]] for role in _CARDS}
    stations = positions["stations"][np.isfinite(positions["stations"]).all(axis=1)]
    fits = all(fits_system(draft, role).all() for role in _CARDS)
    if draft.system is CoordinateSystem.GEOCENTRIC or not fits or not len(stations):
        return
    centre = np.median(_places(stations, geographic), axis=0)

    def apart(position: FloatArray) -> FloatArray:
        """Return (k,) m from the middle of the stations."""
        return np.asarray(np.linalg.norm(_places(position, geographic) - centre, axis=1))

    limit = _FAR * (abs(np.median(stations[:, 2])) + np.median(apart(stations)) + _LEAST)
    for role, position in positions.items():
        names = draft.names("photos", role) if role == "stations" else draft.names("points", role)
        noun = "the station of photo" if role == "stations" else "control point"
        far, others = apart(position), {slip: apart(other) for slip, other in _slips(position, geographic).items()}
        for row in np.flatnonzero(far > limit).tolist():
            slip = min(others, key=lambda slip: others[slip][row])
            if others[slip][row] < limit:
                near = others[slip][row] / 1e3
                where = f"{far[row] / 1e3:,.0f} km from the stations, but {near:,.0f} km with {slip}"
                message = f"{noun} {names[row]} lies {where}"
                yield draft.problem(role, row, message, path=ROLES[role], severity="warning")


def _places(position: FloatArray, geographic: bool) -> FloatArray:
    """Return (k, 3) m, on a sphere, or (k, 2) of the job."""
    if not geographic:
        return position[:, :2]
    latitude, longitude = position[:, 0], position[:, 1]
    x, y = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude)
    return _EARTH * np.stack([x, y, np.sin(latitude)], axis=1)


def _slips(position: FloatArray, geographic: bool) -> Mapping[str, FloatArray]:
    """Return what positions would be without each slip, in words."""
    exchanged = position[:, [1, 0, 2]]
    if not geographic:
        return {"X and Y exchanged": exchanged}
    return {
        "the other sign of the longitude": position * [1.0, -1.0, 1.0],
        "the other sign of the latitude": position * [-1.0, 1.0, 1.0],
        "latitude and longitude exchanged": exchanged,
    }
