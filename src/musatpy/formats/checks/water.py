"""Water: its index and where it comes from, tides, flags of points, and what programs can have unknown of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from musatpy import model
from musatpy.arrays import IntArray
from musatpy.errors import Problem
from musatpy.formats import mapping
from musatpy.formats.checks.check import check
from musatpy.formats.checks.systems import fits_system
from musatpy.formats.draft import Draft
from musatpy.formats.job_tables import POINT_FLAGS
from musatpy.model.water import USUAL_INDICES, index_fault

_FLAGS = ("", "bathymetric", "dry")  # of a point


@check(needs="water")
def one_index(draft: Draft) -> Iterator[Problem]:
    """Yield a refractive index that is given twice, itself and by what it comes from, or not at all."""
    path, card = "water.index", draft.cards("water_conditions")
    lacking, conditions = draft.lacks("water", 0, path), len(draft.rows["water_conditions"]) > 0
    message = "blank"
    if conditions:
        message = f"the index is given here, and on {card} what it comes from: one or the other, not both"
    elif card:
        message = f"blank, and no {draft.card('water_conditions')} says what the index comes from"
    if lacking is not conditions:
        yield draft.problem("water", 0, message, path=path)


@check(of_card=True, needs="water_conditions")
def conditions(draft: Draft) -> Iterator[Problem]:
    """Yield conditions of the water that no formula of its index holds for, or that say too much or too little."""
    from musatpy.formats.refractive_index import FORMULAS, faults  # most decks give the index itself

    role = "water_conditions"
    salty = [not draft.lacks(role, 0, f"{role}.{name}") for name in ("salinity", "chlorinity")]
    if all(salty):
        message = "salinity and chlorinity are one thing: one or the other, not both"
        yield draft.problem(role, 0, message, path=f"{role}.chlorinity")
    elif not any(salty):
        message = "blank, and no chlorinity: one of them is needed, 0 for fresh water"
        yield draft.problem(role, 0, message, path=f"{role}.salinity")
    values = {name: draft.rows[role][f"{role}.{name}"][0].item() for name in mapping.names_of(role)}
    if values["formula"] in FORMULAS:
        given: dict[str, Any] = {name: None if value != value else value for name, value in values.items()}
        for name, message in faults(model.WaterConditions(**given)):
            yield draft.problem(role, 0, message, path=f"{role}.{name}")


@check(of_card=True, needs="water")
def index(draft: Draft) -> Iterator[Problem]:
    """Yield an index that no water has, unless another liquid is named, and one that is out of the ordinary."""
    path, (low, high) = "water.index", USUAL_INDICES
    given, liquid = draft.rows["water"][path][0].item(), str(draft.rows["water"]["water.liquid"][0])
    if liquid and len(draft.rows["water_conditions"]):
        message = f"the index is computed for water on {draft.cards('water_conditions')}: no liquid has a name here"
        yield draft.problem("water", 0, message, path="water.liquid")
    elif np.isnan(given):
        return
    elif fault := index_fault(given, liquid):
        advice = "" if liquid else f" in {draft.cards('water')}.liquid"
        yield draft.problem("water", 0, fault + advice, path=path)
    elif not liquid and not low <= given <= high:
        message = f"a refractive index of {given:g} is out of the ordinary: that of water is {low:g} to {high:g}"
        yield draft.problem("water", 0, message, path=path, severity="warning")


@check()
def flags(draft: Draft) -> Iterator[Problem]:
    """Yield the cards whose flag is not that of the first card of their point, plate cards first.

    And the rows with both flags, which no card has: those of a builder, or of files merged with a deck.
    """
    first = np.full(len(draft.point_ids), -1)  # -1: no card yet, else the flag of the first card
    for role in ("plates", "control"):
        links, path = draft.point[role], POINT_FLAGS[0]
        wet, dry = (draft.rows[role][flag].astype(bool) for flag in POINT_FLAGS)
        names = draft.names("points", role)
        message = "point {} is flagged bathymetric and dry: one or the other"
        yield from draft.problems(role, np.flatnonzero(wet & dry), message, names, path=path)
        named = np.flatnonzero((links >= 0) & ~draft.unread(role, path))
        flag = np.where(dry, _FLAGS.index("dry"), wet)
        new = named[::-1][first[links[named[::-1]]] < 0]
        first[links[new]] = flag[new]  # the first card of a point is written last
        for row in named[flag[named] != first[links[named]]].tolist():
            here, there = _FLAGS[flag[row]], _FLAGS[first[links[row]]]
            card = f"flagged {here} here, and {there or 'is not'}" if here else f"not flagged {there} here, and is"
            yield draft.problem(role, row, f"point {names[row]} is {card} on its first card", path=path)


@check()
def water_card(draft: Draft) -> Iterator[Problem]:
    """Yield the first submerged measurement of a deck without a water card, unless refraction is NONE."""
    submerged = _submerged(draft)
    if submerged.size and not len(draft.rows["water"]) and not len(draft.rows["water_conditions"]):
        count = len(np.unique(draft.point["plates"][submerged]))
        points = "point" if count == 1 else "points"
        message = f"{count} bathymetric {points}, but no {draft.card('water')} with the refractive index"
        yield draft.problem("plates", int(submerged[0]), message, path="points.bathymetric")


@check()
def tides(draft: Draft) -> Iterator[Problem]:
    """Yield the photos with submerged points but without tide, unless nothing is refracted or an ORI card asks."""
    submerged = _submerged(draft) if not draft.to_orient else np.zeros(0, dtype=np.int64)
    photos, first = np.unique(draft.photo["plates"][submerged], return_index=True)
    known = draft.may_lack_station | np.isin(photos, draft.photo["stations"])
    rows = submerged[first[(photos >= 0) & known & ~np.isin(photos, draft.photo["tides"])]]
    message = f"photo {{}} has submerged points but no {draft.card('tides')}"
    yield from draft.problems("plates", rows, message, draft.names("photos", "plates"), path="plates.photo")


@check(of_job=True)
def levels(draft: Draft) -> Iterator[Problem]:
    """Yield the tides that are not below their exposure station (geographic and local jobs)."""
    if draft.system is model.CoordinateSystem.GEOCENTRIC or not fits_system(draft, "stations").all():
        return
    height = np.append(draft.by_photo("stations", "photos.position")[:, 2], np.nan)
    tide = draft.rows["tides"]["photos.tide"]
    message = "the water at {:g} m is not below its exposure station"
    yield from draft.problems("tides", tide >= height[draft.photo["tides"]], message, tide, path="photos.tide")


def _submerged(draft: Draft) -> IntArray:
    """Return the rows of plate measurements of submerged points that refraction has to correct."""
    if draft.options.refraction is model.Refraction.NONE and draft.options.program is model.Program.IIA:
        return np.zeros(0, dtype=np.int64)
    point = draft.point["plates"]
    return np.flatnonzero((point >= 0) & np.append(draft.bathymetric, False)[point])


@check(of_run=True, needs="tides", follows=("plates", "control"))
def tides_without_flags(draft: Draft) -> Iterator[Problem]:
    """Yield the first tide of a deck in which no point is flagged as submerged, unless refraction is NONE."""
    number = len(draft.rows["tides"])
    if (
        not len(draft.rows["plates"])
        or draft.options.refraction is model.Refraction.NONE
        or draft.bathymetric.any()
    ):
        return
    cards = f"{number} {draft.card('tides') if number == 1 else draft.cards('tides') + ' cards'}"
    message = f"{cards}, and no point is flagged as submerged: nothing is refracted (run --submerged)"
    yield draft.problem("tides", 0, message, severity="warning")


@check(of_job=True, of_run=True)
def flags_of_control(draft: Draft) -> Iterator[Problem]:
    """Yield the control whose given height contradicts its flag, by the limits of adjusted heights.

    Not in geocentric jobs, nor where the water is tilted, and stands elsewhere at a point than at its photos, or
    the level of a photo is unknown; waves may be as high as all their crests together.
    """
    options = draft.options
    if draft.system is model.CoordinateSystem.GEOCENTRIC or not fits_system(draft, "control").all():
        return
    tilts = [draft.rows["water"][f"water.tilt_{axis}"] for axis in ("east", "north")]
    if options.water_tilt is not model.Treatment.KNOWN or np.nan_to_num(tilts).any():
        return
    if options.program is model.Program.IIA and options.refraction is model.Refraction.NONE:
        return
    tide, tide_sigma = (draft.by_photo("tides", f"photos.{name}") for name in ("tide", "tide_sigma"))
    if options.water_level is model.WaterLevel.KNOWN:
        tide_sigma = np.nan_to_num(tide_sigma)
    photo, point = draft.photo["plates"], draft.point["plates"]
    seen = np.flatnonzero((photo >= 0) & (point >= 0))
    lowest, highest, sigma = np.full((3, len(draft.point_ids)), np.nan)
    for bound, values, extreme in ((lowest, tide, np.fmin), (highest, tide, np.fmax), (sigma, tide_sigma, np.fmax)):
        extreme.at(bound, point[seen], values[photo[seen]])
    waves = float(np.nansum(np.abs(draft.rows["waves"]["waves.height"]))) / 2.0
    rows, of = draft.rows["control"], draft.point["control"]
    wet, dry = (np.append(flags, False)[of] for flags in (draft.bathymetric, draft.flagged("points.dry")))
    lowest, highest, sigma = (np.append(bound, np.nan)[of] for bound in (lowest, highest, sigma))
    height, kind = rows["control.position"][:, 2], rows["control.kind"]
    given = np.where(rows["control.fixed"].astype(bool), 0.0, rows["control.sigma"][:, 2])
    given[(kind == model.ControlKind.HORIZONTAL) | dry] = np.nan  # an approximate height, and one that says nothing
    beyond = np.where(wet, height - highest, lowest - height) - waves
    tested = np.isfinite(beyond) & np.isfinite(given) & np.isfinite(sigma)
    if not (beyond[tested] > 0.0).any():
        return
    from musatpy.statistics.gates import FINEST, flag_limit  # most decks have no such point

    sigmas = beyond / np.maximum(np.hypot(given, sigma), FINEST)
    for row in np.flatnonzero(tested & (sigmas > flag_limit(int(tested.sum())))).tolist():
        side = (
            "above the water of all its photos, and" if wet[row] else "below the water of all its photos, and not"
        )
        message = (
            f"point {draft.names('points', 'control')[row]}, {height[row]:g} m: {beyond[row]:.2f} m "
            f"({sigmas[row]:.1f} sigmas) {side} flagged as submerged"
        )
        yield draft.problem("control", row, message, path="control.position", component=2, severity="warning")


@check()
def only_simultaneous(draft: Draft) -> Iterator[Problem]:
    """Yield what a job of program IIA asks for and only IIIA has."""
    options = draft.options
    if options.program is not model.Program.IIA:
        return
    for name, only in (
        ("water_level", model.WaterLevel.KNOWN),
        ("water_tilt", model.Treatment.KNOWN),
        ("water_index", model.Treatment.KNOWN),
        ("datum", model.Datum.CONTROL),
    ):
        if getattr(options, name) is not only:
            message = f"'{getattr(options, name)}' needs program IIIA"
            yield draft.problem("more_options", 0, message, path=f"options.{name}")
    for role, what in (("distances", "distances"), ("height_differences", "height differences")):
        if len(draft.rows[role]):
            message = f"the {what} take no part: program IIA does not use them, IIIA does"
            yield draft.problem(role, 0, message, severity="warning")


@check(needs="options")
def only_rigorous(draft: Draft) -> Iterator[Problem]:
    """Yield options of IIA that a job of program IIIA gives in vain."""
    for name, fixed in (("refraction", model.Refraction.RIGOROUS), ("weights", model.Weights.FULL)):
        text = str(draft.rows["options"][f"options.{name}"][0])
        if draft.options.program is model.Program.IIIA and text and text != fixed:
            message = f"'{text}' is not for program IIIA: it has {fixed} only, and uses that"
            yield draft.problem("options", 0, message, path=f"options.{name}", severity="warning")


@check()
def tide_labels(draft: Draft) -> Iterator[Problem]:
    """Yield the tide cards that do not say whose correction their photo shares, where there are groups or days."""
    name = {model.WaterLevel.GROUP: "group", model.WaterLevel.DAY: "day"}.get(draft.options.water_level)
    if name is not None and draft.options.program is model.Program.IIIA:
        path = f"photos.tide_{name}"
        message = f"blank, and the unknown corrections of the tides go by {name}"
        yield from draft.problems("tides", draft.rows["tides"][path] == "", message, path=path)


@check()
def priors_of_the_water(draft: Draft) -> Iterator[Problem]:
    """Yield unknowns of the water without a sigma: the measurements alone have to determine them."""
    options = draft.options
    message = "no sigma: the measurements alone have to determine this unknown"
    for role, path, unknown in (
        ("tides", "photos.tide_sigma", options.water_level is not model.WaterLevel.KNOWN),
        ("water", "water.tilt_sigma", options.water_tilt is model.Treatment.ADJUST),
        ("water", "water.sigma", options.water_index is model.Treatment.ADJUST),
    ):
        if not unknown or options.program is not model.Program.IIIA:
            continue
        if len(draft.rows[role]) and np.isnan(draft.rows[role][path]).all():
            yield draft.problem(role, 0, message, path=path, severity="warning")
        elif not len(draft.rows[role]) and role == "water" and len(draft.rows["water_conditions"]):
            yield draft.problem("water_conditions", 0, message, severity="warning")


@check()
def orientation_card(draft: Draft) -> Iterator[Problem]:
    """Yield what the method of an ORI card cannot have of photos, tides and the index of the water."""
    spec = mapping.single_of("orientation", draft.rows["orientation"].values)
    if spec is None:
        return
    measured, tides = (np.unique(draft.photo[role]) for role in ("plates", "tides"))
    index = draft.rows["water"]["water.index"]
    known = float(index[0]) if len(index) and np.isfinite(index[0]) else np.nan
    names, with_tide = (draft.photo_ids[photos[photos >= 0]].tolist() for photos in (measured, tides))
    control = bool((draft.point["control"] >= 0).any())
    for field, message in spec.faults(names, set(with_tide), known, control):
        yield draft.problem("orientation", 0, message, path=f"orientation.{field}")
