"""What a page consists of, with the text of every cell, and its HTML: one file without script and network."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from musatpy.errors import MissingPackageError, printable

_TEMPLATES = Path(__file__).with_name("templates")
_MARKS = {"ACCEPTED": "✓", "COMPARED": "✓", "DOUBTFUL": "?"}
_REFUSED = "✕"
_NEEDED = ("jinja2", "matplotlib")


def anchor_of(title: str) -> str:
    """Return the name by which links find a title."""
    return "-".join(re.findall(r"[a-z0-9]+", title.lower()))


@dataclass(frozen=True, kw_only=True)
class Titled:
    """What links may lead to."""

    title: str = ""

    @property
    def anchor(self) -> str:
        """The name by which links find it; empty without a title."""
        return anchor_of(self.title)


@dataclass(frozen=True, kw_only=True)
class Head:
    """The head of a column."""

    text: str
    unit: str = ""
    is_id: bool = False  # names what the row is about
    is_text: bool = False  # stands at the left


@dataclass(frozen=True, kw_only=True)
class PageTable(Titled):
    """A table; `folded` it is opened on demand."""

    kind: ClassVar[str] = "table"
    heads: Sequence[Head]
    rows: Sequence[Sequence[str]]
    total: int  # rows that there are, of which those that are worst are shown
    note: str = ""
    folded: bool = False


@dataclass(frozen=True)
class Fact:
    """A number or a few words with what they are."""

    label: str
    value: str
    detail: str = ""
    link: str = ""  # anchor of where it shows, or is told in full


@dataclass(frozen=True)
class Facts:
    """Facts side by side, `large` those that count most."""

    kind: ClassVar[str] = "facts"
    facts: Sequence[Fact]
    large: bool = False


@dataclass(frozen=True, kw_only=True)
class Sentences(Titled):
    """Sentences, as paragraphs or, `listed`, as a list below their title."""

    kind: ClassVar[str] = "texts"
    texts: Sequence[str]
    listed: bool = False


@dataclass(frozen=True, kw_only=True)
class PagePicture(Titled):
    """A picture as a data URI, and a sentence that says what it shows: its alternative text too."""

    kind: ClassVar[str] = "picture"
    name: str
    sentence: str
    is_wide: bool  # of several panels side by side
    uri: str  # without characters that HTML knows: it is not escaped

    @property
    def anchor(self) -> str:
        """The name by which links find it: a table may have the same title."""
        return anchor_of(f"picture {self.name}")


Part = PageTable | Facts | Sentences | PagePicture


@dataclass(frozen=True, kw_only=True)
class Chapter(Titled):
    """A chapter of a page."""

    parts: Sequence[Part]


@dataclass(frozen=True, kw_only=True)
class Page:
    """A page: what stands above, the verdict, and the chapters."""

    title: str
    lines: Sequence[str]  # below the title
    job: Sequence[Fact] = ()  # below them: coordinate system, datum, heights, and what is given for this page
    grade: str
    use: str  # what may be done with the answer
    reasons: Sequence[Fact]  # of the verdict, with the grade that each makes
    causes: Sequence[str] = ()
    notes: Sequence[str] = ()
    figures: Facts  # the numbers that count most
    map: PagePicture | None = None  # beside them
    chapters: Sequence[Chapter]
    closing: str = ""


def check_packages() -> None:
    """Raise `MissingPackageError` where a package is missing that pages need."""
    for name in _NEEDED:
        if importlib.util.find_spec(name) is None:
            raise MissingPackageError("pages need", name, "report")


def html_of(page: Page) -> str:
    """Return a page as HTML, the same bytes for the same page. Raises `MusatError` where jinja2 is missing."""
    return render("page.jinja", page=page, mark=_MARKS.get(page.grade, _REFUSED if page.grade else ""))


def render(template: str, **values: Any) -> str:
    """Return a template filled with values, their texts escaped. Raises `MusatError` where jinja2 is missing."""
    check_packages()
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: printable(value) if type(value) is str else value,
    )
    environment.globals["lines"] = _lines
    style = Markup((_TEMPLATES / "style.css").read_text(encoding="utf-8"))
    return environment.get_template(template).render(style=style, **values)


def _lines(table: PageTable) -> Any:
    """Return the rows of a table as HTML: a template would ask of every cell what is so of its column."""
    from markupsafe import Markup, escape

    tags = []
    for head in table.heads:
        begin = '<td class="x">' if head.is_text else "<td>"
        tags.append(('<th scope="row">', "</th>") if head.is_id else (begin, "</td>"))
    lines = []
    for row in table.rows:
        cells = [f"{begin}{escape(printable(text))}{end}" for (begin, end), text in zip(tags, row, strict=True)]
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return Markup("\n".join(lines))
