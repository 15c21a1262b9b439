"""Pages as HTML: one file without script and network, the same bytes for the same page."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from musatpy.errors import MusatError, printable
from musatpy.page.parts import Page, PageTable

_TEMPLATES = Path(__file__).with_name("templates")
_MARKS = {"ACCEPTED": "✓", "COMPARED": "✓", "DOUBTFUL": "?"}
_REFUSED = "✕"
_NEEDED = ("jinja2", "matplotlib")


def check_packages() -> None:
    """Raise `MusatError` where a package is missing that pages need."""
    missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise MusatError(f"pages need {' and '.join(missing)}: pip install 'musatpy[report]'")


def html_of(page: Page) -> str:
    """Return a page as HTML. Raises `MusatError` where jinja2 is missing."""
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
