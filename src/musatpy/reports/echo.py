"""Echo of the input: every card of the deck of a job, with the fields and units of the card formats."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from enum import IntEnum
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.formats import assembly, mapping
from musatpy.formats.cards.spec import STATED_UNIT, CardSpec
from musatpy.formats.musat import card_family
from musatpy.model.block import parts_of_block
from musatpy.model.tables import columns
from musatpy.reports import brevity, job_record, result_record
from musatpy.reports.columns import vector
from musatpy.reports.editing import field_width
from musatpy.reports.headings import SEXAGESIMAL
from musatpy.reports.origin import Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Choice, Column, Report, key
from musatpy.statistics import Statistics
from musatpy.units import AngleUnit

Cards = Mapping[str, NDArray[Any]]  # what the cards of one kind say, by field, in the unit that is printed

# What headings call a unit, where not as the card does; angles of a stated deck are in that of its SYS card.
_UNITS = {"arcsec": "arc sec", "deg": "degrees", "sec": "s"}
_ANGLES = {AngleUnit.DEGREES: "degrees", AngleUnit.GONS: "gon", AngleUnit.RADIANS: "rad"}
_WIDER = 3  # columns that a number may need, besides those of its card, to be printed with all decimals
_READINGS = "Comparator Readings"
_READ = ("plates", "fiducial_measurements")  # tables that have them, where plates are raw
_STATED = ("options", "photos", "control", "wave_origin")  # what may name or use another system than the job
# What the record has of these differs from what stands on the card: the computed index, what a run has used.
_OTHERWISE = ("plates.sigma", "plates.triangulated", "waves.shape")

REFINED: Report[Statistics] = Report(
    title="Input: Plate Measurements, Refined",
    table=result_record.PLATES,
    columns=(
        key("Photo", "A8", "photo"),
        key("Point", "A8", "point"),
        *vector(("x\nmm", "y\nmm"), ("F12.7", "F12.7"), shows="xy"),
        *vector(("sigma x\num", "sigma y\num"), ("F7.2", "F7.2"), shows="sigma"),
        Column("Bath", "A4", lambda s: s.block.points.letters[s.block.plates.point]),
        Column("Trig", "A4", lambda s: np.where(s.block.plates.triangulated, "", "N")),
    ),
)
brief = brevity.note


def sections(statistics: Statistics) -> list[Section]:
    """Return the cards of the deck, kind by kind; of raw plates the refined coordinates too."""
    given_in, raw = statistics.block.given_in, statistics.solution.reduced is not None
    unit = AngleUnit.DMS if given_in is None else given_in.unit
    echoed: list[Section] = []
    for spec, (values, angle) in _cards(statistics).items():
        report = report_of(spec, unit, readings=raw and _table(spec) in _READ)
        is_stated = given_in is not None and _table(spec) in _STATED
        title = f"{report.title}, As Stated" if is_stated else report.title
        echoed += [report.section(_printed(spec, values, angle), title=title, new_page=not echoed)]
    return [*echoed, REFINED.section(statistics)] if raw else echoed


def _cards(statistics: Statistics) -> dict[CardSpec, tuple[mapping.Values, float]]:
    """Return what the cards of each kind say, in the order of the family; of plates as they were read."""
    family = card_family()
    said = {spec: (values, angle) for spec, values, angle in assembly.values_of_cards(statistics.block, family)}
    if statistics.solution.reduced is not None:
        read = assembly.values_of_cards(statistics.read, family)
        said |= {spec: (values, angle) for spec, values, angle in read if _table(spec) in job_record.OF_READINGS}
    return {spec: said[spec] for spec in family.cards.values() if spec in said and _is_echoed(spec)}


def _is_echoed(spec: CardSpec) -> bool:
    """Tell whether a card has fields that are not on the first page already, as titles are."""
    return _table(spec) not in ("", "titles")


def _table(spec: CardSpec) -> str:
    """Return the table of the model that a card fills, empty of a card without fields."""
    return mapping.slots(spec)[0].path.partition(".")[0] if spec.fields else ""


def _printed(spec: CardSpec, values: mapping.Values, angle: float) -> Cards:
    """Return what cards say, by field: angles in degrees, minutes and seconds together, in rad."""
    fields = mapping.scatter(spec, values, angle)
    return {
        slot.name: values[slot.path][:, slot.component] if slot.is_sexagesimal else fields[slot.fields[0].name]
        for slot in mapping.slots(spec)
    }


@cache
def report_of(spec: CardSpec, unit: AngleUnit = AngleUnit.DMS, *, readings: bool = False) -> Report[Cards]:
    """Return the echo of a kind of card: a column for each field that any card of the job has filled in.

    `unit` is that of angles without one of their own, `readings` are in the unit of a comparator.
    """
    slots = {slot.fields[0]: slot for slot in reversed(mapping.slots(spec))}  # a field with two letters has one
    stated = tuple(_column(slot, unit, readings=readings) for slot in reversed(slots.values()))
    is_recorded = _table(spec) in parts_of_block() and _table(spec) != "equal_elevations"  # whose rows are groups
    home = job_record.called(f"{_table(spec)}.")[0] if is_recorded or _table(spec) == "water_conditions" else ""
    return Report(
        title=f"Input: {spec.title} ({spec.mnemonic})" + (f": {_READINGS}" if readings else ""),
        path="reduction.readings" if readings and home == "plates" else home,
        columns=(
            Choice(
                (stated,),
                lambda cards: tuple(one for one in stated if _is_given(_values(one, cards))) or stated[:1],
            ),
        ),
        words={name: words for slot in slots.values() for name, words in _words(slot.path)},
        some=True,
    )


def card(mnemonic: str) -> Report[Cards]:
    """Return the echo of a kind of card."""
    return report_of(card_family().cards[mnemonic])


def _values(column: Column[Cards], cards: Cards) -> NDArray[Any]:
    assert column.values is not None
    return np.asarray(column.values(cards))


def _is_given(values: NDArray[Any]) -> bool:
    return bool((values != "").any() if values.dtype.kind == "U" else np.isfinite(values).any())


def _column(slot: mapping.Slot, angle: AngleUnit, *, readings: bool) -> Column[Cards]:
    """Return the column of a field, or of an angle in three of them."""
    field, table, name = slot.fields[-1], *slot.path.partition(".")[::2]
    edit, unit = field.edit, _UNITS.get(field.unit, field.unit)
    if slot.is_sexagesimal:
        width = sum(one.edit.width for one in slot.fields) + 1
        descriptor, unit = f"S{width}.{edit.decimals}", SEXAGESIMAL + " " * (edit.decimals - 1)
    elif edit.letter in "AI":
        descriptor = f"{edit.letter}{edit.width}"
    elif edit.letter == "F":
        descriptor = f"F{edit.width + min(edit.decimals, _WIDER)}.{edit.decimals}"
    else:
        descriptor = f"E{edit.width + 1}.{edit.decimals}"
    if field.unit == STATED_UNIT:
        unit = _ANGLES.get(angle, "")
    elif readings and unit:
        unit = "unit"
    heading = slot.name.replace("_", " ")
    heading = heading if len(heading) < 4 else heading.capitalize()
    room = max(field_width(descriptor), *map(len, heading.split()))
    about = columns(mapping.TABLES[table])[name]
    return Column(
        "\n".join([*textwrap.wrap(heading, room), *([unit] if unit else [])]),
        descriptor,
        lambda cards: cards[slot.name],
        _shown(slot),
        is_id=edit.letter == "A" and bool(about.identity or about.link or about.key or about.sort),
    )


def _shown(slot: mapping.Slot) -> Origin | str:
    """Return what of the record a field shows, nothing where that has it otherwise."""
    if slot.path in _OTHERWISE or slot.path.startswith("points."):
        return ""
    name = job_record.called(slot.path)[1]
    place = f"{name}[{slot.component}]" if slot.component is not None else name
    codes = mapping.CODES.get(slot.path, {})
    if slot.path == "wave_origin.position":
        return f"value[{slot.component}]"
    if slot.path == "water.index":
        return Origin(field=place, blank=True)
    flags = {value: letter for letter, value in codes.items() if letter and isinstance(value, bool)}
    return Origin(field=place, true=flags.get(True, ""), false=flags.get(False, "")) if flags else place


def _words(path: str) -> list[tuple[str, Mapping[str, str]]]:
    """Return what stands on cards for the words of the record, of kinds."""
    codes = mapping.CODES.get(path, {})
    words = {value.name.lower(): letter for letter, value in codes.items() if letter and isinstance(value, IntEnum)}
    return [(job_record.called(path)[1], words)] if words else []


def _all_reports() -> tuple[Report[Any], ...]:
    cards = [spec for spec in card_family().cards.values() if _is_echoed(spec)]
    readings = [report_of(spec, readings=True) for spec in cards if _table(spec) in _READ]
    return (*map(report_of, cards), *readings, REFINED)


STATED = _all_reports()
