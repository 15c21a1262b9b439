"""A text file -> pages of lines, without carriage control, page headers and page numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from musatpy.errors import ProblemsError
from musatpy.listings.rules import ListingLayout

_PAGE_NUMBER = re.compile(r"(?:^|\s)\(?PAGE(?: +NO\.?)?[ .:#]*\d+(?: *(?:OF|/) *\d+)?\)?\s*$", re.IGNORECASE)
CUT = re.compile(r"Only the worst \d+ of \d+ rows ")  # below a table of a brief listing
_REFERENCE = re.compile(r"(?:^| )\(page \d+\)$")  # behind what another page shows
_NUMBER_IN_FRONT = re.compile(r"[-+1]\.?\d|0\.\d")  # "0" and a row that begins with a number are no number
SKIPPED = {" ": 0, "0": 1, "-": 2, "1": 0, "+": 0}  # blank lines that a carriage control character asks for


class CannotCompareError(ProblemsError):
    """Files that cannot be compared: one is no text, empty, or of a kind that the other has nothing to do with."""


class PrintedLine(NamedTuple):
    """One printed line."""

    text: str
    page: int  # from 1
    number: int  # of the line in the file, from 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Paper:
    """The pages of a listing, headers apart; each header once, without its page number."""

    pages: tuple[tuple[PrintedLine, ...], ...]
    headers: tuple[PrintedLine, ...]


def text_of(data: bytes, name: str) -> str:
    """Return the text of a file, UTF-8 or Windows-1252; raises `CannotCompareError` where it is none, or empty."""
    if b"\0" in data:
        raise CannotCompareError.of("is not a text file", file=name)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("cp1252", errors="replace")
    if not text.strip():
        raise CannotCompareError.of("is empty", file=name)
    return text


def paper_of(text: str, layout: ListingLayout) -> Paper:
    """Return the pages of a text: parted by form feeds, carriage control, or lines that end with a page number."""
    lines = text.rstrip("\x1a").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    control = has_carriage_control(lines) if layout.carriage_control is None else layout.carriage_control
    pages = _controlled(lines) if control else _fed(lines)
    return _without_headers(pages, layout)


def has_carriage_control(lines: Sequence[str]) -> bool:
    """Tell whether column 1 is ASA carriage control: a page of text begins there, and no number."""
    written = [line for line in lines if line]
    if not written or written[0][0] != "1" or not all(line[0] in SKIPPED for line in written):
        return False
    if not any(character.isalpha() for character in written[0]) or all(line[0] != " " for line in written):
        return False
    return not any(_NUMBER_IN_FRONT.match(line) for line in written)


def _controlled(lines: Sequence[str]) -> list[list[PrintedLine]]:
    """Return the pages that a printer makes of lines with carriage control."""
    pages: list[list[PrintedLine]] = [[]]
    for number, line in enumerate(lines, start=1):
        control, text = line[:1] or " ", line[1:].expandtabs().rstrip()
        if control == "1" and pages[-1]:
            pages.append([])
        if control == "+" and pages[-1]:
            below = pages[-1][-1]
            pages[-1][-1] = below._replace(text=_overprinted(below.text, text))
            continue
        pages[-1] += [PrintedLine("", len(pages), number)] * SKIPPED.get(control, 0)
        pages[-1].append(PrintedLine(text, len(pages), number))
    return pages


def _overprinted(below: str, above: str) -> str:
    """Return two lines printed on one another; what was bold or underlined is as it was."""
    width = max(len(below), len(above))
    pairs = zip(below.ljust(width), above.ljust(width), strict=True)
    return "".join(second if first in " _" else first for first, second in pairs).rstrip()


def _fed(lines: Sequence[str]) -> list[list[PrintedLine]]:
    """Return the pages between form feeds."""
    pages: list[list[PrintedLine]] = [[]]
    page = 1
    for number, line in enumerate(lines, start=1):
        first, *rest = line.split("\f")
        pages[-1].append(PrintedLine(first.expandtabs().rstrip(), page, number))
        for part in rest:
            if any(line.text for line in pages[-1]):
                pages.append([])
                page += 1
            pages[-1].append(PrintedLine(part.expandtabs().rstrip(), page, number))
    return pages


def _without_headers(pages: Sequence[Sequence[PrintedLine]], layout: ListingLayout) -> Paper:
    """Take lines that end with a page number out; each begins a page, unless it is the last of one."""
    headers: dict[str, PrintedLine] = {}
    kept: list[list[PrintedLine]] = []
    number = 0
    patterns = bool(layout.header)
    for page in pages:
        kept.append([])
        number += 1
        for line in page:
            text = line[0]
            if text.endswith(")") and not _REFERENCE.sub("", text).strip():
                continue  # a reference that is alone on its line
            if (patterns or "age" in text or "AGE" in text) and _is_header(
                text, layout, at_top=not any(line.text for line in kept[-1])
            ):
                if any(line.text for line in kept[-1]):
                    kept.append([])
                    number += 1
                title = " ".join(_PAGE_NUMBER.sub("", text).split())
                if title and not any(pattern.search(text) for pattern in layout.header):
                    headers.setdefault(title, PrintedLine(title, number, line.number))
                continue
            if text.endswith(")") and _REFERENCE.search(text):
                line = line._replace(text=_REFERENCE.sub("", text))
            kept[-1].append(line if line[1] == number else line._replace(page=number))
        if not any(line.text for line in kept[-1]) and len(kept) > 1:
            kept.pop()
            number -= 1
    return Paper(pages=tuple(tuple(page) for page in kept), headers=tuple(headers.values()))


def _is_header(text: str, layout: ListingLayout, *, at_top: bool) -> bool:
    """Tell whether a line is a page header; below the top of a page, its number stands apart from words."""
    page = _PAGE_NUMBER.search(text)
    before = text[: page.start()] if page else ""
    if page and (at_top or before.endswith(" ") or not any(character.isalnum() for character in before)):
        return True
    return any(pattern.search(text) for pattern in layout.header)
