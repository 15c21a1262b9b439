"""Decks: a file of cards -> tables of columns and every problem found, and tables -> a file of cards."""

from __future__ import annotations

import codecs
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, ByteArray, IntArray
from musatpy.errors import DeckError, Problem, in_order
from musatpy.formats.cards import codec
from musatpy.formats.cards.slips import foreign, of_survey, readings
from musatpy.formats.cards.spec import CARD_WIDTH, END_MNEMONIC, CardSpec, Family

_CHUNK = 4096  # cards decoded in one go: the numbers of a field stay in the cache
_UNKNOWN = -1
_END_OF_FILE = b"\x1a"
_LF, _TAB = b"\n\t"
_LETTER = "'{}' is not ASCII: only titles and the names of liquids may have such letters"
_CONTROL = "control character (byte {:#04x})"
_TRIED = 200  # cards that a slip must explain one of, before all are tried
_SUBSTITUTE = ord("?")  # in place of characters that no card has
Columns = Mapping[str, codec.Column]  # field -> (k,) float64, NaN for no value; or text without outer blanks


@dataclass(frozen=True, kw_only=True, eq=False)
class CardImages:
    """The lines of a file, which end with LF or CR LF, as cards of 80 columns."""

    cards: ByteArray  # (count, 80), `?` in place of characters beyond ASCII, and of what is none
    overlong: Mapping[int, str]  # lines (1-based) that go on beyond column 80 with more than blanks
    bad_characters: tuple[tuple[int, int, str], ...]  # line and column, 1-based, and what is no ASCII character
    letters: Mapping[int, str]  # lines with letters beyond ASCII, as they are
    encoding: str = ""  # of these letters, where it is not UTF-8

    @property
    def count(self) -> int:
        """The number of lines."""
        return len(self.cards)

    def text(self, line: int) -> str:
        """Return line `line` (1-based) as text, without trailing blanks; `?` for what is no character."""
        if not 1 <= line <= self.count:
            raise IndexError(f"line {line} of {self.count}")
        longer = self.letters.get(line) or self.overlong.get(line)
        return longer or self.cards[line - 1].tobytes().decode("ascii").rstrip(" ")


def card_images(data: bytes) -> CardImages:
    """Return the card images of the bytes of a file. A letter is one column, however many bytes it has."""
    data = data.replace(b"\r\n", b"\n")
    letters, encoding = dict[int, str](), ""
    if not data.isascii():
        text, encoding = codec.text_of(data)
        text = unicodedata.normalize("NFC", text)
        letters = {number: line for number, line in enumerate(text.split("\n"), 1) if not line.isascii()}
        data = text.encode("ascii", "replace")
    # Unsigned differences wrap: one comparison finds what is below the blank and what is above the tilde.
    every = np.frombuffer(data, dtype=np.uint8)
    bad = np.flatnonzero(every - np.uint8(ord(" ")) > ord("~") - ord(" "))
    bad = bad[every[bad] != _LF]
    characters = list(_located(data, bad.tolist()))
    if len(bad):
        mended = every.copy()
        mended[bad] = _SUBSTITUTE
        data = mended.tobytes()
    lines = data.split(b"\n")
    if not lines[-1]:  # the file ends with a line end
        lines.pop()
    cards = np.array(lines, dtype=f"S{CARD_WIDTH}").view(np.uint8).reshape(len(lines), CARD_WIDTH)
    np.maximum(cards, ord(" "), out=cards)  # short lines end in zeros
    long = {number: line.rstrip(b" ") for number, line in enumerate(lines, 1) if len(line) > CARD_WIDTH}
    overlong = {number: line.decode("ascii") for number, line in long.items() if len(line) > CARD_WIDTH}
    characters += [
        (line, column, _LETTER.format(letter) if letter.isprintable() else _CONTROL.format(ord(letter)))
        for line, text in letters.items()
        for column, letter in enumerate(text, 1)
        if not letter.isascii()
    ]
    taken = "Latin-1" if encoding == codec.LATIN_1 else ""
    bad_characters = tuple(sorted(characters))
    return CardImages(
        cards=cards, overlong=overlong, bad_characters=bad_characters, letters=letters, encoding=taken
    )


