"""The correction of apparent points: a chunk of them, and files of any size chunk by chunk on several processes."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from musatpy.depth.cameras import Cameras
from musatpy.errors import DepthError, Problem
from musatpy.refraction.apparent import REASONS, Fault, TruePoints, true_points

if TYPE_CHECKING:
    from concurrent.futures import Future

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

CHUNK = 16384  # points of a task
_WATCH = 0.5  # s, between looks at whether the parent is there
Task = TypeVar("Task")
Done = TypeVar("Done")
Progress = Callable[[int], None]  # told how much more of a file is done


@dataclass(frozen=True, kw_only=True, eq=False)
class Correction:
    """How apparent points are corrected: the cameras and the index of the water."""

    cameras: Cameras
    index: float

    def __call__(self, apparent: FloatArray) -> tuple[TruePoints, BoolArray]:
        """Return the true points of apparent ones (n, 3), and (n, k) which cameras see them."""
        seen = self.cameras.sees(apparent)
        return true_points(apparent, self.cameras.stations, self.index, seen), seen


@dataclass(frozen=True, kw_only=True, eq=False)
class Tally:
    """What came of points: how many of each `Fault`, and sums over those that are corrected."""

    faults: NDArray[np.int64]  # by Fault
    deepest: float = -np.inf  # m
    factor_sum: float = 0.0
    largest_spread: float = -np.inf  # m

    @classmethod
    def of(cls, points: TruePoints) -> Tally:
        """Return the tally of some points."""
        faults = np.bincount(points.fault, minlength=len(Fault))
        good = points.fault == Fault.NONE
        if not good.any():
            return cls(faults=faults)
        return cls(
            faults=faults,
            deepest=float(points.depth[good].max()),
            factor_sum=float(points.factor[good].sum()),
            largest_spread=float(points.spread[good].max()),
        )

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            faults=self.faults + other.faults,
            deepest=max(self.deepest, other.deepest),
            factor_sum=self.factor_sum + other.factor_sum,
            largest_spread=max(self.largest_spread, other.largest_spread),
        )

    def lines(self) -> list[str]:
        """Return the tally in words."""
        total, good = int(self.faults.sum()), int(self.faults[Fault.NONE])
        lines = [f"{total} points, {good} corrected"]
        if good:
            lines.append(
                f"mean factor {self.factor_sum / good:.4f}, deepest {self.deepest:.3f} m, "
                f"largest spread among cameras {self.largest_spread:.3f} m"
            )
        return lines + [f"{count} not: {REASONS[Fault(fault)]}" for fault, count in self._left()]

    def _left(self) -> Iterator[tuple[int, int]]:
        for fault, count in enumerate(self.faults.tolist()):
            if fault != Fault.NONE and count:
                yield fault, count


NO_POINTS = Tally(faults=np.zeros(len(Fault), dtype=np.int64))


def in_order(function: Callable[[Task], Done], tasks: Iterable[Task], jobs: int) -> Iterator[Done]:
    """Yield what a function makes of each task, in their order, on some processes; few tasks wait at any time.

    Raises `DepthError` where one of the processes is killed.
    """
    if jobs < 2:
        yield from map(function, tasks)
        return
    from concurrent.futures import BrokenExecutor, ProcessPoolExecutor  # small files do without

    with ProcessPoolExecutor(jobs, initializer=_end_with, initargs=(os.getpid(),)) as pool:
        waiting: deque[Future[Done]] = deque()
        try:
            for task in tasks:
                waiting.append(pool.submit(function, task))
                if len(waiting) > 2 * jobs:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        except BrokenExecutor as error:
            raise DepthError(
                [Problem(message="a process at work was killed, perhaps for want of memory")]
            ) from error
        finally:
            for future in waiting:
                future.cancel()


def _end_with(parent: int) -> None:
    """Let this process end when its parent is gone: killed, that leaves its workers waiting for tasks for ever."""
    import threading

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
