"""Coordinate systems: the cards that state them, the ellipsoid that they need, and coordinates that fit them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pyproj

from musatpy.arrays import BoolArray
from musatpy.errors import Problem
from musatpy.formats import mapping, system_rows
from musatpy.formats.checks.check import check
from musatpy.formats.draft import Draft
from musatpy.formats.job_tables import PLACES, ROLES
from musatpy.formats.statements import statement_problems, system_row
from musatpy.model import CoordinateSystem
from musatpy.units import AngleUnit

_NEAR = (0.98, 1.1)  # geocentric distances over the semi-major axis: ocean floor at the poles, and low orbits
_EARTH_AXIS = 6.378e6  # m, close enough to tell geocentric from local coordinates
_HIGHEST = 100e3  # m, no local rectangular job has its vertical coordinates beyond


@check()
def system_cards(draft: Draft) -> Iterator[Problem]:
    """Yield the first card of a role that goes with a SYS card which is not there."""
    for role in system_rows.STATING[1:]:
        words = draft.rows[role][f"{role}.role"]
        first = np.isin(np.arange(len(words)), np.unique(words, return_index=True)[1])
        alone = first & (words != "") & ~np.isin(words, draft.rows["systems"]["systems.role"])
        message = f"no {draft.cards('systems')} card for {{}}, which this one goes with"
        yield from draft.problems(role, alone, message, words, path=f"{role}.role")


@check(needs="options")
def job_system(draft: Draft) -> Iterator[Problem]:
    """Yield an option of the system that is not that of the SYS card."""
    if draft.given_in is None:
        return
    system, kind = str(draft.rows["options"]["options.system"][0]), draft.given_in.kind
    also = {kind, CoordinateSystem.LOCAL if kind == CoordinateSystem.LOCAL else CoordinateSystem.GEOGRAPHIC}
    if system and system not in also:
        message = f"a job of system {system}, where the {draft.cards('systems')} card says {kind}"
        yield draft.problem("options", 0, message, path="options.system")


@check()
def statements(draft: Draft) -> Iterator[Problem]:
    """Yield what makes no statement: unknown codes, missing grids, other ellipsoids, what a kind lacks."""
    unread = draft.unread("systems", "systems.kind")
    for role, spec in ((system_rows.IN, draft.given_in), (system_rows.OUT, draft.stated_in)):
        if spec is not None and not unread[system_row(draft, role)]:
            yield from statement_problems(draft, role, spec)


@check()
def decimal_angles(draft: Draft) -> Iterator[Problem]:
    """Yield the first card of each kind whose angles are in the unit of the SYS card, where that says none."""
    unread = draft.unread("systems", "systems.unit").any()
    if unread or (draft.given_in is not None and draft.given_in.unit is not AngleUnit.DMS):
        return
    for role in (*PLACES, "attitudes"):
        rows = draft.rows[role]
        decimal = np.array([mapping.has_stated_unit(spec) for spec in rows.specs], dtype=bool)[rows.kind]
        message = f"angles in decimals, and no {draft.cards('systems')} card for IN that says their unit"
        yield from draft.problems(role, np.flatnonzero(decimal)[:1], message)


@check()
def matrices(draft: Draft) -> Iterator[Problem]:
    """Yield attitudes that are not in the form of the SYS card, and matrices without their three rows."""
    stated = draft.given_in is not None and draft.given_in.angles == system_rows.MATRICES
    rows, links, angles = draft.rows["matrices"], draft.photo["matrices"], draft.rows["attitudes"]
    if draft.unread("systems", "systems.angles").any():
        return
    if len(rows) and not stated:
        message = f"a matrix, and no {draft.cards('systems')} card for IN that says {system_rows.MATRICES}"
        yield draft.problem("matrices", 0, message)
        return
    if stated and len(angles) and angles.specs != rows.specs:  # matrices may stand in rows of the angles
        yield draft.problem("attitudes", 0, "angles, where attitudes are stated as matrices")
    numbers, unread = rows["matrices.row"], draft.unread("matrices", "matrices.row")
    for link in np.unique(links[links >= 0]).tolist():
        of_photo = np.flatnonzero(links == link)
        if not unread[of_photo].any() and sorted(numbers[of_photo].tolist()) != [1.0, 2.0, 3.0]:
            given = ", ".join(f"{number:g}" for number in numbers[of_photo])
            message = f"the matrix of photo {draft.photo_ids[link]} needs rows 1, 2 and 3, not {given}"
            yield draft.problem("matrices", int(of_photo[0]), message, path="matrices.row")


def _system(draft: Draft) -> str:
    """Return the system in which the cards state positions."""
    return draft.system if draft.given_in is None else draft.given_in.kind


def fits_system(draft: Draft, role: str) -> BoolArray:
    """Return (k,) True for the position cards of a role that are of the system of the job."""
    return draft.is_angular(role, ROLES[role]) == (_system(draft) == CoordinateSystem.GEOGRAPHIC)


def _first_of(draft: Draft, role: str, wrong: BoolArray, message: str) -> Iterator[Problem]:
    """Yield the first position of a role that is wrong; how many more there are stands for `{}` in the message."""
    count = np.count_nonzero(wrong)
    text = message.format(f", like {count - 1} more" if count > 1 else "")
    yield from draft.problems(role, np.flatnonzero(wrong)[:1], text, path=ROLES[role])


@check()
def position_cards(draft: Draft) -> Iterator[Problem]:
    """Yield the first position card of each kind that is not of the system of the job."""
    options = draft.rows["options"]
    if len(options) and not draft.lacks("options", 0, "options.system") and options["options.system"][0] == "":
        return  # the system could not be read
    if draft.unread("systems", "systems.kind").any():
        return
    kind = "rectangular" if _system(draft) == CoordinateSystem.GEOGRAPHIC else "geographic"
    for role in PLACES:
        message = f"a {kind} position{{}}, in a job of system {_system(draft)}"
        yield from _first_of(draft, role, ~fits_system(draft, role), message)


@check()
def ellipsoid_card(draft: Draft) -> Iterator[Problem]:
    """Yield a geographic or geocentric job without an ellipsoid, and a local one with one."""
    given, local = len(draft.rows["ellipsoid"]) > 0, draft.system is CoordinateSystem.LOCAL
    if local and given:
        yield draft.problem("ellipsoid", 0, "a local job has no ellipsoid: left out", severity="warning")
    elif not local and not given:
        message = f"a job of system {draft.system} needs an ellipsoid ({draft.card('ellipsoid')})"
        yield Problem(file=draft.deck.file, message=message)


@check(needs="ellipsoid")
def geocentric_positions(draft: Draft) -> Iterator[Problem]:
    """Yield the positions of a geocentric job that are not near its ellipsoid."""
    card = draft.rows["ellipsoid"]
    axis, name = float(card["ellipsoid.semi_major_axis"][0]), str(card["ellipsoid.name"][0]).lower()
    if not axis > 0:
        axis = next((float(one["a"]) for key, one in pyproj.get_ellps_map().items() if key.lower() == name), np.nan)
    if draft.system is not CoordinateSystem.GEOCENTRIC or np.isnan(axis):
        return
    low, high = _NEAR
    for role in PLACES:
        distance = np.linalg.norm(draft.rows[role][ROLES[role]], axis=1)
        far = fits_system(draft, role) & ((distance < low * axis) | (distance > high * axis))
        message = "{:.1f} km from the geocentre is not near the ellipsoid"
        yield from draft.problems(role, far, message, distance / 1000, path=ROLES[role])


@check()
def local_positions(draft: Draft) -> Iterator[Problem]:
    """Yield once for each kind of card the positions of a local job that look geocentric."""
    low, high = _NEAR
    for role in PLACES if draft.system is CoordinateSystem.LOCAL else ():
        xyz = draft.rows[role][ROLES[role]]
        distance = np.linalg.norm(xyz, axis=1) / _EARTH_AXIS
        looks = (distance > low) & (distance < high) & (np.abs(xyz[:, 2]) > _HIGHEST)  # Z can be no height
        message = f"a position that looks geocentric{{}}, in a job of system {draft.system}"
        yield from _first_of(draft, role, fits_system(draft, role) & looks, message)
