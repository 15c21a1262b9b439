"""What cards name: given once, defined by a card of its own, and measured."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Literal

import numpy as np

from musatpy.arrays import IntArray, TextArray
from musatpy.errors import Problem
from musatpy.formats.checks.check import check
from musatpy.formats.draft import Draft
from musatpy.formats.job_tables import STARTS, naming, table_of

_READ_AGAIN = ("plates", "fiducial_measurements")  # of raw plates, whose readings are no measurements
Table = Literal["cameras", "photos", "points"]
Need = tuple[Table, Iterable[str], tuple[str, ...], str, Literal["error", "warning"]]


def repeats(*keys: IntArray) -> Iterator[tuple[int, int]]:
    """Yield (row, first row) for every row whose keys, (k,) each, stood together before; a key of -1 is none."""
    named = np.flatnonzero(np.all([key >= 0 for key in keys], axis=0))
    combined = np.zeros(len(named), dtype=np.int64)
    for key in keys:
        combined = combined * (key.max(initial=0) + 1) + key[named]
    _, first, inverse = np.unique(combined, return_index=True, return_inverse=True)
    for place in np.flatnonzero(first[inverse] != np.arange(len(named))):
        yield int(named[place]), int(named[first[inverse[place]]])


def unknown(draft: Draft, role: str, path: str, known: TextArray, message: str) -> Iterator[Problem]:
    """Yield the cards of a role on which `path` names what is none of the `known`; it stands for `{}`."""
    names = draft.rows[role][path]
    yield from draft.problems(role, ~np.isin(names, known) & (names != ""), message, names, path=path)


@check()
def missing_kinds(draft: Draft) -> Iterator[Problem]:
    """Yield what no job can do without and no card gives, apart from the cards that every deck must have."""
    whole = "the block" if draft.call else "the deck"
    for role, what in (("stations", "exposure stations"), ("attitudes", "attitudes")):
        started = role == "attitudes" and any(len(draft.rows[other]) for other in STARTS)
        if not (draft.may_lack_station or started or len(draft.rows[role])):
            yield Problem(file=draft.deck.file, message=f"{whole} has no {what} (no {draft.card(role)})")


@check()
def repeated_cards(draft: Draft) -> Iterator[Problem]:
    """Yield the cards that say again what a card before gave; of two ends the order does not matter."""
    for role, rows in draft.rows.items():
        once = () if draft.raw and role in _READ_AGAIN else (one for spec in rows.specs for one in spec.once)
        for names, message in dict.fromkeys(once):
            paths = [f"{table_of(rows.role)}.{name}" for name in names.split()]
            keys, texts = zip(*(key for path in paths for key in _keys(draft, role, path)), strict=True)
            for row, first in repeats(*keys):
                text = message.format(*(column[row] for column in texts))
                yield draft.problem(role, row, f"{text} {draft.place(role, first)}", path=paths[-1])


def _keys(draft: Draft, role: str, path: str) -> Iterator[tuple[IntArray, TextArray]]:
    """Yield (k,) numbers of what the cards of a role say, -1 for a blank, and (k,) that; the lower end first."""
    values = draft.rows[role][path]
    if values.dtype.kind == "f":
        yield np.where(np.isnan(values), -1, values).astype(np.int64), values
        return
    table = next((table for table in ("cameras", "photos", "points") if naming(table).get(role) == path), None)
    if table:
        numbers = draft.links(table)[role]
    else:
        inverse = np.unique(values, return_inverse=True)[1].reshape(values.shape)
        numbers = np.where(values == "", -1, inverse)
    if values.ndim == 1:
        yield numbers, values
        return
    order = np.argsort(numbers, axis=1)
    yield from zip(np.take_along_axis(numbers, order, 1).T, np.take_along_axis(values, order, 1).T, strict=True)


@check()
def repeated_members(draft: Draft) -> Iterator[Problem]:
    """Yield the points that are twice in equal elevation groups: a point has one level."""
    role, points = "equal_elevations", draft.point["equal_elevations"]
    for place, first in repeats(points.ravel()):
        row, column = divmod(place, points.shape[1])
        where = draft.place(role, first // points.shape[1])
        message = f"point {draft.point_ids[points[row, column]]} is already in an equal elevation group {where}"
        yield draft.problem(role, row, message, path="equal_elevations.point", component=column)


@check()
def undefined(draft: Draft) -> Iterator[Problem]:
    """Yield each camera, photo and point that is named but not defined or measured, where a card first names it."""
    for table, roles, defining, message, severity in _needed(draft):
        if draft.is_spoilt(*defining):
            continue  # cards that could not be read may say it
        known = np.concatenate([draft.links(table)[role] for role in defining])
        places: dict[int, list[tuple[str, int]]] = {}  # of each that is lost, wherever it is named
        for role in roles:
            links = draft.links(table)[role].ravel()
            for place in np.flatnonzero((links >= 0) & ~np.isin(links, known)).tolist():
                places.setdefault(int(links[place]), []).append((role, place))
        for (role, place), *others in places.values():
            row, component = divmod(place, math.prod(draft.links(table)[role].shape[1:]))
            name, path = draft.names(table, role).ravel()[place], naming(table)[role]
            text = message.format(name, _others(len(others)))
            yield draft.problem(role, row, text, path=path, component=component, severity=severity)


def _others(more: int) -> str:
    return f" ({more} more card{'s name' if more > 1 else ' names'} it)" if more else ""


def _needed(draft: Draft) -> Iterator[Need]:
    """Yield what cards of some roles name and one of others must, and what is said where none does.

    What a deck has no card of at all is one problem for all (`missing_kinds`, and the cards that every deck needs).
    Where initial values are computed a photo needs no station card, unless no measurement, attitude or tide names
    it.
    """
    given = {role for role, rows in draft.rows.items() if len(rows)}
    computed, cameras = draft.may_lack_station, len(draft.rows["cameras"])
    if "cameras" in given:
        message = f"camera {{}} has no {draft.card('cameras')}{{}}"
        yield "cameras", draft.camera, ("cameras",), message, "error"
    if "stations" in given or computed:
        roles = [role for role in draft.photo if role not in ("stations", "matrices")]
        defining = ("stations", "attitudes", "tides", "plates") if computed else ("stations",)
        message = f"photo {{}} has no station card ({draft.cards('stations')}){{}}"
        yield "photos", roles, defining, message, "error"
    if computed and cameras > 1:
        message = f"photo {{}} has no station card, and any of {cameras} cameras may have taken it"
        yield "photos", ("plates",), ("stations",), message, "error"
    if given & {"attitudes", *STARTS} and not computed:
        message = f"photo {{}} has no attitude card ({draft.cards('attitudes')})"
        yield "photos", ("stations",), ("attitudes", "matrices", *STARTS), message, "error"
    if "plates" in given:
        message = "nothing is measured on photo {}: it only keeps what its own cards say"
        yield "photos", ("stations",), ("plates",), message, "warning"
        message = "control point {} is measured on no photo: it cannot be used"
        yield "points", ("control",), ("plates",), message, "warning"
        message = "point {} of an equal elevation group is measured on no photo"
        yield "points", ("equal_elevations",), ("plates",), message, "error"
        for role, what in (("distances", "distance"), ("height_differences", "height difference")):
            message = f"point {{}} is measured on no photo: its {what} cannot be used"
            yield "points", (role,), ("plates",), message, "warning"


@check()
def undefined_marks(draft: Draft) -> Iterator[Problem]:
    """Yield each measured fiducial mark, and each measured cross, that the camera of its photo does not have.

    Of a mark distances alone may be known. It is one problem for all cards that name one, and for all of a camera
    without any.
    """
    for role, noun, calibrated in (
        ("fiducial_measurements", "mark", (("fiducials", "ids"), ("mark_distances", "marks"))),
        ("cross_measurements", "cross", (("reseau", "ids"),)),
    ):
        known: set[tuple[int, str]] = set()
        for one, name in calibrated:
            names = draft.rows[one][f"{one}.{name}"]
            for column in names.reshape(len(names), math.prod(names.shape[1:])).T:
                known.update(zip(draft.camera[one].tolist(), column.tolist(), strict=True))
        with_names = {camera for camera, name in known if name}
        measured, photo = draft.rows[role][f"{role}.ids"].tolist(), draft.photo[role]
        named: dict[tuple[int, str], list[int]] = {}  # "": whatever the name, the camera has none
        for row, (camera, name) in enumerate(zip(draft.camera_of_photo[photo].tolist(), measured, strict=True)):
            if camera >= 0 and name and photo[row] >= 0 and (camera, name) not in known:
                named.setdefault((camera, name if camera in with_names else ""), []).append(row)
        cards = draft.cards(calibrated[0][0])
        for (camera, name), rows in named.items():
            message = f"camera {draft.camera_ids[camera]} has no calibrated {noun} {name or 'at all'} ({cards})"
            yield draft.problem(role, rows[0], message + _others(len(rows) - 1), path=f"{role}.ids")
