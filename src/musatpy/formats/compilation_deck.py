"""Compilation decks: cards of the family `as11` <-> stereomodels and readings, with every problem of the deck."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.errors import DeckError, Problem
from musatpy.formats import mapping
from musatpy.formats.cards.deck import CardDeck, read_cards, write_cards
from musatpy.formats.cards.spec import Family, card_formats_folder, load_family
from musatpy.formats.compilation_checks import READINGS, ModelFaults, cross_checks
from musatpy.formats.draft import Draft
from musatpy.formats.job_tables import RoleRows, card_family
from musatpy.formats.musat import has_errors
from musatpy.formats.system_rows import columns_of_rows
from musatpy.model import Block, Options, compilation
from musatpy.model.tables import Table, columns, stacked, taken

Values = dict[str, NDArray[Any]]  # attribute of a table -> what its cards say
Rows = TypeVar("Rows", bound=Table)
_SHARED = ("TTL", "END", "ELL", "WTR")  # cards of triangulation decks that these have too
_ON_A_CARD = {"PTM": 5, "CIL": 8}  # times, levels


@lru_cache(maxsize=8)
def compilation_family(folder: Path | None = None) -> Family:
    """Return the cards of compilation decks, or those of another folder of their formats.

    Raises `CardFormatError` for formats that are wrong, or whose targets and units are not those of the model.
    """
    family = load_family(folder or card_formats_folder() / "as11")
    mapping.check_targets(family)
    cards = {**family.cards, **{name: card for name, card in card_family().cards.items() if name in _SHARED}}
    ordered = sorted(cards.values(), key=lambda card: (card.order, card.mnemonic))
    return replace(family, cards=MappingProxyType({card.mnemonic: card for card in ordered}))


def compilation_draft(deck: CardDeck) -> Draft:
    """Return what the cards of a compilation deck say, whatever is wrong with them; their roles are mnemonics."""
    rows = {}
    for name, spec in compilation_family().cards.items():
        fills = {slot.path.partition(".")[0] for slot in mapping.slots(spec)}
        values = mapping.gather(spec, deck.tables[name])
        rows[name] = RoleRows.of(fills.pop() if fills else name, (spec,), values, deck.lines[name])
    nobody, links = np.zeros(0, dtype=np.str_), dict[str, IntArray]()
    return Draft(
        deck=deck, rows=rows, options=Options(), reduction=None,
        camera_ids=nobody, photo_ids=nobody, point_ids=nobody, camera=links, photo=links, point=links,
    )  # fmt: skip


def read_compilation(
    source: Path | str | bytes, run: Block | None = None, model_faults: ModelFaults | None = None
) -> tuple[compilation.Compilation, tuple[Problem, ...]]:
    """Return what a compilation deck says, and warnings; the cards of water and ellipsoid are those of the `run`.

    `model_faults` says of two photos, field by field of MDL cards, why they make no model of the run. Raises
    `DeckError` with every problem where there is an error, and `OSError`.
    """
    deck = read_cards(source, compilation_family())
    draft = compilation_draft(deck)
    problems = [*deck.problems, *cross_checks(draft, run, model_faults)]
    if has_errors(problems):
        raise DeckError(sorted(problems, key=lambda problem: problem.line or 0))
    return _contents(draft), tuple(problems)


def _contents(draft: Draft) -> compilation.Compilation:
    """Return what the cards say."""
    models = compilation.StereomodelSpecs(**_values(draft, "MDL"))
    rows = {name: row for row, name in enumerate(models.ids.tolist())}
    lines = np.concatenate([draft.rows[name].lines for name in READINGS])
    order = np.argsort(lines)
    stages = taken(
        stacked([_made(compilation.StageReadings, _values(draft, name), rows) for name in READINGS]), order
    )
    datum = {name: column[0].item() for name, column in _values(draft, "VDT").items() if len(column)}
    return compilation.Compilation(
        titles=tuple(_values(draft, "TTL")["titles"].tolist()),
        models=models,
        stages=_timed(stages, models.ids, _values(draft, "PTM")),
        profiles=_profiles(_values(draft, "PRF"), _values(draft, "PRE"), rows),
        grids=_made(compilation.GridSpecs, _values(draft, "GRD"), {}),
        datum=compilation.SoundingDatum(**datum) if datum else None,
        contours=_contours(draft, "D"),
        heights=_contours(draft, "H"),
        lines=compilation.CardLines(
            models=draft.rows["MDL"].lines,
            stages=lines[order],
            profiles=draft.rows["PRF"].lines,
            grids=draft.rows["GRD"].lines,
        ),
    )


def _values(draft: Draft, name: str) -> Values:
    """Return what the cards of a kind say, by the attributes of their table."""
    return {path.rpartition(".")[2]: column for path, column in draft.rows[name].values.items()}


def _made(kind: type[Rows], values: Values, models: Mapping[str, int]) -> Rows:
    """Return the table that cards fill; `models` are the rows of the models by their names."""
    about, made = columns(kind), {}
    for name, column in values.items():
        rows = [models[one] for one in column.tolist()] if about[name].link else column
        made[name] = np.reshape(rows, (len(column), *about[name].components))
    return kind(**made)


def _timed(stages: compilation.StageReadings, models: TextArray, cards: Values) -> compilation.StageReadings:
    """Return the readings with the times of profiles, which count these in the order of the deck."""
    time, in_profile = stages.time.copy(), stages.kind == compilation.IN_PROFILE
    for model, profile, first, times in zip(
        *(cards[name] for name in ("model", "ids", "first", "time")), strict=True
    ):
        rows = np.flatnonzero(in_profile & (models[stages.model] == model) & (stages.ids == profile))
        known = np.flatnonzero(np.isfinite(times))
        time[rows[int(first) - 1 + known]] = times[known]
    return replace(stages, time=time)


def _profiles(cards: Values, ends: Values, models: Mapping[str, int]) -> compilation.ProfileSpecs:
    """Return the profiles, with the ends that cards of their own give."""
    profiles = _made(compilation.ProfileSpecs, cards, models)
    names, of_ends = (list(zip(one["model"].tolist(), one["ids"].tolist(), strict=True)) for one in (cards, ends))
    rows = [names.index(name) for name in of_ends]
    places, system = profiles.places.copy(), profiles.system.astype("<U1")
    places[rows], system[rows] = ends["places"].reshape(-1, 2, 2), ends["system"]
    spacing = np.where(np.isnan(profiles.spacing), profiles.step, profiles.spacing)
    return replace(profiles, places=places, system=system, spacing=spacing)


def _contours(draft: Draft, kind: str) -> compilation.ContourSpec | None:
    """Return the contours of depth (D) or of height (H) that are asked for."""
    cards, listed = _values(draft, "CIN"), _values(draft, "CIL")
    rows = np.flatnonzero(cards.pop("of") == kind).tolist()
    if not rows:
        return None
    given = {name: column[rows[0]].item() for name, column in cards.items()}
    known = {name: value for name, value in given.items() if value == value}  # not NaN
    if "index" in known:
        known["index"] = int(known["index"])
    of_kind, thick = listed["of"] == kind, listed["thick"]
    fine, bold = (listed["levels"][of_kind & which] for which in (~thick, thick))
    return compilation.ContourSpec(
        **known,
        listed=tuple(fine[np.isfinite(fine)].tolist()),
        listed_index=tuple(bold[np.isfinite(bold)].tolist()),
    )


def compilation_bytes(deck: compilation.Compilation) -> bytes:
    """Return the canonical deck of a compilation.

    Raises `DeckError` with every value that its field cannot hold.
    """
    cards, models, profiles = compilation_family().cards, deck.models, deck.profiles
    as_points = deck.stages.as_points
    given = np.flatnonzero(np.isfinite(profiles.places).all(axis=(1, 2)))
    lines = np.where(profiles.scan == "L", np.nan, profiles.spacing)
    parts = [
        ("TTL", {"titles": np.array(deck.titles, dtype=np.str_)}),
        *_of_surface(deck),
        ("MDL", _values_of("models", models, models.ids)),
        ("PRF", _values_of("profiles", replace(profiles, spacing=lines), models.ids)),
        ("PRE", _values_of("profiles", taken(profiles, given), models.ids)),
        ("GRD", _values_of("grids", deck.grids, models.ids)),
    ]
    readings = [
        (name, _values_of("stages", taken(deck.stages, rows), models.ids))
        for name, rows in zip(READINGS, (np.invert(as_points), as_points), strict=True)
    ]
    tables = [*parts, *readings, *_of_times(deck), ("END", {})]
    return write_cards((cards[name], mapping.scatter(cards[name], values)) for name, values in tables)


def _values_of(table: str, part: Table, models: TextArray) -> Values:
    """Return what the cards of a table say, by model attribute: the inverse of `_made`."""
    values = {}
    for name, about in columns(type(part)).items():
        column = getattr(part, name)
        if about.link:
            column = models[column]
        elif about.components:
            column = column.reshape(part.count, math.prod(about.components))
        values[f"{table}.{name}"] = column
    return values


def _of_times(deck: compilation.Compilation) -> Iterator[tuple[str, Values]]:
    """Yield the times of readings of profiles; those on the stages stand before model points, as their cards do."""
    stages, models = deck.stages, deck.models.ids
    rows: list[tuple[str, str, float, FloatArray]] = []
    for model, name in dict.fromkeys(zip(stages.model.tolist(), stages.ids.tolist(), strict=True)):
        here = (stages.model == model) & (stages.ids == name) & (stages.kind == compilation.IN_PROFILE)
        time = np.concatenate([stages.time[here & ~stages.as_points], stages.time[here & stages.as_points]])
        for first, piece in _pieces(time, _ON_A_CARD["PTM"]):
            if np.isfinite(piece).any():
                rows.append((str(models[model]), name, first + 1.0, piece))
    if rows:
        yield "PTM", columns_of_rows(compilation.ProfileTimes, "profile_times", rows)


def _of_surface(deck: compilation.Compilation) -> Iterator[tuple[str, Values]]:
    """Yield the cards of the sounding datum and of contours, as far as there are any."""
    if deck.datum is not None:
        yield "VDT", {f"datum.{name}": np.array([value]) for name, value in vars(deck.datum).items()}
    specs = {kind: spec for kind, spec in (("D", deck.contours), ("H", deck.heights)) if spec is not None}
    if specs:
        names = ("interval", "index", "longest_edge", "shortest", "drying", "grid")
        values = {name: np.array([getattr(spec, name) for spec in specs.values()]) for name in names}
        edge = values["longest_edge"]
        values |= {"of": np.array(list(specs)), "longest_edge": np.where(np.isinf(edge), np.nan, edge)}
        yield "CIN", {f"contours.{name}": column for name, column in values.items()}
    levels_of = [
        (kind, thick, levels)
        for kind, spec in specs.items()
        for thick, listed in ((False, spec.listed), (True, spec.listed_index))
        for _, levels in _pieces(np.array(listed), _ON_A_CARD["CIL"])
    ]
    if levels_of:
        yield "CIL", columns_of_rows(compilation.ContourLevels, "contour_levels", levels_of)


def _pieces(values: FloatArray, size: int) -> Iterator[tuple[int, FloatArray]]:
    """Yield values (k,) as many at a time as a card holds, NaN after the last, with the place of the first."""
    for first in range(0, len(values), size):
        piece = values[first : first + size]
        yield first, np.pad(piece, (0, size - len(piece)), constant_values=np.nan)


def place_of(file: str, line: int, mnemonic: str) -> dict[str, Any]:
    """Return where the photos of a model (MDL), or the coordinates of a reading, stand, as a `Problem` has it."""
    ends = {"MDL": ("left", "right"), "STG": ("x_left", "y_right"), "MPT": ("x", "z")}[mnemonic]
    first, last = (compilation_family().cards[mnemonic].field(name) for name in ends)
    return {"file": file, "line": line, "card": mnemonic, "columns": (first.first, last.last)}


def with_columns(problem: Problem, file: str) -> Problem:
    """Return a problem of a deck with its file, and where it names a card's field and line with its columns."""
    spec = compilation_family().cards.get(problem.card or "")
    if spec is None or problem.field is None or problem.line is None:
        return Problem(file=file, message=problem.message)
    return replace(problem, file=file, columns=spec.field(problem.field).columns)
