"""Sections of two listings -> which is compared with which.

Sections of one title are partners, in their order. Where photos stand across the page, ten to a table, one photo
more moves those that follow into other tables: their columns find each other in any table of the title.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Hashable, Iterator, Sequence
from typing import NamedTuple

from musatpy.listings.align import align
from musatpy.listings.sections import Section

_DIGITS = re.compile(r"\d+")
_Homes = dict[tuple[str, str], list[int]]  # numbers of tables, by their title and a heading


class SectionPair(NamedTuple):
    """A section of A and one of B, or of one only."""

    a: Section | None
    b: Section | None
    moved: bool = False  # it stands elsewhere
    columns: frozenset[str] | None = None  # only these are compared, nothing else of the sections; None: all
    elsewhere: frozenset[str] = frozenset()  # columns of one that the other listing has in another table

    @property
    def lonely(self) -> str:
        """The listing, `A` or `B`, that alone has the section."""
        return "A" if self.b is None else "B" if self.a is None else ""


def pairs_of_sections(a: Sequence[Section], b: Sequence[Section]) -> Iterator[SectionPair]:
    """Yield the pairs of sections in the order of A; behind each, the tables of B that have more of its columns."""
    homes = _homes(a), _homes(b)
    for pair in _by_title(a, b):
        strays = _strays(pair.a, pair.b, homes), _strays(pair.b, pair.a, homes)
        yield pair._replace(elsewhere=strays[0] | strays[1])
        if pair.a and strays[0]:
            tables: dict[int, set[str]] = defaultdict(set)
            for name in strays[0]:
                tables[homes[1][pair.a.title, name][0]].add(name)
            for n, names in sorted(tables.items()):
                yield SectionPair(pair.a, b[n], columns=frozenset(names))


def _strays(section: Section | None, partner: Section | None, homes: tuple[_Homes, _Homes]) -> frozenset[str]:
    """Return the columns of a table that its partner has not, but another table; each listing has them once."""
    missing = _across(section) - _across(partner)
    title = section.title if section else ""
    return frozenset(name for name in missing if all(len(side.get((title, name), ())) == 1 for side in homes))


def _across(section: Section | None) -> frozenset[str]:
    """Return the names of photos or points that stand across the page in a table."""
    return frozenset(column.name for column in section.columns) if section and section.across else frozenset()


def _homes(sections: Sequence[Section]) -> _Homes:
    """Return in which tables each column stands."""
    homes: _Homes = defaultdict(list)
    for n, section in enumerate(sections):
        for name in _across(section):
            homes[section.title, name].append(n)
    return homes


def _by_title(a: Sequence[Section], b: Sequence[Section]) -> Iterator[SectionPair]:
    """Yield sections of one title, and those of one listing only."""
    keys = _keys(a), _keys(b)
    titles = tuple([section.title for section in sections] for sections in (a, b))
    alignment = align(keys, (titles[0], titles[1]), lambda side, row: keys[side][row], strict=True)
    for n, other in alignment.steps():
        pair = None if n is None else a[n], None if other is None else b[other]
        yield SectionPair(*pair, n in alignment.moved)


def _keys(sections: Sequence[Section]) -> list[Hashable]:
    """Return titles without their numbers, with how many of the same stand before."""
    counts: Counter[str] = Counter()
    keys: list[Hashable] = []
    for section in sections:
        title = _DIGITS.sub("#", section.title)
        keys.append((title, counts[title]))
        counts[title] += 1
    return keys
