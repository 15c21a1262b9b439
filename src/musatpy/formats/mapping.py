"""Card columns <-> values of the model, as the `target` and `unit` keys of the card formats say.

A target is a dotted model attribute, with a component where the attribute has several: `plates.xy[0]`; the parts of
an angle in degrees, minutes and seconds add `:deg`, `:min` and `:sec`. Everything here works on whole columns.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from musatpy import model, units
from musatpy.errors import CardFormatError
from musatpy.formats import system_rows
from musatpy.formats.cards.spec import STATED_UNIT, CardSpec, Family, FieldSpec

Array = NDArray[Any]
Values = Mapping[str, Array]  # model attribute -> (k,) or (k, components), in inside units

_UNITS = {
    "": 1.0,
    "m": 1.0,
    "mm": 1.0,
    "um": units.MICROMETRE,
    "deg": units.DEGREE,
    "min": units.ARC_MINUTE,
    "s": units.ARC_SECOND,
    "arcsec": units.ARC_SECOND,
    "degC": 1.0,
    "ppt": 1.0,
    "nm": 1.0,
    "hPa": units.HECTOPASCAL,
    "sec": 1.0,  # of time
    "m/s": 1.0,
    "rad": 1.0,
    "gon": units.GON,
    "dms": 1.0,  # packed degrees, minutes and seconds: a record field turns them into radians itself
}
_PARTS = ("deg", "min", "sec")
_LAST = 8  # component that an attribute may have: a matrix, row by row
_TARGET = re.compile(r"(?P<path>\w+(?:\.\w+)?)(?:\[(?P<component>\d+)\])?(?::(?P<part>deg|min|sec))?", re.ASCII)

# What the letters of a deck stand for: attribute -> text -> value. The first text of each is that of a blank field.
CODES: dict[str, dict[str, Any]] = {
    "points.bathymetric": {"": False, "B": True},
    "plates.triangulated": {"": True, "N": False},
    "control.fixed": {"": False, "X": True},
    "comparator.left_handed": {"": False, "L": True},
    "system_texts.joined": {"": False, "+": True},
    "control.kind": {
        "": model.ControlKind.CHECK,
        "F": model.ControlKind.FULL,
        "H": model.ControlKind.HORIZONTAL,
        "V": model.ControlKind.VERTICAL,
        "C": model.ControlKind.CHECK,
    },
}

# The tables of a block by the first word of a target.
TABLES: dict[str, type] = {
    "options": model.Options,
    "ellipsoid": model.EllipsoidSpec,
    "water": model.Water,
    "water_conditions": model.WaterConditions,
    "waves": model.Waves,
    "wave_origin": model.WaveOrigin,
    "cameras": model.Cameras,
    "distortion": model.Distortion,
    "fiducials": model.Fiducials,
    "photos": model.Photos,
    "fiducial_measurements": model.FiducialMeasurements,
    "points": model.Points,
    "plates": model.PlateMeasurements,
    "control": model.Control,
    "equal_elevations": model.EqualElevations,
    "air_bases": model.AirBases,
    "distances": model.Distances,
    "height_differences": model.HeightDifferences,
    "reduction": model.ReductionOptions,
    "comparator": model.ComparatorSpec,
    "lenses": model.Lenses,
    "mark_distances": model.MarkDistances,
    "reseau": model.ReseauCrosses,
    "cross_measurements": model.CrossMeasurements,
    **system_rows.TABLES,
}


_TABLES_WITHIN = ("conditions",)  # attributes of the water that are tables themselves


class Layout(Hashable, Protocol):
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
def slots(spec: Layout) -> tuple[Slot, ...]:
    """Return the slots of a card in the order of its fields.

    Raises `CardFormatError` for a target that names no attribute of the model or is given twice, and for an angle
    without its three parts.
    """
    found: dict[tuple[str, int | None], dict[str, FieldSpec]] = {}
    for field in spec.fields:
        match = _TARGET.fullmatch(field.target)
        if match is None or not _is_attribute(match["path"]):
            raise CardFormatError(f"{spec.mnemonic}.{field.name}: target: '{field.target}' is not in the model")
        component = None if match["component"] is None else int(match["component"][:3])
        if component is not None and component > _LAST:
            raise CardFormatError(f"{spec.mnemonic}.{field.name}: target: '{field.target}' has no such component")
        parts = found.setdefault((match["path"], component), {})
        if (match["part"] or "") in parts:
            raise CardFormatError(f"{spec.mnemonic}.{field.name}: target: '{field.target}' is another field's")
        parts[match["part"] or ""] = field
    return tuple(_slot(spec, path, component, parts) for (path, component), parts in found.items())


def _slot(spec: Layout, path: str, component: int | None, parts: dict[str, FieldSpec]) -> Slot:
    if set(parts) == {""}:
        return Slot(path=path, component=component, fields=(parts[""],))
    if set(parts) != set(_PARTS):
        raise CardFormatError(f"{spec.mnemonic}: target {path}: degrees, minutes and seconds go together")
    return Slot(path=path, component=component, fields=tuple(parts[part] for part in _PARTS))


def _is_attribute(path: str) -> bool:
    table, _, attribute = path.partition(".")
    if not attribute:
        return table == "titles"
    return table in TABLES and attribute in {field.name for field in fields(TABLES[table])}


def names_of(table: str) -> tuple[str, ...]:
    """Return the attributes of a table that fields can hold: all but those that are tables themselves."""
    return tuple(one.name for one in fields(TABLES[table]) if one.name not in _TABLES_WITHIN)


def check_targets(family: Family) -> None:
    """Raise `CardFormatError` for a target that the model does not have, or components that do not count up."""
    for spec in family.cards.values():
        components: dict[str, list[int | None]] = {}
        for slot in slots(spec):
            components.setdefault(slot.path, []).append(slot.component)
        for path, numbers in components.items():
            if numbers not in ([None], list(range(len(numbers)))):
                raise CardFormatError(f"{spec.mnemonic}: target {path}: components {numbers} do not count from 0")


def is_angular(spec: CardSpec, path: str) -> bool:
    """Return whether a card gives the first component of `path` as an angle: a geographic position."""
    return any(slot.fields[0].unit in ("deg", STATED_UNIT) for slot in slots(spec) if slot.path == path)


def has_stated_unit(spec: CardSpec) -> bool:
    """Return whether a card has angles in the unit that the SYS card says."""
    return any(field.unit == STATED_UNIT for field in spec.fields)


def gather(spec: Layout, columns: Mapping[str, Array], angle: float = units.DEGREE) -> dict[str, Array]:
    """Return what k cards say, by model attribute: (k,), or (k, components), in inside units.

    `angle` are the radians of the unit of the SYS card. Texts stay texts, except the letters of `CODES`, which
    become their values. Missing numbers are NaN.
    """
    values: dict[str, Array] = {}
    components: dict[str, list[Array]] = {}
    for slot in slots(spec):
        if slot.component is None:
            values[slot.path] = _decode(slot.path, _inside(slot, columns, angle))
        else:
            components.setdefault(slot.path, []).append(_inside(slot, columns, angle))
    return values | {path: np.stack(several, axis=-1) for path, several in components.items()}


def _inside(slot: Slot, columns: Mapping[str, Array], angle: float) -> Array:
    values = [columns[field.name] for field in slot.fields]
    if slot.is_sexagesimal:
        return units.radians_from_dms(*values)
    factor = _factor(slot, angle)
    return values[0] if factor == 1.0 else values[0] * factor


def _decode(path: str, values: Array) -> Array:
    if path not in CODES:
        return values
    codes = CODES[path]
    decoded = np.full(len(values), codes[""])
    for text, value in codes.items():
        if text:
            decoded[values == text] = value
    return decoded


def _factor(slot: Slot, angle: float) -> float:
    unit = slot.fields[0].unit
    return angle if unit == STATED_UNIT else _UNITS[unit]


def scatter(spec: Layout, values: Values, angle: float = units.DEGREE) -> dict[str, Array]:
    """Return the columns of the cards that say `values`: the inverse of `gather`."""
    columns: dict[str, Array] = {}
    for slot in slots(spec):
        value = np.asarray(values[slot.path])
        if slot.component is not None and (value.ndim < 2 or slot.component >= value.shape[1]):
            raise CardFormatError(f"{spec.mnemonic}: target: '{slot.path}' has no component {slot.component}")
        value = _encode(slot.path, value) if slot.component is None else value[:, slot.component]
        columns.update(_outside(slot, value, angle))
    return columns


def _encode(path: str, values: Array) -> Array:
    if path not in CODES:
        return values
    encoded = np.full(len(values), "", dtype="U1")
    for text, value in CODES[path].items():
        encoded[values == value] = text
    return encoded


def _outside(slot: Slot, value: Array, angle: float) -> dict[str, Array]:
    names = [field.name for field in slot.fields]
    if slot.is_sexagesimal:
        with np.errstate(invalid="ignore"):  # a missing angle has missing parts
            return dict(zip(names, units.dms_from_radians(value, slot.fields[-1].edit.decimals), strict=True))
    factor = _factor(slot, angle)
    return {names[0]: value if factor == 1.0 else value / factor}
