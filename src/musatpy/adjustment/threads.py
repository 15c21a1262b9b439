"""Pieces of work side by side, their results in order: numpy lets other threads run while it computes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from itertools import islice
from typing import TypeVar

Piece = TypeVar("Piece")
Result = TypeVar("Result")

_MOST = 4  # threads: memory grows with them, and the adding up is done by one
_FEWEST = 3000  # rays: starting threads takes longer than working at less


def side_by_side(work: Callable[[Piece], Result], pieces: Sequence[Piece], rays: int) -> Iterable[Result]:
    """Yield the results of `work` in the order of `pieces`, so that sums do not depend on the threads.

    `rays` says how much work there is in all of them; a little is done without threads. A few pieces are worked at
    ahead of the one that is asked for, no more: results may be large.
    """
    threads = min(_MOST, os.cpu_count() or 1)
    if threads == 1 or len(pieces) <= 1 or rays < _FEWEST:
        yield from map(work, pieces)
        return
    from concurrent.futures import ThreadPoolExecutor  # small jobs do without

    with ThreadPoolExecutor(threads) as pool:
        left = iter(pieces)
        waiting = [pool.submit(work, piece) for piece in islice(left, threads + 1)]
        while waiting:
            yield waiting.pop(0).result()
            waiting += [pool.submit(work, piece) for piece in islice(left, 1)]
