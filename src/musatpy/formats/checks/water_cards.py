"""Submerged points: the flags, the water and the tides that they need."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from musatpy.arrays import IntArray
from musatpy.errors import Problem
from musatpy.formats import mapping
from musatpy.formats.checks.system_use import fits_system
from musatpy.formats.draft import Draft
from musatpy.formats.job_tables import POINT_FLAGS
from musatpy.model import CoordinateSystem, Program, Refraction, WaterConditions
from musatpy.model.water import USUAL_INDICES, index_fault

_FLAGS = ("", "bathymetric", "dry")  # of a point


def flags(draft: Draft) -> Iterator[Problem]:
    """Yield the cards whose flag is not that of the first card of their point, plate cards first.

    And the rows with both flags, which no card has: those of a builder, or of files merged with a deck.
    """
    first = np.full(len(draft.point_ids), -1)  # -1: no card yet, else the flag of the first card
    for role in ("plates", "control"):
        links, path = draft.point[role], POINT_FLAGS[0]
        wet, dry = (draft.rows[role][flag].astype(bool) for flag in POINT_FLAGS)
        names = draft.names("points", role)
        both = np.flatnonzero(wet & dry)
        message = "point {} is flagged bathymetric and dry: one or the other"
        yield from draft.problems(role, both, message, names, path=path)
        named = np.flatnonzero((links >= 0) & ~draft.unread(role, path))
        flag = np.where(dry, _FLAGS.index("dry"), wet)
        new = named[::-1][first[links[named[::-1]]] < 0]
        first[links[new]] = flag[new]  # the first card of a point is written last
        for row in named[flag[named] != first[links[named]]].tolist():
            here, there = _FLAGS[flag[row]], _FLAGS[first[links[row]]]
            card = f"flagged {here} here, and {there or 'is not'}" if here else f"not flagged {there} here, and is"
            yield draft.problem(role, row, f"point {names[row]} is {card} on its first card", path=path)


def water_card(draft: Draft) -> Iterator[Problem]:
    """Yield the first submerged measurement of a deck without a water card, unless refraction is NONE."""
    submerged = _submerged(draft)
    if submerged.size and not len(draft.rows["water"]) and not len(draft.rows["water_conditions"]):
        count = len(np.unique(draft.point["plates"][submerged]))
        points = "point" if count == 1 else "points"
        message = f"{count} bathymetric {points}, but no {draft.card('water')} with the refractive index"
        yield draft.problem("plates", int(submerged[0]), message, path="points.bathymetric")


def one_index(draft: Draft) -> Iterator[Problem]:
    """Yield a refractive index that is given twice, itself and by what it comes from, or not at all."""
    if not len(draft.rows["water"]):
        return
    path, card = "water.index", draft.cards("water_conditions")
    lacking, conditions = draft.lacks("water", 0, path), len(draft.rows["water_conditions"]) > 0
    if conditions and not lacking:
        message = f"the index is given here, and on {card} what it comes from: one or the other, not both"
        yield draft.problem("water", 0, message, path=path)
    elif lacking and not conditions:
        message = (
            f"blank, and no {draft.card('water_conditions')} says what the index comes from" if card else "blank"
        )
        yield draft.problem("water", 0, message, path=path)


def index(draft: Draft) -> Iterator[Problem]:
    """Yield an index that no water has, unless another liquid is named, and one that is out of the ordinary."""
    if not len(draft.rows["water"]):
        return
    path, name = "water.index", "water.liquid"
    given, liquid = draft.rows["water"][path][0].item(), str(draft.rows["water"][name][0])
    if liquid and len(draft.rows["water_conditions"]):
        message = f"the index is computed for water on {draft.cards('water_conditions')}: no liquid has a name here"
        yield draft.problem("water", 0, message, path=name)
    elif fault := "" if np.isnan(given) else index_fault(given, liquid):
        advice = "" if liquid else f" in {draft.cards('water')}.liquid"
        yield draft.problem("water", 0, fault + advice, path=path)
    elif not liquid and not np.isnan(given) and not USUAL_INDICES[0] <= given <= USUAL_INDICES[1]:
        low, high = USUAL_INDICES
        message = f"a refractive index of {given:g} is out of the ordinary: that of water is {low:g} to {high:g}"
        yield draft.problem("water", 0, message, path=path, severity="warning")


def conditions(draft: Draft) -> Iterator[Problem]:
    """Yield conditions of the water that no formula of its index holds for, or that say too much or too little."""
    rows, role = draft.rows["water_conditions"], "water_conditions"
    if not len(rows):
        return
    from musatpy.formats.refractive_index import FORMULAS, faults  # most decks give the index itself

    salty = [not draft.lacks(role, 0, f"{role}.{name}") for name in ("salinity", "chlorinity")]
    if all(salty):
        message = "salinity and chlorinity are one thing: one or the other, not both"
        yield draft.problem(role, 0, message, path=f"{role}.chlorinity")
    elif not any(salty):
        message = "blank, and no chlorinity: one of them is needed, 0 for fresh water"
        yield draft.problem(role, 0, message, path=f"{role}.salinity")
    values = {name: rows[f"{role}.{name}"][0].item() for name in mapping.names_of(role)}
    if values["formula"] in FORMULAS:
        given: dict[str, Any] = {name: None if value != value else value for name, value in values.items()}
        for name, message in faults(WaterConditions(**given)):
            yield draft.problem(role, 0, message, path=f"{role}.{name}")


def tides(draft: Draft) -> Iterator[Problem]:
    """Yield the photos with submerged points but without tide, unless nothing is refracted or an ORI card asks."""
    if draft.to_orient:
        return
    submerged = _submerged(draft)
    photos, first = np.unique(draft.photo["plates"][submerged], return_index=True)
    known, with_tide = set(draft.photo["stations"].tolist()), set(draft.photo["tides"].tolist())
    for photo, row in zip(photos.tolist(), submerged[first].tolist(), strict=True):
        if photo >= 0 and (photo in known or draft.may_lack_station) and photo not in with_tide:
            message = f"photo {draft.photo_ids[photo]} has submerged points but no {draft.card('tides')}"
            yield draft.problem("plates", row, message, path="plates.photo")


def levels(draft: Draft) -> Iterator[Problem]:
    """Yield the tides that are not below their exposure station (geographic and local jobs)."""
    if draft.system is CoordinateSystem.GEOCENTRIC or not fits_system(draft, "stations", "photos.position").all():
        return
    height = np.append(draft.by_photo("stations", "photos.position")[:, 2], np.nan)
    tide = draft.rows["tides"]["photos.tide"]
    message = "the water at {:g} m is not below its exposure station"
    yield from draft.problems("tides", tide >= height[draft.photo["tides"]], message, tide, path="photos.tide")


def _submerged(draft: Draft) -> IntArray:
    """Return the rows of plate measurements of submerged points that refraction has to correct."""
    if draft.options.refraction is Refraction.NONE and draft.options.program is Program.IIA:
        return np.zeros(0, dtype=np.int64)
    point = draft.point["plates"]
    return np.flatnonzero((point >= 0) & np.append(draft.bathymetric, False)[point])
