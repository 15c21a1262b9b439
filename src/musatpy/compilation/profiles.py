"""The profiles of a compilation: readings along lines of a model, one by one or scanned side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.compilation.compiled import Compiled, CompiledModel, DepthDatum
from musatpy.errors import CompilationError
from musatpy.geometry.crs import MapPlan
from musatpy.model import CoordinateSystem
from musatpy.model.compilation import IN_PROFILE
from musatpy.units import DEGREE

_MOST_LINES = 10_000  # of a scan
_MOST_POSTS = 20_000  # of a card: two seconds and 20,000 rows of the listing
_HALF = 3  # readings to either side of one whose median it is held against
BESIDE = "beside the lines of the scan"


@dataclass(frozen=True, kw_only=True, eq=False)
class LineProfile:
    """k readings in the order of their stations (k,) m along a line, `offset` (k,) m to its left; input `rows`.

    spike (k,) are readings farther from the median of seven than a limit, kept (k,) those that a thinning needs.
    """

    rows: IntArray
    station: FloatArray
    offset: FloatArray
    value: FloatArray
    spike: BoolArray
    kept: BoolArray

    def at_steps(self, step: float) -> tuple[FloatArray, FloatArray]:
        """Return stations (s,) from the first reading on, a step apart, and the values there, spikes left out."""
        good = self.station[~self.spike]
        if not len(good):
            return np.zeros(0), np.zeros(0)
        posts = np.arange(good[0], good[-1] + 1e-9 * max(step, 1.0), step)
        return posts, self.at(posts)

    def at(self, stations: FloatArray) -> FloatArray:
        """Return the values (s,) between readings, spikes left out; beyond the first and the last, theirs."""
        good = ~self.spike
        station, first = np.unique(self.station[good], return_index=True)
        return np.interp(stations, station, self.value[good][first])

    def variance_at(self, stations: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the variances (s,) of values between readings with independent sigmas (k,)."""
        good = ~self.spike
        station, first = np.unique(self.station[good], return_index=True)
        after = np.clip(np.searchsorted(station, stations), 1, max(len(station) - 1, 1))
        if len(station) < 2:
            return np.full(len(stations), float(np.square(sigma[good][0])))
        part = np.clip((stations - station[after - 1]) / (station[after] - station[after - 1]), 0.0, 1.0)
        variance = np.square(sigma[good][first])
        return np.square(1.0 - part) * variance[after - 1] + np.square(part) * variance[after]


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledProfile:
    """A profile of a model, its values depths below the sounding datum; None with the `reason` why there is none.

    `line` is its number in a scan, 1 of a single one. rows (k,) are its readings among all points of the
    compilation, position (k, 3) and sigma (k,) of the depth theirs; their times (k,) s, NaN where not known, and
    stages (k, 2, 2) mm. ends (2, 2) are those of its line on the map, `plan` that of the job, None of a local one.
    """

    name: str
    model: str
    step: float
    line: int
    rows: IntArray
    profile: LineProfile | None
    position: FloatArray
    sigma: FloatArray
    time: FloatArray
    stages: FloatArray
    ends: FloatArray
    plan: MapPlan | None
    reason: str = ""

    def posts(self, datum: DepthDatum) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return stations (s,) at even steps, depths there, their sigmas, and coordinates (s, 3) of the job."""
        assert self.profile is not None
        stations, depths = self.profile.at_steps(self.step)
        sigma = np.sqrt(self.profile.variance_at(stations, self.sigma))
        along = (self.ends[1] - self.ends[0]) / np.linalg.norm(self.ends[1] - self.ends[0])
        places = np.column_stack([self.ends[0] + stations[:, None] * along, np.zeros(len(stations))])
        place = places if self.plan is None else self.plan.coordinates(places)
        height = datum.over(place) - depths
        places[:, 2] = height
        return stations, depths, sigma, places if self.plan is None else self.plan.coordinates(places)

    @cached_property
    def pace(self) -> tuple[float, float, float]:
        """Time from the first to the last reading (s), mean and largest speed of a stage (mm/s); NaN without."""
        order = np.argsort(self.time, kind="stable")
        order = order[np.isfinite(self.time[order])]
        time, stages = self.time[order], self.stages[order]
        taken = np.diff(time)
        if not (taken > 0.0).any():
            return np.nan, np.nan, np.nan
        way = np.linalg.norm(np.diff(stages, axis=0), axis=2).max(axis=1)
        speed = way[taken > 0.0] / taken[taken > 0.0]
        return float(time[-1] - time[0]), float(way.sum() / (time[-1] - time[0])), float(speed.max())

    @property
    def turns(self) -> int:
        """How often the mark went back along the line, by the times of its readings."""
        if self.profile is None:
            return 0
        order = np.argsort(self.time, kind="stable")
        order = order[np.isfinite(self.time[order])]
        ahead = np.sign(np.diff(self.profile.station[order]))
        return sum(first * second < 0.0 for first, second in pairwise(ahead[ahead != 0.0].tolist()))


@dataclass(frozen=True, kw_only=True, eq=False)
class ProfileScan:
    """A scan of a model along X or Y, and its lines."""

    name: str
    model: str
    scan: str
    spacing: float
    lines: tuple[CompiledProfile, ...]


def profiles_of(compiled: Compiled) -> list[CompiledProfile]:
    """Return the profiles of a deck, those of scans line by line."""
    return [line for row in range(len(compiled.deck.profiles.ids)) for line in _lines_of(compiled, row)]


def oddities(profiles: list[CompiledProfile]) -> Iterator[str]:
    """Yield which profiles there are not, and why."""
    for part in profiles:
        if part.reason:
            line = f", line {part.line}" if part.line > 1 else ""
            yield f"profile {part.name}{line} of model {part.model}: {part.reason}"


def scans_of(compiled: Compiled, profiles: list[CompiledProfile]) -> list[ProfileScan]:
    """Return the scans of a deck with their lines."""
    specs, found = compiled.deck.profiles, []
    for row in np.flatnonzero(specs.scan != "L").tolist():
        name, model = str(specs.ids[row]), str(compiled.deck.models.ids[specs.model[row]])
        lines = tuple(line for line in profiles if (line.name, line.model) == (name, model) and line.line)
        found.append(
            ProfileScan(
                name=name, model=model, scan=str(specs.scan[row]), spacing=float(specs.spacing[row]), lines=lines
            )
        )
    return found


def _lines_of(compiled: Compiled, row: int) -> Iterator[CompiledProfile]:
    """Yield the lines of a profile, and what readings of a scan lie beside these."""
    specs = compiled.deck.profiles
    number = int(specs.model[row])
    here = compiled.model_ids == compiled.deck.models.ids[number]
    known, in_profile = here & np.isfinite(compiled.height), compiled.kind == IN_PROFILE
    rows = np.flatnonzero(known & in_profile & (compiled.ids == specs.ids[row]))
    model = compiled.models[number]
    ends = _ends(compiled, row, model, np.flatnonzero(known & ~in_profile))
    missing = next(
        (name for name, end in zip((specs.start[row], specs.end[row]), ends, strict=True) if end is None), ""
    )
    if missing:
        yield _without(compiled, row, rows, f"its end {missing} has no position in the model")
        return
    place = np.array(ends)
    if specs.scan[row] == "L":
        _check_step(compiled, row, [place])
        yield _along(compiled, row, 1, rows, place)
        return
    lines = _scan_lines(
        model, str(specs.scan[row]), float(specs.spacing[row]), place, compiled.model_position[rows, :2]
    )
    if lines is None:
        yield _without(compiled, row, rows, "the scan has no extent along its lines, or too many of them")
        return
    of, on_lines = lines
    _check_step(compiled, row, on_lines)
    for line, end in enumerate(on_lines, 1):
        yield _along(compiled, row, line, rows[of == line], end)
    if (of == 0).any():
        count = int(np.count_nonzero(of == 0))
        yield _without(compiled, row, rows[of == 0], f"{count} {'reading' if count == 1 else 'readings'} {BESIDE}")


def _check_step(compiled: Compiled, row: int, lines: Sequence[FloatArray]) -> None:
    """Raise `CompilationError` at its card where a profile has more posts along its lines than any sheet."""
    specs, where = compiled.deck.profiles, compiled.deck.lines
    ways = np.diff(compiled.run.frame.working(np.array(lines)), axis=1)
    posts = np.linalg.norm(ways, axis=2).sum() / specs.step[row]
    if posts > _MOST_POSTS:
        message = (
            f"profile {specs.ids[row]} has {posts:.3g} posts: give another step ({_MOST_POSTS:,} posts at most)"
        )
        line = None if where is None else int(where.profiles[row])
        raise CompilationError.of(message, line=line, card="PRF", field="step")


def _ends(compiled: Compiled, row: int, model: CompiledModel, points: IntArray) -> list[FloatArray | None]:
    """Return the positions (3,) of the ends of a profile in the system of the job, None of points without one."""
    specs, frame = compiled.deck.profiles, compiled.run.frame
    if specs.system[row] == "":
        ids, position = compiled.ids[points], compiled.points.position[points]
        of_names = [np.flatnonzero(ids == name) for name in (specs.start[row], specs.end[row])]
        return [position[rows[0]] if len(rows) else None for rows in of_names]
    place = np.column_stack([specs.places[row], np.zeros(2)])
    if specs.system[row] == "M":
        return list(frame.system(model.stereo.working(place)))
    angular = compiled.run.block.options.system is CoordinateSystem.GEOGRAPHIC
    return list(place * [DEGREE, DEGREE, 1.0] if angular else place)


def _scan_lines(
    model: CompiledModel, scan: str, spacing: float, ends: FloatArray, xy: FloatArray
) -> tuple[IntArray, list[FloatArray]] | None:
    """Return the lines of readings xy (k, 2) in the model, 0 of those beside all, and the ends of each line.

    Ends (2, 3) are those of the diagonal of the scan in the system of the job. None where there are no lines.
    """
    frame, across = model.stereo.run.frame, 1 if scan == "X" else 0
    corner = model.stereo.model(frame.working(ends))[:, :2]
    width, sign = abs(corner[1, across] - corner[0, across]), np.sign(corner[1, across] - corner[0, across]) or 1.0
    count = int(width / spacing + 1e-6) + 1
    if corner[0, 1 - across] == corner[1, 1 - across] or count > _MOST_LINES:
        return None
    off = sign * (xy[:, across] - corner[0, across]) / spacing
    line = np.rint(off).astype(np.int64)
    of = np.where((line >= 0) & (line < count), line + 1, 0)
    places = []
    for number in range(count):
        place = np.column_stack([corner, np.zeros(2)])
        place[:, across] = corner[0, across] + sign * number * spacing
        places.append(frame.system(model.stereo.working(place)))
    return of, places


def _without(compiled: Compiled, row: int, rows: IntArray, reason: str, line: int = 0) -> CompiledProfile:
    """Return a profile that is none."""
    specs, stages = compiled.deck.profiles, compiled.deck.stages
    read = np.concatenate([model.readings.xy for model in compiled.models])
    return CompiledProfile(
        name=str(specs.ids[row]),
        model=str(compiled.deck.models.ids[specs.model[row]]),
        step=float(specs.step[row]),
        line=line,
        rows=rows,
        profile=None,
        position=compiled.points.position[rows],
        sigma=compiled.datum_depth_sigma[rows],
        time=stages.time[compiled.rows[rows]],
        stages=read[rows],
        ends=np.full((2, 2), np.nan),
        plan=None,
        reason=reason,
    )


def _along(compiled: Compiled, row: int, line: int, rows: IntArray, ends: FloatArray) -> CompiledProfile:
    """Return the profile of readings along a line between ends (2, 3) in the system of the job."""
    specs, depth = compiled.deck.profiles, compiled.datum_depth
    if len(rows) < 2:
        count = "1 reading" if len(rows) == 1 else f"{len(rows)} readings"
        return _without(compiled, row, rows, f"{count} with a position", line)
    system, position = compiled.run.map_system, np.concatenate([ends, compiled.points.position[rows]])
    plan = None if system is None else MapPlan.about(system, position)
    xy = (position if plan is None else plan.places(position))[:, :2]
    if not np.linalg.norm(xy[1] - xy[0]) > 0.0:
        return _without(compiled, row, rows, "its ends are in one place", line)
    spike = float(specs.spike[row])
    done = profile(
        xy[2:], depth[rows], xy[0], xy[1], spike=spike if np.isfinite(spike) else np.inf,
        tolerance=float(specs.tolerance[row]),
    )  # fmt: skip
    return replace(_without(compiled, row, rows[done.rows], "", line), profile=done, ends=xy[:2], plan=plan)


def profile(
    xy: FloatArray, value: FloatArray, start: FloatArray, end: FloatArray, *, spike: float, tolerance: float
) -> LineProfile:
    """Return the readings xy (k, 2) m with values (k,) along the line from `start` (2,) to `end` (2,).

    `spike` and `tolerance` (m) are the limits of spikes and of thinning (Douglas and Peucker 1973, in station and
    value); infinite for none of the first, 0 for none of the second.
    """
    along = (end - start) / np.linalg.norm(end - start)
    station, offset = (xy - start) @ along, (xy - start) @ np.array([-along[1], along[0]])
    order = np.argsort(station, kind="stable")
    station, values = station[order], value[order]
    # of each value and its three neighbours to either side, as far as there are any
    medians = np.array([np.median(values[max(i - _HALF, 0) : i + _HALF + 1]) for i in range(len(values))])
    spikes = np.abs(values - medians) > spike
    kept = np.zeros(len(order), dtype=bool)
    good = np.flatnonzero(~spikes)
    kept[good[_needed(station[good], values[good], tolerance)]] = True
    return LineProfile(rows=order, station=station, offset=offset[order], value=values, spike=spikes, kept=kept)


def _needed(station: FloatArray, value: FloatArray, tolerance: float) -> BoolArray:
    """Return which points (k,) a line needs that stays within a tolerance of the others."""
    needed = np.zeros(len(station), dtype=bool)
    if not tolerance > 0.0 or len(station) < 3:
        return ~needed
    needed[[0, -1]] = True
    parts = [(0, len(station) - 1)]
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        line = np.interp(station[first : last + 1], station[[first, last]], value[[first, last]])
        off = np.abs(value[first : last + 1] - line)
        worst = first + int(off.argmax())
        if off.max() > tolerance:
            needed[worst] = True
            parts += [(first, worst), (worst, last)]
    return needed
