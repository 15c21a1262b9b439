"""New names for cameras, photos, points, groups and tides of a block, and the files that list them.

The names of several blocks as one list, and their tables one below the other with links to it.

What several give stands there once where they agree, from the deck that is to be believed where they do not.
"""

from __future__ import annotations

import shlex
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from functools import cached_property
from pathlib import Path, PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.arrays import BoolArray, IntArray, TextArray
from musatpy.errors import DeckError, Problem
from musatpy.jobs.agreement import Part, same
from musatpy.model import Block
from musatpy.model.tables import renumbered, stacked

EVERY_DECK = "*"


def text_of(path: Path) -> str:
    """Return what a file of names or corners says; bytes that are no UTF-8 stand as escapes, and fit no name."""
    return path.read_text(encoding="utf-8", errors="backslashreplace")


def names_of(text: str) -> list[str]:
    """Return the names on the lines of a text, # before a comment; commas may part them."""
    names = (name.strip() for line in text.splitlines() for name in line.partition("#")[0].split(","))
    return [name for name in names if name]


class NamedKind(StrEnum):
    """What has a name."""

    CAMERA = "camera"
    PHOTO = "photo"
    POINT = "point"
    GROUP = "group"  # of equal elevations
    TIDE = "tide"  # group of photos whose tides have one unknown correction
    DAY = "day"  # likewise


# kind -> table and attribute with its names
_PLACES = {
    NamedKind.CAMERA: ("cameras", "ids"),
    NamedKind.PHOTO: ("photos", "ids"),
    NamedKind.POINT: ("points", "ids"),
    NamedKind.GROUP: ("equal_elevations", "ids"),
    NamedKind.TIDE: ("photos", "tide_group"),
    NamedKind.DAY: ("photos", "tide_day"),
}
_LABELS = (NamedKind.TIDE, NamedKind.DAY)  # several photos may have the same one
Names = Mapping[NamedKind, Mapping[str, str]]  # kind -> old -> new


@dataclass(frozen=True, kw_only=True)
class NewName:
    """One line of a file of new names."""

    deck: str  # path or name without ending of a deck, `*` for every one
    kind: NamedKind
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
        if len(words) != 4 or words[1] not in set(NamedKind) or not all(words):
            message = f"not 'deck kind old new' with a kind of {', '.join(NamedKind)}"
            problems.append(Problem(file=file, line=number, message=message))
            continue
        names.append(
            NewName(deck=words[0], kind=NamedKind(words[1]), old=words[2], new=words[3], file=file, line=number)
        )
    if problems:
        raise DeckError(problems)
    return tuple(names)


def names_in(block: Block, kind: NamedKind) -> TextArray:
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


def _taken_twice(kind: NamedKind, before: list[str], after: list[str], deck: str) -> Iterable[Problem]:
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
            raise DeckError.of(f"'{wanted}' may be any of {', '.join(decks[i] for i in matches)}")
    raise DeckError.of(f"'{wanted}' is none of the decks {', '.join(decks)}")


def assigned(new: Iterable[NewName], parts: Sequence[tuple[str, Block]]) -> list[dict[NamedKind, dict[str, str]]]:
    """Return the new names of each part, name and block, that lines of a file give.

    `*` stands for every deck that has the name. Raises `DeckError` with every line that names no deck, nothing in
    it, or something twice.
    """
    names: list[dict[NamedKind, dict[str, str]]] = [{} for _ in parts]
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


def prefixed(block: Block, kind: NamedKind, prefix: str, names: Names, but: Container[str] = ()) -> dict[str, str]:
    """Return the new names of a kind: what `names` say, and `prefix` before all others that are not in `but`."""
    given = dict(names.get(kind, {}))
    others = (name for name in names_in(block, kind).tolist() if name not in given and name not in but)
    return given | {name: prefix + name for name in others}


_LINKS = {"cameras": NamedKind.CAMERA, "photos": NamedKind.PHOTO, "points": NamedKind.POINT}  # tables with names


@dataclass(frozen=True, kw_only=True)
class Once:
    """Which rows (k,) of stacked tables stay, what was dropped as said before, and where one deck was believed."""

    stays: BoolArray
    dropped: int
    believed: tuple[str, ...]  # what these rows are called
    problems: tuple[Problem, ...]


