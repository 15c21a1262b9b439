"""What the cards of a deck say, as the record has it: each field is one of the model, and means what the cards say.

A table of the record that has results too states the fields that it shares with the cards by itself; `with_cards`
adds what else the cards say of its rows.
"""

from __future__ import annotations

import re
import typing
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import fields, replace
from enum import IntEnum, StrEnum
from functools import cache, partial
from operator import attrgetter, itemgetter
from types import UnionType
from typing import Any, TypeVar

from musatpy.formats import mapping
from musatpy.formats.cards.spec import CardSpec
from musatpy.formats.job_tables import card_family
from musatpy.model import Block
from musatpy.model.block import parts_of_block
from musatpy.model.kinds import TablesOfKinds
from musatpy.model.tables import Table, columns, types_of
from musatpy.reports.fields import Field, FieldGroup, Node, Rows, same
from musatpy.reports.values import names
from musatpy.statistics import Statistics

Source = TypeVar("Source")

# What the record calls a table of the block, where it has results besides, and not by its own name.
HOMES = {"photos": "stations", "reduction": "reduction.options"}
# And what it calls an attribute, where not by its own name: in a table of results `given_` keeps both apart.
_CALLED = {
    **{f"{table}.ids": table.removesuffix("s") for table in ("cameras", "photos", "points", "waves")},
    **{f"{table}.ids": "mark" for table in ("fiducials", "fiducial_measurements")},
    **{f"{table}.ids": "cross" for table in ("reseau", "cross_measurements")},
    "equal_elevations.ids": "group",
    "air_bases.photo": "photos",
    **{f"{table}.point": "points" for table in ("equal_elevations", "distances", "height_differences")},
    **{f"photos.{name}": f"given_{name}" for name in ("position", "position_sigma", "attitude", "attitude_sigma")},
    **{
        f"{table}.{name}": f"given_{name}"
        for table, kind in parts_of_block().items()
        if "correlation" in columns(kind)
        for name in ("position", "sigma", "correlation")
    },
    **{f"waves.{name}": f"given_{name}" for name in ("period", "length", "speed")},
    **{f"{table}.length": "given_length" for table in ("air_bases", "distances")},
    "height_differences.difference": "given_difference",
    **{
        f"{table}.sigma": "given_sigma"
        for table in ("equal_elevations", "air_bases", "distances", "height_differences")
    },
}
_UNITS = {"um": "mm", "deg": "rad", "arcsec": "rad", "sec": "s", "hPa": "Pa", "ppt": "parts per thousand"}
# Tables of comparator readings: of a job whose plates were reduced they are those that were read.
OF_READINGS = (
    "comparator",
    "lenses",
    "mark_distances",
    "reseau",
    "fiducial_measurements",
    "cross_measurements",
    "plates",
    "reduction",
)
_KINDS = {str: "string", int: "integer", float: "number", bool: "boolean"}


def called(path: str) -> tuple[str, str]:
    """Return the table of the record and its field that have an attribute of the model: `cameras.ids`."""
    table, _, name = path.partition(".")
    if table == "water_conditions":
        return "water.conditions", name
    return HOMES.get(table, table), _CALLED.get(path, name)


def input_tables(results: Collection[str]) -> Iterator[Node[Statistics]]:
    """Yield every part of the block, those of kinds last, but those that have a table of `results`."""
    for name, kind in sorted(parts_of_block().items(), key=lambda part: part[0] in columns(TablesOfKinds)):
        if HOMES.get(name, name).partition(".")[0] not in results:
            block = "read" if name in OF_READINGS else "block"
            if issubclass(kind, Table):
                yield table(name, name, attrgetter(block))
            else:
                yield part(name, name, attrgetter(f"{block}.{name}"))


def table(name: str, called: str, block: Callable[[Source], Block]) -> Rows[Source, Any]:
    """Return a table of the block as the record has it."""
    kind = parts_of_block()[name]
    of_images = "photo" in columns(kind) and name.endswith(("plates", "measurements"))
    return Rows(called, _text(kind), tuple(_fields(name, same)), block, of_images)


def part(name: str, called: str, of: Callable[[Source], Any]) -> FieldGroup[Source, Any]:
    """Return what one card says of a job, null without the card."""
    kind = mapping.TABLES[name]
    hints = typing.get_type_hints(kind)
    nodes: list[Node[Any]] = []
    for one in fields(kind):
        within = f"{name}_{one.name}"
        if within in mapping.TABLES:
            nodes.append(part(within, one.name, attrgetter(one.name)))
        elif (field := _single(name, one.name, hints[one.name], one.default)) is not None:
            nodes.append(field)
    return FieldGroup(called, _text(kind), of=of, fields=tuple(nodes), optional=name != "options")


