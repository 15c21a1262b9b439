"""Lines of free text in a listing: labels with values, and wrapped sentences."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence

from musatpy.errors import printable, without_names
from musatpy.reports.pages import PAGE_WIDTH

_LABEL_WIDTH = 50


def text_of(lines: Iterable[str]) -> str:
    """Return the text of lines, safe for a terminal."""
    return printable("".join(f"{line}\n" for line in lines))


def labelled(values: Mapping[str, str]) -> list[str]:
    """Return one line per entry, the label led to its value by dots."""
    return [f"{label + ' ':.<{_LABEL_WIDTH}} {value}" for label, value in values.items()]


def wrapped(sentences: Iterable[str], *, lead: str = "") -> list[str]:
    """Return the sentences broken to the width of the paper, each behind `lead` and indented below it."""
    lines: list[str] = []
    for sentence in sentences:
        lines += textwrap.wrap(
            sentence, width=PAGE_WIDTH, initial_indent=lead, subsequent_indent=" " * len(lead)
        ) or [lead.rstrip()]
    return lines


def by_kind(texts: Sequence[str], *, shown: int) -> list[list[str]]:
    """Return the lines of texts by kind: texts that differ in names and numbers only.

    Of each kind `shown` texts, and how many more there are.
    """
    kinds: dict[str, list[str]] = {}
    for text in texts:
        kinds.setdefault(without_names(text), []).append(text)
    return [
        wrapped(alike[:shown], lead="- ") + ([f"and {len(alike) - shown} more of this kind"] * (len(alike) > shown))
        for alike in kinds.values()
    ]
