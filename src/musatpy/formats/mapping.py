"""Card columns <-> values of the model, as the `target` and `unit` keys of the card formats say.

A target is a dotted model attribute, with a component where the attribute has several: `plates.xy[0]`; the parts of
an angle in degrees, minutes and seconds add `:deg`, `:min` and `:sec`. A field of letters may have several targets,
of which each knows its own letters: `points.bathymetric points.dry`. Everything here works on whole columns.
"""

from __future__ import annotations

import math
import re
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, fields
from enum import StrEnum
from functools import cache, lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from musatpy import model, units
from musatpy.errors import CardFormatError
from musatpy.formats import system_rows
from musatpy.formats.cards.spec import STATED_UNIT, CardSpec, Family, FieldSpec
from musatpy.model.block import parts_of_block
from musatpy.model.compilation import CARD_TABLES
from musatpy.model.tables import Codes, Table, columns

Array = NDArray[Any]
Values = Mapping[str, Array]  # model attribute -> (k,) or (k, components), in inside units

# Units of fields that are not those of the model; a record field turns packed angles into radians itself.
_FACTORS = {
    **{"deg": units.DEGREE, "min": units.ARC_MINUTE, "s": units.ARC_SECOND, "arcsec": units.ARC_SECOND},
    **{"um": units.MICROMETRE, "hPa": units.HECTOPASCAL, "gon": units.GON},
}
ANGULAR = ("deg", "min", "s", "arcsec", "rad", "gon", "dms", STATED_UNIT)
_OF_SIGMAS = ("dms", "job")  # besides metres: along geographic coordinates
_DIMENSIONS = {  # units in which a value of the model may stand in a file; without any it stands as it is
    "m": ("m", *_OF_SIGMAS), "mm": ("mm", "um"), "rad": ANGULAR, "s": ("sec",), "m/s": ("m/s",),
}  # fmt: skip
_PARTS = ("deg", "min", "sec")
_LAST = 8  # component that an attribute may have: a matrix, row by row
_TARGET = re.compile(r"(?P<path>\w+(?:\.\w+)?)(?:\[(?P<component>\d+)\])?(?::(?P<part>deg|min|sec))?", re.ASCII)

# The tables of a block, and what else the cards of a job fill, by the first word of a target.
JOB_TABLES: Mapping[str, type[Any]] = {
    **parts_of_block(),
    "water_conditions": model.WaterConditions,
    **system_rows.TABLES,
}
TABLES = {**JOB_TABLES, **CARD_TABLES}

# What the letters of a deck stand for: attribute -> text -> value, with the text of a blank field among them. Of
# several texts with one value the last is written.
CODES: Mapping[str, Codes] = {
    f"{table}.{name}": about.codes
    for table, kind in TABLES.items()
    for name, about in columns(kind).items()
    if about.codes is not None
}

_TABLES_WITHIN = ("conditions",)  # attributes of the water that are tables themselves


class FieldLayout(Hashable, Protocol):
    """A card, or a row of another agency's file: fields with targets."""

    @property
    def mnemonic(self) -> str:
        """What messages call it."""

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """Its fields."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Slot:
    """A component of a model attribute, and its field on a card: one, or degrees, minutes and seconds."""

    path: str
    component: int | None  # None where the attribute has one only
    fields: tuple[FieldSpec, ...]

    @property
    def is_sexagesimal(self) -> bool:
        """True for an angle in degrees, minutes and seconds."""
        return len(self.fields) == len(_PARTS)

    @property
    def name(self) -> str:
        """The field's name; of an angle, what the names of its three fields begin with."""
        name = self.fields[0].name
        return name.removesuffix(f"_{_PARTS[0]}") if self.is_sexagesimal else name

    @property
    def columns(self) -> tuple[int, int]:
        """First and last column."""
        return min(field.first for field in self.fields), max(field.last for field in self.fields)