def with_cards(node: Node[Statistics]) -> Node[Statistics]:
    """Return a table of results with what else the cards say of its rows."""
    name = next((name for name, called in HOMES.items() if called == node.name), node.name)
    if not isinstance(node, Rows) or name not in parts_of_block():
        return node
    known = {field.name for field in node.fields}
    block = itemgetter(0) if name == "waves" else attrgetter("block")  # by linear theory there is more of waves
    more = [field for field in _fields(name, block) if field.name not in known]
    return replace(node, fields=(*node.fields, *more)) if more else node


def _fields(name: str, block: Callable[[Any], Block]) -> Iterator[Field[Any]]:
    """Yield the columns of a table of the block, which a source has, that have one value per row."""
    kind: Any = parts_of_block()[name]
    for column, about in columns(kind).items():
        path = f"{name}.{column}"
        if about.rows or not (text := _meaning(path)):
            continue
        codes = [value for value in (about.codes or {}).values() if isinstance(value, IntEnum)]
        of_cards = _card_fields(path)
        is_whole = not about.link and all(field.edit.letter in "AI" for field in of_cards)
        base = "string" if about.link or codes else _KINDS[types_of(kind)[column]]
        base = "integer" if base == "number" and is_whole else base
        may_be_blank = any(field.blank == "missing" or field.asterisks for field in of_cards)
        is_open = base == "number" and (about.role or may_be_blank)
        sizes = "x".join(map(str, about.components))
        yield Field(
            called(path)[1],
            f"{sizes} {base}{'?' if is_open else ''}".strip(),
            text,
            partial(_values, name, column, about.link, codes, base, block),
            unit=about.unit or _unit(path),
            choices=[value.name.lower() for value in dict.fromkeys(codes)] or _allowed(path),
            exact=True,
        )


def _values(
    name: str, column: str, link: str, codes: list[IntEnum], base: str, block: Callable[[Any], Block], source: Any
) -> Any:
    """Return the values of a column: links as names, kinds as words."""
    of = block(source)
    value = getattr(getattr(of, name), column)
    if link:
        return getattr(of, link).ids[value]
    if codes:
        return names(type(codes[0]), value)
    return value.astype(int) if base == "integer" else value


def _single(name: str, attribute: str, hint: Any, default: Any) -> Field[Any] | None:
    """Return the only value of a card, None of an attribute that no card has."""
    path = f"{name}.{attribute}"
    if not (text := _meaning(path)):
        return None
    is_open = isinstance(hint, UnionType) or default != default  # NaN: not given
    inside = typing.get_args(hint)[0] if isinstance(hint, UnionType) else hint
    if typing.get_origin(inside) is tuple:
        kind, choices = f"{len(typing.get_args(inside))} number", []
    elif issubclass(inside, StrEnum):
        kind, choices = "string", list(inside)
    else:
        kind, choices = _KINDS[inside], _allowed(path) if inside is str else []
    return Field(attribute, f"{kind}{'?' if is_open else ''}", text, unit=_unit(path), choices=choices)


@cache
def _cards() -> Mapping[str, list[tuple[CardSpec, mapping.Slot]]]:
    """Return the places on cards where each attribute of the model stands."""
    places: dict[str, list[tuple[CardSpec, mapping.Slot]]] = {}
    for spec in card_family().cards.values():
        for slot in mapping.slots(spec) if spec.fields else ():
            places.setdefault(slot.path, []).append((spec, slot))
    return places


def _card_fields(path: str) -> list[Any]:
    """Return the fields of all cards that have an attribute."""
    return [field for _, slot in _cards().get(path, ()) for field in slot.fields]


def _meaning(path: str) -> str:
    """Return what an attribute is, as the first card with it says, and where it stands; empty where none has it."""
    places = _cards().get(path, [])
    if not places:
        return ""
    spec = places[0][0]
    of_card = ", ".join(slot.name for one, slot in places if one is spec)
    return f"{spec.mnemonic} {of_card}: {places[0][1].fields[0].doc}"


def _allowed(path: str) -> list[str]:
    """Return what a text of a card may be, blank where it may be left out."""
    for field in _card_fields(path):
        if field.allowed and path not in mapping.CODES:
            return ["", *field.allowed] if field.blank == "missing" else list(field.allowed)
    return []


def _unit(path: str) -> str:
    units = {field.unit for field in _card_fields(path)}
    unit = next(iter(units)) if len(units) == 1 else ""
    return _UNITS.get(unit, unit)


def _text(kind: Any) -> str:
    """Return what a part of the block is, the first sentence of its own text."""
    return re.split(r"\.(?:\s|$)|\n", str(kind.__doc__))[0]
