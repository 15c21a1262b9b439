"""What a page consists of: chapters of tables, facts, texts and pictures, with the text of every cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar


@dataclass(frozen=True, kw_only=True)
class Head:
    """The head of a column."""

    text: str
    unit: str = ""
    is_id: bool = False  # names what the row is about
    is_text: bool = False  # stands at the left


@dataclass(frozen=True, kw_only=True)
class PageTable:
    """A table; `folded` it is opened on demand."""

    kind: ClassVar[str] = "table"
    title: str
    anchor: str
    heads: Sequence[Head]
    rows: Sequence[Sequence[str]]
    total: int  # rows that there are, of which those that are worst are shown
    note: str = ""
    folded: bool = False


@dataclass(frozen=True, kw_only=True)
class Fact:
    """A number or a few words with what they are."""

    label: str
    value: str
    detail: str = ""
    link: str = ""  # anchor of where it is told in full


@dataclass(frozen=True, kw_only=True)
class Facts:
    """Facts side by side, `large` those that count most."""

    kind: ClassVar[str] = "facts"
    facts: Sequence[Fact]
    large: bool = False


@dataclass(frozen=True, kw_only=True)
class Texts:
    """Sentences, as paragraphs or, `listed`, as a list below their title."""

    kind: ClassVar[str] = "texts"
    texts: Sequence[str]
    title: str = ""
    anchor: str = ""
    listed: bool = False


@dataclass(frozen=True, kw_only=True)
class PagePicture:
    """A picture as a data URI, and a sentence that says what it shows: its alternative text too."""

    kind: ClassVar[str] = "picture"
    title: str
    anchor: str
    sentence: str
    uri: str  # without characters that HTML knows: it is not escaped


Part = PageTable | Facts | Texts | PagePicture


@dataclass(frozen=True, kw_only=True)
class Chapter:
    """A chapter of a page."""

    title: str
    anchor: str
    parts: Sequence[Part]


@dataclass(frozen=True, kw_only=True)
class Reason:
    """A reason of the verdict."""

    grade: str
    text: str
    link: str = ""  # anchor of where it shows


@dataclass(frozen=True, kw_only=True)
class Page:
    """A page: what stands above, the verdict, and the chapters."""

    title: str
    lines: Sequence[str]  # below the title
    grade: str
    use: str  # what may be done with the answer
    reasons: Sequence[Reason]
    causes: Sequence[str]
    notes: Sequence[str]
    figures: Facts  # the numbers that count most
    chapters: Sequence[Chapter] = field(default_factory=tuple)
    closing: str = ""
