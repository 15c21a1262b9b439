"""What a card looks like: fields, cards and families of cards, stated once in TOML and checked on loading."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import musatpy
from musatpy.errors import CardFormatError
from musatpy.fortran import (
    Blank,
    Edit,
    FieldError,
    fit_number,
    parse_edit,
    read_number,
    read_text,
    write_text,
)
from musatpy.specs import read_toml

CARD_WIDTH = 80
DATA_COLUMNS = (4, 72)  # where fields may stand: after the mnemonic, before the sequence number
UNITS = ("", "m", "mm", "um", "deg", "min", "s", "arcsec", "degC", "ppt", "nm", "hPa", "sec", "m/s")
STATED_UNIT = "angle"  # of angles in the unit that the deck says on its SYS card
END_MNEMONIC = "END"  # the card of a family that ends its decks

_TARGET = re.compile(r"[A-Za-z]\w*(\[\w+\])*(\.[A-Za-z]\w*(\[\w+\])*)*(:(deg|min|sec))?", re.ASCII)
_MNEMONIC = re.compile(r"[A-Z][A-Z0-9]{2}", re.ASCII)
_NAME = re.compile(r"[a-z][a-z0-9_]*", re.ASCII)


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldSpec:
    """One field of a card.

    A blank field is an error, no value (NaN, or empty text), or zero, as `blank` says; asterisks in place of a
    number are no value where `asterisks` allows them. A text that is not blank is one of `allowed`, where given.
    """

    name: str
    first: int  # columns, 1-based, inclusive
    last: int
    edit: Edit
    unit: str = ""
    target: str = ""  # where the value goes in the model, dotted
    blank: Blank = "error"
    asterisks: bool = False
    allowed: tuple[str, ...] = ()
    doc: str = ""

    def decode(self, text: str) -> float | str:
        """Return the value of `text`, the columns of the field: a number, NaN for none; or text, outer blanks cut.

        Raises `FieldError`.
        """
        if self.edit.is_number:
            return read_number(text, self.edit, blank=self.blank, asterisks=self.asterisks)
        value = read_text(text, self.edit).strip(" ")
        if not value:
            if self.blank == "error":
                raise FieldError(text, self.expected)
            return ""
        if self.allowed and value not in self.allowed:
            raise FieldError(value, self.expected)
        return value

    def encode(self, value: float | str) -> str:
        """Return the columns of the field: text left-justified, a number right-justified and never asterisks.

        Raises `FieldError` for a value that does not fit, that is not allowed, or that is missing where the blank
        rule does not read a blank field as missing.
        """
        if isinstance(value, str):
            return self._encode_text(value)
        if math.isnan(value) and self.blank != "missing":
            raise FieldError("nan", f"a value of {self.edit}")
        return fit_number(value, self.edit)

    def _encode_text(self, value: str) -> str:
        if not value and self.blank == "error":
            raise FieldError(value, self.expected)
        if (
            len(value) > self.edit.width
            or value != value.strip(" ")
            or not (value.isascii() and value.isprintable())
        ):
            raise FieldError(value, f"{self.edit} (up to {self.edit.width} ASCII characters, no outer blanks)")
        if value and self.allowed and value not in self.allowed:
            raise FieldError(value, self.expected)
        return write_text(value.ljust(self.edit.width), self.edit)

    @property
    def expected(self) -> str:
        """What the field wants, for messages: `F12.6`, or `A4 (one of GEOG, GEOC, LOCL)`."""
        return f"{self.edit} (one of {', '.join(self.allowed)})" if self.allowed else str(self.edit)


@dataclass(frozen=True, kw_only=True, eq=False)
class CardSpec:
    """One kind of card. `order` is its place in a canonical deck."""

    mnemonic: str
    title: str
    doc: str
    order: int
    repeat: Literal["one", "many"]
    required: bool
    sample: str
    fields: tuple[FieldSpec, ...]
    file: str = ""  # where all this stands

    def field(self, name: str) -> FieldSpec:
        """Return the field called `name`; raises `KeyError`."""
        for field in self.fields:
            if field.name == name:
                return field
        raise KeyError(f"{self.mnemonic}.{name}")

    def encode(self, values: Mapping[str, float | str], number: int) -> str:
        """Return one canonical card of 80 columns with its sequence number. Raises `FieldError` as fields do."""
        card = self.mnemonic
        for field in sorted(self.fields, key=lambda field: field.first):
            card = card.ljust(field.first - 1) + field.encode(values[field.name])
        return f"{card.ljust(DATA_COLUMNS[1])}{number:08d}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Family:
    """The cards of one agency or program, by mnemonic, in canonical order."""

    name: str
    cards: Mapping[str, CardSpec]


def card_formats_folder() -> Path:
    """Return the folder that holds the families: in the installed package, or in the checkout it is run from.

    Raises `CardFormatError` where neither is there.
    """
    package = Path(musatpy.__file__).resolve().parent
    for folder in (package / "card_formats", package.parents[1] / "card_formats"):
        if folder.is_dir():
            return folder
    raise CardFormatError(f"no card_formats folder in {package} nor in {package.parents[1]}")


def load_family(folder: Path | str) -> Family:
    """Return the family of cards that the TOML files of `folder` describe.

    Raises `CardFormatError`, naming file and key, for whatever is wrong with them: unknown or missing keys, columns
    that overlap, leave 4-72 or do not fit the descriptor, duplicate names and mnemonics, unknown units and targets
    that are no attribute, and samples that do not decode and encode again to the same card.
    """
    folder = Path(folder)
    paths = sorted(folder.glob("*.toml"))
    if not paths:
        raise CardFormatError(f"{folder}: no card formats (*.toml)")
    specs: dict[str, CardSpec] = {}
    for path in paths:
        spec = _load_card(path)
        if spec.mnemonic in specs:
            raise CardFormatError(f"{path}: mnemonic: {spec.mnemonic} is already in another file of the folder")
        specs[spec.mnemonic] = spec
    ordered = sorted(specs.values(), key=lambda spec: (spec.order, spec.mnemonic))
    return Family(name=folder.name, cards=MappingProxyType({spec.mnemonic: spec for spec in ordered}))


class Key(NamedTuple):
    """One key of a card format file."""

    type: type
    required: bool
    doc: str


CARD_KEYS = {
    "mnemonic": Key(str, True, "three capitals or digits in columns 1-3 that name the card"),
    "title": Key(str, True, "what the card is called"),
    "doc": Key(str, True, "what it is for"),
    "order": Key(int, True, "place of the card in a canonical deck; on reading any order is accepted"),
    "repeat": Key(str, True, "`one` or `many` cards in a deck"),
    "required": Key(bool, True, "whether a deck must have the card"),
    "sample": Key(str, True, "a canonical card, 80 columns, number 1; it must decode and encode to itself"),
    "field": Key(list, False, "the fields, one `[[field]]` table each"),
}
FIELD_KEYS = {
    "name": Key(str, True, "lower case identifier, unique on the card"),
    "columns": Key(list, True, "`[first, last]`, counted from 1, within 4-72, of no other field"),
    "edit": Key(str, True, "FORTRAN edit descriptor (`Iw`, `Fw.d`, `Ew.d`, `Dw.d`, `Aw`) as wide as the columns"),
    "unit": Key(
        str,
        False,
        "`m`, `mm`, `um`, `deg`, `min`, `s`, `arcsec`, `degC`, `ppt` (parts per thousand), `nm`, `hPa`, "
        "`sec` (seconds of time), `m/s`, "
        "`angle` (that of the SYS card), or empty",
    ),
    "target": Key(str, True, "the attribute of the block that holds the value; `:deg`, `:min`, `:sec` of an angle"),
    "blank": Key(str, False, "a blank field is an `error` (so without the key), `missing` (no value) or `zero`"),
    "asterisks": Key(bool, False, "whether asterisks, a FORTRAN overflow, read as no value; numbers only"),
    "allowed": Key(list, False, "the values that a text may have"),
    "doc": Key(str, True, "what the field means"),
}


def require(holds: bool, where: str, what: str) -> None:
    """Raise `CardFormatError` saying `where` and `what` unless it holds."""
    if not holds:
        raise CardFormatError(f"{where}: {what}")


def check_keys(table: object, keys: Mapping[str, Key], where: str) -> dict[str, Any]:
    """Return `table` when its keys are among `keys`, the required ones are there and all have their type."""
    if not isinstance(table, dict):
        raise CardFormatError(f"{where}: not a table")
    for key, value in table.items():
        if key not in keys:
            raise CardFormatError(f"{where}: {key}: unknown key; known are {', '.join(keys)}")
        if type(value) is not keys[key].type:
            raise CardFormatError(f"{where}: {key}: {value!r} is not a {keys[key].type.__name__}")
    for key, known in keys.items():
        if known.required and key not in table:
            raise CardFormatError(f"{where}: {key}: key is missing")
    return table


def _load_card(path: Path) -> CardSpec:
    try:
        raw = read_toml(path)
    except ValueError as error:
        raise CardFormatError(f"{path}: {error}") from error
    where = str(path)
    table = check_keys(raw, CARD_KEYS, where)
    mnemonic = table["mnemonic"]
    require(bool(_MNEMONIC.fullmatch(mnemonic)), f"{where}: mnemonic", f"{mnemonic!r} is not three capitals")
    require(table["repeat"] in ("one", "many"), f"{where}: repeat", "not one or many")
    fields = tuple(_load_field(field, f"{where}: field {i}") for i, field in enumerate(table.pop("field", []), 1))
    _check_fields(fields, where)
    spec = CardSpec(**table, fields=fields, file=where)
    _check_sample(spec, f"{where}: sample")
    return spec


def _load_field(raw: object, where: str) -> FieldSpec:
    table = dict(check_keys(raw, FIELD_KEYS, where))
    name = table["name"]
    require(bool(_NAME.fullmatch(name)), f"{where}: name", f"{name!r} is not a lower case identifier")
    where = f"{where} ({name})"
    try:
        edit = parse_edit(table.pop("edit"))
    except FieldError as error:
        raise CardFormatError(f"{where}: edit: {error}") from error
    require(edit.letter != "X", f"{where}: edit", "columns to skip need no field")
    first, last = _check_columns(table.pop("columns"), edit, f"{where}: columns")
    require(table.get("unit", "") in (*UNITS, STATED_UNIT), f"{where}: unit", f"not one of {UNITS}, {STATED_UNIT}")
    require(bool(_TARGET.fullmatch(table["target"])), f"{where}: target", "not a dotted attribute")
    blanks = ("error", "missing", "zero") if edit.is_number else ("error", "missing")
    require(table.get("blank", "error") in blanks, f"{where}: blank", f"not one of {blanks}")
    require(edit.is_number or "asterisks" not in table, f"{where}: asterisks", "only for numbers")
    table["allowed"] = _check_allowed(table.get("allowed", []), edit, f"{where}: allowed")
    return FieldSpec(**table, first=first, last=last, edit=edit)


def _check_columns(columns: list[object], edit: Edit, where: str) -> tuple[int, int]:
    match columns:
        case [int(first), int(last)]:
            low, high = DATA_COLUMNS
            require(low <= first <= last <= high, where, f"{first}-{last} is not within {low}-{high}")
            width = last - first + 1
            require(width == edit.width, where, f"{first}-{last} is {width} wide, {edit} is {edit.width}")
            return first, last
    raise CardFormatError(f"{where}: not [first, last]")


def _check_allowed(allowed: Sequence[object], edit: Edit, where: str) -> tuple[str, ...]:
    texts = tuple(text for text in allowed if isinstance(text, str))
    require(len(texts) == len(allowed), where, "not a list of strings")
    require(not texts or edit.letter == "A", where, "only for texts (Aw)")
    require(all(text and len(text) <= edit.width for text in texts), where, f"values that do not fit {edit}")
    return texts


def _check_fields(fields: Sequence[FieldSpec], where: str) -> None:
    names = [field.name for field in fields]
    for name in names:
        require(names.count(name) == 1, f"{where}: field {name}", "a second field has the same name")
    for field, after in pairwise(sorted(fields, key=lambda field: field.first)):
        require(field.last < after.first, f"{where}: field {after.name}: columns", f"overlap those of {field.name}")


def _check_sample(spec: CardSpec, where: str) -> None:
    try:
        values = {field.name: field.decode(spec.sample[field.first - 1 : field.last]) for field in spec.fields}
        card = spec.encode(values, 1)
    except FieldError as error:
        raise CardFormatError(f"{where}: {error}") from error
    require(card == spec.sample, where, f"does not encode to itself:\n    {spec.sample}\n    {card}")
