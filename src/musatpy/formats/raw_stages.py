"""Stages that were read raw: the interior orientation of a compilation deck, its readings as raw plates of a run.

An interior orientation is measured anew on the plotter. Its cards are those of triangulation decks, and are checked
as there; cameras and photos are those of the run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from musatpy.arrays import IntArray
from musatpy.errors import Problem
from musatpy.formats import assembly
from musatpy.formats.cards.codec import Column
from musatpy.formats.cards.deck import CardDeck
from musatpy.formats.cards.spec import CardSpec
from musatpy.formats.checks import identities, raw, references, values, zeros
from musatpy.formats.draft import Draft, draft_of, draft_of_rows
from musatpy.formats.job_tables import Rows, Table, card_family, naming, roles_of, size
from musatpy.formats.musat import has_errors
from musatpy.formats.parts import parts_of
from musatpy.model import Block, PlateMeasurements, Points
from musatpy.model.compilation import StageReadings, StereomodelSpecs
from musatpy.model.tables import empty

CARDS = ("RED", "CMP", "DST", "LNS", "FID", "FDS", "RSC", "FMS", "RSM")
_OF_RUN = ("options", "cameras", "stations", "attitudes")
_CHECKS: tuple[Callable[[Draft], Iterator[Problem]], ...] = (
    identities.repeated_cards,
    references.undefined_marks,
    values.sigmas,
    values.magnitudes,
    values.distortion,
    values.bounds,
    values.two_ends,
    zeros.marks,
    raw.lenses,
    raw.distortions,
    raw.calibrations,
    raw.reseaux,
    raw.unmeasured_marks,
    raw.unmeasured_crosses,
    raw.curvature,
    raw.heights,
)


def raw_stages(
    deck: CardDeck, models: StereomodelSpecs, stages: StageReadings, lines: IntArray, run: Block
) -> tuple[Block | None, list[Problem]]:
    """Return the readings of a deck as raw plates of a run, None with errors, and every problem of their cards.

    A reading, on line `lines` (k,) of the deck, is a point by its number in `stages`, as names may repeat. Readings
    on photos that the run does not have are left out, as are model points.
    """
    draft = _draft(deck, _plates(models, stages), lines, run)
    problems = [_placed(problem) for problem in _strangers(draft, run, models)]
    if not has_errors(problems):  # the checks look for the cameras of marks
        problems += [_placed(problem) for check in _CHECKS for problem in check(draft)]
    return (None if has_errors(problems) else assembly.block_of(draft)), problems


def cards_of(plates: Block) -> Iterator[tuple[CardSpec, dict[str, Column]]]:
    """Yield the cards of the interior orientation of raw stages, and their columns."""
    family = card_family()
    wanted = {role for role, specs in roles_of(family).items() if any(spec.mnemonic in CARDS for spec in specs)}
    tables = {role: table for role, table in parts_of(plates).items() if role in wanted}
    cards = assembly.cards_of_tables(tables, family, system=None)
    yield from (card for card in cards if card[0].mnemonic in CARDS)


def _plates(models: StereomodelSpecs, stages: StageReadings) -> Table:
    """Return what plate cards would say, those of the left stages first."""
    count = len(stages.ids)
    return {
        "plates.photo": np.concatenate([photos[stages.model] for photos in (models.left, models.right)]),
        "plates.point": np.tile(np.arange(count).astype(np.str_), 2),
        "plates.xy": np.concatenate([stages.xy[:, 0], stages.xy[:, 1]]),
        "plates.sigma": np.full((2 * count, 2), np.nan),
        "plates.triangulated": np.ones(2 * count, dtype=bool),
        "points.bathymetric": np.tile(stages.submerged, 2),
        "points.dry": np.zeros(2 * count, dtype=bool),
    }


def _draft(deck: CardDeck, plates: Table, lines: IntArray, run: Block) -> Draft:
    """Return the draft of a deck of these plates: photos and cameras of the run, the rest of the deck's cards."""
    family = card_family()
    interior = replace(deck, tables={name: deck.tables[name] for name in CARDS if name in deck.tables})
    rows, specs = dict(draft_of(interior, family).rows), roles_of(family)
    card = rows["reduction"].lines
    parts = parts_of(replace(run, points=empty(Points), plates=empty(PlateMeasurements)))
    for role in _OF_RUN:
        rows[role] = Rows.of(role, specs[role], parts[role], np.repeat(card, size(parts[role])))
    known = np.isin(plates["plates.photo"], run.photos.ids) & np.isfinite(plates["plates.xy"]).all(axis=1)
    kept = {path: column[known] for path, column in plates.items()}
    rows["plates"] = Rows.of("plates", specs["plates"], kept, np.tile(lines, 2)[known])
    return draft_of_rows(rows, interior)


def _strangers(draft: Draft, run: Block, models: StereomodelSpecs) -> Iterator[Problem]:
    """Yield cameras that the run does not have, and photos with marks or crosses that are in no model."""
    for role, links in draft.camera.items():
        if role in _OF_RUN:
            continue
        names = draft.camera_ids[links]
        bad = ~np.isin(names, run.cameras.ids)
        yield from draft.problems(role, bad, "the run has no camera {}", names, path=naming("cameras")[role])
    read = np.concatenate([models.left, models.right])
    for role in ("fiducial_measurements", "cross_measurements"):
        links = draft.photo[role]
        names = draft.photo_ids[links]
        bad = ~np.isin(names, read)
        yield from draft.problems(role, bad, "photo {} is in no model", names, path=f"{role}.photo")


def _placed(problem: Problem) -> Problem:
    """Return a problem at the card of the deck: readings stand on STG cards, what the run says on none."""
    if problem.card in CARDS:
        return problem
    if problem.card == "PLT":
        return replace(problem, card="STG", columns=None, field=None)
    return replace(problem, card=None, columns=None, field=None, line=None, text="")