class Linking:
    """The names of all parts in the order of first appearance; equal ones are one thing."""

    def __init__(self, parts: Sequence[Part]) -> None:
        self.parts = tuple(parts)

    @cached_property
    def number(self) -> dict[NamedKind, dict[str, int]]:
        """The number of each name of a kind."""
        numbers = {}
        for kind in NamedKind:
            names = dict.fromkeys(name for part in self.parts for name in names_in(part.block, kind).tolist())
            numbers[kind] = {name: number for number, name in enumerate(names)}
        return numbers

    def ids(self, kind: NamedKind) -> list[str]:
        """Return the names of a kind."""
        return list(self.number[kind])

    def links(self, part: Part, kind: NamedKind) -> IntArray:
        """Return the number of each thing that one part has."""
        number = self.number[kind]
        return np.array([number[name] for name in names_in(part.block, kind).tolist()], dtype=int)

    def all_links(self, kind: NamedKind) -> IntArray:
        """Return the numbers of the things of all parts, one part after the other."""
        return np.concatenate([self.links(part, kind) for part in self.parts])

    def shared(self, kind: NamedKind) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """Return the names of a kind that several decks have, and these decks."""
        decks: dict[str, list[str]] = {}
        for part in self.parts:
            for name in dict.fromkeys(names_in(part.block, kind).tolist()):
                decks.setdefault(name, []).append(part.name)
        return tuple((name, tuple(those)) for name, those in decks.items() if name and len(those) > 1)

    def table(self, name: str) -> Any:
        """Return a table of all parts, its links those of the common names."""
        return stacked([renumbered(getattr(part.block, name), self._numbers(part)) for part in self.parts])

    def _numbers(self, part: Part) -> dict[str, IntArray]:
        return {table: self.links(part, kind) for table, kind in _LINKS.items()}

    def named(self, link: str, values: NDArray[Any]) -> list[Any]:
        """Return values of such a table as they are, or, of links to a table with names, these."""
        return (np.array(self.ids(_LINKS[link]))[values] if link else values).tolist()

    def deck(self, name: str) -> IntArray:
        """Return which part (k,) each row of such a table comes from."""
        sizes = [getattr(part.block, name).count for part in self.parts]
        return np.repeat(np.arange(len(self.parts)), sizes)

    def once(
        self, name: str, table: Any, key: IntArray, what: Sequence[str], apart: Sequence[str], prefer: int
    ) -> Once:
        """Return each row of a table of all parts that several decks give only once.

        Rows with the same `key` (k, q) of different decks are the same thing, called `what` (k,); the attributes
        `apart` of the key are not compared. Where they differ, the row of deck `prefer` holds (-1: none does), and
        without one that is a problem, which names the decks. Rows of one deck stay as they are.
        """
        part, names = self.deck(name), [part.name for part in self.parts]
        stays = np.ones(len(part), dtype=bool)
        dropped, believed, problems = 0, [], []
        columns = [column.name for column in fields(table) if column.name not in apart]
        _, inverse = np.unique(key, axis=0, return_inverse=True)
        inverse = inverse.reshape(-1)
        repeated = np.flatnonzero(np.bincount(inverse)[inverse] > 1) if len(inverse) else np.zeros(0, dtype=int)
        decided = set(inverse[part == prefer].tolist())
        kept: dict[int, int] = {}
        for row in repeated.tolist():
            first = kept.setdefault(int(inverse[row]), row)
            if part[first] == part[row]:
                continue
            differ = [name for name in columns if not same(getattr(table, name)[first], getattr(table, name)[row])]
            if differ and int(inverse[row]) not in decided:
                message = f"{what[row]} differs in {', '.join(differ)}: {names[part[first]]} and {names[part[row]]}"
                problems.append(Problem(message=message))
            elif differ:
                believed.append(what[row])
            else:
                dropped += 1
            loser = first if differ and part[row] == prefer else row
            stays[loser] = False
            kept[int(inverse[row])] = row if loser == first else first
        return Once(stays=stays, dropped=dropped, believed=tuple(dict.fromkeys(believed)), problems=tuple(problems))
