"""The names of several blocks as one list, and their tables one below the other with links to it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from musatpy.arrays import IntArray
from musatpy.jobs.agreement import Part
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
