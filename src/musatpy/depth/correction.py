"""The correction of apparent points: a chunk of them, and files of any size chunk by chunk on several processes.

Stations of a local job and points stand in one rectangular system with Z up. On the ellipsoid stations are
geocentric, points in any system, and every point has its own vertical: the water over it is a plane across that, at
the tide above the ellipsoid, as in the adjustment. Tilted water is a plane too, across its own normal.
"""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.depth.cameras import CameraStations
from musatpy.errors import DepthError, Problem, SystemsError
from musatpy.geometry.collinearity import cross
from musatpy.geometry.crs import LongitudeLatitude
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.projected import Projected
from musatpy.geometry.systems import Geocentric, System, geographic
from musatpy.refraction.apparent import Fault, Through, TruePoints, Verticals, true_points
from musatpy.units import FOOT

if TYPE_CHECKING:
    from concurrent.futures import Future

_ZONE = 6.0  # degrees, of UTM
_WATCH = 0.1  # s, between looks at whether the parent is there
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
class PlacedPoints:
    """n points in the axes of the stations, and each in its own vertical; None: that is Z of these axes."""

    position: FloatArray  # (n, 3) m
    upright: FloatArray  # (n, 3) m in the verticals
    verticals: Verticals | None


def _tilted(axes: FloatArray, slope: FloatArray) -> FloatArray:
    """Return axes (n, 3, 3) turned so that the third is normal to water of a slope (3,) over the second two."""
    up = axes[:, 2]
    normal = up - (slope - up * (up @ slope)[:, None])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    north = cross(normal, axes[:, 0])
    north /= np.linalg.norm(north, axis=1)[:, None]
    return np.stack([cross(north, normal), north, normal], axis=1)


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
    def points_in(self) -> System:
        """The system of the points."""
        return self.system or self.cameras.system

    def __call__(self, apparent: FloatArray) -> tuple[TruePoints, BoolArray]:
        """Return the true points of apparent ones (n, 3), and (n, k) which cameras see them.

        Raises `SystemsError` where the system of the points does not reach one.
        """
        known = np.asarray(np.isfinite(apparent).all(axis=1))
        placed = self.placed(apparent if known.all() else np.where(known[:, None], apparent, self.middle))
        placed.upright[~known] = np.nan
        seen = self.cameras.sees(placed.position) & known[:, None]
        points = true_points(
            placed.upright, self.cameras.stations, self.index, seen, placed.verticals, self.through
        )
        good = np.flatnonzero(points.fault == Fault.NONE)
        if placed.verticals is not None:
            points.position[good] = self.restated(points.position[good], placed.verticals[good])
        if self.errors is not None:
            level = self.points_in.level(points.position[good])
            points.sigma[good], points.depth_sigma[good] = self.errors(level, seen[good])
        return points, seen

    def placed(self, given: FloatArray) -> PlacedPoints:
        """Return finite points (n, 3) as they are placed. Raises `SystemsError` where the system does not reach."""
        ellipsoid, tilt = self.points_in.ellipsoid, self.cameras.tilt
        if ellipsoid is None:
            if tilt is None:
                return PlacedPoints(position=given, upright=given, verticals=None)
            position, height, axes = given, given[:, 2], np.broadcast_to(np.eye(3), (len(given), 3, 3))
        else:
            level = self.points_in.level(given)
            position, height, axes = ellipsoid.geocentric(level), level[:, 2], ellipsoid.frame(level)
        if tilt is not None:
            height = height - (position - tilt.pivot) @ tilt.slope
            axes = _tilted(axes, tilt.slope)
        upright = np.zeros_like(position)
        upright[:, 2] = height
        origin = position - height[:, None] * axes[:, 2]
        return PlacedPoints(position=position, upright=upright, verticals=Verticals(origin=origin, axes=axes))

    def restated(self, upright: FloatArray, verticals: Verticals) -> FloatArray:
        """Return the coordinates (n, 3) of points in their verticals."""
        return self.coordinates(verticals.origin + np.einsum("nij,ni->nj", verticals.axes, upright))

    def coordinates(self, position: FloatArray) -> FloatArray:
        """Return the coordinates (n, 3) of positions in the axes of the stations."""
        ellipsoid = self.points_in.ellipsoid
        return position if ellipsoid is None else self.points_in.coordinates(geographic(ellipsoid, position))

    @property
    def nadirs(self) -> FloatArray:
        """(k, 2) plan coordinates of the stations, in the system of the points."""
        return self.coordinates(self.cameras.stations.position)[:, :2]

    @property
    def middle(self) -> FloatArray:
        """(3,) of the stations, in the system of the points."""
        return self.coordinates(self.cameras.stations.position.mean(axis=0))


