"""What a check is: a function of the draft that yields problems, and at which drafts it looks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import Problem
from musatpy.formats.draft import Draft

Find = Callable[[Draft], Iterator[Problem]]


@dataclass(frozen=True, kw_only=True)
class DeckCheck:
    """A check. Calling it yields its problems; none where there is nothing for it to look at."""

    find: Find
    of_card: bool  # it looks at one card, whatever the others say
    of_job: bool  # it looks at coordinates and attitudes in the words of the adjustment
    of_run: bool  # it misses what a deck may lack that is to be merged with others, or edited, before it is run
    needs: str  # a role without whose cards there is nothing to look at; empty: none
    follows: tuple[str, ...]  # roles of which a card that cannot be read would have it say what follows from that
    raw: bool | None  # it looks at raw plates alone, or at refined ones alone; None: at both

    def __call__(self, draft: Draft) -> Iterator[Problem]:
        """Return the problems of a draft."""
        if (self.needs and not len(draft.rows[self.needs])) or self.raw not in (None, draft.raw):
            return iter(())
        return iter(()) if draft.is_spoilt(*self.follows) else self.find(draft)


# By the role of observations of a kind: the rows (k, 7) that they add to the datum of some photos (n,) at stations
# (n, 3), see `datum`, and how they may hold nothing, in words. The checks of the kind say so.
MOTIONS: dict[str, tuple[Callable[[Draft, FloatArray, BoolArray], Iterator[FloatArray]], str]] = {}


def check(
    *,
    of_card: bool = False,
    of_job: bool = False,
    of_run: bool = False,
    needs: str = "",
    follows: tuple[str, ...] = (),
    raw: bool | None = None,
) -> Callable[[Find], DeckCheck]:
    """Return what makes a check of a function of the draft."""
    return lambda find: DeckCheck(
        find=find, of_card=of_card, of_job=of_job, of_run=of_run, needs=needs, follows=follows, raw=raw
    )
