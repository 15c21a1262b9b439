"""Parts of a block, as files of other agencies hold them: what is said of each thing, by identification.

A `Block` is whole; these need not be. A table is named by its role (`formats.draft.ROLES`), and its columns by the
attribute of the model that they fill, in inside units: what a deck's cards of the role say.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from musatpy import model
from musatpy.errors import DeckError, Problem
from musatpy.formats import assembly, mapping, system_rows
from musatpy.formats.cards.deck import read_cards
from musatpy.formats.cards.spec import Family
from musatpy.formats.draft import (
    POINT_FLAGS,
    ROLES,
    Rows,
    attributes,
    draft_of,
    draft_of_rows,
    roles_of,
    with_flags,
)
from musatpy.formats.musat import card_family
from musatpy.formats.statements import entered_draft, statement_problems
from musatpy.model.tables import columns

if TYPE_CHECKING:
    from musatpy.formats.draft import Draft
    from musatpy.systems import Statement

Array = NDArray[Any]
Table = dict[str, Array]  # model attribute -> (k,) or (k, components)
Parts = dict[str, Table]  # role -> table, of at least one row

# What identifies the rows of a role: the attributes that two tables of it must share to be put together.
KEYS = {
    role: keys for role in ROLES if (keys := tuple(path for path, about in attributes(role).items() if about.key))
}
_STATED = (
    "stations",
    "attitudes",
    "tides",
    "control",
    "matrices",
    "wave_origin",
)  # what is in words of the statement


@lru_cache(maxsize=1)
def _nothing() -> Parts:
    """Return the tables of an empty deck: every attribute of every role, with its type and components."""
    family = card_family()
    return {role: dict(rows.values) for role, rows in draft_of(read_cards(b"", family), family).rows.items()}


def size(table: Mapping[str, Array]) -> int:
    """Return the number of rows of a table."""
    return len(next(iter(table.values()))) if table else 0


def blank(role: str, path: str, count: int) -> Array:
    """Return (count,) or (count, components) of an attribute of which nothing is said."""
    return mapping.blanks(path, _nothing()[role][path], count)


def held_attributes(role: str) -> tuple[str, ...]:
    """Return the model attributes of a role; none of what states a deck, because parts are as the adjustment is."""
    return () if role in system_rows.TABLES else tuple(_nothing()[role])


def is_said(path: str, values: Array) -> Array:
    """Return (k,) True where a column says something: not NaN, not empty, no flag off its default."""
    if path in mapping.CODES:
        return values != mapping.CODES[path][""]
    full = values != "" if values.dtype.kind == "U" else ~np.isnan(values.astype(float))
    return np.asarray(full.reshape(len(values), -1).any(axis=1)) if full.size else np.zeros(len(values), dtype=bool)


def parts_of(block: model.Block) -> Parts:
    """Return everything that a block says, in the words of the adjustment, and how it and its answer are stated."""
    parts = _stating(block.given_in, block.stated_in)
    for role, specs in roles_of(card_family()).items():
        if role in system_rows.TABLES:
            continue
        table = assembly.values_of(block, role, specs[0])
        if size(table):
            parts[role] = {path: np.asarray(table[path]) for path in held_attributes(role)}
    return parts


def deck_parts(path: Any) -> Parts:
    """Return what a deck says that need not be whole: a camera card and options will do.

    What it states in other words comes in those of the adjustment. Raises `DeckError` with every card that cannot
    be read, or that makes no statement, `SystemsError`, and `OSError`.
    """
    family = card_family()
    deck = read_cards(path, family)
    missing = [one for one in deck.problems if one.line is None and one.card]  # cards that a whole deck must have
    errors = [one for one in deck.problems if one.severity == "error" and one not in missing]
    if errors:
        raise DeckError(errors)
    draft = draft_of(deck, family)
    draft = _entered(draft)
    stated = {role: rows for role, rows in draft.rows.items() if role not in system_rows.TABLES}
    parts = {role: dict(rows.values) for role, rows in stated.items() if len(rows)}
    parts |= _stating(draft.given_in, draft.stated_in)
    return parts | {"options": assembly.single_values(draft.options, "options")}


def _entered(draft: Draft) -> Draft:
    """Return a draft, which need not be whole, in the words of the adjustment. Raises `DeckError`."""
    specs = {system_rows.IN: draft.given_in, system_rows.OUT: draft.stated_in}
    problems = [
        one for role, spec in specs.items() if spec is not None for one in statement_problems(draft, role, spec)
    ]
    if problems:
        raise DeckError(problems)
    if draft.given_in is None or not any(len(draft.rows[role]) for role in _STATED):
        return draft
    try:
        block = assembly.block_of(draft)
    except ValueError as error:  # a link to what is not there
        message = f"a deck with SYS IN must be whole where it has stations, attitudes, tides or control: {error}"
        raise DeckError([Problem(message=message)]) from error
    draft, _, problems_found = entered_draft(draft, block)
    if any(problem.severity == "error" for problem in problems_found):
        raise DeckError(problems_found)
    return draft


def _stating(given_in: model.SystemSpec | None, stated_in: model.SystemSpec | None) -> Parts:
    """Return the tables that say how a job and its answer are stated, none where they are not."""
    tables = system_rows.values_of({system_rows.IN: given_in, system_rows.OUT: stated_in})
    return {role: table for role, table in tables.items() if size(table)}


def spec_of(parts: Parts, role: str) -> model.SystemSpec | None:
    """Return how a job (`system_rows.IN`) or its answer (`OUT`) is stated, None where it is not."""
    return system_rows.spec_of(role, {name: parts.get(name) or _nothing()[name] for name in system_rows.STATING})


def statement_of(parts: Parts) -> Statement | None:
    """Return the statement that other agencies' files follow, both ways: that of the job, else of its answer.

    The job's comes first because its deck completes the files when they are read again. None where there is none,
    or where it is geographic or local, which other agencies' files are as before. Raises `SystemsError`.
    """
    spec = spec_of(parts, system_rows.IN) or spec_of(parts, system_rows.OUT)
    if spec is None or spec.kind in (model.CoordinateSystem.GEOGRAPHIC, model.CoordinateSystem.LOCAL):
        return None
    from musatpy.systems import statement_on  # few jobs need it

    return statement_on(spec, ellipsoid_of(parts))


def cards_of_parts(parts: Parts, family: Family) -> Any:
    """Yield the cards that say the parts (see `assembly.cards_of`)."""
    geographic = system_of(parts) is model.CoordinateSystem.GEOGRAPHIC
    tables = {role: table for role, table in parts.items() if role not in system_rows.TABLES}
    return assembly.cards_of_values(tables, geographic, family)


def system_of(parts: Parts) -> model.CoordinateSystem | None:
    """Return the coordinate system of the job, None where no options are known."""
    options = parts.get("options")
    return None if options is None else model.CoordinateSystem(str(options["options.system"][0]))


def ellipsoid_of(parts: Parts) -> model.EllipsoidSpec | None:
    """Return the ellipsoid of the job, None where none is known."""
    table = parts.get("ellipsoid")
    if table is None:
        return None
    values = {name: table[f"ellipsoid.{name}"][0].item() for name in ("name", "semi_major_axis")}
    flattening = table["ellipsoid.inverse_flattening"][0].item()
    axis = values["semi_major_axis"]
    if values["name"]:
        return model.EllipsoidSpec(name=values["name"])
    return model.EllipsoidSpec(semi_major_axis=axis, inverse_flattening=flattening)


def is_raw(parts: Parts) -> bool:
    """Return whether the plate coordinates are comparator readings."""
    table = parts.get("reduction", {})
    return any(str(plates) == model.Plates.RAW for plates in table.get("reduction.plates", ()))


def missing_parts(parts: Parts) -> list[Problem]:
    """Return what a block must have and the parts do not."""
    lacks = []
    if "options" not in parts:
        lacks.append("the coordinate system of the job is not known: no options (OPT card)")
    if "cameras" not in parts:
        lacks.append("no camera (CAM card)")
    elif "stations" in parts:
        photos = parts["stations"]["photos.ids"][parts["stations"]["photos.camera"] == ""].tolist()
        shown = ", ".join(photos[:5]) + (", ..." if len(photos) > 5 else "")
        if photos:
            named = f"photo {shown}" if len(photos) == 1 else f"{len(photos)} photos ({shown})"
            lacks.append(f"no camera is known of {named}")
    return [Problem(message=f"{message}; give a deck that says it") for message in lacks]


def block_of(parts: Parts) -> model.Block:
    """Return the block that the parts make; raises `DeckError` for what they lack."""
    family = card_family()
    problems = missing_parts(parts)
    if problems:
        raise DeckError(problems)
    empty = _nothing()
    roles = roles_of(family)
    rows = {}
    for role, nothing in empty.items():
        table = nothing if role in system_rows.TABLES else parts.get(role) or nothing
        nowhere = np.zeros(size(table), dtype=np.int64)
        specs = roles.get(role, ())
        rows[role] = Rows(role=role, specs=specs, kind=nowhere, lines=nowhere, values=dict(table))
    draft = draft_of_rows(rows, read_cards(b"", family))
    try:
        block = assembly.block_of(draft)
    except ValueError as error:  # a link to what is not there
        raise DeckError([Problem(message=str(error))]) from error
    given_in, stated_in = spec_of(parts, system_rows.IN), spec_of(parts, system_rows.OUT)
    return replace(block, given_in=given_in, stated_in=stated_in)


def merged(given: Parts, read: Parts) -> Parts:
    """Return the parts that files `read`, and `given` for the rest.

    A table that the files hold stands in the place of the given one. Attributes that they do not hold come from the
    given row of the same photo, image or control point; flagged points are those of the given deck.
    """
    parts = dict(given)
    for role, table in read.items():
        parts[role] = _completed(role, table, given.get(role))
    _add_cameras(parts)
    _add_flags(parts, given)
    return parts


def _completed(role: str, table: Table, given: Table | None) -> Table:
    """Return a table with all attributes of its role."""
    count = size(table)
    rows, known = _same_rows(role, table, given)
    full = {}
    for path in held_attributes(role):
        column = table[path] if path in table else blank(role, path, count)
        if path not in table and given is not None and rows.size:
            source = given[path]
            column = column.astype(np.result_type(column, source)) if source.dtype.kind == "U" else column.copy()
            column[known] = source[rows[known]]
        full[path] = column
    return full


def _same_rows(role: str, table: Table, given: Table | None) -> tuple[Array, Array]:
    """Return (k,) rows of the given table with the same identification, and (k,) where there is one."""
    if given is None or role not in KEYS:
        return np.zeros(0, dtype=int), np.zeros(size(table), dtype=bool)
    places = {key: row for row, key in reversed(list(enumerate(_keys(role, given))))}
    rows = np.array([places.get(key, -1) for key in _keys(role, table)], dtype=int)
    return rows, rows >= 0


def _keys(role: str, table: Mapping[str, Array]) -> list[tuple[str, ...]]:
    return list(zip(*(table[path].tolist() for path in KEYS[role]), strict=True))


def repeated(role: str, table: Mapping[str, Array]) -> list[int]:
    """Return the rows whose identification an earlier row has."""
    seen: set[tuple[str, ...]] = set()
    rows = []
    for row, key in enumerate(_keys(role, table)) if role in KEYS else ():
        if key in seen:
            rows.append(row)
        seen.add(key)
    return rows


def _add_cameras(parts: Parts) -> None:
    """Give photos without camera the only one that there is."""
    stations, cameras = parts.get("stations"), parts.get("cameras")
    if stations is None or cameras is None or len(cameras["cameras.ids"]) != 1:
        return
    camera = stations["photos.camera"]
    parts["stations"] = stations | {"photos.camera": np.where(camera == "", cameras["cameras.ids"][0], camera)}


def _add_flags(parts: Parts, given: Parts) -> None:
    """Flag the points that the given deck flags, on every row of theirs."""
    flags: dict[str, list[str]] = {flag: [] for flag in POINT_FLAGS}
    for source in (given, parts):
        for role in ("plates", "control"):
            for flag, ids in flags.items() if role in source else ():
                ids.extend(source[role][f"{role}.point"][source[role][flag].astype(bool)].tolist())
    parts.update({role: with_flags(role, table, flags) for role, table in parts.items()})


def role_of(path: str, paths: Iterable[str]) -> str:
    """Return the role that an attribute belongs to, on a row that has all `paths`."""
    table, _, name = path.partition(".")
    if table == "points":
        tables = {one.partition(".")[0] for one in paths}
        return "control" if "control" in tables else "plates"
    return columns(mapping.TABLES[table])[name].role or ("stations" if table == "photos" else table)


def noun_of(path: str) -> str:
    """Return what an attribute is called where it cannot be held."""
    table, _, name = path.partition(".")
    return columns(mapping.TABLES[table])[name].noun or name.replace("_", " ")


def noun_of_role(role: str) -> str:
    """Return what a row of a role is called."""
    return _NOUNS.get(role, role.replace("_", " ").removesuffix("s"))


# Where it is not the name of the role.
_NOUNS = {
    "options": "option card",
    "more_options": "card of further options",
    "water": "water card",
    "water_conditions": "card of water conditions",
    "wave_sigmas": "wave sigma card",
    "distortion": "distortion record",
    "fiducials": "calibrated fiducial mark",
    "plates": "plate measurement",
    "control": "control point",
    "equal_elevations": "equal elevation card",
    "reduction": "reduction card",
    "orientation": "orientation card",
    "comparator": "comparator card",
    "lenses": "lens record",
    "mark_distances": "calibrated mark distance",
    "reseau": "calibrated reseau mark",
    "cross_measurements": "reseau measurement",
}
