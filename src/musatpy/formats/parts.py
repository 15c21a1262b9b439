"""Parts of a job, as files of other agencies hold them: tables by role, of which any may be missing."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy import model
from musatpy.errors import DeckError, Problem
from musatpy.formats import assembly, job_tables, mapping, system_rows
from musatpy.formats.cards.deck import read_cards
from musatpy.formats.cards.settings import Setting, deck_with
from musatpy.formats.cards.spec import CardSpec, Family
from musatpy.formats.checks.systems import statements
from musatpy.formats.draft import draft_of, draft_of_rows
from musatpy.formats.records.layout import OPTION_OF_CAMERAS, OPTION_OF_SYSTEM
from musatpy.formats.statements import entered_draft
from musatpy.model.block import known_of_kinds

if TYPE_CHECKING:
    from musatpy.formats.draft import Draft
    from musatpy.systems import Statement

# What is in words of the statement.
_STATED = (*job_tables.PLACES, *job_tables.COVARIANCES, "attitudes", "tides", "matrices")


def held_attributes(role: str) -> tuple[str, ...]:
    """Return the model attributes of a role; none of what states a deck, because parts are as the adjustment is."""
    return () if role in system_rows.TABLES else tuple(job_tables.nothing(role))


def parts_of(block: model.Block) -> job_tables.Tables:
    """Return everything that a block says, in the words of the adjustment, and how it and its answer are stated."""
    said = assembly.tables_of(block, job_tables.card_family())
    parts = {
        role: {path: np.asarray(table[path]) for path in job_tables.nothing(role)} for role, table in said.items()
    }
    return _stating(block.given_in, block.stated_in) | parts


def deck_parts(path: Any, name: str | None = None) -> job_tables.Tables:
    """Return what a deck says that need not be whole: a camera card and options will do.

    `path` may be the bytes of a deck, which messages call `name`. What it states in other words comes in those of
    the adjustment. Raises `DeckError` with every card that cannot be read, or that makes no statement,
    `SystemsError`, and `OSError`.
    """
    family = job_tables.card_family()
    deck = read_cards(path, family, name)
    # cards that a whole deck must have
    missing = [problem for problem in deck.problems if problem.line is None and problem.card]
    errors = [problem for problem in deck.problems if problem.severity == "error" and problem not in missing]
    draft = draft_of(deck, family)
    if errors := errors or list(statements(draft)):
        raise DeckError(errors)
    if draft.given_in is not None and any(len(draft.rows[role]) for role in _STATED):
        needed = "a deck with SYS IN must be whole where it has stations, attitudes, tides or control"
        draft, _, problems = entered_draft(draft, _linked(draft, needed))
        if any(problem.severity == "error" for problem in problems):
            raise DeckError(problems)
    stated = {role: rows for role, rows in draft.rows.items() if role not in system_rows.TABLES}
    parts = {role: dict(rows.values) for role, rows in stated.items() if len(rows)}
    parts |= _stating(draft.given_in, draft.stated_in)
    return parts | {"options": assembly.single_values(draft.options, "options")}


def given_parts(
    deck: Path | None, settings: Sequence[Setting] = (), cameras: Sequence[str] = ()
) -> job_tables.Tables:
    """Return what a deck says that need not be whole, with settings in place of what it says, and camera cards.

    Without a deck the options are those of the settings, none where these do not say the system of the job. Raises
    what `deck_parts` does.
    """
    if deck is None and not (settings or cameras):
        return {}
    data = b"" if deck is None else deck.read_bytes()
    if not re.search(rb"(?m)^END", data):
        data = data.removesuffix(b"\n") + b"\nEND\n" if data else b"END\n"
    data = deck_with(data, settings)
    more = "".join(f"{card}\n" for card in cameras).encode()
    given = deck_parts(re.sub(rb"(?m)^END", lambda end: more + end[0], data, count=1), str(deck or "options"))
    if deck is None and not any(setting.name == "system" or setting.card == "SYS" for setting in settings):
        given.pop("options")
    return given


def with_control_sigmas(given: job_tables.Tables, sigmas: Sequence[float]) -> tuple[job_tables.Tables, int]:
    """Return parts whose control has `sigmas` (3,) of east, north, up, m, where it has none; with their number."""
    table = given.get("control")
    if table is None:
        return given, 0
    lacks = known_of_kinds(table["control.kind"]) & np.isnan(table["control.sigma"])
    lacks &= ~table["control.fixed"].astype(bool)[:, None]
    sigma = np.where(lacks, np.asarray(sigmas), table["control.sigma"])
    return given | {"control": table | {"control.sigma": sigma}}, int(lacks.any(axis=1).sum())


def _linked(draft: Draft, needed: str) -> model.Block:
    """Return the block of a draft; raises `DeckError` with what is `needed` for a link to what is not there."""
    try:
        return assembly.block_of(draft)
    except ValueError as error:
        raise DeckError.of(f"{needed}: {error}") from error


def _stating(given_in: model.SystemSpec | None, stated_in: model.SystemSpec | None) -> job_tables.Tables:
    """Return the tables that say how a job and its answer are stated, none where they are not."""
    tables = system_rows.values_of({system_rows.IN: given_in, system_rows.OUT: stated_in})
    return {role: table for role, table in tables.items() if job_tables.size(table)}


def spec_of(parts: job_tables.Tables, role: str) -> model.SystemSpec | None:
    """Return how a job (`system_rows.IN`) or its answer (`OUT`) is stated, None where it is not."""
    return system_rows.spec_of(
        role, {name: parts.get(name) or job_tables.nothing(name) for name in system_rows.STATING}
    )


def statement_of(parts: job_tables.Tables) -> Statement | None:
    """Return the statement that other agencies' files follow, both ways: that of the job, else of its answer.

    The job's comes first because its deck completes the files when they are read again. None where there is none,
    or where it is geographic or local, which other agencies' files are as before. Raises `SystemsError`.
    """
    spec = spec_of(parts, system_rows.IN) or spec_of(parts, system_rows.OUT)
    if spec is None or spec.kind in (model.CoordinateSystem.GEOGRAPHIC, model.CoordinateSystem.LOCAL):
        return None
    from musatpy.systems import statement_on  # few jobs need it

    return statement_on(spec, ellipsoid_of(parts))


def cards_of_parts(parts: job_tables.Tables, family: Family) -> Iterator[tuple[CardSpec, job_tables.Table]]:
    """Yield the cards that say the parts, in words of the adjustment (see `assembly.cards_of`)."""
    said = {role: table for role, table in parts.items() if role not in system_rows.TABLES}
    for spec, values, angle in assembly.cards_of_tables(said, family, system_of(parts)):
        yield spec, mapping.scatter(spec, values, angle)


def system_of(parts: job_tables.Tables) -> model.CoordinateSystem | None:
    """Return the coordinate system of the job, None where no options are known."""
    options = parts.get("options")
    return None if options is None else model.CoordinateSystem(str(options["options.system"][0]))


def ellipsoid_of(parts: job_tables.Tables) -> model.EllipsoidSpec | None:
    """Return the ellipsoid of the job, None where none is known."""
    spec: model.EllipsoidSpec | None = mapping.single_of(
        "ellipsoid", parts.get("ellipsoid") or job_tables.nothing("ellipsoid")
    )
    return spec


def missing_parts(parts: job_tables.Tables) -> list[Problem]:
    """Return what a block must have and the parts do not."""
    lacks = []
    if "options" not in parts:
        lacks.append(f"the coordinate system of the job is not known: {OPTION_OF_SYSTEM}")
    if "cameras" not in parts:
        lacks.append(f"no camera (CAM card): {OPTION_OF_CAMERAS}")
    elif "stations" in parts:
        photos = parts["stations"]["photos.ids"][parts["stations"]["photos.camera"] == ""].tolist()
        shown = ", ".join(photos[:5]) + (", ..." if len(photos) > 5 else "")
        if photos:
            named = f"photo {shown}" if len(photos) == 1 else f"{len(photos)} photos ({shown})"
            lacks.append(f"no camera is known of {named}: a --deck with their stations (STA or STX)")
    return [Problem(message=message) for message in lacks]


def block_of(parts: job_tables.Tables) -> model.Block:
    """Return the block that the parts make; raises `DeckError` for what they lack."""
    family = job_tables.card_family()
    if problems := missing_parts(parts):
        raise DeckError(problems)
    said = {role: table for role, table in parts.items() if role not in system_rows.TABLES}
    rows = {
        role: job_tables.RoleRows.of(
            role, job_tables.roles_of(family)[role], said.get(role) or job_tables.nothing(role)
        )
        for role in job_tables.ROLES
    }
    block = _linked(draft_of_rows(rows, read_cards(b"", family)), "the parts do not fit together")
    return replace(block, given_in=spec_of(parts, system_rows.IN), stated_in=spec_of(parts, system_rows.OUT))


def merged(given: job_tables.Tables, read: job_tables.Tables) -> job_tables.Tables:
    """Return the parts that files `read`, and `given` for the rest.

    A table that the files hold stands in the place of the given one. Attributes that they do not hold come from the
    given row of the same photo, image or control point; flagged points are those of the given deck.
    """
    parts = dict(given)
    for role, table in read.items():
        parts[role] = _completed(role, table, given.get(role))
    _add_cameras(parts)
    flags = job_tables.flags_of([*given.items(), *parts.items()])
    return {role: job_tables.with_flags(role, table, flags) for role, table in parts.items()}


def _completed(role: str, table: job_tables.Table, given: job_tables.Table | None) -> job_tables.Table:
    """Return a table with all attributes of its role: those that it lacks from the given row of the same name."""
    rows = np.full(job_tables.size(table), -1)  # the last one of the given is blank
    if given is not None and role in job_tables.KEYS:
        places = {key: row for row, key in reversed(list(enumerate(job_tables.keys_of(role, given))))}
        rows = np.array([places.get(key, -1) for key in job_tables.keys_of(role, table)], dtype=int)
    source = job_tables.nothing(role) if given is None else given
    return {
        path: table[path]
        if path in table
        else np.concatenate([source[path], job_tables.blank(role, path, 1)])[rows]
        for path in held_attributes(role)
    }


def _add_cameras(parts: job_tables.Tables) -> None:
    """Give photos without camera the only one that there is."""
    stations, cameras = parts.get("stations"), parts.get("cameras")
    if stations is None or cameras is None or len(cameras["cameras.ids"]) != 1:
        return
    camera = stations["photos.camera"]
    parts["stations"] = stations | {"photos.camera": np.where(camera == "", cameras["cameras.ids"][0], camera)}
