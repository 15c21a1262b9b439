"""New names for cameras, photos, points, groups and tides of a block, and the files that list them."""

from __future__ import annotations

import shlex
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from musatpy.arrays import TextArray
from musatpy.errors import DeckError, Problem
from musatpy.model import Block

EVERY_DECK = "*"


def text_of(path: Path) -> str:
    """Return what a file of names or corners says; bytes that are no UTF-8 stand as escapes, and fit no name."""
    return path.read_text(encoding="utf-8", errors="backslashreplace")


def names_of(text: str) -> list[str]:
    """Return the names on the lines of a text, # before a comment; commas may part them."""
    names = (name.strip() for line in text.splitlines() for name in line.partition("#")[0].split(","))
    return [name for name in names if name]


class Kind(StrEnum):
    """What has a name."""

    CAMERA = "camera"
    PHOTO = "photo"
    POINT = "point"
    GROUP = "group"  # of equal elevations
    TIDE = "tide"  # group of photos whose tides have one unknown correction
    DAY = "day"  # likewise


# kind -> table and attribute with its names
_PLACES = {
    Kind.CAMERA: ("cameras", "ids"),
    Kind.PHOTO: ("photos", "ids"),
    Kind.POINT: ("points", "ids"),
    Kind.GROUP: ("equal_elevations", "ids"),
    Kind.TIDE: ("photos", "tide_group"),
    Kind.DAY: ("photos", "tide_day"),
}
_LABELS = (Kind.TIDE, Kind.DAY)  # several photos may have the same one
Names = Mapping[Kind, Mapping[str, str]]  # kind -> old -> new


@dataclass(frozen=True, kw_only=True)
class NewName:
    """One line of a file of new names."""

    deck: str  # path or name without ending of a deck, `*` for every one
    kind: Kind
    old: str
    new: str
    file: str
    line: int


def new_names(text: str, file: str) -> tuple[NewName, ...]:
    """Return the new names that a file lists: lines of deck, kind, old and new name.

    A name with blanks stands in quotes; what follows # is a comment. Raises `DeckError` with every bad line.
    """
    names, problems = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            words = shlex.split(line, comments=True)
        except ValueError as error:
            problems.append(Problem(file=file, line=number, message=f"{error}".lower()))
            continue
        if not words:
            continue
        if len(words) != 4 or words[1] not in set(Kind) or not all(words):
            message = f"not 'deck kind old new' with a kind of {', '.join(Kind)}"
            problems.append(Problem(file=file, line=number, message=message))
            continue
        names.append(
            NewName(deck=words[0], kind=Kind(words[1]), old=words[2], new=words[3], file=file, line=number)
        )
    if problems:
        raise DeckError(problems)
    return tuple(names)


def names_in(block: Block, kind: Kind) -> TextArray:
    """Return the names of a kind that a block has, one per row of their table."""
    table, attribute = _PLACES[kind]
    names: TextArray = getattr(getattr(block, table), attribute)
    return names


def renamed(block: Block, names: Names, deck: str) -> Block:
    """Return the block with new names, all given at once: two names may be exchanged.

    Raises `DeckError` where a name is not in the block, or two things would get the same one; tides and days may.
    """
    problems = [
        Problem(file=deck, message=f"no {kind} {old} to be renamed {new}")
        for kind, changes in names.items()
        for old, new in changes.items()
        if old not in names_in(block, kind)
    ]
    tables: dict[str, Any] = {}
    for kind, changes in names.items():
        table, attribute = _PLACES[kind]
        before = names_in(block, kind).tolist()
        after = [changes.get(name, name) for name in before]
        if kind not in _LABELS:
            problems += _taken_twice(kind, before, after, deck)
        tables[table] = replace(tables.get(table, getattr(block, table)), **{attribute: np.array(after, dtype=str)})
    if problems:
        raise DeckError(problems)
    return replace(block, **tables)


def _taken_twice(kind: Kind, before: list[str], after: list[str], deck: str) -> Iterable[Problem]:
    first: dict[str, str] = {}
    for old, new in zip(before, after, strict=True):
        if new in first:
            yield Problem(file=deck, message=f"{kind}s {first[new]} and {old} would both be called {new}")
        first[new] = old


def deck_number(wanted: str, decks: Sequence[str]) -> int:
    """Return which deck a text means: its path as given, or its file name with or without ending.

    Raises `DeckError` where it is none of them, or might be several.
    """
    for meaning in (str, lambda deck: PurePath(deck).name, lambda deck: PurePath(deck).stem):
        matches = [number for number, deck in enumerate(decks) if meaning(deck) == wanted]
        if len(matches) == 1:
            return matches[0]
        if matches:
            raise DeckError([Problem(message=f"'{wanted}' may be any of {', '.join(decks[i] for i in matches)}")])
    raise DeckError([Problem(message=f"'{wanted}' is none of the decks {', '.join(decks)}")])


def assigned(new: Iterable[NewName], parts: Sequence[tuple[str, Block]]) -> list[dict[Kind, dict[str, str]]]:
    """Return the new names of each part, name and block, that lines of a file give.

    `*` stands for every deck that has the name. Raises `DeckError` with every line that names no deck, nothing in
    it, or something twice.
    """
    names: list[dict[Kind, dict[str, str]]] = [{} for _ in parts]
    decks = [deck for deck, _ in parts]
    problems = []
    for change in new:
        place: dict[str, Any] = {"file": change.file, "line": change.line}
        try:
            chosen = range(len(parts)) if change.deck == EVERY_DECK else [deck_number(change.deck, decks)]
        except DeckError as error:
            problems += [replace(problem, **place) for problem in error.problems]
            continue
        having = [number for number in chosen if change.old in names_in(parts[number][1], change.kind)]
        if not having:
            problems.append(Problem(message=f"no {change.kind} {change.old} in {change.deck}", **place))
        for number in having:
            before = names[number].setdefault(change.kind, {}).setdefault(change.old, change.new)
            if before != change.new:
                message = f"{change.kind} {change.old} is to be called {before} already"
                problems.append(Problem(message=message, **place))
    if problems:
        raise DeckError(problems)
    return names


def prefixed(block: Block, kind: Kind, prefix: str, names: Names, but: Container[str] = ()) -> dict[str, str]:
    """Return the new names of a kind: what `names` say, and `prefix` before all others that are not in `but`."""
    given = dict(names.get(kind, {}))
    others = (name for name in names_in(block, kind).tolist() if name not in given and name not in but)
    return given | {name: prefix + name for name in others}
