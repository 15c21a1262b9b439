"""Cards out of the rows of a table whose columns have the names of the fields."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from musatpy.errors import DeckError, Problem, in_order
from musatpy.formats.cards.manual import card_of
from musatpy.formats.cards.settings import PARTS, Setting, SettingError, setting_of
from musatpy.formats.cards.spec import CardSpec, Family
from musatpy.pointfiles.columns import FileColumn, Wanted
from musatpy.pointfiles.point_tables import PointTable, read_table


def cards_of_table(path: Path, spec: CardSpec, family: Family) -> list[str]:
    """Return a card of `spec` for each row of a table, without sequence numbers.

    Values are in the units of the card; a field without a column is blank. The three fields of an angle may be one
    column of degrees, minutes and seconds. Raises `DeckError` with everything that is wrong, by line and column of
    the table, and `OSError`.
    """
    table = read_table(path, wanted_of(spec))
    table.require(DeckError, empty="no rows")
    names = [column.name for column in table.layout.columns.values()]
    texts = zip(*(table.texts(name) for name in names), strict=True)
    cards, problems = list[str](), list[Problem]()
    for row, values in enumerate(texts):
        settings, wrong = _settings(spec, table, row, dict(zip(names, values, strict=True)))
        card, faults = card_of(spec, settings, family)
        cards.append(card)
        problems += wrong or [replace(fault, file=str(path), line=table.lines[row]) for fault in faults]
    if any(problem.severity == "error" for problem in problems):
        raise DeckError(in_order(problems))
    return cards


def wanted_of(spec: CardSpec) -> Wanted:
    """Return the columns that a table of such cards may have: fields that must not be blank must be there."""
    names = [field.name for field in spec.fields]
    first = f"_{PARTS[0]}"
    angles = [name.removesuffix(first) for name in names if name.endswith(first)]
    must = {
        field.name
        for field in spec.fields
        if field.blank == "error" and not any(field.name.startswith(f"{angle}_") for angle in angles)
    }
    columns = [
        FileColumn(name=name.lower(), aliases=(), kind="text", required=name in must, blank=name not in must)
        for name in [*names, *angles]
    ]
    return Wanted(columns=tuple(columns), closed=True)


def _settings(
    spec: CardSpec, table: PointTable, row: int, values: dict[str, str]
) -> tuple[list[Setting], list[Problem]]:
    """Return what the columns of the card of a row are to be, and the values that cannot stand there."""
    settings, problems = list[Setting](), list[Problem]()
    texts = {field.name for field in spec.fields if not field.edit.is_number}
    for name, text in values.items():
        if name not in texts and table.layout.separator != ",":
            text = text.replace(",", ".")
        if text:
            try:
                settings.append(setting_of(spec, name, text))
            except SettingError as error:
                problems.append(table.layout.fault((table.lines[row], table.rows[row]), name, str(error)))
    return settings, problems
