"""What several decks give: once where they agree, from the deck that is to be believed where they do not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, IntArray
from musatpy.errors import Problem
from musatpy.jobs.agreement import same


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