def _located(data: bytes, places: list[int]) -> Iterator[tuple[int, int, str]]:
    """Yield line, column, and in words what is there: a tab, or a control character."""
    line, start = 1, 0
    for place in places:
        line += data.count(b"\n", start, place)
        start = max(start, data.rfind(b"\n", start, place) + 1)
        byte = data[place]
        yield line, place - start + 1, "tab character" if byte == _TAB else _CONTROL.format(byte)


@dataclass(frozen=True, kw_only=True, eq=False)
class CardDeck:
    """A deck as read: of each kind of card of its family, in the order of the deck, what the k cards say.

    A card with problems stays in its table, with no value in the fields that do not decode.
    """

    file: str  # name for messages
    tables: Mapping[str, Columns]  # by mnemonic
    lines: Mapping[str, IntArray]  # by mnemonic, (k,) 1-based
    problems: tuple[Problem, ...]  # by line
    images: CardImages
    unread: frozenset[int] = frozenset()  # lines with errors, whose values are not known
    end: int | None = None  # the first line that should not be there: it stands behind the END card

    @classmethod
    def blank(cls, file: str, count: int) -> CardDeck:
        """Return a deck of blank cards, in the place of one where other files or calls say it all."""
        cards = np.broadcast_to(np.uint8(ord(" ")), (count, CARD_WIDTH))
        images = CardImages(cards=cards, overlong={}, bad_characters=(), letters={})
        return cls(file=file, tables={}, lines={}, problems=(), images=images)


def read_cards(source: Path | str | bytes, family: Family, name: str | None = None) -> CardDeck:
    """Return the deck in `source`, a path or the bytes of a file, which messages call `name`.

    Cards may come in any order. Line ends may be LF or CR LF, and the file may end with the byte 1A that marked its
    end under DOS; a blank line is skipped with a warning. Problems are listed in the deck, never raised; `OSError`
    is raised for a file that cannot be read.
    """
    file = name or ("deck" if isinstance(source, bytes) else str(source))
    data = (source if isinstance(source, bytes) else Path(source).read_bytes()).removesuffix(_END_OF_FILE)
    kind = foreign(data, family)
    marked = data.startswith(codecs.BOM_UTF8)
    images = card_images(b"" if kind or data.isspace() else data.removeprefix(codecs.BOM_UTF8))
    del data  # which is not kept beside them
    reader = _DeckReader(file, family, images)
    if kind:
        reader.problems = [Problem(file=file, message=f"this is {kind}")]
    elif images.encoding:
        taken = f"letters beyond ASCII are read as {images.encoding}: the file is not in UTF-8"
        reader.problems.append(Problem(file=file, message=taken, severity="warning"))
    if marked and not kind:
        skipped = Problem(file=file, message="begins with a byte order mark, skipped", severity="warning")
        reader.problems.append(skipped)
    tables = {spec.mnemonic: reader.columns(spec) for spec in family.cards.values()}
    lines = {mnemonic: rows + 1 for mnemonic, rows in reader.rows.items()}
    errors = {problem.line for problem in reader.problems if problem.line and problem.severity == "error"}
    return CardDeck(
        file=file,
        tables=tables,
        lines=lines,
        problems=in_order(until(reader.end, reader.problems)),
        images=images,
        unread=frozenset(errors - reader.mended),
        end=reader.end,
    )


def _reads(spec: CardSpec, cards: ByteArray, columns: dict[str, codec.Column] | None = None) -> BoolArray:
    """Return (k,) whether all of a card (k, 80) reads; its columns (k,) are filled."""
    read = columns or {field.name: codec.empty_column(field, len(cards)) for field in spec.fields}
    bad = {row for field in spec.fields for row, _ in codec.decode_column(field, cards, read[field.name])}
    bad |= {row for row, _, _ in codec.strays(spec, cards)}
    return ~np.isin(np.arange(len(cards)), list(bad))


def until(end: int | None, problems: Iterable[Problem]) -> Iterator[Problem]:
    """Yield problems without the errors of lines behind one; all where there is none."""
    return (one for one in problems if end is None or one.severity == "warning" or (one.line or 0) <= end)


