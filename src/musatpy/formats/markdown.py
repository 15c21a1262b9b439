"""Tables of the manuals in Markdown."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from musatpy.specs import is_required, keys


def key_table(kind: Any) -> str:
    """Return the table that explains the keys of a format file."""
    rows = (
        [f"`{name}`", "yes" if is_required(field) else "no", field.metadata["doc"]]
        for name, field in keys(kind).items()
    )
    return markdown_table(["key", "required", "meaning"], rows)


def markdown_table(header: list[str], rows: Iterable[list[str]]) -> str:
    """Return a table in Markdown."""
    lines = [header, ["---"] * len(header), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
