"""Flags of points besides those of the cards: dry for certain, or submerged; by a list, a polygon, or heights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from musatpy import adjustment
from musatpy.arrays import BoolArray
from musatpy.errors import AdjustmentError, DeckError, Problem, count_of, numerics
from musatpy.formats.cards.deck import write_cards
from musatpy.formats.job_tables import POINT_FLAGS, Tables, card_family
from musatpy.formats.musat import check_deck
from musatpy.formats.parts import cards_of_parts, missing_parts
from musatpy.geometry.areas import area_of
from musatpy.jobs.naming import names_of, text_of
from musatpy.jobs.plan_positions import plan
from musatpy.model import Block, CoordinateSystem, Editing, Refraction, Solution, Treatment, WaterLevel
from musatpy.statistics import Statistics

BELOW = Path("BELOW")
_POLYGONS = (".csv", ".geojson", ".json")

First = Callable[[], Solution]
"""The first adjustment of a block, which is done where it is asked for, and once."""


@dataclass(frozen=True, kw_only=True)
class PointFlags:
    """What says that points are dry for certain, or submerged."""

    dry: Path | None = None  # a polygon
    submerged: Path | None = None  # a list of points, a polygon, or `BELOW`

    @property
    def files(self) -> dict[str, Path]:
        """The files that are read, by the option that names each."""
        given = {"dry": self.dry, "submerged": self.submerged}
        return {name: path for name, path in given.items() if path not in (None, BELOW)}


@dataclass(frozen=True, kw_only=True)
class FlagsSet:
    """The points that have flags besides those of their cards."""

    flags: dict[str, list[str]]  # of `POINT_FLAGS`, its points
    settings: tuple[str, ...]  # what was set, as a listing says it
    undecided: tuple[str, ...]  # what to tell of points too near the water for their heights to say


def flags_set(block: Block, wanted: PointFlags) -> FlagsSet:
    """Return the points of a block that are flagged as `wanted`.

    A point has its place by its control card, else by a first adjustment with the flags of the cards. Raises
    `DeckError` where a polygon holds no point, a point does not exist or would be submerged and dry, or no tide
    says what is below the water; `AdjustmentError` where the first adjustment is none; `OSError`.
    """
    first = cache(partial(_first_adjustment, block))
    points, given, settings = block.points, {"submerged": wanted.submerged, "dry": wanted.dry}, []
    submerged, dry, undecided = np.zeros((3, len(points.ids)), dtype=bool)
    if wanted.dry is not None:
        dry = _inside(block, wanted.dry, first)
    if wanted.submerged == BELOW:
        submerged, undecided = (rows & ~points.dry & ~dry for rows in _below(block, first))
    elif wanted.submerged is not None:
        is_polygon = wanted.submerged.suffix.lower() in _POLYGONS
        submerged = _inside(block, wanted.submerged, first) if is_polygon else _listed(block, wanted.submerged)
    if len(both := points.ids[(points.bathymetric | submerged) & (points.dry | dry)]):
        message = "point {} would be flagged as submerged and as dry for certain: one or the other"
        raise DeckError(Problem(message=message.format(name)) for name in both.tolist())
    flags = {flag: points.ids[of].tolist() for flag, of in zip(POINT_FLAGS, (submerged, dry), strict=True)}
    for (option, path), ids in zip(given.items(), flags.values(), strict=True):
        if path is not None:
            settings.append(f"{option}={path.name} ({count_of(len(ids), 'point')})")
    if not undecided.any():
        return FlagsSet(flags=flags, settings=tuple(settings), undecided=())
    names = " ".join(points.ids[undecided].tolist())
    text = "not flagged as submerged, and nearer to the water than their limit, or below some of it"
    note = f"{BELOW}: undecided, {text}: {names}"
    return FlagsSet(flags=flags, settings=(*settings, f"undecided: {names}"), undecided=(note,))


def flags_of_parts(parts: Tables, wanted: PointFlags) -> FlagsSet:
    """Return the points of a job that is converted which are flagged as `wanted`; raises as `flags_set`."""
    if missing := missing_parts(parts):
        raise DeckError(missing)
    block, problems = check_deck(write_cards(cards_of_parts(parts, card_family())), for_run=False)
    if block is None:
        raise DeckError(problems)
    return flags_set(block, wanted)


def _first_adjustment(block: Block) -> Solution:
    """Return the solution of a block with its water as it is given; raises `AdjustmentError` if there is none."""
    options = replace(block.options, editing=Editing.NONE, water_level=WaterLevel.KNOWN)
    options = replace(options, water_tilt=Treatment.KNOWN, water_index=Treatment.KNOWN)
    if options.refraction is Refraction.NONE:  # by which no height would speak against a flag
        options = replace(options, refraction=Refraction.RIGOROUS)
    if block.raw:
        from musatpy.reduction.readings_job import reduce  # most jobs come refined

        block, _ = reduce(block)
    solution = adjustment.adjust(replace(block, options=options))
    if not solution.converged:
        message = "the first adjustment, which says where points are, does not converge: list them instead"
        raise AdjustmentError.of(message)
    return solution


def _listed(block: Block, path: Path) -> BoolArray:
    """Return (p,) the points that a file names."""
    wanted = names_of(text_of(path))
    unknown = [name for name in wanted if name not in set(block.points.ids.tolist())]
    if unknown or not wanted:
        messages = [f"no point {name} in the deck" for name in unknown] or ["no point is named"]
        raise DeckError(Problem(file=str(path), message=message) for message in messages)
    return np.isin(block.points.ids, wanted)


def _inside(block: Block, path: Path, first: First) -> BoolArray:
    """Return (p,) the points in a polygon."""
    local = block.options.system is CoordinateSystem.LOCAL
    area = area_of(text_of(path), str(path), geographic=not local)
    known = np.full((len(block.points.ids), 2), np.nan)
    known[block.control.point] = plan(block, block.control.position)
    lacking = ~np.isfinite(known).all(axis=1)
    lacking &= np.bincount(block.plates.point, minlength=len(known)) > 0
    if lacking.any():
        known[lacking] = plan(block, first().points.position)[lacking]
    inside = area.holds(known)
    if not inside.any():
        what = "X and Y of the job" if local else "longitude and latitude in degrees"
        message = f"no point of the deck is in the polygon: its corners are {what}, in this order"
        raise DeckError.of(message, file=path)
    return inside


def _below(block: Block, first: First) -> tuple[BoolArray, BoolArray]:
    """Return (p,) the points below the water of all their photos for certain, and those too near it to say."""
    if not np.isfinite(block.photos.tide).any():
        raise DeckError.of(f"{BELOW}: no tide says how high the water stands: it is on TID cards")
    with numerics("the first adjustment"):
        tests = Statistics(first()).flags
    below, undecided = np.zeros((2, len(block.points.ids)), dtype=bool)
    below[tests.point[tests.doubted_of(False)]] = True
    near = tests.mixed | (np.abs(tests.sigmas) <= tests.limit)
    undecided[tests.point[near & ~tests.flagged & ~tests.shore]] = True
    return below, undecided
