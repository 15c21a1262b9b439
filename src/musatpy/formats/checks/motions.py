"""What the observations hold of the seven motions of a part of a block: three shifts, three turns, one scale.

Each observed component of a station, of a control point, of an attitude, and each observed length or difference of
heights is a row of seven: what the motions change of it. Their rank says what is held. Positions are those of the
cards; where a card says nothing of one, any other would do, for what is free with most of them is free.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.formats.checks.headings import plan
from musatpy.formats.checks.system_use import fits_system
from musatpy.formats.draft import Draft
from musatpy.formats.draft_rays import Rays
from musatpy.formats.job_tables import ROLES
from musatpy.model import CoordinateSystem, Program

MOTIONS = 7
_RELIEF = 0.1  # of the extent, of points whose height no card gives
_LEVEL = 0.1  # rad: tilts up to which the angles turn about east, north and up
_FREE = 1e-3  # of the motions over the extent of a part: what holds less than that holds nothing
_OUTSIDE = 50.0  # extents: a card that is wrong says nothing of where its photo or point is
_SEED = 0  # the same deck must always get the same answer


def motions_held(draft: Draft, rays: Rays, photos: BoolArray, points: BoolArray, observed: BoolArray) -> int:
    """Return how many motions of a part are held: of its photos (n,) and the points (p,) measured there.

    observed (n, 6): the east, north, up, X-tilt, Y-tilt and heading that have a sigma.
    """
    station, ground = _places(draft, rays, photos, points)
    rows = [
        *_positions(station, observed[:, :3] & photos[:, None]),
        *_positions(ground, np.stack([rays.horizontal, rays.horizontal, rays.vertical], axis=1) & points[:, None]),
        *_turns(draft, observed[:, 3:] & photos[:, None]),
        *_lengths(draft, photos, points),
        *_levels(draft, ground, points),
    ]
    if not rows:
        return 0
    return int(np.linalg.matrix_rank(np.concatenate(rows), tol=_FREE))


def _places(draft: Draft, rays: Rays, photos: BoolArray, points: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the photos (n, 3) and points (p, 3) about their middle, east, north, up, in units of their extent.

    That is twice the median distance from the middle.
    """
    stations = np.array(_metric(draft, "stations", draft.by_photo("stations", ROLES["stations"])))
    control = np.full((len(points), 3), np.nan)
    link = draft.point["control"]
    control[link[link >= 0]] = draft.rows["control"][ROLES["control"]][link >= 0]
    control = np.array(_metric(draft, "control", control))
    control[~rays.horizontal, :2], control[~rays.vertical, 2] = np.nan, np.nan
    if not all(fits_system(draft, role, ROLES[role]).all() for role in ("stations", "control")):  # said elsewhere
        stations[:], control[:] = np.nan, np.nan
    both = np.concatenate([stations[photos], control[points]])
    known = np.isfinite(both)
    if not known.any():
        both, known = np.zeros((1, 3)), np.ones((1, 3), dtype=bool)
    middle = np.array([np.median(both[good, k]) if good.any() else 0.0 for k, good in enumerate(known.T)])
    off = np.nanmax(np.abs(both - middle)[known.any(axis=1)], axis=1, initial=0.0)
    extent = 2.0 * float(np.median(off)) or float(off.max()) or 1.0
    rng = np.random.default_rng(_SEED)
    places = []
    for xyz in (stations, control):
        somewhere = rng.uniform(-1.0, 1.0, size=xyz.shape) * np.array([1.0, 1.0, _RELIEF])
        scaled = (xyz - middle) / extent
        places.append(np.where(np.abs(scaled) < _OUTSIDE, scaled, somewhere))
    return places[0], places[1]


def _metric(draft: Draft, role: str, position: FloatArray) -> FloatArray:
    """Return positions (k, 3) on cards of a role as east, north, up in m, good from one to another near by."""
    geocentric = draft.system is CoordinateSystem.GEOCENTRIC
    if not geocentric and not draft.is_angular(role, ROLES[role]).all():
        return position
    level = plan(draft, position)
    height = np.linalg.norm(position, axis=1) if geocentric else position[:, 2]
    return np.stack([level.real, level.imag, height], axis=1)


def _moves(place: FloatArray) -> FloatArray:
    """Return what the motions do to places (k, 3): (k, 3, 7)."""
    X, Y, Z = place.T
    zero = np.zeros_like(X)
    turns = np.stack([[zero, -Z, Y], [Z, zero, -X], [-Y, X, zero]])  # (axis, component, k)
    shifts = np.broadcast_to(np.eye(3), (len(place), 3, 3))
    return np.concatenate([shifts, np.transpose(turns, (2, 1, 0)), place[:, :, None]], axis=2)


def _positions(place: FloatArray, known: BoolArray) -> Iterator[FloatArray]:
    """Yield the rows of the known components (k, 3) of places (k, 3)."""
    yield _moves(place)[known]


def _turns(draft: Draft, known: BoolArray) -> Iterator[FloatArray]:
    """Yield the rows of the known angles (n, 3): turns of the block about east, north and up change them."""
    attitude = np.nan_to_num(draft.by_photo("attitudes", "photos.attitude"))
    omega, phi = np.where((np.abs(attitude[:, :2]) > _LEVEL).any(axis=1)[:, None], attitude[:, :2], 0.0).T
    zero, one = np.zeros_like(omega), np.ones_like(omega)
    # the axes about which the angles turn, M = R3(kappa) R2(phi) R1(omega)
    axes = np.stack(
        [
            [one, zero, zero],
            [zero, np.cos(omega), np.sin(omega)],
            [np.sin(phi), -np.cos(phi) * np.sin(omega), np.cos(phi) * np.cos(omega)],
        ]
    )
    rows = np.zeros((len(omega), 3, MOTIONS))
    rows[:, :, 3:6] = np.linalg.pinv(np.transpose(axes, (2, 1, 0)))
    yield rows[known]


def _lengths(draft: Draft, photos: BoolArray, points: BoolArray) -> Iterator[FloatArray]:
    """Yield a row of the scale for each air base and, in IIIA, each distance."""
    count = int(np.append(photos, False)[draft.photo["air_bases"]].all(axis=1).sum())
    if draft.options.program is Program.IIIA:
        count += int(np.append(points, False)[draft.point["distances"]].all(axis=1).sum())
    rows = np.zeros((count, MOTIONS))
    rows[:, 6] = 1.0
    yield rows


def _levels(draft: Draft, ground: FloatArray, points: BoolArray) -> Iterator[FloatArray]:
    """Yield the rows of equal elevations and, in IIIA, of measured differences of heights."""
    up = _moves(ground)[:, 2]
    inside = np.append(points, False)
    if draft.options.program is Program.IIIA:
        ends = draft.point["height_differences"]
        ends = ends[inside[ends].all(axis=1)]
        yield up[ends[:, 1]] - up[ends[:, 0]]
    _, group = draft.equal_elevation_groups
    members = draft.point["equal_elevations"]
    for number in np.unique(group[group >= 0]).tolist():
        points_of_group = members[group == number].ravel()
        points_of_group = np.unique(points_of_group[inside[points_of_group] & (points_of_group >= 0)])
        level = np.array(up[points_of_group])
        level[:, 6] = 0.0  # heights that are the same stay so
        yield level[1:] - level[:1]
