"""Rows of a listing as a record is held against them: columns that become tokens when asked for, sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from musatpy.listings.sections import Row, Section, squeezed
from musatpy.listings.tokens import Token, parse


class Cells:
    """The columns of one row of a listing: texts that become tokens where they are asked for."""

    __slots__ = ("cells", "section", "texts")

    def __init__(self, section: Section, text: str) -> None:
        self.section = section
        self.texts = section.fields(text) if section.grouped else None
        self.cells = {} if self.texts else dict(section.cells(text, angles=section.angles))

    @property
    def is_note(self) -> bool:
        """True for a line that does not keep to the columns."""
        return -1 in self.cells

    def text(self, column: int) -> str:
        """Return what stands in a column, with one blank between fields."""
        if self.texts:
            return squeezed(self.texts[column])
        return " ".join(one.token.text for one in self.cells.get(column, []))

    def word(self, column: int) -> str:
        """Return what stands in a column where that is known without a look at other columns."""
        return self.texts[column].strip() if self.texts else ""

    def tokens(self, column: int) -> Sequence[Token]:
        """Return the tokens in a column."""
        if not self.texts:
            return [one.token for one in self.cells.get(column, [])]
        word = self.texts[column].strip()
        if " " in word:
            inside = self.section.tokens_in(column, self.texts[column], angles=self.section.angles)
            return [one.token for one in inside]
        return parse(word) if word else ()


def numbered(names: Sequence[str]) -> list[str]:
    """Return headings, a second one of a name as `name#2`."""
    counts: Counter[str] = Counter()
    found = []
    for name in names:
        counts[name] += 1
        found.append(f"{name}#{counts[name]}" if counts[name] > 1 else name)
    return found


def is_zero(tokens: Sequence[Token]) -> bool:
    """Tell whether the number in a column is zero as printed."""
    return bool(tokens) and tokens[0].value == 0


def sentences(rows: Sequence[Row]) -> list[Row]:
    """Return the rows that are not indented, each with the lines that continue it as its id."""
    found: list[Row] = []
    for row in rows:
        text = squeezed(row.line.text)
        if found and row.line.text[0] == " ":
            found[-1] = found[-1]._replace(ids=(f"{found[-1].ids[0]} {text}",))
        else:
            found.append(row._replace(ids=(text.removeprefix("- ").removeprefix("Note: "),)))
    return found


def unbroken(text: object) -> str:
    """Return a text without blanks: lines may be broken behind hyphens too."""
    return "".join(str(text).split())
