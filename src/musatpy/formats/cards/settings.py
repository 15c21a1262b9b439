"""Fields of cards by their names, as people say them: `OP2.water_level=ONE` -> the columns of a card."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from musatpy.errors import MusatError, nearest, nearest_or_all
from musatpy.formats.cards.codec import bytes_of, text_of
from musatpy.formats.cards.spec import DATA_COLUMNS, END_MNEMONIC, CardSpec, Family, FieldSpec
from musatpy.fortran import FieldError

PARTS = ("deg", "min", "sec")
_SETTING = re.compile(r"([^.=\s]+)\.([^.=\s]+)\s*=(.*)", re.DOTALL)


class SettingError(MusatError):
    """A field that no card has, or a value that it cannot take."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """A field of a card, or the three of an angle, with what is to stand in their columns."""

    card: str
    name: str
    value: str
    columns: tuple[tuple[int, str], ...]  # first column, and the text from there on

    def __str__(self) -> str:
        return f"{self.card}.{self.name}={self.value}"


def card_named(cards: Mapping[str, CardSpec], name: str) -> CardSpec:
    """Return the card of a mnemonic, in small letters too; raises `SettingError` with the nearest that there is."""
    if name.upper() not in cards:
        raise SettingError(f"no card '{name}'{nearest_or_all(name.upper(), cards)}")
    return cards[name.upper()]


def settings_of(texts: Iterable[str], family: Family) -> tuple[Setting, ...]:
    """Return what `CARD.FIELD=VALUE` says of cards that a deck has once, the last where a field is said twice.

    Raises `SettingError`.
    """
    settings: dict[tuple[str, str], Setting] = {}
    for text in texts:
        match = _SETTING.fullmatch(text.strip())
        single = single_cards(family)
        if match is None:
            raise SettingError(f"'{text}' is not CARD.FIELD=VALUE{_with_card(text, single)}")
        spec = card_named(family.cards, match[1])
        if spec.mnemonic not in single:
            raise SettingError(f"{spec.mnemonic}: a deck may have many such cards; --set takes {', '.join(single)}")
        setting = setting_of(spec, match[2], match[3])
        settings[setting.card, setting.name] = setting
    return tuple(settings.values())


def single_cards(family: Family) -> dict[str, CardSpec]:
    """Return the cards that a deck has once, by their mnemonics."""
    return {name: card for name, card in family.cards.items() if card.repeat == "one" and card.fields}


def _with_card(text: str, cards: Mapping[str, CardSpec]) -> str:
    """Return the end of a message about a setting without a card: those that have such a field, or an example."""
    name, equals, value = text.strip().partition("=")
    named = {f"{card}.{field.name}": field.name for card, spec in cards.items() for field in spec.fields}
    likely = nearest(name.strip().lower(), named.values()) if equals else ""
    meant = [f"{place}={value}" for place, field in named.items() if field == likely]
    return f"; did you mean {' or '.join(meant)}?" if meant else ", such as OP2.water_level=ONE"


def setting_of(spec: CardSpec, name: str, text: str) -> Setting:
    """Return the setting of a field to what a text says: a number, one of its words, nothing for a blank.

    An angle in three fields `NAME_deg`, `NAME_min`, `NAME_sec` may be said as `NAME`: degrees, minutes and seconds
    with blanks or colons between. Raises `SettingError`.
    """
    fields = {field.name: field for field in spec.fields}
    parts = [f"{name}_{part}" for part in PARTS]
    if name not in fields and all(part in fields for part in parts):
        words = text.replace(":", " ").split()
        if words and len(words) != len(parts):
            raise SettingError(f"{spec.mnemonic}.{name}: '{text}' is not degrees, minutes and seconds")
        values = dict(zip(parts, words or [""] * len(parts), strict=True))
    elif name in fields:
        values = {name: text.strip()}
    else:
        known = [field.name for field in spec.fields]
        raise SettingError(f"{spec.mnemonic} has no field '{name}'{nearest_or_all(name, known)}")
    columns = tuple((fields[part].first, _columns(spec, fields[part], value)) for part, value in values.items())
    shown = " ".join(column.strip() for _, column in columns).strip()
    return Setting(card=spec.mnemonic, name=name, value=shown, columns=columns)


def _columns(spec: CardSpec, field: FieldSpec, text: str) -> str:
    """Return the columns of a field that say a text, which a person does not punch: 5 is 5 in a field F8.3."""
    where, capitals = f"{spec.mnemonic}.{field.name}", text.upper()
    try:
        if not text:
            columns = " " * field.edit.width
            field.decode(columns)
            return columns
        value = _number(field, text) if field.edit.is_number else (capitals if capitals in field.allowed else text)
        columns = field.encode(value)
        read = field.decode(columns)
    except FieldError as error:
        likely = nearest(capitals, field.allowed)
        meant = f"; did you mean {likely}?" if likely else ""
        raise SettingError(f"{where}: '{text}' is not {error.expected}{meant}") from error
    if read != value and abs(float(read) - float(value)) > 1e-12 * abs(float(value)):
        raise SettingError(f"{where}: '{text}' does not fit {field.edit}: {columns.strip()} would be read")
    return columns


def _number(field: FieldSpec, text: str) -> float:
    try:
        number = float(re.sub("[dD]", "E", text))
    except ValueError as error:
        raise FieldError(text, "a number") from error
    if field.edit.letter == "I" and number != round(number):
        raise FieldError(text, f"a whole number ({field.edit})")
    return -0.0 if number == 0.0 and text.startswith("-") else number


def blank_card(spec: CardSpec) -> str:
    """Return a card with nothing on it, up to the sequence number."""
    return spec.mnemonic.ljust(DATA_COLUMNS[1])


def card_with(card: str, settings: Iterable[Setting]) -> str:
    """Return a card with other columns."""
    for setting in settings:
        for first, text in setting.columns:
            card = card.ljust(first - 1)
            card = card[: first - 1] + text + card[first - 1 + len(text) :]
    return card


def deck_with(data: bytes, settings: Iterable[Setting]) -> bytes:
    """Return a deck in which cards say something else: in their columns; a missing card stands before the END.

    All else stays as it is, byte by byte. A deck without END, which is an error, gets no cards.
    """
    by_card: dict[str, list[Setting]] = {}
    for setting in settings:
        by_card.setdefault(setting.card, []).append(setting)
    text, encoding = text_of(data)
    lines = re.findall(r"[^\n]*\n|[^\n]+", text)
    for mnemonic, of_card in by_card.items():
        row, end = (
            next((row for row, line in enumerate(lines) if line.startswith(name)), None)
            for name in (mnemonic, END_MNEMONIC)
        )
        if row is not None:
            card = lines[row].rstrip("\r\n")
            lines[row] = card_with(card, of_card) + lines[row][len(card) :]
        elif end is not None:
            lines.insert(end, card_with(mnemonic, of_card) + "\n")
    return bytes_of("".join(lines), encoding)
