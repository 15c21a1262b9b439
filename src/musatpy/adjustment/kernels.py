"""Who does the work: numpy or loops compiled by numba (the extra `fast`), in one thread or in several.

Compiled loops take the points of large blocks. Both give the same numbers to rounding. numba takes longer to load
than a small job to compute; `MUSAT_KERNELS` says which it is to be. Pieces of work go side by side in threads,
their results in order.
"""

from __future__ import annotations

import importlib.util
import os
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import islice
from typing import TYPE_CHECKING, TypeVar

from musatpy.errors import AdjustmentError, Problem

if TYPE_CHECKING:  # these have loops over points themselves
    from concurrent.futures import ThreadPoolExecutor

    from musatpy.adjustment.collinear import Follow
    from musatpy.adjustment.iteration import State
    from musatpy.adjustment.network import Network, PointGroup
    from musatpy.adjustment.normals import Cofactors, NormalEquations
    from musatpy.adjustment.propagation import Diagonal, PointRows, PropagatedObservations
    from musatpy.arrays import FloatArray

VARIABLE = "MUSAT_KERNELS"
NUMPY, NUMBA = "numpy", "numba"
LARGE = 500  # photos, from which on numba is worth its loading
_MOST = 4  # threads: memory grows with them, and the adding up is done by one
_FEWEST = 3000  # rays: handing work to threads takes longer than working at less


def loops_of(network: Network, groups: Iterable[PointGroup]) -> Loops:
    """Return the loops over points of a network, compiled ones for a large one. Raises as `name_of`."""
    if name_of(network.photos) == NUMPY:
        return Loops(network=network, groups=tuple(groups))
    from musatpy.adjustment.compiled.loops import CompiledLoops  # numba takes its time

    return CompiledLoops.of(network, groups)


def name_of(photos: int) -> str:
    """Return the name of the kernels for a block of so many photos.

    Raises `AdjustmentError` where the variable asks for what there is not.
    """
    asked = os.environ.get(VARIABLE, "")
    if asked not in ("", NUMPY, NUMBA):
        raise AdjustmentError([Problem(message=f"{VARIABLE} is {asked!r}: it is {NUMPY} or {NUMBA}")])
    if asked == NUMBA and not is_there():
        message = f"{VARIABLE}={NUMBA} needs the package numba: pip install 'musatpy[fast]'"
        raise AdjustmentError([Problem(message=message)])
    return asked or (NUMBA if photos > LARGE and is_there() else NUMPY)


def is_there() -> bool:
    """Return whether numba is installed."""
    return importlib.util.find_spec("numba") is not None


@dataclass(frozen=True, kw_only=True, eq=False)
class Loops:
    """Loops over points of a network, which do what they can and return the points that are left: all, by numpy."""

    network: Network
    groups: tuple[PointGroup, ...]

    def get_ready(self, state: State, say: Callable[[], None]) -> None:
        """Compile what no run before has compiled, and say so first."""

    def eliminate(
        self, state: State, normals: NormalEquations, follows: list[Follow]
    ) -> tuple[tuple[PointGroup, ...], float]:
        """Add points to the normal equations, and to `follows` how they do; return those left, and the gain.

        That is r' N_pp^-1 r of all: by how much the sum of squares falls when these go to their best.
        """
        return self.groups, 0.0

    def settle(self, state: State, ground: FloatArray, squares: FloatArray) -> tuple[PointGroup, ...]:
        """Take points to their best for the stations: set `ground` (p, 3) and their weighted `squares` (p,)."""
        return self.groups

    def set_squares(self, state: State, squares: FloatArray) -> tuple[PointGroup, ...]:
        """Set the weighted squares (p,) of points where they are, infinite behind a camera."""
        return self.groups

    def spread(
        self, state: State, cofactors: Cofactors, residual: FloatArray, points: FloatArray, diagonal: Diagonal
    ) -> tuple[tuple[PointGroup, ...], list[PropagatedObservations]]:
        """Set the cofactors of `points` (p, 3, 3) along east, north, up, and return those of their images.

        Adds to the diagonal; `residual` (all measurements, 2) mm.
        """
        return self.groups, []

    def observations(self, state: State) -> tuple[tuple[PointGroup, ...], list[PointRows]]:
        """Return the points left, and the weighted observations of the others."""
        return self.groups, []


Piece = TypeVar("Piece")
Result = TypeVar("Result")
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