class _DeckReader:
    """The problems of a deck, gathered while its tables are decoded."""

    def __init__(self, file: str, family: Family, images: CardImages) -> None:
        self.file = file
        self.images = images
        self.specs = tuple(family.cards.values())
        mnemonics = np.ascontiguousarray(images.cards[:, :3]).view("S3")[:, 0]
        self.kinds = np.full(images.count, _UNKNOWN, dtype=np.int8)  # of each line, by its mnemonic
        capitals = np.char.upper(mnemonics)
        for kind, spec in enumerate(self.specs):
            self.kinds[capitals == spec.mnemonic.encode("ascii")] = kind
        self.rows = {spec.mnemonic: np.flatnonzero(self.kinds == kind) for kind, spec in enumerate(self.specs)}
        self.problems: list[Problem] = []
        self.mended = {*(np.flatnonzero((capitals != mnemonics) & (self.kinds != _UNKNOWN)) + 1).tolist()}
        self.end: int | None = None  # the first line behind the END card, where there are cards
        self.unreadable: set[int] = set()  # lines whose characters are wrong; their fields are not complained of
        self.lettered = {spec.mnemonic: [field for field in spec.fields if field.letters] for spec in self.specs}
        self._check_characters()
        self._check_mnemonics()
        self._check_counts()

    def columns(self, spec: CardSpec) -> Columns:
        """Return the columns of the cards of `spec`, decoded in chunks."""
        rows = self.rows[spec.mnemonic]
        columns = {field.name: codec.empty_column(field, rows.size) for field in spec.fields}
        for start in range(0, rows.size, _CHUNK):
            lines = rows[start : start + _CHUNK]
            cards = self.images.cards[lines]
            for field in spec.fields:
                for row, error in codec.decode_column(field, cards, columns[field.name][start : start + _CHUNK]):
                    line = int(lines[row]) + 1
                    if line not in self.unreadable:
                        card = {"file": self.file, "card": spec.mnemonic, "text": self.images.text(line)}
                        self.problems.append(field.problem(error, line=line, **card))
            for row, column, found in codec.strays(spec, cards):
                line = int(lines[row]) + 1
                if line not in self.unreadable:
                    name, why = None, " stands in columns of no field"
                    for given_up, first, last, instead in spec.given_up:
                        name, why = (given_up, f": {instead}") if first <= column <= last else (name, why)
                    place = {"columns": (column, column + len(found) - 1), "card": spec.mnemonic, "field": name}
                    self._add(line, message=f"'{found}'{why}", found=found, **place)
        self._try_slips(spec, columns)
        if self.unreadable:
            lost = np.isin(rows + 1, list(self.unreadable))
            for field in spec.fields:
                columns[field.name][lost] = np.nan if field.edit.is_number else ""
        lettered = self.images.letters.keys() - self.unreadable
        for line in lettered & {*(rows + 1).tolist()} if lettered else ():
            for field in self.lettered[spec.mnemonic]:
                text = self.images.letters[line][field.first - 1 : field.last]
                columns[field.name][np.searchsorted(rows, line - 1)] = text.strip(" ")
        return columns

    def _try_slips(self, spec: CardSpec, columns: Columns) -> None:
        """Say of cards that read without one slip what that is, not what is wrong in each of their fields.

        The columns (k,) have the values that the cards have without it, so that no other card misses them. A card
        with a field that is given up, or with letters beyond ASCII, is none of them.
        """
        of_card = [problem for problem in self.problems if problem.card == spec.mnemonic]
        fields = {name for name, *_ in spec.given_up}
        used = {problem.line for problem in of_card if problem.field in fields} | self.images.letters.keys()
        wrong = {problem.line for problem in of_card if problem.line is not None} - used
        at = np.flatnonzero(np.isin(self.rows[spec.mnemonic] + 1, list(wrong)))
        if not len(at):
            return
        lines = self.rows[spec.mnemonic][at] + 1
        left = np.ones(len(at), dtype=bool)
        for message, mended, possible in readings(spec, self.images.cards[lines - 1]):
            tried = np.flatnonzero(left & possible)
            if not _reads(spec, mended[tried[:_TRIED]]).any():
                continue
            read = {field.name: codec.empty_column(field, len(tried)) for field in spec.fields}
            good = tried[_reads(spec, mended[tried], read)]
            known = dict(zip(lines[good].tolist(), good.tolist(), strict=True))
            self.problems = [problem for problem in self.problems if problem.line not in known]
            for line, row in known.items():
                changed = np.flatnonzero(mended[row] != self.images.cards[line - 1]) + 1
                place = None if message.endswith(("left", "right")) else (int(changed[0]), int(changed[-1]))
                field = place and next(
                    (field for field in spec.fields if field.first <= place[0] <= place[1] <= field.last), None
                )
                details: dict[str, Any] = {"message": message, "columns": place}
                if field:
                    found = self.images.text(line)[field.first - 1 : field.last].strip()
                    details = {"message": f"'{found}': {message}", "columns": field.columns, "field": field.name}
                self._add(line, card=spec.mnemonic, **details)
            for name, values in read.items():
                columns[name][at[good]] = values[np.isin(tried, good)]
            left[good] = False
            self.mended |= known.keys()

    # --- problems ---

    def _add(self, line: int, **details: Any) -> None:
        text = self.images.text(line)
        self.problems.append(Problem(file=self.file, line=line, text=text, **details))

    def _check_characters(self) -> None:
        for line, column, what in self.images.bad_characters:
            mnemonic = self.images.cards[line - 1, :3].tobytes().decode("ascii")
            fields = self.lettered.get(mnemonic, ()) if what.startswith("'") else ()
            if any(field.first <= column <= field.last for field in fields):
                continue
            if line not in self.unreadable:  # one problem for each card
                self.unreadable.add(line)
                self._add(line, columns=(column,) * 2, message=what, expected="printable ASCII characters")
        for line, text in self.images.overlong.items():
            if line in self.unreadable:
                continue
            message = f"card of {len(text)} columns, longer than {CARD_WIDTH}"
            self._add(line, columns=(CARD_WIDTH + 1, len(text)), message=message, expected=f"{CARD_WIDTH} columns")

    def _check_mnemonics(self) -> None:
        known = [spec.mnemonic for spec in self.specs]
        for line in sorted({*(np.flatnonzero(self.kinds == _UNKNOWN) + 1).tolist(), *self.mended}):
            text = self.images.text(line)
            if not text:
                self._add(line, message="blank line, skipped", severity="warning")
            elif line not in self.unreadable:
                found, capitals = text[:3], text[:3].upper()
                expected = capitals if capitals in known else f"one of {', '.join(known)}"
                message = f"'{found}' is no card{of_survey(text) or f'; expected {expected}'}"
                self._add(line, columns=(1, 3), message=message, found=found, expected=expected)

    def _check_counts(self) -> None:
        if not self.images.count:
            self.problems.append(Problem(file=self.file, message="the deck is empty"))
            return
        for spec in self.specs:
            rows = self.rows[spec.mnemonic]
            if spec.required and not rows.size:
                message = f"no {spec.mnemonic} card ({spec.title.lower()})"
                self.problems.append(Problem(file=self.file, card=spec.mnemonic, message=message))
            if spec.mnemonic == END_MNEMONIC and rows.size:
                end = int(rows[0]) + 1
                after = [row + 1 for row in range(end, self.images.count) if self.images.text(row + 1)]
                count = "a card" if len(after) == 1 else f"{len(after)} cards"
                for line in after[:1]:
                    message = f"{count} after the {END_MNEMONIC} card of line {end}"
                    self._add(line, columns=(1, 3), message=message)
                    self.end = line
            elif spec.repeat == "one":
                for row in rows[1:]:
                    message = f"a second {spec.mnemonic} card; the first is on line {rows[0] + 1}"
                    self._add(int(row) + 1, columns=(1, 3), message=message, card=spec.mnemonic)


def write_cards(tables: Iterable[tuple[CardSpec, Columns]]) -> bytes:
    """Return the deck of `tables` in their order: canonical cards of 80 columns, numbered in 73-80, ended by LF.

    A table gives a column (k,) for every field of its card; a card without fields is written once. Numbers that do
    not fit lose decimals. Raises `DeckError`, with every value that cannot be written.
    """
    blocks: list[bytes] = []
    problems: list[Problem] = []
    number = 1
    for spec, columns in tables:
        count = len(columns[spec.fields[0].name]) if spec.fields else 1
        block, unwritten = codec.encode_cards(spec, columns, count, number)
        blocks.append(block)
        problems += unwritten
        number += count
    if problems:
        raise DeckError(problems)
    return b"".join(blocks)
