"""Names of any length <-> those that go into the columns of cards: `DJI_20260109141611_0031.JPG` is photo 0031."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from musatpy.formats import mapping
from musatpy.formats.job_tables import Tables, card_family, naming, roles_of
from musatpy.model import Block

_PREFIX = {"cameras": "C", "photos": "P", "points": "T"}
_PART = re.compile(r"[\W_]+")


def short_names(names: Sequence[str], width: int, prefix: str) -> list[str]:
    """Return names of at most `width` letters: those that fit as they are, where all do.

    Else the shortest tails that tell all of them apart, of whole parts between signs where these fit; else the
    prefix and numbers.
    """
    if all(_fits(name, width) for name in names):
        return list(names)
    stems = [_stem(name) for name in names]
    parts = [[part for part in _PART.split(stem) if part] for stem in stems]
    whole = (["_".join(part[-count:]) for part in parts] for count in range(1, 1 + width // 2))
    letters = ([stem[-count:] for stem in stems] for count in range(1, 1 + width))
    for tails in (*whole, *letters):
        if len(set(tails)) == len(tails) and all(_fits(tail, width) for tail in tails):
            return tails
    digits = width - len(prefix)
    return [f"{prefix}{number:0{digits}d}" for number in range(1, len(names) + 1)]


def for_cards(tables: Tables) -> tuple[Tables, list[tuple[str, str, str]]]:
    """Return tables with names that cards hold, and what was renamed: table, short and long name."""
    renamed: list[tuple[str, str, str]] = []
    tables = dict(tables)
    for table, prefix in _PREFIX.items():
        paths = {role: path for role, path in naming(table).items() if role in tables}
        every = [np.ravel(tables[role][path]) for role, path in paths.items()]
        names = list(dict.fromkeys(name for column in every for name in column.tolist() if name))
        width = min((_width(role, path) for role, path in paths.items()), default=8)
        short = short_names(names, width, prefix)
        if short == names:
            continue
        of = {"": ""} | dict(zip(names, short, strict=True))
        renamed += [(table, new, old) for old, new in zip(names, short, strict=True)]
        for role, path in paths.items():
            column = tables[role][path]
            new = np.array([of[name] for name in np.ravel(column).tolist()], dtype=np.str_).reshape(column.shape)
            tables[role] = tables[role] | {path: new}
    return tables, renamed


def short_block(block: Block, tables: Iterable[str] = _PREFIX) -> tuple[Block, list[tuple[str, str, str]]]:
    """Return a block with names that cards hold, as `for_cards` does of tables."""
    renamed: list[tuple[str, str, str]] = []
    for table in tables:
        rows = getattr(block, table)
        names = rows.ids.tolist()
        width = min(_width(role, path) for role, path in naming(table).items())
        short = short_names(names, width, _PREFIX[table])
        if short != names:
            renamed += [(table, new, old) for old, new in zip(names, short, strict=True)]
            block = replace(block, **{table: replace(rows, ids=np.array(short))})
    return block, renamed


def names_csv(renamed: Iterable[tuple[str, str, str]]) -> bytes:
    """Return what NAME.ids.csv says: table, short and long name."""
    rows = ",".join(("table", "id", "name")), *(f'{table},{new},"{old}"' for table, new, old in renamed)
    return ("\n".join(rows) + "\n").encode()


def _fits(name: str, width: int) -> bool:
    return 0 < len(name) <= width and name.isprintable() and not any(map(str.isspace, name))


def _stem(name: str) -> str:
    """Return a name without its folder and its suffix."""
    last = name.replace("\\", "/").rpartition("/")[2]
    return last.rpartition(".")[0] or last


def _width(role: str, path: str) -> int:
    """Return how many columns the cards of a role have for a name."""
    slots = [slot for spec in roles_of(card_family()).get(role, ()) for slot in mapping.slots(spec)]
    return min((slot.columns[1] - slot.columns[0] + 1 for slot in slots if slot.path == path), default=8)