@lru_cache(maxsize=256)
def slots(spec: FieldLayout) -> tuple[Slot, ...]:
    """Return the slots of a card in the order of its fields.

    Raises `CardFormatError` for a target that names no attribute of the model or is given twice, for several of one
    field that are no letters, and for an angle without its three parts.
    """
    fields_of: dict[tuple[str, int | None], dict[str, FieldSpec]] = {}
    for field in spec.fields:
        targets = field.target.split() or [""]
        for target in targets:
            match = _TARGET.fullmatch(target)
            table = target.partition(".")[0]
            paths = [f"{table}.{name}" for name in names_of(table)] if table in TABLES else []
            if match is None or match["path"] not in (*paths, "titles"):
                wrong = f"{spec.mnemonic}.{field.name}: target: '{target}' is not in the model"
                raise CardFormatError(f"{wrong}; expected one of {', '.join(paths or TABLES)}")
            component = None if match["component"] is None else int(match["component"][:3])
            if component is not None and component > _LAST:
                raise CardFormatError(f"{spec.mnemonic}.{field.name}: target: '{target}' has no such component")
            if len(targets) > 1 and target not in CODES:
                raise CardFormatError(f"{spec.mnemonic}.{field.name}: target: '{target}' has no letters to share")
            parts = fields_of.setdefault((match["path"], component), {})
            if (match["part"] or "") in parts:
                raise CardFormatError(f"{spec.mnemonic}.{field.name}: target: '{target}' is another field's")
            parts[match["part"] or ""] = field
    return tuple(_slot(spec, path, component, parts) for (path, component), parts in fields_of.items())


def _slot(spec: FieldLayout, path: str, component: int | None, parts: dict[str, FieldSpec]) -> Slot:
    table, _, name = path.partition(".")
    unit = columns(TABLES[table])[name].unit if name else ""
    for field in parts.values():
        if field.unit and not field.edit.is_number:
            raise CardFormatError(f"{spec.mnemonic}.{field.name}: unit: '{field.unit}', of a field of letters")
        if field.unit and unit in _DIMENSIONS and field.unit not in _DIMENSIONS[unit]:
            wrong = f"{spec.mnemonic}.{field.name}: unit: '{field.unit}', expected {' or '.join(_DIMENSIONS[unit])}"
            raise CardFormatError(f"{wrong}: {path} is in {unit}")
    if set(parts) == {""}:
        return Slot(path=path, component=component, fields=(parts[""],))
    if set(parts) != set(_PARTS):
        raise CardFormatError(f"{spec.mnemonic}: target {path}: degrees, minutes and seconds go together")
    return Slot(path=path, component=component, fields=tuple(parts[part] for part in _PARTS))


@cache
def names_of(table: str) -> tuple[str, ...]:
    """Return the attributes of a table that fields can hold: no numbers of its rows, no tables within."""
    meanings = columns(TABLES[table]).items()
    return tuple(name for name, about in meanings if name not in _TABLES_WITHIN and about.link != table)


def single_of(table: str, values: Values, row: int = 0) -> Any:
    """Return the part of the model that a card fills, defaults where it is blank; None without the card."""
    rows = len(next(iter(values.values())))
    return TABLES[table](**said_of(table, values, row)) if rows else None


def said_of(table: str, values: Values, row: int = 0) -> dict[str, Any]:
    """Return what a card, if there is one, says of a part of the model, by attribute; nothing of a blank."""
    given: dict[str, Any] = {}
    for attribute in fields(TABLES[table]):
        column = values.get(f"{table}.{attribute.name}", ())
        if not len(column):
            continue
        value: Any = column[row].tolist()
        kind: Any = type(attribute.default)
        value = tuple(value) if isinstance(value, list) else value
        if value == value and value != "":
            given[attribute.name] = kind(value) if issubclass(kind, StrEnum | int) else value
    return given


def blanks(path: str, like: Array, count: int) -> Array:
    """Return (count,) or (count, components) of an attribute of which nothing is said; `like` has its type."""
    if path in CODES:
        return np.full(count, CODES[path][""])
    return np.full((count, *like.shape[1:]), "" if like.dtype.kind == "U" else np.nan, dtype=like.dtype)


