"""Coordinate systems: one for the whole deck, with the ellipsoid that it needs, and coordinates that fit it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pyproj

from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import Problem
from musatpy.formats.draft import Draft
from musatpy.model import CoordinateSystem

POSITIONS = (
    ("stations", "photos.position"),
    ("control", "control.position"),
    ("wave_origin", "wave_origin.position"),
)
_NEAR = (0.98, 1.1)  # geocentric distances over the semi-major axis: ocean floor at the poles, and low orbits
_EARTH_AXIS = 6.378e6  # m, close enough to tell geocentric from local coordinates
_HIGHEST = 100e3  # m, no local rectangular job has its vertical coordinates beyond


def fits_system(draft: Draft, role: str, path: str) -> BoolArray:
    """Return (k,) True for the position cards of a role that are of the system of the job."""
    system = draft.system if draft.given_in is None else draft.given_in.kind
    geographic = system == CoordinateSystem.GEOGRAPHIC
    return draft.is_angular(role, path) if geographic else ~draft.is_angular(role, path)


def position_cards(draft: Draft) -> Iterator[Problem]:
    """Yield the first position card of each kind that is not of the system of the job."""
    options = draft.rows["options"]
    if len(options) and not draft.lacks("options", 0, "options.system") and options["options.system"][0] == "":
        return  # the system could not be read
    if draft.unread("systems", "systems.kind").any():
        return
    for role, path in POSITIONS:
        wrong = np.flatnonzero(~fits_system(draft, role, path))
        if wrong.size:
            row, more = int(wrong[0]), wrong.size - 1
            kind = "geographic" if draft.is_angular(role, path)[row] else "rectangular"
            others = f", like {more} more" if more else ""
            system = draft.system if draft.given_in is None else draft.given_in.kind
            message = f"a {kind} position{others}, in a job of system {system}"
            yield draft.problem(role, row, message, path=path)


def ellipsoid_card(draft: Draft) -> Iterator[Problem]:
    """Yield a geographic or geocentric job without an ellipsoid, and a local one with one."""
    given = len(draft.rows["ellipsoid"]) > 0
    if draft.system is CoordinateSystem.LOCAL:
        if given:
            message = "a local job has no ellipsoid: left out"
            yield draft.problem("ellipsoid", 0, message, severity="warning")
    elif not given:
        message = f"a job of system {draft.system} needs an ellipsoid ({draft.card('ellipsoid')})"
        yield Problem(file=draft.deck.file, message=message)


def geocentric_positions(draft: Draft) -> Iterator[Problem]:
    """Yield the positions of a geocentric job that are not near its ellipsoid."""
    axis = _semi_major_axis(draft)
    if draft.system is not CoordinateSystem.GEOCENTRIC or axis is None:
        return
    low, high = _NEAR
    for role, path in POSITIONS:
        distance = np.linalg.norm(draft.rows[role][path], axis=1)
        far = fits_system(draft, role, path) & ((distance < low * axis) | (distance > high * axis))
        message = "{:.1f} km from the geocentre is not near the ellipsoid"
        yield from draft.problems(role, far, message, distance / 1000, path=path)


def local_positions(draft: Draft) -> Iterator[Problem]:
    """Yield once for each kind of card the positions of a local job that look geocentric."""
    if draft.system is not CoordinateSystem.LOCAL:
        return
    for role, path in POSITIONS:
        looks = fits_system(draft, role, path) & _looks_geocentric(draft.rows[role][path])
        rows = np.flatnonzero(looks).tolist()
        if rows:
            others = f", like {len(rows) - 1} more" if len(rows) > 1 else ""
            message = f"a position that looks geocentric{others}, in a job of system {draft.system}"
            yield draft.problem(role, rows[0], message, path=path)


def _looks_geocentric(xyz: FloatArray) -> BoolArray:
    """Return (k,) True for X, Y, Z at the distance of the earth's surface, and a Z that can be no height."""
    distance = np.linalg.norm(xyz, axis=1) / _EARTH_AXIS
    low, high = _NEAR
    at_surface: BoolArray = (distance > low) & (distance < high)
    return at_surface & (np.abs(xyz[:, 2]) > _HIGHEST)


def _semi_major_axis(draft: Draft) -> float | None:
    """Return the semi-major axis (m) of the ellipsoid card, None without a good one."""
    rows = draft.rows["ellipsoid"]
    if not len(rows):
        return None
    axis, name = float(rows["ellipsoid.semi_major_axis"][0]), str(rows["ellipsoid.name"][0])
    if axis > 0:
        return axis
    named = {key.lower(): definition for key, definition in pyproj.get_ellps_map().items()}
    return float(named[name.lower()]["a"]) if name.lower() in named else None
