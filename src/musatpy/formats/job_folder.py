"""The job folder `NAME.job`: what a deck says, without its eighty columns, for long names and millions of images.

`job.toml` has what is said once, and the cameras; `tables.npz` has all else, a table for each kind of row. Keys are
the targets of the card formats, so a field of a card stands here without a line of code. Numbers are kept to the
last bit; equal jobs are equal files. What the job was made from (the cameras as another program left them, its
points) may stand there too, under `source/`.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.errors import DeckError, Problem, nearest_or_all
from musatpy.formats import assembly, mapping, system_rows
from musatpy.formats.cards.deck import CardDeck, read_cards, write_cards
from musatpy.formats.cards.settings import Setting, deck_with
from musatpy.formats.cards.spec import Family
from musatpy.formats.draft import Draft, draft_of, draft_of_rows
from musatpy.formats.job_tables import (
    ROLES,
    Array,
    Flags,
    RoleRows,
    Table,
    Tables,
    attributes,
    card_family,
    nothing,
    plain_card,
    roles_of,
    size,
    table_of,
    with_flags,
)
from musatpy.model import Block, CoordinateSystem
from musatpy.model.block import parts_of_block
from musatpy.specs import read_toml

SUFFIX = ".job"
SOURCE = "source/"  # before the keys of what another program left
_JOB, _TABLES, _FORMAT = "job.toml", "tables.npz", "musatpy job 1"
_OF_FILE = ("format", "tables_sha256", "inputs")


@dataclass(frozen=True, kw_only=True, eq=False)
class JobFolder:
    """What stands in a job folder."""

    path: Path
    tables: Tables
    source: Mapping[str, Array] = field(default_factory=dict)  # by keys without `source/`
    inputs: Mapping[str, str] = field(default_factory=dict)  # SHA-256 of the files that it was made from


def is_job(path: object) -> bool:
    """Return whether a path is that of a job folder."""
    return isinstance(path, str | Path) and Path(path).suffix.lower() == SUFFIX and Path(path).is_dir()


def job_files(
    block: Block, folder: Path, source: Mapping[str, Array] | None = None, inputs: Mapping[str, str] | None = None
) -> dict[Path, bytes]:
    """Return the two files of the job folder of a block, for `files.write_files`."""
    return files_of_tables(tables_of_job(block), folder, source, inputs)


def tables_of_job(block: Block) -> Tables:
    """Return the tables of the job folder of a block.

    Coordinates stay as the adjustment knows them: a job that a deck states in another system is answered in it.
    """
    block = replace(block, given_in=None, stated_in=block.answer_in)
    stating = system_rows.values_of({system_rows.IN: None, system_rows.OUT: block.stated_in})
    tables = assembly.tables_of(block, card_family()) | stating
    return {role: table for role, table in tables.items() if size(table)}


def files_of_tables(
    given: Tables, folder: Path, source: Mapping[str, Array] | None = None, inputs: Mapping[str, str] | None = None
) -> dict[Path, bytes]:
    """Return the two files of a job folder that says what tables do."""
    tables = {role: {path: table[path] for path in nothing(role) if path in table} for role, table in given.items()}
    tables = {role: table for role, table in tables.items() if size(table)}
    once = {role: table for role, table in tables.items() if _stands_in_text(role)}
    arrays = {
        f"{role}/{path}": values
        for role, table in tables.items()
        if role not in once
        for path, values in table.items()
    }
    arrays |= {f"{SOURCE}{name}": values for name, values in (source or {}).items()}
    data = io.BytesIO()
    np.savez(data, allow_pickle=False, **{name: _plain(values) for name, values in sorted(arrays.items())})
    lines = [f"format = {json.dumps(_FORMAT)}", f'tables_sha256 = "{sha256(data.getvalue()).hexdigest()}"', ""]
    lines += [
        "[inputs]",
        *(f"{json.dumps(name)} = {json.dumps(of)}" for name, of in sorted((inputs or {}).items())),
    ]
    for role, table in once.items():
        for row in range(size(table)):
            lines += ["", f"[[{role}]]"]
            lines += [f"{json.dumps(path)} = {_written(values[row])}" for path, values in table.items()]
    return {folder / _TABLES: data.getvalue(), folder / _JOB: ("\n".join(lines) + "\n").encode()}


def read_job(path: Path) -> JobFolder:
    """Return what stands in a job folder. Raises `DeckError` with every key that cannot be read."""
    job, tables = path / _JOB, path / _TABLES
    try:
        text, data = read_toml(job), tables.read_bytes()
    except ValueError as error:
        raise DeckError.of(error, file=job) from None
    except OSError as error:
        raise DeckError.of(error.strerror or str(error), file=error.filename or path) from None
    if text.get("format") != _FORMAT:
        raise DeckError.of(f"its format is {text.get('format')!r}; expected {_FORMAT!r}", file=job)
    if text.get("tables_sha256") != sha256(data).hexdigest():
        message = f"{_TABLES} beside it is not the one that was written with it: the job is not whole"
        raise DeckError.of(message, file=job)
    problems: list[Problem] = []
    once = {role: rows for role, rows in text.items() if role not in _OF_FILE}
    read = {role: _of_text(str(job), role, rows, problems) for role, rows in once.items()}
    many, source = _of_arrays(str(tables), data, problems)
    if problems:
        raise DeckError(problems)
    return JobFolder(path=path, tables=read | many, source=source, inputs=text.get("inputs", {}))


def draft_of_tables(
    tables: Tables, file: str, family: Family, settings: Sequence[Setting] = (), flags: Flags | None = None
) -> Draft:
    """Return the draft of a job that says what `tables` do."""
    system = tables.get("options", nothing("options"))["options.system"]
    geographic = not len(system) or system[0] == CoordinateSystem.GEOGRAPHIC
    rows, line = dict[str, RoleRows](), 0
    for role, specs in roles_of(family).items():
        values = tables.get(role, nothing(role))
        values = with_flags(role, values, flags) if flags else values
        cards = specs if role in system_rows.TABLES else (plain_card(role, geographic),)
        rows[role] = RoleRows.of(role, cards, values, line + 1 + np.arange(size(values)))
        line += size(values)
    if settings:
        once = _set(tables, family, settings)
        rows |= {role: of for role, of in once.items() if _stands_in_text(role) and role != "cameras"}
    return draft_of_rows(rows, CardDeck.blank(file, line), lambda number: _label(rows, number))


def placed(problem: Problem, draft: Draft) -> Problem:
    """Return a problem of a row of a job as one of that row: its table and number stand for card and line."""
    if problem.line is None or draft.call is None:
        return problem
    return replace(problem, card=draft.call(problem.line), line=None, columns=None, text=None)


def _label(rows: Mapping[str, RoleRows], line: int) -> str:
    """Return the table and the row of a line, with the names on it: `plates 17 (0031, 1204)`."""
    of = next(of for of in rows.values() if len(of) and of.lines[0] <= line <= of.lines[-1])
    row = int(line - of.lines[0])
    about = attributes(of.role).items()
    ids = [path for path, one in about if one.identity or one.key or one.link]
    names = [str(name) for path in ids for name in np.ravel(of[path][row]) if str(name)]
    return f"{of.role} {row + 1}" + (f" ({', '.join(dict.fromkeys(names))})" if names else "")


def _stands_in_text(role: str) -> bool:
    """Return whether the rows of a role stand in job.toml: all that is said once, and the cameras."""
    kind = parts_of_block().get(table_of(role))
    return role in ("cameras", "titles", *system_rows.TABLES) or not hasattr(kind, "links_to")


def _plain(values: Array) -> Array:
    """Return an array as it is kept: texts no wider than the longest of them."""
    width = max(1, int(np.char.str_len(values).max(initial=1))) if values.dtype.kind == "U" else 0
    return values.astype(f"U{width}") if width else values


def _written(value: Any) -> str:
    """Return a value in TOML."""
    if isinstance(value, np.ndarray):
        return f"[{', '.join(map(_written, value))}]"
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    if isinstance(value, float | np.floating):
        return repr(float(value)) if math.isfinite(value) else str(float(value))
    return str(int(value)) if isinstance(value, int | np.integer) else json.dumps(str(value))


def _of_text(file: str, role: str, rows: Any, problems: list[Problem]) -> Table:
    """Return the table of a role in job.toml; what is wrong goes to `problems`."""
    if role not in ROLES and role not in system_rows.TABLES:
        problems.append(
            Problem(file=file, field=role, message=f"nothing is called so{nearest_or_all(role, ROLES)}")
        )
        return {}
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        problems.append(Problem(file=file, field=role, message="it is no list of tables"))
        return {}
    paths = dict.fromkeys(path for row in rows for path in row)
    values = {path: [row.get(path) for row in rows] for path in paths}
    return _table(file, role, values, problems)


def _of_arrays(file: str, data: bytes, problems: list[Problem]) -> tuple[Tables, dict[str, Array]]:
    """Return the tables and the source in tables.npz; what is wrong goes to `problems`."""
    read: dict[str, dict[str, Any]] = {}
    source: dict[str, Array] = {}
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            for key in arrays.files:
                if key.startswith(SOURCE):
                    source[key.removeprefix(SOURCE)] = arrays[key]
                else:
                    role, _, path = key.partition("/")
                    read.setdefault(role, {})[path] = arrays[key]
    except (ValueError, OSError, EOFError, zipfile.BadZipFile, KeyError) as error:
        problems.append(Problem(file=file, message=f"it cannot be read: {error}"))
        return {}, {}
    tables: Tables = {}
    for role, values in read.items():
        if role in ROLES and not _stands_in_text(role):
            tables[role] = _table(file, role, values, problems)
        else:
            problems.append(
                Problem(file=file, field=role, message=f"no table is called so{nearest_or_all(role, ROLES)}")
            )
    return tables, source


def _table(file: str, role: str, values: Mapping[str, Any], problems: list[Problem]) -> Table:
    """Return a table with all of its columns, blank those that are not there."""
    empty, table = nothing(role), Table()
    for path in sorted(set(values) - set(empty)):
        message = f"no column is called so{nearest_or_all(path, empty)}"
        problems.append(Problem(file=file, field=path, message=message))
    counts = {len(values[path]) for path in values if path in empty}
    if len(counts) != 1:
        problems.append(Problem(file=file, card=role, message=f"its columns have {sorted(counts)} rows"))
        return {}
    (count,) = counts
    for path, none in empty.items():
        if path not in values:
            table[path] = mapping.blanks(path, none, count)
            continue
        try:
            column = np.asarray(values[path])
        except ValueError:
            column = np.zeros(count, dtype=object)
        is_text, shape = none.dtype.kind == "U", (count, *none.shape[1:])
        if (column.dtype.kind == "U") == is_text and column.dtype.kind in "Ufiub" and column.shape == shape:
            table[path] = column if is_text else column.astype(none.dtype)
            continue
        expected = f"{' x '.join(map(str, shape))} {'texts' if is_text else 'numbers'}"
        got = f"{' x '.join(map(str, column.shape))} of the type {column.dtype}"
        problems.append(Problem(file=file, field=path, found=got, expected=expected))
    return table


def _set(tables: Tables, family: Family, settings: Iterable[Setting]) -> dict[str, RoleRows]:
    """Return the rows of what is said once after settings, which are of cards: by way of these."""
    once = {role: table for role, table in tables.items() if _stands_in_text(role) and role != "cameras"}
    system = str(once["options"]["options.system"][0]) if "options" in once else None
    cards = assembly.cards_of_tables(once, family, system)
    data = write_cards((spec, mapping.scatter(spec, values, angle)) for spec, values, angle in cards)
    return draft_of(read_cards(deck_with(data, list(settings)), family), family).rows
