"""The cards that say how a deck is stated (SYS, SYT, SYO, SYF), and those of matrices: rows <-> plain words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.model import SystemSpec
from musatpy.model.tables import Table, columns, per_row
from musatpy.units import DEGREE, GON, AngleUnit

IN, OUT = "IN", "OUT"
MATRICES = "MATR"
DEFINITION, GEOID = "PROJ", "GEOID"  # the kinds of texts
_TEXT_WIDTH = 57  # columns of a text; the format of the card says where they stand
_SHORT = 40  # a definition of so many characters stands on the SYS card itself
_RADIANS = {AngleUnit.DEGREES: DEGREE, AngleUnit.GONS: GON, AngleUnit.RADIANS: 1.0, AngleUnit.DMS: DEGREE}


@dataclass(frozen=True, kw_only=True, eq=False)
class SystemCards(Table):
    """What k SYS cards say, empty for a blank."""

    role: TextArray
    kind: TextArray
    axes: TextArray
    angles: TextArray
    unit: TextArray
    deviations: TextArray
    definition: TextArray


@dataclass(frozen=True, kw_only=True, eq=False)
class SystemTexts(Table):
    """What k SYT cards say."""

    role: TextArray
    kind: TextArray
    text: TextArray
    joined: BoolArray = per_row(codes={"": False, "+": True})


@dataclass(frozen=True, kw_only=True, eq=False)
class SystemOrigins(Table):
    """What k SYO cards say."""

    role: TextArray
    position: FloatArray = per_row(3)  # latitude, longitude (rad), height (m)


@dataclass(frozen=True, kw_only=True, eq=False)
class SystemShifts(Table):
    """What k SYF cards say."""

    role: TextArray
    shift: FloatArray = per_row(3, unit="m")


@dataclass(frozen=True, kw_only=True, eq=False)
class Matrices(Table):
    """What k MAT cards say: a row of a matrix each."""

    photo: TextArray = per_row(link="photos")
    row: FloatArray = per_row()  # 1 to 3
    elements: FloatArray = per_row(3)
    sigma: FloatArray = per_row(unit="rad")


_STATING: dict[str, type] = {
    "systems": SystemCards,
    "system_texts": SystemTexts,
    "system_origins": SystemOrigins,
    "system_shifts": SystemShifts,
}
STATING = tuple(_STATING)
TABLES = _STATING | {"matrices": Matrices}


def radians_of(unit: str) -> float:
    """Return the radians of the unit of decimal angles; degrees for no such unit, which the checks complain of."""
    return _RADIANS[AngleUnit(unit)] if unit in list(AngleUnit) else DEGREE


def spec_of(role: str, rows: Mapping[str, Any]) -> SystemSpec | None:
    """Return what the first SYS card of a role says, with the cards that go with it; None without one.

    `rows` are those of a draft, by table.
    """
    cards = rows["systems"]
    of_role = np.flatnonzero(cards["systems.role"] == role)
    if not of_role.size:
        return None
    word = {name: str(cards[f"systems.{name}"][of_role[0]]) for name in columns(SystemCards)}
    default = SystemSpec()
    return SystemSpec(
        kind=word["kind"] or default.kind,
        axes=word["axes"] or default.axes,
        angles=word["angles"] or default.angles,
        sigmas=word["deviations"] or ("SYST" if role == OUT else default.sigmas),
        unit=AngleUnit(word["unit"]) if word["unit"] else default.unit,
        definition=_joined(rows["system_texts"], role, DEFINITION, word["definition"]),
        geoid=_joined(rows["system_texts"], role, GEOID),
        origin=_triple(rows, role, "system_origins", "position"),
        false=_triple(rows, role, "system_shifts", "shift"),
    )


def _joined(texts: Any, role: str, kind: str, head: str = "") -> str:
    """Return the texts of a kind put together."""
    out, blank = head, bool(head)
    of_role = (texts["system_texts.role"] == role) & (texts["system_texts.kind"] == kind)
    for row in np.flatnonzero(of_role).tolist():
        out += (" " if blank else "") + str(texts["system_texts.text"][row])
        blank = not texts["system_texts.joined"][row]
    return out


def _triple(rows: Mapping[str, Any], role: str, table: str, name: str) -> tuple[float, float, float] | None:
    cards = np.flatnonzero(rows[table][f"{table}.role"] == role)
    if not cards.size:
        return None
    x, y, z = rows[table][f"{table}.{name}"][cards[0]].tolist()
    return x, y, z


def values_of(specs: Mapping[str, SystemSpec | None]) -> dict[str, dict[str, NDArray[Any]]]:
    """Return what the cards of these statements, by role, say: table -> attribute -> column."""
    given = {role: spec for role, spec in specs.items() if spec is not None}
    short = {role: spec.definition if len(spec.definition) <= _SHORT else "" for role, spec in given.items()}
    texts = []
    for role, spec in given.items():
        long = "" if short[role] else spec.definition
        texts += [
            (role, kind, *piece) for kind, text in ((DEFINITION, long), (GEOID, spec.geoid)) for piece in _cut(text)
        ]
    tables: dict[str, list[Any]] = {
        "systems": [
            (role, spec.kind, spec.axes, spec.angles, spec.unit.value, spec.sigmas, short[role])
            for role, spec in given.items()
        ],
        "system_texts": texts,
        "system_origins": [(role, spec.origin) for role, spec in given.items() if spec.origin],
        "system_shifts": [(role, spec.false) for role, spec in given.items() if spec.false],
    }
    return {name: columns_of_rows(_STATING[name], name, rows) for name, rows in tables.items()}


def columns_of_rows(kind: type[Any], table: str, rows: Sequence[tuple[Any, ...]]) -> dict[str, NDArray[Any]]:
    """Return rows of a table as columns, by model attribute; none without rows."""
    values = zip(*rows, strict=True) if rows else ()
    pairs = zip(columns(kind), values, strict=bool(rows))
    return {f"{table}.{name}": np.array(column) for name, column in pairs}


def _cut(text: str) -> list[tuple[str, bool]]:
    """Return a text in pieces that fit a card, each with whether the next follows without a blank."""
    pieces: list[tuple[str, bool]] = []
    line = ""
    for word in text.split():
        if line and len(line) + 1 + len(word) > _TEXT_WIDTH:
            pieces.append((line, False))
            line = ""
        line = f"{line} {word}" if line else word
        while len(line) > _TEXT_WIDTH:
            pieces.append((line[:_TEXT_WIDTH], True))
            line = line[_TEXT_WIDTH:]
    return [*pieces, (line, False)] if line else pieces
