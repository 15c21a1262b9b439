"""Pairs of zeros: a card that was not punched reads as one, and few measurements do.

A single point may lie at the principal point, or at the origin of a job; two cannot.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import Problem
from musatpy.formats.checks.headings import photo_pairs
from musatpy.formats.draft import Draft
from musatpy.formats.draft_rays import common_rays, rays_of
from musatpy.formats.job_tables import ROLES

_NEAR = 30.0  # mm: so well the images of another photo say where one is
_AROUND = 3.0  # extents of all other positions, beyond which zeros are no position


def plates(draft: Draft) -> Iterator[Problem]:
    """Yield the images at x = y = 0 that cannot be there.

    Two of different points on one photo, and one that the same point on another photo does not put there. One of
    which no other photo tells is an error where the principal point lies elsewhere, else a warning.
    """
    rows, photo = draft.rows["plates"], draft.photo["plates"]
    zero = _at_zero(rows["plates.xy"])
    if not zero.any():
        return
    several = _several(zero, photo, draft.point["plates"])
    distance = np.full(len(zero), np.nan) if draft.raw else _distances(draft, zero)
    centred = np.append(_centred(draft)[draft.camera_of_photo], False)[photo]
    for row in np.flatnonzero(zero).tolist():
        where = ""
        severity: Literal["error", "warning"] = "error"
        if several[row]:
            where = ", and of another one on the photo"
        elif distance[row] > _NEAR:
            where = f", which by other photos lies {distance[row]:.0f} mm from there"
        elif draft.raw or not np.isnan(distance[row]):
            continue
        elif centred[row]:
            severity = "warning"
        name = draft.point_ids[draft.point["plates"][row]]
        message = f"x = y = 0 of point {name}{where}: an image that was not punched reads so"
        yield draft.problem("plates", row, message, path="plates.xy", severity=severity)


def _distances(draft: Draft, zero: BoolArray) -> FloatArray:
    """Return how far (m,) mm from zero each image lies by another photo, the least; NaN where none tells."""
    photo, xy = draft.photo["plates"], draft.rows["plates"]["plates.xy"]
    image = xy[:, 0] + 1j * xy[:, 1]
    sound = rays_of(draft).sound
    pairs = photo_pairs(draft, sound & ~zero)
    one, other = common_rays(draft, sound)
    keys = pairs.first * len(draft.photo_ids) + pairs.second
    place = np.searchsorted(keys, photo[one] * len(draft.photo_ids) + photo[other])
    place = np.minimum(place, max(len(keys) - 1, 0))
    out = np.full(len(photo), np.nan)
    if not len(keys):
        return out
    fitted = keys[place] == photo[one] * len(draft.photo_ids) + photo[other]
    one, other, place = one[fitted], other[fitted], place[fitted]
    a, b = pairs.a[place], pairs.b[place]
    np.fmin.at(out, other, np.abs(a * image[one] + b))
    np.fmin.at(out, one, np.abs((image[other] - b) / a))
    return out


def _centred(draft: Draft) -> BoolArray:
    """Return (cameras + 1,) whether the principal point is the origin of the plate; the last: no camera."""
    centred = np.zeros(len(draft.camera_ids) + 1, dtype=bool)
    links, point = draft.camera["cameras"], draft.rows["cameras"]["cameras.principal_point"]
    centred[links] = _at_zero(np.nan_to_num(point))
    centred[-1] = False
    return centred


def marks(draft: Draft) -> Iterator[Problem]:
    """Yield the fiducial marks and crosses at 0/0 of which one camera, or photo, has several."""
    for role, owners in (
        ("fiducials", draft.camera),
        ("fiducial_measurements", draft.photo),
        ("reseau", draft.camera),
        ("cross_measurements", draft.photo),
    ):
        rows, path = draft.rows[role], f"{role}.xy"
        names = np.unique(rows[f"{role}.ids"], return_inverse=True)[1].reshape(-1)
        several = _several(_at_zero(rows[path]), owners[role], names)
        message = "x = y = 0, and so has another one: marks that were not punched read so"
        yield from draft.problems(role, several, message, path=path)


def positions(draft: Draft) -> Iterator[Problem]:
    """Yield stations and control points at 0/0 where several are, or where nothing else is near."""
    for role, what in (("stations", "the station"), ("control", "the control point")):
        rows, path = draft.rows[role], ROLES[role]
        names = draft.photo["stations"] if role == "stations" else draft.point["control"]
        zero = _at_zero(rows[path][:, :2])
        several = _several(zero, np.zeros(len(zero), dtype=np.int64), names)
        message = f"zeros for the position of {what}, {{}}: a card that was not punched reads so"
        why = np.where(several, "as of another one", "far from all others")
        yield from draft.problems(role, zero & (several | ~_reached(draft, role, zero)), message, why, path=path)


def _reached(draft: Draft, role: str, zero: BoolArray) -> BoolArray:
    """Return (k,) whether zeros on a card of a role lie about all other positions on cards of its words."""
    angular = draft.is_angular(role, ROLES[role])
    out = np.ones(len(zero), dtype=bool)
    for kind in (True, False):
        others = []
        for one in ("stations", "control"):
            xy = draft.rows[one][ROLES[one]][:, :2]
            alike = (draft.is_angular(one, ROLES[one]) == kind) & ~_at_zero(xy) & np.isfinite(xy).all(axis=1)
            others.append(xy[alike])
        xy = np.concatenate(others)
        if len(xy) > 1:
            low, high = xy.min(axis=0), xy.max(axis=0)
            far = bool((_AROUND * (high - low).max() < np.maximum(low, -high)).any())
            out[(angular == kind) & far] = False
    return out


def _at_zero(xy: FloatArray) -> BoolArray:
    return (xy == 0.0).all(axis=1)


def _several(zero: BoolArray, owner: IntArray, name: IntArray) -> BoolArray:
    """Return (k,) the zeros whose owner has zeros of another name too; -1 is no owner and no name."""
    out = np.zeros(len(zero), dtype=bool)
    counts = zero & (owner >= 0) & (name >= 0)
    for one in np.unique(owner[counts]).tolist():
        of_owner = counts & (owner == one)
        out[of_owner] = len(np.unique(name[of_owner])) > 1
    return out
