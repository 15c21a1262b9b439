"""Attitudes of an inertial unit: cards that go together, angles of their convention, what a misalignment needs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import Problem
from musatpy.formats.checks.check import MOTIONS, check
from musatpy.formats.draft import Draft
from musatpy.geometry.body import BodyAngles, body_matrix
from musatpy.model import Program
from musatpy.model.tables import finite_rows
from musatpy.units import DEGREE

_ATTITUDES, _MISALIGNMENTS = "inertial_attitudes", "misalignments"


@check()
def inertial_cards(draft: Draft) -> Iterator[Problem]:
    """Yield cards of an inertial unit in a job of IIA, and those that lack the others."""
    given = [role for role in (_ATTITUDES, _MISALIGNMENTS, "inertial_convention") if len(draft.rows[role])]
    if given and draft.options.program is Program.IIA:
        message = "MUSAT-IIA knows no inertial attitudes: program IIIA (OPT) does, or take the cards out"
        yield draft.problem(given[0], 0, message)
    elif given and _ATTITUDES not in given:
        yield draft.problem(given[0], 0, f"it is that of {draft.cards(_ATTITUDES)} cards, and there are none")
    elif given and "inertial_convention" not in given:
        message = f"nothing says what its angles are: {draft.card('inertial_convention')} with OPK, POK or RPY"
        yield draft.problem(_ATTITUDES, 0, message)


@check(of_card=True, needs=_ATTITUDES)
def pitches(draft: Draft) -> Iterator[Problem]:
    """Yield pitches beyond a right angle."""
    convention = draft.rows["inertial_convention"]
    if len(convention) and convention["inertial_convention.angles"][0] == "RPY":
        path = f"{_ATTITUDES}.angles"
        pitch = draft.rows[_ATTITUDES][path][:, 1] / DEGREE
        message, beyond = "a pitch of {:.4f} degrees is beyond 90", np.abs(pitch) > 90.0 + 1e-9
        yield from draft.problems(_ATTITUDES, beyond, message, pitch, path=path, component=1)


def _motions_held(draft: Draft, station: FloatArray, photos: BoolArray) -> Iterator[FloatArray]:
    """Yield the rows of inertial attitudes of photos: what free misalignments leave of the turns of bodies."""
    role, rows, photo = _MISALIGNMENTS, draft.rows[_MISALIGNMENTS], draft.photo[_ATTITUDES]
    angles, convention = draft.rows[_ATTITUDES][f"{_ATTITUDES}.angles"], draft.rows["inertial_convention"]
    known = np.append(photos, False)[photo] & finite_rows(angles)
    camera = np.append(draft.camera_of_photo, -1)[photo]
    free = draft.camera[role][rows[f"{role}.free"] & np.isnan(rows[f"{role}.sigma"]).all(axis=1)]
    for form in BodyAngles:
        if form in convention["inertial_convention.angles"][:1]:
            for number in np.unique(camera[known]).tolist():
                bodies = body_matrix(angles[known & (camera == number)], form)
                bodies = bodies - bodies.mean(axis=0) if number in free else bodies
                yield np.pad(bodies.reshape(-1, 3), ((0, 0), (1, 3)))  # of the scale, turns, shifts


MOTIONS[_ATTITUDES] = _motions_held, "free misalignments leave nothing of the inertial attitudes of parallel photos"


@check(needs=_MISALIGNMENTS)
def misalignments(draft: Draft) -> Iterator[Problem]:
    """Yield unknown misalignments that no inertial attitude determines."""
    role, rows, camera = _MISALIGNMENTS, draft.rows[_MISALIGNMENTS], draft.camera[_MISALIGNMENTS]
    free, given = rows[f"{role}.free"], ~np.isnan(rows[f"{role}.sigma"])
    seen = np.append(draft.camera_of_photo, -1)[draft.photo[_ATTITUDES]]
    message = f"no photo of camera {{}} has an {draft.card(_ATTITUDES)}, which could determine its misalignment"
    lost = (camera >= 0) & ~np.isin(camera, seen) & (free | given.any(axis=1))
    yield from draft.problems(role, lost, message, rows[f"{role}.camera"], path=f"{role}.camera")
