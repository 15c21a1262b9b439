"""The correction of apparent points: a chunk of them, and files of any size chunk by chunk on several processes."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.depth.cameras import CameraStations
from musatpy.depth.point_positions import PointSystem
from musatpy.errors import DepthError, Problem
from musatpy.geometry.systems import System
from musatpy.refraction.apparent import REASONS, Fault, Through, TruePoints, true_points

if TYPE_CHECKING:
    from concurrent.futures import Future


_WATCH = 0.1  # s, between looks at whether the parent is there
_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of Linux
Task = TypeVar("Task")
Done = TypeVar("Done")
Progress = Callable[[int], None]  # told how much more of a file is done


class PointErrors(Protocol):
    """What knows the errors of stations and images."""

    def __call__(self, level: FloatArray, seen: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return the sigmas (n, 3) m of true points along east, north, up, and those (n,) of their depths.

        level (n, 3): latitude, longitude (rad) and height (m), or X, Y, Z; seen (n, k): which cameras see them.
        """


@dataclass(frozen=True, kw_only=True, eq=False)
class Correction:
    """How apparent points are corrected: the cameras, the index of the water, and the system of the points.

    `errors`: what makes their sigmas, None where nothing is known of it; `through`: what refracts their rays where
    there are waves.
    """

    cameras: CameraStations
    index: float
    system: System | None = None  # None: that of the cameras
    errors: PointErrors | None = None
    through: Through | None = None

    @property
    def ground(self) -> PointSystem:
        """The system of the points, over the water of the cameras."""
        return PointSystem(system=self.system or self.cameras.system, tilt=self.cameras.tilt)

    def __call__(self, apparent: FloatArray) -> tuple[TruePoints, BoolArray]:
        """Return the true points of apparent ones (n, 3), and (n, k) which cameras see them.

        Raises `SystemsError` where the system of the points does not reach one.
        """
        ground = self.ground
        known = np.asarray(np.isfinite(apparent).all(axis=1))
        placed = ground.placed(apparent if known.all() else np.where(known[:, None], apparent, self.middle))
        placed.upright[~known] = np.nan
        seen = self.cameras.sees(placed.position) & known[:, None]
        points = true_points(
            placed.upright, self.cameras.stations, self.index, seen, placed.verticals, self.through
        )
        good = np.flatnonzero(points.fault == Fault.NONE)
        if placed.verticals is not None:
            points.position[good] = ground.restated(points.position[good], placed.verticals[good])
        if self.errors is not None:
            level = ground.system.level(points.position[good])
            points.sigma[good], points.depth_sigma[good] = self.errors(level, seen[good])
        return points, seen

    @property
    def nadirs(self) -> FloatArray:
        """(k, 2) plan coordinates of the stations, in the system of the points."""
        return self.ground.coordinates(self.cameras.stations.position)[:, :2]

    @property
    def middle(self) -> FloatArray:
        """(3,) of the stations, in the system of the points."""
        return self.ground.coordinates(self.cameras.stations.position.mean(axis=0))


@dataclass(frozen=True, kw_only=True, eq=False)
class CorrectionTally:
    """What came of points: how many of each `Fault`, and sums over those that are corrected."""

    faults: IntArray  # by Fault
    deepest: float = -np.inf  # m
    factor_sum: float = 0.0
    largest_spread: float = -np.inf  # m
    depth_variance: float = 0.0  # m2, a sum; NaN without sigmas
    seen: int = 0  # points that a camera sees, corrected or not

    @classmethod
    def of(cls, points: TruePoints) -> CorrectionTally:
        """Return the tally of some points."""
        faults = np.bincount(points.fault, minlength=len(Fault))
        seen = int(np.count_nonzero(points.cameras))
        good = points.fault == Fault.NONE
        if not good.any():
            return cls(faults=faults, seen=seen)
        return cls(
            faults=faults,
            seen=seen,
            deepest=float(points.depth[good].max()),
            factor_sum=float(points.factor[good].sum()),
            largest_spread=float(points.spread[good].max()),
            depth_variance=float(np.square(points.depth_sigma[good]).sum()),
        )

    def __add__(self, other: CorrectionTally) -> CorrectionTally:
        return CorrectionTally(
            faults=self.faults + other.faults,
            deepest=max(self.deepest, other.deepest),
            factor_sum=self.factor_sum + other.factor_sum,
            largest_spread=max(self.largest_spread, other.largest_spread),
            depth_variance=self.depth_variance + other.depth_variance,
            seen=self.seen + other.seen,
        )

    @property
    def corrected(self) -> int:
        """How many points have a true place."""
        return int(self.faults[Fault.NONE])

    def lines(self) -> list[str]:
        """Return the tally in words."""
        total, good = int(self.faults.sum()), self.corrected
        lines = [f"{total} points, {good} corrected"]
        if good:
            lines.append(
                f"mean factor {self.factor_sum / good:.4f}, deepest {self.deepest:.3f} m, "
                f"largest spread among cameras {self.largest_spread:.3f} m"
            )
            if not np.isnan(self.depth_variance):
                lines.append(f"sigma of a depth {np.sqrt(self.depth_variance / good):.3f} m")
        counts = zip(Fault, self.faults.tolist(), strict=True)
        return lines + [f"{n} not: {REASONS[fault]}" for fault, n in counts if fault != Fault.NONE and n]


NO_POINTS = CorrectionTally(faults=np.zeros(len(Fault), dtype=np.int64))


def in_order(function: Callable[[Task], Done], tasks: Iterable[Task], jobs: int) -> Iterator[Done]:
    """Yield what a function makes of each task, in their order, on some processes; few tasks wait at any time.

    Raises `DepthError` where one of the processes is killed.
    """
    if jobs < 2:
        yield from map(function, tasks)
        return
    from concurrent.futures import BrokenExecutor, ProcessPoolExecutor  # small files do without

    with ProcessPoolExecutor(jobs, initializer=_begin, initargs=(os.getpid(), function)) as pool:
        waiting: deque[Future[Done]] = deque()
        try:
            for task in tasks:
                waiting.append(pool.submit(_work, task))
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


_of_process: dict[str, Callable[[Any], Any]] = {}


def _begin(parent: int, function: Callable[[Any], Any]) -> None:
    """Let this process have the function of its tasks once: covariances of stations are large."""
    _of_process["function"] = function
    _end_with(parent)


def _work(task: Any) -> Any:
    return _of_process["function"](task)


def _end_with(parent: int) -> None:
    """Let this process end when its parent is gone: killed, that leaves its workers waiting for tasks for ever.

    On Linux the system does so at once, even in the middle of a task; elsewhere the process looks for its parent.
    """
    import ctypes
    import signal
    import threading

    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGKILL)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
