"""What one card names and another must define, or measure."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np

from musatpy.arrays import BoolArray, IntArray
from musatpy.errors import Problem
from musatpy.formats.draft import Draft
from musatpy.formats.job_tables import naming

_UNUSED = "point {{}} is measured on no photo: its {} cannot be used"
# What is to be measured: its table, the role that names it, and what is said of it where it is not.
_MEASURED: tuple[tuple[Literal["photos", "points"], str, Literal["error", "warning"], str], ...] = (
    ("photos", "stations", "warning", "nothing is measured on photo {}: it only keeps what its own cards say"),
    ("points", "control", "warning", "control point {} is measured on no photo: it cannot be used"),
    ("points", "equal_elevations", "error", "point {} of an equal elevation group is measured on no photo"),
    ("points", "distances", "warning", _UNUSED.format("distance")),
    ("points", "height_differences", "warning", _UNUSED.format("height difference")),
)
_SHOWN = 5  # lines that the message of a problem of many cards names


def missing_kinds(draft: Draft) -> Iterator[Problem]:
    """Yield what no job can do without and no card gives, apart from the cards that every deck must have."""
    if draft.may_lack_station:
        return
    for role, what in (("stations", "exposure stations"), ("attitudes", "attitudes")):
        rows = draft.rows[role]
        if not len(rows):
            whole = "the block" if draft.call else "the deck"
            yield Problem(file=draft.deck.file, message=f"{whole} has no {what} (no {draft.card(role)})")


def undefined_cameras(draft: Draft) -> Iterator[Problem]:
    """Yield each camera that is named but has no camera card, where it is first named."""
    if not len(draft.rows["cameras"]):
        return  # one problem for all, as a card that every deck needs
    message = f"camera {{}} has no {draft.card('cameras')}{{}}"
    undefined = ~_present(draft.camera["cameras"], len(draft.camera_ids))
    for role in draft.camera:
        yield from _first_named(draft, "cameras", role, undefined, message)


def undefined_photos(draft: Draft) -> Iterator[Problem]:
    """Yield each photo that is named but has no station card, where it is first named on each kind of card.

    Where initial values are computed it needs none, unless no measurement, attitude or tide names it either.
    """
    if not len(draft.rows["stations"]) and not draft.may_lack_station:
        return  # one problem for all
    defining = ("stations", "attitudes", "tides", "plates") if draft.may_lack_station else ("stations",)
    undefined = ~_present(np.concatenate([draft.photo[role] for role in defining]), len(draft.photo_ids))
    message = f"photo {{}} has no station card ({draft.cards('stations')}){{}}"
    for role in draft.photo:
        if role not in ("stations", "matrices"):
            yield from _first_named(draft, "photos", role, undefined, message)


def photos_without_camera(draft: Draft) -> Iterator[Problem]:
    """Yield the measured photos whose camera no station card names, in a deck of several cameras."""
    count = len(draft.rows["cameras"])
    if not draft.may_lack_station or count < 2:
        return
    without = ~_present(draft.photo["stations"], len(draft.photo_ids))
    message = f"photo {{}} has no station card, and any of {count} cameras may have taken it"
    yield from _first_named(draft, "photos", "plates", without, message)


def undefined_marks(draft: Draft) -> Iterator[Problem]:
    """Yield each measured fiducial mark, and each measured cross, that the camera of its photo does not have.

    That is one problem for all cards that name it, and one for all of a camera without any calibrated marks.
    """
    known = _named_by_cameras(draft, "fiducials", "fiducials.ids")
    for end in (0, 1):  # a mark of which only distances are known
        known |= _named_by_cameras(draft, "mark_distances", "mark_distances.marks", end)
    yield from _undefined(draft, "fiducial_measurements", known, "mark", "fiducials")
    known = _named_by_cameras(draft, "reseau", "reseau.ids")
    yield from _undefined(draft, "cross_measurements", known, "cross", "reseau")


def _named_by_cameras(draft: Draft, role: str, path: str, component: int | None = None) -> set[tuple[int, str]]:
    """Return (camera, name) of what the cards of a role name."""
    names = draft.rows[role][path] if component is None else draft.rows[role][path][:, component]
    return set(zip(draft.camera[role].tolist(), names.tolist(), strict=True))


def _undefined(draft: Draft, role: str, known: set[tuple[int, str]], noun: str, defining: str) -> Iterator[Problem]:
    """Yield the names on cards of a role of measurements that are not `known` of the camera of their photo."""
    path, rows = f"{role}.ids", draft.rows[role]
    camera = draft.camera_of_photo[draft.photo[role]] if len(rows) else np.zeros(0, dtype=np.int64)
    calibrated = {link for link, name in known if name}
    undefined: dict[tuple[int, str], list[int]] = {}  # "": whatever the name, the camera has none
    for row, (link, mark) in enumerate(zip(camera.tolist(), rows[path].tolist(), strict=True)):
        if link >= 0 and mark and draft.photo[role][row] >= 0 and (link, mark) not in known:
            undefined.setdefault((link, mark if link in calibrated else ""), []).append(row)
    for (link, mark), named in undefined.items():
        name, cards = f"camera {draft.camera_ids[link]}", draft.cards(defining)
        lines = _lines(rows.lines[named].tolist())
        if mark:
            message = f"{noun} {mark} is no calibrated {noun} ({cards}) of {name}"
            message += f" ({len(named)} cards name it, {lines})" if len(named) > 1 else ""
        else:
            measured = f"{len(named)} cards measure" if len(named) > 1 else "1 card measures"
            message = (
                f"{name} has no calibrated {noun} ({cards}), and {measured} one ({draft.cards(role)}, {lines})"
            )
        yield draft.problem(role, named[0], message, path=path)


def _lines(numbers: list[int]) -> str:
    """Return the first of some lines in words, and how many more there are."""
    shown = ", ".join(str(number) for number in numbers[:_SHOWN])
    more = f" and {len(numbers) - _SHOWN} more" if len(numbers) > _SHOWN else ""
    return f"line{'s' if len(numbers) > 1 else ''} {shown}{more}"


def photos_without_attitude(draft: Draft) -> Iterator[Problem]:
    """Yield the photos that have a station card but no attitude card, of angles or of a matrix."""
    if not len(draft.rows["attitudes"]) or draft.may_lack_station:
        return  # one problem for all, or none
    given = np.concatenate([draft.photo["attitudes"], draft.photo["matrices"]])
    message = f"photo {{}} has no attitude card ({draft.cards('attitudes')})"
    yield from _first_named(draft, "photos", "stations", ~_present(given, len(draft.photo_ids)), message)


def unmeasured(draft: Draft) -> Iterator[Problem]:
    """Yield the photos on which nothing is measured, and what is said of points that are on no plate card."""
    if not len(draft.rows["plates"]):
        return  # one problem for all
    for table, role, severity, message in _MEASURED:
        ids, links = (draft.photo_ids, draft.photo) if table == "photos" else (draft.point_ids, draft.point)
        yield from _first_named(draft, table, role, ~_present(links["plates"], len(ids)), message, severity)


def _present(links: IntArray, count: int) -> BoolArray:
    """Return (count,) True where one of `links` points."""
    present = np.zeros(count, dtype=bool)
    present[links[links >= 0]] = True
    return present


def _first_named(
    draft: Draft,
    table: Literal["cameras", "photos", "points"],
    role: str,
    wanted: BoolArray,
    message: str,
    severity: Literal["error", "warning"] = "error",
) -> Iterator[Problem]:
    """Yield where a role first names each of the `wanted` rows of a table.

    Its name and, if asked for, how many more cards name it stand in the place of `{}` in the message.
    """
    links, names = draft.links(table)[role], draft.names(table, role).ravel()
    unique, first, count = np.unique(links, return_index=True, return_counts=True)
    for link, place, times in zip(unique.tolist(), first.tolist(), count.tolist(), strict=True):
        if link >= 0 and wanted[link]:
            row, component = divmod(place, math.prod(links.shape[1:]))
            text, path = message.format(names[place], _others(times - 1)), naming(table)[role]
            yield draft.problem(role, row, text, path=path, component=component, severity=severity)


def _others(more: int) -> str:
    return "" if not more else f" ({more} more card{'s name' if more > 1 else ' names'} it)"