# --- points that no camera sees: what would put them below the cameras ---


def attempted(correction: Correction, source: str, apparent: FloatArray) -> tuple[TruePoints, BoolArray] | Problem:
    """Return the true points of apparent ones (n, 3), and (n, k) which cameras see them.

    Or the problem of a file with points that their system does not reach: errors do not leave a process.
    """
    try:
        return correction(apparent)
    except SystemsError as error:
        what = "; ".join(problem.message for problem in error.problems)
        return Problem(
            file=source, message=f"{what}: are the points in this system? {_directions(correction, apparent)}"
        )


def require_sight(correction: Correction, count: int, source: Path, some: FloatArray) -> None:
    """Raise `DepthError` of so many points that no camera sees, with what would let it see `some`."""
    raise DepthError.of(
        f"no camera sees any of its {count} points: are they in the system of the job? They were taken as "
        f"{correction.points_in.text}. {_directions(correction, some)}",
        file=source,
    )


def _directions(correction: Correction, points: FloatArray) -> str:
    """Return in words where the stations are in the system of points (n, 3), and how these would be seen."""
    system = correction.points_in
    place = ", ".join(
        f"{name} {value:.{min(decimals, 6)}f}"
        for name, value, decimals in zip(system.names, correction.middle.tolist(), system.decimals, strict=True)
    )
    ways = "".join(f". They are seen as {words}" for words in _ways(correction, points))
    return f"The middle of the stations is {place}{ways}"


def _ways(correction: Correction, points: FloatArray) -> Iterator[str]:
    """Yield in words how points would be seen: changed, or in another system."""
    points = points[np.isfinite(points).all(axis=1)]
    changed = {
        "x and y exchanged": points[:, [1, 0, 2]],
        "feet": points * FOOT,
        "heights in feet": points * [1.0, 1.0, FOOT],
        "depths positive down": points * [1.0, 1.0, -1.0],
    }
    for words, others in changed.items():
        if _fits(correction, others):
            yield words
    ellipsoid = correction.points_in.ellipsoid
    if ellipsoid is not None:
        for words, system in _systems(ellipsoid, correction.points_in.level(correction.middle[None])):
            if _fits(replace(correction, system=system), points):
                yield words


def _fits(correction: Correction, points: FloatArray) -> bool:
    """Tell whether a camera sees one of the points, which is nearer to the water than the stations are."""
    stations = correction.cameras.stations
    level, height = float(stations.level.mean()), float(stations.heights.mean())
    try:
        placed = correction.placed(points)
    except SystemsError:
        return False
    near = np.abs(placed.upright[:, 2] - level) < height - level
    return bool((correction.cameras.sees(placed.position).any(axis=1) & near).any())


def _systems(ellipsoid: Ellipsoid, middle: FloatArray) -> Iterator[tuple[str, System]]:
    """Yield the systems that files are often in, of the zones of UTM those that the stations may be in."""
    yield "longitude and latitude in degrees", LongitudeLatitude(ellipsoid)
    yield "geocentric coordinates", Geocentric(ellipsoid)
    latitude, longitude = np.degrees(middle[0, :2]).tolist()
    zone = int((longitude + 180.0) // _ZONE) % 60
    for near in (zone - 1, zone, zone + 1):
        for side in ("north", "south"):
            number = near % 60 + 1
            definition = f"+proj=utm +zone={number}{' +south' if side == 'south' else ''} {ellipsoid.definition}"
            if (side == "north") == (latitude >= 0.0) or abs(latitude) < _ZONE:
                yield f'UTM, zone {number} {side} (--crs "{definition}")', Projected(definition, ellipsoid)


# --- on several processes ---


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
            raise DepthError.of("a process at work was killed, perhaps because memory ran out") from error
        finally:
            for future in waiting:
                future.cancel()


_of_process: dict[str, Callable[[Any], Any]] = {}


def _begin(parent: int, function: Callable[[Any], Any]) -> None:
    """Let this process have the function of its tasks once: covariances of stations are large.

    It ends when its parent is gone: that leaves workers waiting for tasks for ever where it is killed.
    """
    import threading

    _of_process["function"] = function

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _work(task: Any) -> Any:
    return _of_process["function"](task)
