"""Echo of the input: every card of the deck of a job, with the fields and units of the card formats."""

from __future__ import annotations

import textwrap
from dataclasses import replace
from enum import IntEnum
from functools import cache, partial
from typing import Any

import numpy as np

from musatpy.formats import assembly, mapping
from musatpy.formats.cards.spec import STATED_UNIT, CardSpec
from musatpy.formats.job_tables import card_family
from musatpy.model import Block
from musatpy.model.block import parts_of_block
from musatpy.model.tables import POSITION_UNIT, Table, columns
from musatpy.reports import job_record, residuals
from musatpy.reports.editing import SEXAGESIMAL, field_width
from musatpy.reports.fields import Field, FieldGroup, Rows, of_job, same
from musatpy.reports.pages import MOST_PAGES, Section, wrapped
from musatpy.reports.table import Report
from musatpy.reports.values import Values
from musatpy.statistics import Statistics
from musatpy.units import AngleUnit


def _trains(statistics: Statistics) -> tuple[Block, Any] | None:
    """Return the block, and what linear theory makes of its waves; None in a job without."""
    block = statistics.block
    if not len(block.waves.ids):
        return None
    from musatpy.sea.deck_waves import wave_trains

    return block, wave_trains(block.waves)


def _shapes(trains: tuple[Block, Any]) -> list[str]:
    from musatpy.sea.deck_waves import SHAPES

    return [str(SHAPES[shape]) for shape in trains[0].waves.shape.tolist()]


WAVES: Rows[Statistics, tuple[Block, Any]] = Rows(
    "waves", "one row per wave on the water; empty where it is level", of=_trains, fields=(
        Field("wave", "string", "wave id", lambda w: w[0].waves.ids, "Wave", "A4", is_id=True),
        Field("shape", "string", "of the wave", _shapes, "Shape", "A10",
              choices=("sinusoidal", "stokes", "trochoidal")),
        Field("depth", "number?", "of the water, for the theory of the wave; null is deep",
              lambda w: w[0].waves.depth, "Depth\nm", "F8.2"),
        Field("period", "number", "as given, or found by linear theory", lambda w: w[1].period, "Period\ns",
              "F8.3"),
        Field("length", "number", "as given, or found by linear theory", lambda w: w[1].length, "Length\nm",
              "F9.3"),
        Field("speed", "number", "of the crests: length over period", lambda w: w[1].speed, "Speed\nm/s", "F8.3"),
        Field("group_speed", "number", "of groups of such waves, by linear theory", lambda w: w[1].group_speed,
              "Group\nm/s", "F8.3"),
        Field("height", "number", "from trough to crest", lambda w: w[0].waves.height, "Height\nm", "F8.3"),
        Field("breaking_height", "number", "that the wave cannot exceed, by linear theory",
              lambda w: w[1].breaking_height, "Breaks at\nm", "F9.2"),
        Field("azimuth", "number", "direction it runs to, clockwise from true north (+Y in LOCL jobs)",
              lambda w: w[0].waves.azimuth, "Towards\ndegrees", "F9.3"),
        Field("crest", "number", "distance from the origin, in that direction, of a crest at time 0",
              lambda w: w[0].waves.crest, "Crest\nm", "F10.3"),
    ),
)  # fmt: skip
WAVE_ORIGIN = Field[Statistics](
    "wave_origin", "3 number or null", "place from which crests count; null without waves",
    lambda s: None if s.block.wave_origin is None else s.block.wave_origin.position, unit=POSITION_UNIT,
)  # fmt: skip
SEA = Report("Waves On The Water", WAVES)


def _waves(statistics: Statistics) -> list[Section]:
    """Return the waves through which a job was adjusted, nothing where its water was level."""
    if not len(statistics.block.waves.ids):
        return []
    notes = [
        "",
        "Heights are from trough to crest, directions clockwise from true north. A crest stands so far from the "
        "origin of",
        "the waves, in the direction they run to, at time 0 of the exposures. A wave without depth is one of deep "
        "water.",
    ]
    return [SEA.section(statistics, notes, together=True)]


# What headings call a unit, where not as the card does; angles of a stated deck are in that of its SYS card.
_UNITS = {"arcsec": "arc sec", "deg": "degrees", "sec": "s"}
_ANGLES = {AngleUnit.DEGREES: "degrees", AngleUnit.GONS: "gon", AngleUnit.RADIANS: "rad"}
_WIDER = 3  # columns that a number may need, besides those of its card, to be printed with all decimals
_READINGS = "Comparator Readings"
_READ = ("plates", "fiducial_measurements")  # tables that have them, where plates are raw
_STATED = ("options", "photos", "control", "wave_origin")  # what may name or use another system than the job
# What the record has of these differs from what stands on the card: the computed index, what a run has used.
_OTHERWISE = ("plates.sigma", "plates.triangulated", "waves.shape")

