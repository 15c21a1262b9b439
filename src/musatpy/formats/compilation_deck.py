"""Compilation decks: cards of the family `as11` <-> stereomodels and readings, with every problem of the deck."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.errors import DeckError, Problem
from musatpy.formats import raw_stages
from musatpy.formats.cards.codec import Column
from musatpy.formats.cards.deck import CardDeck, CardTable, read_cards, write_cards
from musatpy.formats.cards.spec import CardSpec, Family, card_formats_folder, load_family
from musatpy.formats.musat import has_errors
from musatpy.model import Block
from musatpy.model.compilation import (
    IN_PROFILE,
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

_SHARED = ("TTL", "END", *raw_stages.CARDS)  # cards of triangulation decks that these have too
_POSITIVE = {
    "MDL": ("pointing", "limit"),
    "STG": ("sigma",),
    "MPT": ("sigma",),
    "CIN": ("interval", "index", "longest_edge"),
    "PRF": ("step", "spike"),
    "GRD": ("spacing",),
}
_COORDINATES = ("x_left", "y_left", "x_right", "y_right")
_PLACE = ("x", "y", "z")
_READINGS = ("STG", "MPT")
_CORNERS = ("first_1", "first_2", "second_1", "second_2")


@lru_cache(maxsize=1)
def compilation_family() -> Family:
    """Return the cards of compilation decks. Raises `CardFormatError` for formats that are wrong."""
    folder = card_formats_folder()
    cards = {**load_family(folder / "as11").cards}
    cards |= {name: card for name, card in load_family(folder / "musat").cards.items() if name in _SHARED}
    ordered = sorted(cards.values(), key=lambda card: (card.order, card.mnemonic))
    return Family(name="as11", cards=MappingProxyType({card.mnemonic: card for card in ordered}))


def read_compilation(
    source: Path | str | bytes, run: Block | None = None
) -> tuple[Compilation, tuple[Problem, ...]]:
    """Return what a compilation deck says, and warnings; `run` has the photos and cameras of stages read raw.

    Raises `DeckError` with every problem where there is an error, and `OSError`.
    """
    deck = read_cards(source, compilation_family())
    problems = [*deck.problems, *_cross_checks(deck)]
    if has_errors(problems):
        raise _refused(problems)
    contents, lines = _contents(deck)
    if _is_raw(deck):
        if run is None:
            raise DeckError([Problem(file=deck.file, message="its stages are raw: it is read beside the run")])
        plates, faults = raw_stages.raw_stages(deck, contents.models, contents.stages, lines, run)
        problems += faults
        if plates is None:
            raise _refused(problems)
        contents = replace(contents, raw=plates)
    return contents, tuple(problems)


def _refused(problems: list[Problem]) -> DeckError:
    return DeckError(sorted(problems, key=lambda problem: problem.line or 0))


def _is_raw(deck: CardDeck) -> bool:
    table = deck.table(compilation_family().cards["RED"])
    return "RAW" in _text(table, "plates").tolist()


def _contents(deck: CardDeck) -> tuple[Compilation, IntArray]:
    """Return what the cards say, the stages as they were read, and the lines of these (k,)."""
    cards = compilation_family().cards
    titles, models = (deck.table(cards[name]) for name in ("TTL", "MDL"))
    number = {name: row for row, name in enumerate(_text(models, "model").tolist())}
    tables = [deck.table(cards[name]) for name in _READINGS]
    lines = np.concatenate([table.lines for table in tables])
    order = np.argsort(lines)
    return (
        Compilation(
            titles=tuple(_text(titles, "text").tolist()),
            models=StereomodelSpecs(
                ids=_text(models, "model"),
                left=_text(models, "left"),
                right=_text(models, "right"),
                mode=_text(models, "mode"),
                vertical=_text(models, "vertical"),
                tide=_text(models, "tide"),
                rays=_text(models, "rays"),
                pointing=_number(models, "pointing") * MICROMETRE,
                limit=_number(models, "limit") * MICROMETRE,
                adjust=_text(models, "adjust") == "A",
                true_marks=_text(models, "loop") == "T",
            ),
            stages=taken(stacked([_readings(table, number) for table in tables]), order),
            profiles=_profiles(deck.table(cards["PRF"]), number),
            grids=_grids(deck.table(cards["GRD"])),
            datum=_datum(deck.table(cards["VDT"])),
            contours=_contours(deck.table(cards["CIN"])),
        ),
        lines[order],
    )


def _readings(table: CardTable, models: dict[str, int]) -> StageReadings:
    """Return what the cards of a kind say; what the other kind has is NaN."""
    kind = _text(table, "class")
    return StageReadings(
        model=np.array([models[name] for name in _text(table, "model").tolist()], dtype=np.int64),
        ids=_text(table, "point"),
        kind=np.where(kind == "", "G", kind),
        submerged=_text(table, "bathymetric") == "B",
        xy=_numbers(table, _COORDINATES).reshape(-1, 2, 2),
        sigma=_number(table, "sigma") * MICROMETRE,
        place=_numbers(table, _PLACE),
        parallax=_numbers(table, ("parallax",))[:, 0] * MICROMETRE,
    )


def _profiles(table: CardTable, models: dict[str, int]) -> ProfileSpecs:
    return ProfileSpecs(
        ids=_text(table, "profile"),
        model=np.array([models[name] for name in _text(table, "model").tolist()], dtype=np.int64),
        start=_text(table, "start"),
        end=_text(table, "end"),
        step=_number(table, "step"),
        spike=_number(table, "spike"),
        tolerance=_number(table, "tolerance"),
    )


def _grids(table: CardTable) -> GridSpecs:
    return GridSpecs(
        ids=_text(table, "name"),
        collocated=_text(table, "surface") == "C",
        spacing=_number(table, "spacing"),
        first=_numbers(table, _CORNERS[:2]),
        second=_numbers(table, _CORNERS[2:]),
    )


def _datum(table: CardTable) -> SoundingDatum | None:
    if not len(table):
        return None
    return SoundingDatum(
        name=str(table.columns["name"][0]),
        height=float(table.columns["height"][0]),
        sigma=float(table.columns["sigma"][0]),
    )


def _contours(table: CardTable) -> ContourSpec | None:
    if not len(table):
        return None
    given = {name: float(values[0]) for name, values in table.columns.items() if np.isfinite(values[0])}
    if "index" in given:
        given["index"] = int(given["index"])
    return ContourSpec(**given)  # type: ignore[arg-type]


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
        (
            cards["PRF"],
            {
                "profile": deck.profiles.ids,
                "model": models.ids[deck.profiles.model],
                **{name: getattr(deck.profiles, name) for name in ("start", "end", "step", "spike", "tolerance")},
            },
        ),
        (
            cards["GRD"],
            {
                "name": deck.grids.ids,
                "surface": np.where(deck.grids.collocated, "C", ""),
                "spacing": deck.grids.spacing,
                **dict(zip(_CORNERS, np.hstack([deck.grids.first, deck.grids.second]).T, strict=True)),
            },
        ),
        *([] if deck.raw is None else raw_stages.cards_of(deck.raw)),
        *_of_readings(deck),
        (cards["END"], {}),
    ]
    return write_cards(tables)


def _of_readings(deck: Compilation) -> Iterator[tuple[CardSpec, dict[str, Column]]]:
    """Yield the cards of stage readings and of model points."""
    as_points: BoolArray = deck.stages.as_points
    for name, wanted in zip(_READINGS, (~as_points, as_points), strict=True):
        stages, card = taken(deck.stages, wanted), compilation_family().cards[name]
        columns: dict[str, Column] = {
            "model": deck.models.ids[stages.model],
            "point": stages.ids,
            "class": stages.kind,
            "bathymetric": np.where(stages.submerged, "B", ""),
            **dict(zip(_COORDINATES, stages.xy.reshape(-1, 4).T, strict=True)),
            **dict(zip(_PLACE, stages.place.T, strict=True)),
            "parallax": stages.parallax / MICROMETRE,
            "sigma": stages.sigma / MICROMETRE,
        }
        yield card, {field.name: columns[field.name] for field in card.fields}


def _of_surface(deck: Compilation) -> list[tuple[CardSpec, dict[str, Column]]]:
    """Return the cards of the sounding datum and of contours, as far as there are any."""
    cards, tables = compilation_family().cards, []
    for name, part in (("VDT", deck.datum), ("CIN", deck.contours)):
        if part is not None:
            values = {key: np.array([value]) for key, value in vars(part).items()}
            tables.append((cards[name], {key: _finite(value) for key, value in values.items()}))
    return tables


def _finite(values: Column) -> Column:
    """Return numbers without those that a blank field stands for."""
    if values.dtype.kind == "U":
        return values
    return np.where(np.isfinite(values.astype(float)), values.astype(float), np.nan)


def _text(table: CardTable, name: str) -> TextArray:
    return np.asarray(table.columns[name], dtype=np.str_)


def _number(table: CardTable, name: str) -> FloatArray:
    return np.asarray(table.columns[name], dtype=float)


def _numbers(table: CardTable, names: Sequence[str]) -> FloatArray:
    """Return several fields as columns (k, n), NaN of those that the cards do not have."""
    nothing = np.full(len(table), np.nan)
    return np.stack([_number(table, name) if name in table.columns else nothing for name in names], axis=1)


def _cross_checks(deck: CardDeck) -> Iterator[Problem]:
    cards = compilation_family().cards
    unused = [name for name in raw_stages.CARDS if name in deck.tables]
    if unused and not _is_raw(deck):
        message = (
            f"stages are taken as refined plate coordinates, and {', '.join(unused)} cards not used: no RED RAW"
        )
        yield Problem(file=deck.file, message=message, severity="warning")
    models = deck.table(cards["MDL"])
    ids = _text(models, "model")
    for row in _repeated([ids]):
        yield _problem(deck, models, row, "model", f"model {ids[row]} is defined twice")
    for row in np.flatnonzero(_text(models, "left") == _text(models, "right")).tolist():
        yield _problem(deck, models, row, "right", f"model {ids[row]} has one photo on both stages")
    for mnemonic, names in _POSITIVE.items():
        table = deck.table(cards[mnemonic])
        for name in names:
            for row in np.flatnonzero(_number(table, name) <= 0.0).tolist():
                yield _problem(deck, table, row, name, "not greater than zero")
    profiles = deck.table(cards["PRF"])
    for row in _repeated([_text(profiles, "model"), _text(profiles, "profile")]):
        yield _problem(deck, profiles, row, "profile", "a second profile of this name in the model")
    for row in np.flatnonzero(~np.isin(_text(profiles, "model"), ids)).tolist():
        yield _problem(deck, profiles, row, "model", "there is no MDL card of this model")
    grids = deck.table(cards["GRD"])
    for row in _repeated([_text(grids, "name")]):
        yield _problem(deck, grids, row, "name", "a second grid of this name")
    given = np.isfinite(_numbers(grids, _CORNERS))
    for row in np.flatnonzero(given.any(axis=1) & ~given.all(axis=1)).tolist():
        missing = _CORNERS[int(np.argmin(given[row]))]
        yield _problem(deck, grids, row, missing, "a grid has both corners, or none")
    yield from _faults_of_readings(deck, ids)


def _faults_of_readings(deck: CardDeck, models: TextArray) -> Iterator[Problem]:
    """Yield readings in no model, and points that are read twice in one."""
    tables = [deck.table(compilation_family().cards[name]) for name in _READINGS]
    of, points, kinds = (
        np.concatenate([_text(table, name) for table in tables]) for name in ("model", "point", "class")
    )
    faults = [
        (row, "model", f"there is no MDL card of model {of[row]}")
        for row in np.flatnonzero(~np.isin(of, models)).tolist()
    ]
    single = np.flatnonzero(kinds != IN_PROFILE)
    faults += [
        (row, "point", f"point {points[row]} is read twice in model {of[row]}")
        for row in single[_repeated([of[single], points[single]])].tolist()
    ]
    first = len(tables[0])
    for row, field, message in faults:
        table, place = (tables[0], row) if row < first else (tables[1], row - first)
        yield _problem(deck, table, place, field, message)


def _repeated(columns: Sequence[TextArray]) -> list[int]:
    """Return the rows that are like one before them."""
    rows = np.stack(columns, axis=1) if len(columns) > 1 else columns[0][:, None]
    _, first = np.unique(rows, axis=0, return_index=True)
    again: IntArray = np.setdiff1d(np.arange(len(rows)), first)
    return [int(row) for row in again]


def _problem(deck: CardDeck, table: CardTable, row: int, field: str, message: str) -> Problem:
    line, spec = int(table.lines[row]), table.spec.field(field)
    text = deck.text(line)
    found = text[spec.first - 1 : spec.last].strip()
    return Problem(
        file=deck.file, line=line, columns=spec.columns, card=table.spec.mnemonic, field=field, found=found,
        message=message, text=text,
    )  # fmt: skip
