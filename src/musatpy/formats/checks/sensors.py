"""Antenna positions and attitudes of inertial units: cards that go together, and what they determine."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import Problem
from musatpy.formats.checks.check import MOTIONS, check
from musatpy.formats.checks.images import metric
from musatpy.formats.draft import Draft, first_of_names
from musatpy.formats.job_tables import ROLES
from musatpy.geometry.body import BodyAngles, body_matrix
from musatpy.geometry.similarity import by_change
from musatpy.model import Program
from musatpy.model.tables import finite_rows
from musatpy.units import DEGREE

_TABLES = ("antenna_positions", "antenna_covariances", "lever_arms", "antenna_lines")
_LONGEST = 30.0  # m, of a lever arm in an aircraft
_UNITS = (("millimetres", 1000.0), ("centimetres", 100.0))
_FEWEST = 3  # photos of a line with a drift
_STRAIGHT = 0.1  # of its length that a line is wide: of others nothing is said of the order


@check()
def antennas_in_iia(draft: Draft) -> Iterator[Problem]:
    """Yield the first card of each kind that only program IIIA uses."""
    for role in _TABLES if draft.options.program is Program.IIA else ():
        if len(draft.rows[role]):
            yield draft.problem(role, 0, "antenna positions need program IIIA, and this job is one of MUSAT-IIA")


@check(needs="antenna_positions", follows=("antenna_positions", "antenna_covariances"))
def antenna_sigmas(draft: Draft) -> Iterator[Problem]:
    """Yield antenna positions without standard deviations."""
    role, path, rows = "antenna_positions", "antenna_positions.sigma", draft.rows["antenna_positions"]
    lacks = np.isnan(rows[path]).any(axis=1) & (first_of_names(rows, draft.rows["antenna_covariances"]) < 0)
    message = f"its three standard deviations are needed, or a {draft.card('antenna_covariances')}"
    yield from draft.problems(role, lacks, message, path=path)


@check(needs="lever_arms")
def lever_arms(draft: Draft) -> Iterator[Problem]:
    """Yield lever arms in other units, and those of no antenna position."""
    role, camera = "lever_arms", draft.camera["lever_arms"]
    offset = draft.rows[role]["lever_arms.offset"]
    for row in np.flatnonzero(np.linalg.norm(offset, axis=1) > _LONGEST).tolist():
        length = float(np.linalg.norm(offset[row]))
        likely = [
            f"{length / ratio:.3g} m if these are {unit} ({ratio:g} times)"
            for unit, ratio in _UNITS if length / ratio <= _LONGEST
        ]  # fmt: skip
        message = (
            f"a lever arm of {length:.6g} m is longer than an aircraft: {' or '.join(likely) or 'read it again'}"
        )
        yield draft.problem(role, row, message, path="lever_arms.offset")
    seen = draft.camera_of_photo[draft.photo["antenna_positions"]]
    message = "camera {} has a lever arm, and none of its photos an antenna position"
    unused = np.isin(camera, draft.camera["cameras"]) & ~np.isin(camera, seen)
    names = draft.names("cameras", role)
    yield from draft.problems(role, unused, message, names, path="lever_arms.camera")


@check(needs="antenna_lines")
def antenna_lines(draft: Draft) -> Iterator[Problem]:
    """Yield shifts and drifts of no photo, of too few, or without times."""
    role, rows, lines = "antenna_lines", draft.rows["antenna_lines"], draft.rows["antenna_positions"]
    line, time = lines["antenna_positions.line"], _times(draft)
    drifting = np.isfinite(rows[f"{role}.drift_sigma"]).any(axis=1) | rows[f"{role}.drift_free"]
    for row, name in enumerate(rows[f"{role}.line"].tolist()):
        member = line == name
        photos, timed = np.count_nonzero(member), member & np.isfinite(time)
        if not name:
            continue
        if not photos:
            message = f"no antenna position is of line {name}"
            yield draft.problem(role, row, message, path=f"{role}.line")
        elif drifting[row] and (photos < _FEWEST or len(np.unique(time[timed])) < 2):
            have = f"{photos} photo{'s' if photos > 1 else ''} at {len(np.unique(time[timed]))} times"
            message = f"a drift of line {name}, which has {have}: {_FEWEST} photos and two times are needed"
            yield draft.problem(role, row, message, path=f"{role}.drift_sigma")
        elif drifting[row]:
            message = f"line {name} has a drift, and this photo no time ({draft.card('exposure_times')})"
            yield from draft.problems("antenna_positions", member & np.isnan(time), message)


@check(of_job=True, needs="exposure_times", follows=("antenna_positions", "exposure_times"))
def times_in_order(draft: Draft) -> Iterator[Problem]:
    """Yield the times that do not grow, or fall, along a straight line as its antenna positions do."""
    role, rows = "antenna_positions", draft.rows["antenna_positions"]
    line, time, place = rows[f"{role}.line"], _times(draft), metric(draft, role, rows[ROLES[role]])
    names, card = draft.names("photos", role), draft.photo["exposure_times"]
    for name in np.unique(line[line != ""]).tolist():
        member = np.flatnonzero((line == name) & np.isfinite(time + place.sum(axis=1)))
        if len(member) < _FEWEST:
            continue
        plan = place[member, :2] - place[member, :2].mean(axis=0)
        width, axes = np.linalg.svd(plan, full_matrices=False)[1:]
        if width[1] > _STRAIGHT * width[0]:
            continue
        order = member[np.argsort(plan @ axes[0], kind="stable")]
        stays = max((_rising(sign * time[order]) for sign in (1.0, -1.0)), key=np.count_nonzero)
        for number in np.flatnonzero(~stays).tolist():
            row = int(order[number])
            beside = [order[k] for k in (number - 1, number + 1) if 0 <= k < len(order)]
            shown = " and ".join(f"photo {names[k]} ({time[k]:.10g} s)" for k in beside)
            message = f"the time is out of order: along line {name} photo {names[row]} is beside {shown}"
            of_photo = int(np.flatnonzero(card == draft.photo[role][row])[0])
            yield draft.problem("exposure_times", of_photo, message, path="exposure_times.time")


def _motions_held(draft: Draft, station: FloatArray, photos: BoolArray) -> Iterator[FloatArray]:
    """Yield the rows of antenna positions of photos : what free shifts and drifts of their line leave."""
    role, of_lines = "antenna_positions", draft.rows["antenna_lines"]
    photo, line = draft.photo[role], draft.rows[role][f"{role}.line"]
    known = {name: row for row, name in enumerate(of_lines["antenna_lines.line"].tolist()) if name}
    time = draft.by_photo("exposure_times", "exposure_times.time")
    inside = np.append(photos, False)[photo]
    for name in np.unique(line[inside]).tolist():
        member = photo[inside & (line == name)]
        since = np.nan_to_num(time[member] - np.nanmean(np.append(time[member], 0.0)))
        follows = np.stack([np.ones(len(member)), since], axis=1)
        for component in range(3):
            rows = by_change(station)[member, component]
            free = [
                name in known
                and bool(of_lines[f"antenna_lines.{what}_free"][known[name]])
                and bool(np.isnan(of_lines[f"antenna_lines.{what}_sigma"][known[name], component]))
                for what in ("shift", "drift")
            ]
            yield rows - follows[:, free] @ np.linalg.pinv(follows[:, free]) @ rows


MOTIONS["antenna_positions"] = (
    _motions_held,
    "free shifts and drifts of lines leave nothing of their antenna positions to hold it",
)


def _rising(values: FloatArray) -> BoolArray:
    """Return which of the values (k,) make the longest series that grows."""
    length, before = np.ones(len(values), dtype=int), np.full(len(values), -1)
    for k in range(len(values)):
        for j in np.flatnonzero(values[:k] < values[k]).tolist():
            if length[j] >= length[k]:
                length[k], before[k] = length[j] + 1, j
    stays, k = np.zeros(len(values), dtype=bool), int(length.argmax())
    while k >= 0:
        stays[k], k = True, int(before[k])
    return stays


def _times(draft: Draft) -> FloatArray:
    """Return the times (a,) s of the antenna positions, NaN without."""
    photo: IntArray = draft.photo["antenna_positions"]
    return np.append(draft.by_photo("exposure_times", "exposure_times.time"), np.nan)[photo]


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


def _turns_held(draft: Draft, station: FloatArray, photos: BoolArray) -> Iterator[FloatArray]:
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


MOTIONS[_ATTITUDES] = _turns_held, "free misalignments leave nothing of the inertial attitudes of parallel photos"


@check(needs=_MISALIGNMENTS)
def misalignments(draft: Draft) -> Iterator[Problem]:
    """Yield unknown misalignments that no inertial attitude determines."""
    role, rows, camera = _MISALIGNMENTS, draft.rows[_MISALIGNMENTS], draft.camera[_MISALIGNMENTS]
    free, given = rows[f"{role}.free"], ~np.isnan(rows[f"{role}.sigma"])
    seen = np.append(draft.camera_of_photo, -1)[draft.photo[_ATTITUDES]]
    message = f"no photo of camera {{}} has an {draft.card(_ATTITUDES)}, which could determine its misalignment"
    lost = (camera >= 0) & ~np.isin(camera, seen) & (free | given.any(axis=1))
    yield from draft.problems(role, lost, message, rows[f"{role}.camera"], path=f"{role}.camera")