REFINED = Report(
    "Input: Plate Measurements, Refined",
    residuals.PLATES,
    (
        "photo point",
        residuals.PLATES.column("xy", ("x\nmm", "y\nmm"), "F12.7"),
        residuals.PLATES.column("sigma", ("sigma x\num", "sigma y\num"), "F7.2"),
        of_job("Bath", "A4", lambda s: s.block.points.letters[s.block.plates.point]),
        of_job("Trig", "A4", lambda s: np.where(s.block.plates.triangulated, "", "N")),
    ),
)
_BRIEF = (
    "Without the echo of the input, the residuals of plate measurements, and the coordinates of bathymetric points "
    f"beside their depths; tables are cut to their worst rows where there would be more than {MOST_PAGES} pages. "
    "The record has everything."
)


def brief(statistics: Statistics) -> list[Section]:
    """Return what a brief listing has not, and the waves."""
    return [Section(title="Brief Listing", lines=wrapped([_BRIEF])), *_waves(statistics)]


def sections(statistics: Statistics) -> list[Section]:
    """Return the cards of the deck, kind by kind; of raw plates the refined coordinates too."""
    given_in, raw = statistics.block.given_in, statistics.solution.reduced is not None
    unit = AngleUnit.DMS if given_in is None else given_in.unit
    echoed: list[Section] = []
    for spec, (values, angle) in _cards(statistics).items():
        report = report_of(spec, unit, readings=raw and _table(spec) in _READ)
        is_stated = given_in is not None and _table(spec) in _STATED
        title = f"{report.title}, As Stated" if is_stated else report.title
        echoed += [report.section(_said(spec, values, angle), title=title, new_page=not echoed)]
    return [*echoed, *([REFINED.section(statistics)] if raw else []), *_waves(statistics)]


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


def _said(spec: CardSpec, values: mapping.Values, angle: float) -> Values:
    """Return what cards say as columns of the record: letters as they are there, numbers in its units."""
    letters = mapping.scatter(spec, values, angle)
    said = {
        _called(slot): letters[slot.fields[0].name] if slot.path in mapping.CODES else values[slot.path]
        for slot in reversed(mapping.slots(spec))
    }
    return Values(list(said), said.__getitem__, source=spec)


@cache
def report_of(spec: CardSpec, unit: AngleUnit = AngleUnit.DMS, *, readings: bool = False) -> Report[Any]:
    """Return the echo of a kind of card: a column for each field that any card of the job has filled in.

    `unit` is that of angles without one of their own, `readings` are in the unit of a comparator.
    """
    slots = {slot.fields[0]: slot for slot in reversed(mapping.slots(spec))}  # a field with two letters has one
    first, *others = (_column(slot, unit, readings=readings) for slot in reversed(slots.values()))
    table = _record_of(_table(spec))
    places = {"plates": "reduction.readings" if readings else "", "wave_origin": "."}  # the record itself
    return Report(
        f"Input: {spec.title} ({spec.mnemonic})" + (f": {_READINGS}" if readings else ""),
        table,
        (first, *(replace(column, when=partial(_is_given, column)) for column in others)),
        path=places.get(_table(spec), ""),
        some=True,
    )


def _record_of(table: str) -> Rows[Any, Any] | FieldGroup[Any, Any] | None:
    """Return what the record has of a table of the model, None where that is something else."""
    if table == "wave_origin":
        return FieldGroup(table, "", (WAVE_ORIGIN,))
    if table == "equal_elevations" or table not in ("water_conditions", *parts_of_block()):  # rows are groups
        return None
    stated = job_record.table if issubclass(mapping.TABLES[table], Table) else job_record.part
    return stated(table, job_record.called(f"{table}.")[0], same)


def card(mnemonic: str) -> Report[Any]:
    """Return the echo of a kind of card."""
    return report_of(card_family().cards[mnemonic])


def _is_given(column: Field[Any], said: Values) -> bool:
    values = np.asarray(column.exactly(said))
    return bool((values != "").any() if values.dtype.kind == "U" else np.isfinite(values).any())


def _column(slot: mapping.Slot, angle: AngleUnit, *, readings: bool) -> Field[Any]:
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
    codes = mapping.CODES.get(slot.path, {})
    return Field(
        _called(slot) if slot.component is None else f"{_called(slot)}[{slot.component}]",
        heading="\n".join([*textwrap.wrap(heading, room), *([unit] if unit else [])]),
        edit=descriptor,
        is_id=edit.letter == "A" and bool(about.identity or about.link or about.key or about.sort),
        words={value.name.lower() if isinstance(value, IntEnum) else value: text for text, value in codes.items()},
        blank=slot.path == "water.index",
        of_run=slot.path in _OTHERWISE or table == "points",
        card_width=edit.width if edit.is_number else 0,
    )


def _called(slot: mapping.Slot) -> str:
    """Return what the record calls an attribute."""
    return "wave_origin" if slot.path == "wave_origin.position" else job_record.called(slot.path)[1]


_ECHOED = [spec for spec in card_family().cards.values() if _is_echoed(spec)]
_READINGS_OF = [report_of(spec, readings=True) for spec in _ECHOED if _table(spec) in _READ]
STATED = (*map(report_of, _ECHOED), *_READINGS_OF, REFINED, SEA)