def check_targets(family: Family) -> None:
    """Raise `CardFormatError` for a target that the model does not have, or not so many components of."""
    for spec in family.cards.values():
        components: dict[str, list[int | None]] = {}
        try:
            for slot in slots(spec):
                components.setdefault(slot.path, []).append(slot.component)
        except CardFormatError as error:
            raise CardFormatError(f"{spec.file}: {error}") from error
        for path, numbers in components.items():
            where = f"{spec.file}: {spec.mnemonic}: target {path}"
            if numbers not in ([None], list(range(len(numbers)))):
                raise CardFormatError(f"{where}: components {numbers} do not count from 0")
            expected = _components(path)
            if expected is not None and numbers != expected:
                count = len(expected) if expected != [None] else "none"
                given = f"components {numbers}" if expected == [None] else f"{len(numbers)} components"
                raise CardFormatError(f"{where}: {given}, expected {count}")


def _components(path: str) -> list[int | None] | None:
    """Return the components that the model has of an attribute, as targets have them; None where cards decide."""
    table, _, name = path.partition(".")
    kind = TABLES.get(table)
    if kind is None or not issubclass(kind, Table) or columns(kind)[name].rows:
        return None
    count = math.prod(columns(kind)[name].components)
    return list(range(count)) if count > 1 else [None]


def is_angular(spec: CardSpec, path: str) -> bool:
    """Return whether a card gives the first component of `path` as an angle: a geographic position."""
    return any(slot.fields[0].unit in ("deg", STATED_UNIT) for slot in slots(spec) if slot.path == path)


def has_stated_unit(spec: CardSpec) -> bool:
    """Return whether a card has angles in the unit that the SYS card says."""
    return any(field.unit == STATED_UNIT for field in spec.fields)


def gather(spec: FieldLayout, columns: Mapping[str, Array], angle: float = units.DEGREE) -> dict[str, Array]:
    """Return what k cards say, by model attribute: (k,), or (k, components), in inside units.

    `angle` are the radians of the unit of the SYS card. Texts stay texts, except the letters of `CODES`, which
    become their values. Missing numbers are NaN.
    """
    values: dict[str, Array] = {}
    components: dict[str, list[Array]] = {}
    for slot in slots(spec):
        if slot.component is None:
            column = values[slot.path] = _inside(slot, columns, angle)
            if slot.path in CODES:
                decoded = np.full(len(column), CODES[slot.path][""])
                for text, value in CODES[slot.path].items():
                    decoded[column == text] = value
                values[slot.path] = decoded
        else:
            components.setdefault(slot.path, []).append(_inside(slot, columns, angle))
    return values | {path: np.stack(several, axis=-1) for path, several in components.items()}


def _inside(slot: Slot, columns: Mapping[str, Array], angle: float) -> Array:
    values = [columns[field.name] for field in slot.fields]
    if slot.is_sexagesimal:
        return units.radians_from_dms(*values)
    unit = factor(slot, angle)
    return values[0] if unit == 1.0 else values[0] * unit


def factor(slot: Slot, angle: float) -> float:
    """Return the unit of a slot, degrees of three fields, in that of the model; `angle` is that of the SYS card."""
    unit = slot.fields[0].unit
    return angle if unit == STATED_UNIT else _FACTORS.get(unit, 1.0)


def scatter(spec: FieldLayout, values: Values, angle: float = units.DEGREE) -> dict[str, Array]:
    """Return the columns of the cards that say `values`: the inverse of `gather`."""
    columns: dict[str, Array] = {}
    for slot in slots(spec):
        value = np.asarray(values[slot.path])
        if slot.component is not None and (value.ndim < 2 or slot.component >= value.shape[1]):
            raise CardFormatError(f"{spec.mnemonic}: target: '{slot.path}' has no component {slot.component}")
        if slot.path in CODES:
            letters = np.full(len(value), "", dtype="U1")
            for text, code in CODES[slot.path].items():
                letters[value == code] = text
            value = letters
        value = value if slot.component is None else value[:, slot.component]
        for name, column in _outside(slot, value, angle).items():
            shared = columns.get(name)  # a field of letters that has another target too
            columns[name] = column if shared is None else np.where(column == "", shared, column)
    return columns


def _outside(slot: Slot, value: Array, angle: float) -> dict[str, Array]:
    names = [field.name for field in slot.fields]
    if slot.is_sexagesimal:
        with np.errstate(invalid="ignore"):  # a missing angle has missing parts
            return dict(zip(names, units.dms_from_radians(value, slot.fields[-1].edit.decimals), strict=True))
    unit = factor(slot, angle)
    return {names[0]: value if unit == 1.0 else value / unit}
