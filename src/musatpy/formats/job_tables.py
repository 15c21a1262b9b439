"""A job between its files and its block: a table of columns for every kind of card, whatever says them.

A table is named by its role (`ROLES`), and its columns by the attributes of the model that they fill, in inside
units. Decks, files of other agencies, calls and blocks come to such tables, and are made of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import IntArray
from musatpy.errors import CardFormatError
from musatpy.formats import mapping, system_rows
from musatpy.formats.cards.codec import empty_column
from musatpy.formats.cards.spec import CardSpec, Family, card_formats_folder, load_family
from musatpy.model import extensions
from musatpy.model.tables import POSITION_UNIT, Column, columns

Array = NDArray[Any]
Table = dict[str, Array]  # model attribute -> (k,) or (k, components), of k cards
Tables = dict[str, Table]  # role -> table, of at least one row


def _roles() -> Iterator[tuple[str, str]]:
    """Yield what a draft is made of, and the model attribute (or table) by which the cards of each are known.

    A table whose columns say by which cards they come has as many roles; any other has one of its own name.
    """
    yield from (("titles", "titles"), ("options", "options.program"), ("more_options", "options.initial"))
    first = ("ellipsoid", "water", "water_conditions", "waves", "wave_origin")
    for table in dict.fromkeys((*first, *mapping.JOB_TABLES)):
        if table in ("options", "points"):
            continue
        meanings = columns(mapping.TABLES[table])
        shared = [
            (about.role, f"{table}.{name}") for name, about in meanings.items() if about.role and not about.link
        ]
        yield from reversed(dict(reversed(shared)).items())
        if not shared:
            yield table, f"{table}.position" if "position" in meanings else table


ROLES = dict(_roles())

# Of places with correlations: the cards that give these besides, and the table.
COVARIANCES = {role: path.partition(".")[0] for role, path in ROLES.items() if path.endswith(".correlation")}

# What a family need not have cards for.
OPTIONAL = (
    *system_rows.TABLES,
    *extensions.stated("TABLES"),
    "water_conditions",
    "waves",
    "wave_sigmas",
    "wave_origin",
    "orientation",
    *COVARIANCES,
    "ports",
)

# Of points, on the cards of their images and of control.
POINT_FLAGS = ("points.bathymetric", "points.dry")

Flags = Mapping[str, list[str]]
"""Of `POINT_FLAGS`, the points that have it."""

# The order in which cards name cameras, photos and points, where it is not that of the roles.
_FIRST = ("cameras", "stations", "attitudes", "matrices", "tides", "fiducial_measurements", "cross_measurements")


def table_of(role: str) -> str:
    """Return the table of the model that the cards of a role fill."""
    return ROLES.get(role, role).partition(".")[0]


@cache
def attributes(role: str) -> Mapping[str, Column]:
    """Return the attributes of the model that cards of a role may carry, and all must but for those of options."""
    table = table_of(role)
    if table == "titles":
        return {"titles": Column()}
    meanings = columns(mapping.TABLES[table])
    names = [name for name in mapping.names_of(table) if meanings[name].role in ("", role)]
    points = columns(mapping.TABLES["points"]) if role in ("plates", "control") else {}
    flags = {path: points[path.partition(".")[2]] for path in POINT_FLAGS if points}
    return {f"{table}.{name}": meanings[name] for name in names} | flags


@cache
def naming(table: str) -> Mapping[str, str]:
    """Return the attributes with the names of cameras, photos or points, by role, in the order of the cards."""
    return {
        role: path
        for role in dict.fromkeys((*_FIRST, *ROLES))
        for path, about in attributes(role).items()
        if about.link == table or (about.identity and table_of(role) == table)
    }


# What identifies the rows of a role: the attributes that two tables of it must share to be put together.
KEYS = {
    role: keys for role in ROLES if (keys := tuple(path for path, about in attributes(role).items() if about.key))
}

# The cards with places in the system of the job.
PLACES = tuple(role for role, path in ROLES.items() if attributes(role).get(path, Column()).unit == POSITION_UNIT)


# The cards by which photos start that have none of attitudes.
STARTS = tuple(role for role in ROLES if any(about.starts == "attitudes" for about in attributes(role).values()))

# Those besides that of the station with the place of a photo.
OF_STATIONS = tuple(role for role in PLACES if f"{role}.photo" in attributes(role))


@dataclass(frozen=True, kw_only=True, eq=False)
class RoleRows:
    """The k cards that say one kind of thing, in the order of the deck; or what files or calls say so."""

    role: str
    specs: tuple[CardSpec, ...]
    kind: IntArray  # (k,) link to specs
    lines: IntArray  # (k,) where they stand, zeros where that is not known
    values: Table

    @classmethod
    def of(cls, role: str, specs: tuple[CardSpec, ...], values: Table, lines: IntArray | None = None) -> Self:
        """Return the rows of a table, all of the first kind of card."""
        zeros = np.zeros(size(values), dtype=np.int64)
        return cls(role=role, specs=specs, kind=zeros, lines=zeros if lines is None else lines, values=values)

    def __len__(self) -> int:
        return len(self.lines)

    def __getitem__(self, path: str) -> Array:
        return self.values[path]

    def spec(self, row: int) -> CardSpec:
        """Return the card of a row."""
        return self.specs[int(self.kind[row])]


@lru_cache(maxsize=8)
def card_family(folder: Path | None = None) -> Family:
    """Return the cards of the musat family, or those of another folder of card formats that fill a block.

    Raises `CardFormatError` for formats that are wrong, or whose targets are not those of the model.
    """
    if folder is not None:
        from musatpy.formats.records.layout import is_record_folder  # a folder is rarely given

        if is_record_folder(folder):
            raise CardFormatError(
                f"{folder} has formats of records, not of cards: convert such files to a deck first"
            )
        family = load_family(folder)
    else:
        family = load_family(card_formats_folder() / "musat", extensions.card_folders())
    mapping.check_targets(family)
    roles_of(family)
    return family


@lru_cache(maxsize=8)
def roles_of(family: Family) -> Mapping[str, tuple[CardSpec, ...]]:
    """Return the cards that fill each role; a family may have none that state systems.

    Raises `CardFormatError` where a role has no card, its cards do not carry all attributes of the model, or carry
    what the model takes from other cards: it would be lost.
    """
    targets = {
        spec: {path for slot in mapping.slots(spec) for path in (slot.path, slot.path.partition(".")[0])}
        for spec in family.cards.values()
    }
    roles: dict[str, tuple[CardSpec, ...]] = {}
    for role, anchor in ROLES.items():
        specs = tuple(spec for spec in targets if anchor in targets[spec])
        if specs:
            roles[role] = specs
        elif role not in OPTIONAL:
            raise CardFormatError(f"{family.name}: no card has the target {anchor}")
        for spec in specs:
            required = {anchor} if table_of(role) == "options" else set(attributes(role))
            if lacking := required - targets[spec]:
                raise CardFormatError(f"{family.name}: {spec.mnemonic} has no target {', '.join(sorted(lacking))}")
    for spec in targets:
        held = [path for role, specs in roles.items() if spec in specs for path in attributes(role)]
        for slot in mapping.slots(spec):
            if slot.path not in held:
                where = f"{spec.file}: field {slot.name}: target: '{slot.path}'"
                expected = f"one of {', '.join(held)}" if held else f"also one of {', '.join(ROLES.values())}"
                raise CardFormatError(f"{where} is nowhere in the model of such a card; expected {expected}")
    if lacking := set(attributes("options")) - set().union(*targets.values()):
        raise CardFormatError(f"{family.name}: no card has the target {', '.join(sorted(lacking))}")
    return roles


@cache
def nothing(role: str) -> Table:
    """Return the table of a role without rows: every attribute, with its type and components."""
    spec = roles_of(card_family())[role][0]
    return mapping.gather(spec, {field.name: empty_column(field, 0) for field in spec.fields})


def plain_card(role: str, geographic: bool) -> CardSpec:
    """Return the card of a role in the units of a job that states none, geographic or not."""
    specs = [spec for spec in roles_of(card_family())[role] if not mapping.has_stated_unit(spec)]
    return next((spec for spec in specs if mapping.is_angular(spec, ROLES[role]) == geographic), specs[0])


def size(table: Table) -> int:
    """Return the number of rows of a table."""
    return len(next(iter(table.values()))) if table else 0


def blank(role: str, path: str, count: int) -> Array:
    """Return (count,) or (count, components) of an attribute of which nothing is said."""
    return mapping.blanks(path, nothing(role)[path], count)


def is_said(path: str, values: Array) -> Array:
    """Return (k,) True where a column says something: not NaN, not empty, no flag off its default."""
    if path in mapping.CODES:
        return values != mapping.CODES[path][""]
    full = values != "" if values.dtype.kind == "U" else ~np.isnan(values.astype(float))
    return np.asarray(full.reshape(len(values), -1).any(axis=1)) if full.size else np.zeros(len(values), dtype=bool)


def keys_of(role: str, table: Table) -> list[tuple[str, ...]]:
    """Return what identifies each row of a role; nothing of a role without `KEYS`."""
    return list(zip(*(table[path].tolist() for path in KEYS.get(role, ())), strict=True))


def repeated(role: str, table: Table) -> list[int]:
    """Return the rows whose identification an earlier row has."""
    first: dict[tuple[str, ...], int] = {}
    return [row for row, key in enumerate(keys_of(role, table)) if first.setdefault(key, row) != row]


def flags_of(tables: Iterable[tuple[str, Table]]) -> dict[str, list[str]]:
    """Return the points that plate or control rows of tables, each with its role, flag."""
    flags: dict[str, list[str]] = {flag: [] for flag in POINT_FLAGS}
    for role, table in tables:
        for flag, ids in flags.items() if role in ("plates", "control") else ():
            ids += table[f"{role}.point"][table[flag].astype(bool)].tolist()
    return flags


def with_flags(role: str, table: Table, flags: Flags) -> Table:
    """Return a table in which every plate or control row of some points has flags besides its own."""
    more = {flag: ids for flag, ids in flags.items() if ids and role in ("plates", "control")}
    points = table[f"{role}.point"].tolist() if more else []
    columns = {flag: np.fromiter(map(set(ids).__contains__, points), bool) for flag, ids in more.items()}
    return table | {flag: table[flag].astype(bool) | named for flag, named in columns.items()}


def role_of(path: str, paths: Iterable[str]) -> str:
    """Return the role that an attribute belongs to, on a row that has all `paths`."""
    table, _, name = path.partition(".")
    if table == "points":
        tables = {path.partition(".")[0] for path in paths}
        return "control" if "control" in tables else "plates"
    return columns(mapping.TABLES[table])[name].role or ("stations" if table == "photos" else table)


def words_of(role: str) -> str:
    """Return what the rows of a role are called: `plates`, `height differences`."""
    return role.replace("_", " ")
