"""The names of several blocks as one list, and their tables one below the other with links to it.

What several give stands there once where they agree, from the deck that is to be believed where they do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, IntArray
from musatpy.errors import Problem
from musatpy.jobs.agreement import Part, same
from musatpy.jobs.naming import Kind, names_in
from musatpy.model.tables import renumbered, stacked

_LINKS = {"cameras": Kind.CAMERA, "photos": Kind.PHOTO, "points": Kind.POINT}  # tables with names


class Linking:
    """The names of all parts in the order of first appearance; equal ones are one thing."""

    def __init__(self, parts: Sequence[Part]) -> None:
        self.parts = tuple(parts)

    @cached_property
    def number(self) -> dict[Kind, dict[str, int]]:
        """The number of each name of a kind."""
        numbers = {}
        for kind in Kind:
            names = dict.fromkeys(name for part in self.parts for name in names_in(part.block, kind).tolist())
            numbers[kind] = {name: number for number, name in enumerate(names)}
        return numbers

    def ids(self, kind: Kind) -> list[str]:
        """Return the names of a kind."""
        return list(self.number[kind])

    def links(self, part: Part, kind: Kind) -> IntArray:
        """Return the number of each thing that one part has."""
        number = self.number[kind]
        return np.array([number[name] for name in names_in(part.block, kind).tolist()], dtype=int)

    def all_links(self, kind: Kind) -> IntArray:
        """Return the numbers of the things of all parts, one part after the other."""
        return np.concatenate([self.links(part, kind) for part in self.parts])

    def shared(self, kind: Kind) -> tuple[tuple[str, tuple[str, ...]], ...]:
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

    def deck(self, name: str) -> IntArray:
        """Return which part (k,) each row of such a table comes from."""
        sizes = [getattr(part.block, name).count for part in self.parts]
        return np.repeat(np.arange(len(self.parts)), sizes)


@dataclass(frozen=True, kw_only=True)
class Once:
    """Which rows (k,) of stacked tables stay, what was dropped as said before, and where one deck was believed."""

    stays: BoolArray
    dropped: int
    believed: tuple[str, ...]  # what these rows are called
    problems: tuple[Problem, ...]


def once(
    table: Any,
    key: IntArray,
    part: IntArray,
    names: Sequence[str],
    *,
    what: Sequence[str],
    apart: Sequence[str] = (),
    prefer: int = -1,
) -> Once:
    """Return each row of a table that several decks give only once.

    Rows with the same `key` (k, q) of different decks `part` (k,) are the same thing, called `what` (k,); the
    attributes `apart` of the key are not compared. Where they differ, the row of deck `prefer` holds (-1: none
    does), and without one that is a problem, which names the decks by `names`. Rows of one deck stay as they are.
    """
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
