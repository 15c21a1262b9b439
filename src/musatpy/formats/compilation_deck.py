"""Compilation decks: cards of the family `as11` <-> stereomodels and readings, with every problem of the deck."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.errors import DeckError, Problem
from musatpy.formats import raw_stages
from musatpy.formats.cards.codec import Column
from musatpy.formats.cards.deck import CardDeck, CardTable, read_cards, write_cards
from musatpy.formats.cards.spec import CardSpec
from musatpy.formats.compilation_cards import (
    COORDINATES,
    CORNERS,
    LEVELS,
    PLACE,
    READINGS,
    TIMES,
    cards_of,
    compilation_family,
    is_raw,
    number,
    numbers,
    reading_lines,
    text,
)
from musatpy.formats.compilation_checks import ModelFaults, cross_checks, of_contours
from musatpy.formats.musat import has_errors
from musatpy.model import Block
from musatpy.model.compilation import (
    IN_PROFILE,
    CardLines,
    Compilation,
    ContourSpec,
    GridSpecs,
    ProfileSpecs,
    SoundingDatum,
    StageReadings,
    StereomodelSpecs,
)
from musatpy.model.tables import stacked, taken
from musatpy.units import MICROMETRE


def read_compilation(
    source: Path | str | bytes, run: Block | None = None, model_faults: ModelFaults | None = None
) -> tuple[Compilation, tuple[Problem, ...]]:
    """Return what a compilation deck says, and warnings; `run` has the photos and cameras of stages read raw.

    `model_faults` says of two photos, field by field of MDL cards, why they make no model of the run. Raises
    `DeckError` with every problem where there is an error, and `OSError`.
    """
    deck = read_cards(source, compilation_family())
    problems = [*deck.problems, *cross_checks(deck, run, model_faults)]
    if has_errors(problems):
        raise _refused(problems)
    contents = _contents(deck)
    if is_raw(deck):
        if run is None:
            raise DeckError([Problem(file=deck.file, message="its stages are raw: it is read beside the run")])
        lines = reading_lines(deck)
        plates, faults = raw_stages.raw_stages(deck, contents.models, contents.stages, lines, run)
        problems += faults
        if plates is None:
            raise _refused(problems)
        contents = replace(contents, raw=plates)
    return contents, tuple(problems)


def _refused(problems: list[Problem]) -> DeckError:
    return DeckError(sorted(problems, key=lambda problem: problem.line or 0))


def _contents(deck: CardDeck) -> Compilation:
    """Return what the cards say, the stages as they were read."""
    titles, models, profiles = (cards_of(deck, name) for name in ("TTL", "MDL", "PRF"))
    row = {name: row for row, name in enumerate(text(models, "model").tolist())}
    tables = [cards_of(deck, name) for name in READINGS]
    order = np.argsort(np.concatenate([table.lines for table in tables]))
    stages = taken(stacked([_readings(table, row) for table in tables]), order)
    names = text(models, "model")
    return Compilation(
        titles=tuple(text(titles, "text").tolist()),
        models=StereomodelSpecs(
            ids=names,
            left=text(models, "left"),
            right=text(models, "right"),
            mode=text(models, "mode"),
            vertical=text(models, "vertical"),
            tide=text(models, "tide"),
            rays=text(models, "rays"),
            pointing=number(models, "pointing") * MICROMETRE,
            limit=number(models, "limit") * MICROMETRE,
            adjust=text(models, "adjust") == "A",
            true_marks=text(models, "loop") == "T",
        ),
        stages=_timed(stages, names, cards_of(deck, "PTM")),
        profiles=_profiles(profiles, cards_of(deck, "PRE"), row),
        grids=_grids(cards_of(deck, "GRD")),
        datum=_datum(cards_of(deck, "VDT")),
        contours=_contours(deck, "D"),
        heights=_contours(deck, "H"),
        lines=CardLines(
            models=models.lines,
            stages=reading_lines(deck),
            profiles=profiles.lines,
            grids=cards_of(deck, "GRD").lines,
        ),
    )


def _readings(table: CardTable, models: dict[str, int]) -> StageReadings:
    """Return what the cards of a kind say; what the other kind has is NaN."""
    kind = text(table, "class")
    return StageReadings(
        model=np.array([models[name] for name in text(table, "model").tolist()], dtype=np.int64),
        ids=text(table, "point"),
        kind=np.where(kind == "", "G", kind),
        submerged=text(table, "bathymetric") == "B",
        xy=numbers(table, COORDINATES).reshape(-1, 2, 2),
        sigma=number(table, "sigma") * MICROMETRE,
        place=numbers(table, PLACE),
        parallax=numbers(table, ("parallax",))[:, 0] * MICROMETRE,
        time=np.full(len(table), np.nan),
    )


def _timed(stages: StageReadings, models: TextArray, table: CardTable) -> StageReadings:
    """Return the readings with the times of profiles, which count these in the order of the deck."""
    time, given = stages.time.copy(), numbers(table, TIMES)
    in_profile = stages.kind == IN_PROFILE
    names = zip(text(table, "model"), text(table, "profile"), number(table, "first"), given, strict=True)
    for model, profile, first, times in names:
        rows = np.flatnonzero(in_profile & (models[stages.model] == model) & (stages.ids == profile))
        known = np.flatnonzero(np.isfinite(times))
        time[rows[int(first) - 1 + known]] = times[known]
    return replace(stages, time=time)


def _profiles(table: CardTable, ends: CardTable, models: dict[str, int]) -> ProfileSpecs:
    ids, of = text(table, "profile"), text(table, "model")
    rows = {name: row for row, name in enumerate(zip(of.tolist(), ids.tolist(), strict=True))}
    places, system = np.full((len(table), 2, 2), np.nan), np.full(len(table), "", dtype="<U1")
    for name, place, kind in zip(
        zip(text(ends, "model").tolist(), text(ends, "profile").tolist(), strict=True),
        numbers(ends, CORNERS),
        text(ends, "system"),
        strict=True,
    ):
        places[rows[name]], system[rows[name]] = place.reshape(2, 2), kind or "M"
    scan, spacing, step = text(table, "scan"), number(table, "spacing"), number(table, "step")
    return ProfileSpecs(
        ids=ids,
        model=np.array([models[name] for name in of.tolist()], dtype=np.int64),
        start=text(table, "start"),
        end=text(table, "end"),
        places=places,
        system=system,
        step=step,
        spike=number(table, "spike"),
        tolerance=number(table, "tolerance"),
        scan=np.where(scan == "", "L", scan),
        zigzag=text(table, "zig") == "Z",
        spacing=np.where(np.isnan(spacing), step, spacing),
    )


def _grids(table: CardTable) -> GridSpecs:
    return GridSpecs(
        ids=text(table, "name"),
        collocated=text(table, "surface") == "C",
        spacing=number(table, "spacing"),
        first=numbers(table, CORNERS[:2]),
        second=numbers(table, CORNERS[2:]),
    )


def _datum(table: CardTable) -> SoundingDatum | None:
    if not len(table):
        return None
    return SoundingDatum(
        name=str(table.columns["name"][0]),
        height=float(table.columns["height"][0]),
        sigma=float(table.columns["sigma"][0]),
        geoid=str(table.columns["geoid"][0]),
    )


def _contours(deck: CardDeck, kind: str) -> ContourSpec | None:
    """Return the contours of depth (D) or of height (H) that are asked for."""
    table, listed = cards_of(deck, "CIN"), cards_of(deck, "CIL")
    rows = np.flatnonzero(of_contours(table) == kind).tolist()
    if not rows:
        return None
    names = ("interval", "index", "longest_edge", "shortest", "drying")
    given = {name: float(table.columns[name][rows[0]]) for name in names}
    known = {name: value for name, value in given.items() if np.isfinite(value)}
    if "index" in known:
        known["index"] = int(known["index"])
    of = of_contours(listed) == kind
    levels, thick = numbers(listed, LEVELS)[of], text(listed, "index")[of] == "I"
    return ContourSpec(
        **known,  # type: ignore[arg-type]
        grid=str(table.columns["grid"][rows[0]]),
        listed=tuple(levels[~thick][np.isfinite(levels[~thick])].tolist()),
        listed_index=tuple(levels[thick][np.isfinite(levels[thick])].tolist()),
    )


def compilation_bytes(deck: Compilation) -> bytes:
    """Return the canonical deck of a compilation.

    Raises `DeckError` with every value that its field cannot hold.
    """
    cards, models = compilation_family().cards, deck.models
    names = ("left", "right", "mode", "vertical", "tide", "rays")
    tables: list[tuple[CardSpec, dict[str, Column]]] = [
        (cards["TTL"], {"text": np.array(deck.titles, dtype=np.str_)}),
        *_of_surface(deck),
        (
            cards["MDL"],
            {
                "model": models.ids,
                **{name: getattr(models, name) for name in names},
                "pointing": models.pointing / MICROMETRE,
                "limit": models.limit / MICROMETRE,
                "adjust": np.where(models.adjust, "A", ""),
                "loop": np.where(models.true_marks, "T", ""),
            },
        ),
        *_of_profiles(deck),
        (
            cards["GRD"],
            {
                "name": deck.grids.ids,
                "surface": np.where(deck.grids.collocated, "C", ""),
                "spacing": deck.grids.spacing,
                **dict(zip(CORNERS, np.hstack([deck.grids.first, deck.grids.second]).T, strict=True)),
            },
        ),
        *([] if deck.raw is None else raw_stages.cards_of(deck.raw)),
        *_of_readings(deck),
        *_of_times(deck),
        (cards["END"], {}),
    ]
    return write_cards(tables)


def _of_profiles(deck: Compilation) -> Iterator[tuple[CardSpec, dict[str, Column]]]:
    """Yield the cards of profiles, and of the ends of those that no points give."""
    cards, profiles = compilation_family().cards, deck.profiles
    models, lines = deck.models.ids[profiles.model], profiles.scan == "L"
    names = ("start", "end", "step", "spike", "tolerance")
    yield (
        cards["PRF"],
        {
            "profile": profiles.ids,
            "model": models,
            **{name: getattr(profiles, name) for name in names},
            "scan": np.where(lines, "", profiles.scan),
            "zig": np.where(profiles.zigzag, "Z", ""),
            "spacing": np.where(lines, np.nan, profiles.spacing),
        },
    )
    given = np.isfinite(profiles.places).all(axis=(1, 2))
    yield (
        cards["PRE"],
        {
            "profile": profiles.ids[given],
            "model": models[given],
            "system": profiles.system[given],
            **dict(zip(CORNERS, profiles.places[given].reshape(-1, 4).T, strict=True)),
        },
    )


def _of_readings(deck: Compilation) -> Iterator[tuple[CardSpec, dict[str, Column]]]:
    """Yield the cards of stage readings and of model points."""
    as_points: BoolArray = deck.stages.as_points
    for name, wanted in zip(READINGS, (~as_points, as_points), strict=True):
        stages, card = taken(deck.stages, wanted), compilation_family().cards[name]
        columns: dict[str, Column] = {
            "model": deck.models.ids[stages.model],
            "point": stages.ids,
            "class": stages.kind,
            "bathymetric": np.where(stages.submerged, "B", ""),
            **dict(zip(COORDINATES, stages.xy.reshape(-1, 4).T, strict=True)),
            **dict(zip(PLACE, stages.place.T, strict=True)),
            "parallax": stages.parallax / MICROMETRE,
            "sigma": stages.sigma / MICROMETRE,
        }
        yield card, {field.name: columns[field.name] for field in card.fields}


def _of_times(deck: Compilation) -> Iterator[tuple[CardSpec, dict[str, Column]]]:
    """Yield the times of readings of profiles; those on the stages stand before model points, as their cards do."""
    stages, models = deck.stages, deck.models.ids
    rows: list[tuple[str, str, int, FloatArray]] = []
    for model, name in dict.fromkeys(zip(stages.model.tolist(), stages.ids.tolist(), strict=True)):
        here = (stages.model == model) & (stages.ids == name) & (stages.kind == IN_PROFILE)
        time = np.concatenate([stages.time[here & ~stages.as_points], stages.time[here & stages.as_points]])
        for first in range(0, len(time), len(TIMES)):
            piece = time[first : first + len(TIMES)]
            if np.isfinite(piece).any():
                filled = np.full(len(TIMES), np.nan)
                filled[: len(piece)] = piece
                rows.append((str(models[model]), name, first + 1, filled))
    if rows:
        of, names, firsts, times = (list(column) for column in zip(*rows, strict=True))
        columns: dict[str, Column] = {
            "model": np.array(of), "profile": np.array(names), "first": np.array(firsts, dtype=float),
            **dict(zip(TIMES, np.array(times).T, strict=True)),
        }  # fmt: skip
        yield compilation_family().cards["PTM"], columns


def _of_surface(deck: Compilation) -> Iterator[tuple[CardSpec, dict[str, Column]]]:
    """Yield the cards of the sounding datum and of contours, as far as there are any."""
    cards = compilation_family().cards
    if deck.datum is not None:
        yield cards["VDT"], {name: np.array([value]) for name, value in vars(deck.datum).items()}
    specs = {kind: spec for kind, spec in (("D", deck.contours), ("H", deck.heights)) if spec is not None}
    names = ("interval", "index", "longest_edge", "shortest", "drying")
    if specs:
        columns: dict[str, Column] = {
            name: np.array([_finite(getattr(spec, name)) for spec in specs.values()]) for name in names
        }
        columns["of"] = np.where(np.array(list(specs)) == "D", "", list(specs))
        yield cards["CIN"], columns | {"grid": np.array([spec.grid for spec in specs.values()])}
    rows = [
        (kind, thick, levels[first : first + len(LEVELS)])
        for kind, spec in specs.items()
        for thick, levels in (("", spec.listed), ("I", spec.listed_index))
        for first in range(0, len(levels), len(LEVELS))
    ]
    if rows:
        filled = np.full((len(rows), len(LEVELS)), np.nan)
        for row, (_, _, levels) in enumerate(rows):
            filled[row, : len(levels)] = levels
        kinds, thick_lines = (np.array(column) for column in zip(*((row[0], row[1]) for row in rows), strict=True))
        of = np.where(kinds == "D", "", kinds)
        yield cards["CIL"], {"of": of, "index": thick_lines, **dict(zip(LEVELS, filled.T, strict=True))}


def _finite(value: float) -> float:
    """Return a number, NaN for one that a blank field stands for."""
    return value if math.isfinite(value) else math.nan
