"""Pieces of work side by side, their results in order: numpy and LAPACK let other threads run meanwhile."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from itertools import islice
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

Piece = TypeVar("Piece")
Result = TypeVar("Result")

_MOST = 4  # threads: memory grows with them, and the adding up is done by one
_FEWEST = 3000  # rays: handing work to threads takes longer than working at less
_here = threading.local()


def side_by_side(work: Callable[[Piece], Result], pieces: Sequence[Piece], rays: int) -> Iterable[Result]:
    """Yield the results of `work` in the order of `pieces`, so that sums do not depend on the threads.

    `rays` says how much work there is in all of them; a little is done without threads, and so is what a piece
    itself would share. A few pieces are worked at ahead of the one that is asked for, no more: results may be
    large. What `work` raises is raised here, when nothing runs any more.
    """
    alone = len(pieces) <= 1 or rays < _FEWEST or getattr(_here, "is_worker", False)
    threads = 1 if alone else min(_MOST, os.cpu_count() or 1)  # the system is asked, which takes 10 us
    if threads == 1:
        yield from map(work, pieces)
        return
    from concurrent.futures import wait  # small jobs do without

    pool, left = _pool(threads), iter(pieces)
    waiting = [pool.submit(work, piece) for piece in islice(left, threads + 2)]
    try:
        while waiting:
            yield waiting.pop(0).result()
            waiting += [pool.submit(work, piece) for piece in islice(left, 1)]
    finally:
        for future in waiting:
            future.cancel()
        wait(waiting)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Return the threads of this process, which wait from one call to the next: starting them takes time."""
    from concurrent.futures import ThreadPoolExecutor

    return ThreadPoolExecutor(threads, thread_name_prefix="musatpy", initializer=_set_out)


def _set_out() -> None:
    _here.is_worker = True  # which must not wait for others


os.register_at_fork(after_in_child=_pool.cache_clear)  # threads stay with the parent
