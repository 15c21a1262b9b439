"""Cards of what was typed: words with blanks between, put into columns where there is one way to do so, or a table.

The columns of a table have the names of the fields.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

from musatpy.errors import DeckError, Problem, in_order, nearest_or_all
from musatpy.formats.cards.codec import bytes_of, text_of
from musatpy.formats.cards.deck import read_cards
from musatpy.formats.cards.manual import card_of
from musatpy.formats.cards.settings import PARTS, Setting, SettingError, blank_card, card_with, setting_of
from musatpy.formats.cards.spec import DATA_COLUMNS, CardSpec, Family, FieldSpec
from musatpy.pointfiles.columns import FileColumn, Wanted
from musatpy.pointfiles.point_tables import PointTable, read_table


@dataclass(frozen=True, kw_only=True)
class TidyDeck:
    """A deck whose typed cards stand in their columns; every other line is as it was, byte by byte."""

    data: bytes
    changed: tuple[tuple[int, str, str], ...]  # line, the card as typed, the card in its columns
    problems: tuple[Problem, ...]  # of lines that are neither cards nor can be made one


def tidied(data: bytes, family: Family, file: str = "deck") -> TidyDeck:
    """Return a deck in which words that were typed freely stand in the columns of their card.

    A line that reads well as it stands is kept. Of others the words go to the fields in their order, from the first
    on; where they do not fit so, to the only fields that can take them in that order. A line for which there is no
    such way, or more than one, is kept and has a problem.
    """
    text, encoding = text_of(data)
    lines = re.findall(r"[^\n]*\n|[^\n]+", text)
    deck = read_cards(data, family, name=file)
    wrong = {problem.line for problem in deck.problems if problem.severity == "error" and problem.line is not None}
    if not deck.images.count:  # no line begins with a card
        wrong = {number for number, line in enumerate(lines, 1) if line.strip()}
    changed, problems = list[tuple[int, str, str]](), list[Problem]()
    for number in sorted(wrong):
        text = lines[number - 1].rstrip("\r\n")
        card, fault = tidy_card(text, family)
        if fault:
            problems.append(Problem(file=file, line=number, text=text, message=fault))
        elif card.rstrip() != text.rstrip():
            lines[number - 1] = card.rstrip() + lines[number - 1][len(text) :]
            changed.append((number, text, card.rstrip()))
    return TidyDeck(data=bytes_of("".join(lines), encoding), changed=tuple(changed), problems=tuple(problems))


def tidy_card(text: str, family: Family) -> tuple[str, str]:
    """Return the card of a line of words, and why there is none.

    A line with every word in columns of a field of its own is no line of words: what is wrong is one of its values.
    """
    in_capitals = text.upper() if text == text.lower() else text[:3].upper() + text[3:]
    faults = [one for one in read_cards(f"{in_capitals}\n".encode(), family).problems if one.line == 1]
    faults = [one for one in faults if one.severity == "error"]
    if not faults:
        return in_capitals, ""
    if _in_columns(in_capitals, family):
        return text, faults[0].headline().partition(" ")[2]
    end = DATA_COLUMNS[1]  # behind it a number of the sequence says nothing
    mnemonic, *words = (text[:end] if text[end:].strip().isdigit() else text).split() or [""]
    spec = family.cards.get(mnemonic.upper())
    if spec is None:
        return text, f"'{mnemonic}' is no card{nearest_or_all(mnemonic.upper(), family.cards)}"
    fields = sorted(spec.fields, key=lambda field: field.first)
    if len(fields) == 1 and not fields[0].edit.is_number:  # a title has blanks
        words = [text.strip()[len(mnemonic) :].strip()]
    if len(words) > len(fields):
        return text, f"{len(words)} words for the {len(fields)} fields of {spec.mnemonic}"
    try:
        settings = [setting_of(spec, field.name, word) for field, word in zip(fields, words, strict=False)]
    except SettingError as error:
        ways, why = list(islice(_ways(spec, fields, words), 2)), str(error)
    else:
        missing = [field.name for field in fields[len(words) :] if field.blank == "error"]
        ways, why = [] if missing else [settings], f"no word for {', '.join(missing)}"
    if len(ways) > 1:
        both = [" ".join(f"{setting.name}={setting.value}" for setting in way) for way in ways]
        return text, f"in more than one way a card {spec.mnemonic}: {both[0]}, or {both[1]}"
    return (card_with(blank_card(spec), ways[0]), "") if ways else (text, why)


def _in_columns(text: str, family: Family) -> bool:
    """Tell whether each word stands in columns of a field, and no two in those of one."""
    spec = family.cards.get(text[:3])
    words = [] if spec is None else list(re.finditer(r"\S+", text[: DATA_COLUMNS[1]]))[1:]
    homes = [
        next((f.name for f in spec.fields if f.first <= word.start() + 1 and word.end() <= f.last), "")
        for word in words
        if spec is not None
    ]
    return len(words) > 1 and all(homes) and len(set(homes)) == len(homes)


def _ways(spec: CardSpec, fields: Sequence[FieldSpec], words: Sequence[str]) -> Iterator[list[Setting]]:
    """Yield the ways in which fields can take words in their order, what is left being blank."""
    if not words:
        if all(field.blank != "error" for field in fields):
            yield []
        return
    if len(words) > len(fields):
        return
    with suppress(SettingError):
        setting = setting_of(spec, fields[0].name, words[0])
        yield from ([setting, *others] for others in _ways(spec, fields[1:], words[1:]))
    if fields[0].blank != "error":
        yield from _ways(spec, fields[1:], words)


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
