"""What a card looks like: fields, cards and families of cards, stated once in TOML and checked on loading."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import musatpy
from musatpy import fortran
from musatpy.errors import CardFormatError, Problem
from musatpy.specs import Reader, key, read_toml, require

CARD_WIDTH = 80
DATA_COLUMNS = (4, 72)  # where fields may stand: after the mnemonic, before the sequence number
UNITS = ("", "m", "mm", "um", "deg", "min", "s", "arcsec", "degC", "ppt", "nm", "hPa", "sec", "m/s")
STATED_UNIT = "angle"  # of angles in the unit that the deck says on its SYS card
_PARTS = {"deg": "deg", "min": "min", "sec": "s"}  # units of what targets call parts of an angle
_SIGMA = re.compile(r"(sigma|\.pointing)(\[\d+\])?$", re.ASCII)  # targets of standard deviations
END_MNEMONIC = "END"  # the card of a family that ends its decks


def _matching(pattern: re.Pattern[str], wrong: str) -> Callable[[Any], str]:
    def convert(value: Any) -> str:
        require(isinstance(value, str) and bool(pattern.fullmatch(value)), wrong.format(repr(value)))
        return str(value)

    return convert


_mnemonic = _matching(re.compile(r"[A-Z][A-Z0-9]{2}", re.ASCII), "{} is not three capitals")
_identifier = _matching(re.compile(r"[a-z][a-z0-9_]*", re.ASCII), "{} is not a lower case identifier")


def _edit(text: Any) -> fortran.Edit:
    require(isinstance(text, str), f"{text!r} is not a str")
    return fortran.parse_edit(text)


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldSpec:
    """One field of a card.

    A blank field is an error, no value (NaN, or empty text), or zero, as `blank` says; asterisks in place of a
    number are no value where `asterisks` allows them. A text that is not blank is one of `allowed`, where given.
    """

    name: str = key(doc="lower case identifier, unique on the card", convert=_identifier)
    columns: tuple[int, int] = key(doc="`[first, last]`, counted from 1, within 4-72, of no other field")
    edit: fortran.Edit = key(
        doc="FORTRAN edit descriptor (`Iw`, `Fw.d`, `Ew.d`, `Dw.d`, `Aw`) as wide as the columns", convert=_edit
    )
    unit: str = key(
        "",
        "`m`, `mm`, `um`, `deg`, `min`, `s`, `arcsec`, `degC`, `ppt` (parts per thousand), `nm`, `hPa`, "
        "`sec` (seconds of time), `m/s`, `angle` (that of the SYS card), or empty; an angle's parts have theirs",
        choices=(*UNITS, STATED_UNIT),
    )
    target: str = key(
        "",
        "the attribute of the block that holds the value; `:deg`, `:min`, `:sec` of an angle",
        required=True,
    )
    blank: fortran.Blank = key(
        "error", "a blank field is an `error` (so without the key), `missing` (no value) or `zero`"
    )
    asterisks: bool = key(False, "whether asterisks, a FORTRAN overflow, read as no value; numbers only")
    allowed: tuple[str, ...] = key((), "the values that a text may have")
    letters: bool = key(False, "whether a text may have letters beyond ASCII, as titles have")
    bound: tuple[str, float, str] | None = key(
        None, '`[">" or ">=", number, message]`: what a number must be, in inside units'
    )
    most: tuple[float, str] | None = key(
        None, "`[number, message]`: beyond which it cannot be, in the unit of the field; angles in degrees"
    )
    doc: str = key("", "what the field means", required=True)

    @property
    def first(self) -> int:
        """The first column, from 1."""
        return self.columns[0]

    @property
    def last(self) -> int:
        """The last column."""
        return self.columns[1]

    def check(self) -> None:
        """Raise `ValueError` for a field that contradicts itself."""
        edit, (low, high) = self.edit, DATA_COLUMNS
        require(
            low <= self.first <= self.last <= high, f"columns: {self.first}-{self.last} is not within {low}-{high}"
        )
        self.check_width()
        blanks = ("error", "missing", "zero") if edit.is_number else ("error", "missing")
        require(self.blank in blanks, f"blank: not one of {blanks}")
        require(edit.is_number or not self.asterisks, "asterisks: only for numbers")
        require(self.bound is None or self.bound[0] in (">", ">="), 'bound: not [">" or ">=", number, message]')
        require(not self.allowed or edit.letter == "A", "allowed: only for texts (Aw)")
        fits = all(text and len(text) <= edit.width for text in self.allowed)
        require(fits, f"allowed: values that do not fit {edit}")

    def check_width(self) -> None:
        """Raise `ValueError` where the descriptor is not as wide as the columns."""
        first, last = self.columns
        width = last - first + 1
        require(
            width == self.edit.width, f"columns: {first}-{last} is {width} wide, {self.edit} is {self.edit.width}"
        )

    def decode(self, text: str) -> float | str:
        """Return the value of `text`, the columns of the field: a number, NaN for none; or text, outer blanks cut.

        Raises `FieldError`.
        """
        if self.edit.is_number:
            return fortran.read_number(text, self.edit, blank=self.blank, asterisks=self.asterisks)
        value = text[: self.edit.width].strip(" ")
        if not value:
            if self.blank == "error":
                raise fortran.FieldError(text, self.expected)
            return ""
        if self.allowed and value not in self.allowed:
            raise fortran.FieldError(value, self.expected)
        return value

    def encode(self, value: float | str) -> str:
        """Return the columns of the field: text left-justified, a number right-justified and never asterisks.

        Raises `FieldError` for a value that does not fit, that is not allowed, or that is missing where the blank
        rule does not read a blank field as missing.
        """
        if isinstance(value, str):
            width = self.edit.width
            if not value and self.blank == "error":
                raise fortran.FieldError(value, self.expected)
            known = (self.letters or value.isascii()) and value.isprintable()
            if len(value) > width or value != value.strip(" ") or not known:
                characters = "characters" if self.letters else "ASCII characters"
                raise fortran.FieldError(value, f"{self.edit} (up to {width} {characters}, no outer blanks)")
            if value and self.allowed and value not in self.allowed:
                raise fortran.FieldError(value, self.expected)
            return value.ljust(width)
        if math.isnan(value) and self.blank != "missing":
            raise fortran.FieldError("nan", f"a value of {self.edit}")
        return fortran.fit_number(value, self.edit, all_digits=self.is_sigma)

    @property
    def is_sigma(self) -> bool:
        """Whether it is a standard deviation: one is written with all digits that the columns hold."""
        return self.edit.letter == "F" and bool(_SIGMA.search(self.target))

    def problem(self, error: fortran.FieldError, message: str = "", **place: Any) -> Problem:
        """Return the problem of a text that does not decode, or of a value that does not fit, at some place."""
        columns, found = self.columns, error.found
        if not message:  # a text
            found = found.strip()
            message = "" if found else f"blank, expected {error.expected}"
        details = {"columns": columns, "field": self.name, "found": found, "expected": error.expected}
        return Problem(**{"message": message, **details, **place})

    @property
    def expected(self) -> str:
        """What the field wants, for messages: `F12.6`, or `A4 (one of GEOG, GEOC, LOCL)`."""
        return f"{self.edit} (one of {', '.join(self.allowed)})" if self.allowed else str(self.edit)


@dataclass(frozen=True, kw_only=True, eq=False)
class CardSpec:
    """One kind of card. `order` is its place in a canonical deck."""

    mnemonic: str = key(doc="three capitals or digits in columns 1-3 that name the card", convert=_mnemonic)
    title: str = key(doc="what the card is called")
    doc: str = key(doc="what it is for")
    order: int = key(doc="place of the card in a canonical deck; on reading any order is accepted")
    repeat: Literal["one", "many"] = key(
        "many", "`one` card in a deck, or `many` (so without the key)", choices=("one", "many")
    )
    required: bool = key(False, "whether a deck must have the card")
    once: tuple[tuple[str, str], ...] = key(
        (),
        "lists of two: attributes by which two cards are the same, the last shown; what is said of the second",
    )
    two_ends: tuple[str, str] | None = key(
        None, "an attribute whose two components must differ, and what is said where they do not"
    )
    given_up: tuple[tuple[str, int, int, str], ...] = key(
        (),
        "lists of four: name, first and last column of a field that is given up, and what is said of its use",
    )
    sample: str = key(doc="a canonical card, 80 columns, number 1; it must decode and encode to itself")
    fields: tuple[FieldSpec, ...] = key((), "the fields, one `[[field]]` table each", name="field")
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


def load_family(folder: Path | str, further: Iterable[Path] = ()) -> Family:
    """Return the family of cards that the TOML files of `folder` describe, and those of `further` folders.

    Raises `CardFormatError`, naming file and key, for whatever is wrong with them: unknown or missing keys, columns
    that overlap, leave 4-72 or do not fit the descriptor, duplicate names and mnemonics, unknown units and targets
    that are no attribute, and samples that do not decode and encode again to the same card.
    """
    folder = Path(folder)
    paths = sorted(folder.glob("*.toml"))
    if not paths:
        raise CardFormatError(f"{folder}: no card formats (*.toml)")
    specs: dict[str, CardSpec] = {}
    for path in [*paths, *(path for each in further for path in sorted(each.glob("*.toml")))]:
        spec = _load_card(path)
        if spec.mnemonic in specs:
            raise CardFormatError(f"{path}: mnemonic: {spec.mnemonic} is already in another file of the family")
        specs[spec.mnemonic] = spec
    ordered = sorted(specs.values(), key=lambda spec: (spec.order, spec.mnemonic))
    return Family(name=folder.name, cards=MappingProxyType({spec.mnemonic: spec for spec in ordered}))


def format_of(kind: type[Any], path: Path) -> Any:
    """Return `kind` as a TOML file states it. Raises `CardFormatError` with everything that is wrong."""
    try:
        raw = read_toml(path)
    except ValueError as error:
        raise CardFormatError(f"{path}: {error}") from error
    reader = Reader(str(path))
    spec = reader.table(kind, raw, "")
    if reader.problems:
        places = [re.sub(r"\[(\d+)\]", r" \1", one.field or "").replace(".", ": ") for one in reader.problems]
        faults = [f"{place}: {one.message}" for place, one in zip(places, reader.problems, strict=True)]
        raise CardFormatError("\n".join(f"{path}: {fault.removeprefix('spec: ')}" for fault in faults))
    return spec


def _load_card(path: Path) -> CardSpec:
    spec: CardSpec = format_of(CardSpec, path)
    units = [field.unit or _PARTS.get(field.target.rpartition(":")[2], "") for field in spec.fields]
    fields = tuple(replace(field, unit=unit) for field, unit in zip(spec.fields, units, strict=True))
    spec = replace(spec, fields=fields, file=str(path))
    try:
        for number, field in enumerate(spec.fields, 1):
            with named(f"field {number} ({field.name})"):
                field.check()
        check_fields(spec.fields)
        with named("sample"):
            values = {field.name: field.decode(spec.sample[field.first - 1 : field.last]) for field in spec.fields}
            card = spec.encode(values, 1)
            require(card == spec.sample, f"does not encode to itself:\n    {spec.sample}\n    {card}")
    except ValueError as error:
        raise CardFormatError(f"{path}: {error}") from error
    return spec


@contextmanager
def named(what: str) -> Iterator[None]:
    """Put `what` before the message of a `ValueError`."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from error


def check_fields(fields: Sequence[FieldSpec]) -> None:
    """Raise `ValueError` for names given twice and columns that overlap."""
    names = [field.name for field in fields]
    for name in names:
        require(names.count(name) == 1, f"field {name}: a second field has the same name")
    for field, after in pairwise(sorted(fields, key=lambda field: field.first)):
        require(field.last < after.first, f"field {after.name}: columns: overlap those of {field.name}")
