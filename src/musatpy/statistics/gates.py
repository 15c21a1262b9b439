"""What no answer can be: gates of the verdict that need no statistics, only physics; and flags against heights.

Each yields its reasons. What the cards of a deck put there themselves (a camera that looks up) is no reason. A
point that contradicts its flag fits as well as others: without the refraction of its rays these meet elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import count_of
from musatpy.geometry import geodesy
from musatpy.geometry.geodesy import ellipsoid_by
from musatpy.model import (
    Block,
    Concern,
    CoordinateSystem,
    Grade,
    Initial,
    OtherFlags,
    PointStatus,
    Program,
    Reason,
    Refraction,
    Solution,
    Treatment,
)
from musatpy.model.findings import named
from musatpy.model.tables import Table, falling, per_row
from musatpy.model.water import index_range
from musatpy.probability import test_limit

if TYPE_CHECKING:
    from musatpy.statistics.quality import Quality

FARTHEST = 100.0  # flying heights
PART_OF_FORMAT = 0.1  # of a plate, that no residual of a measurement in the solution reaches
_LEVEL = 0.02  # flying heights: where half of the points lie nearer to one level, they could be seen in a mirror
_NAMED = 5  # points with their heights
FLAGS = "Flags Against Heights"
_STATIONS, _POINTS = "Adjusted Exposure Stations", "Adjusted Ground Points"
LEAST_LIMIT = 4.0  # sigmas
FEW = 3  # flagged points that say less together than each
NO_BETTER = 16.0  # of v'Pv over sigma0 squared: smaller differences choose no flag
FINEST = 0.001  # m, sigma of heights that are without error: no card gives more


def gates(statistics: Quality) -> Iterator[Reason]:
    """Yield every physical reason to reject a solution."""
    yield from not_finite(statistics)
    yield from stations(statistics)
    yield from far_points(statistics)
    yield from index(statistics)
    yield from residuals(statistics)


def not_finite(statistics: Quality) -> Iterator[Reason]:
    """Yield what has no finite number: sigma0, stations, points, their covariances."""
    solution, block = statistics.solution, statistics.block
    if not np.isfinite(solution.sigma0):
        yield Reason(Grade.REJECTED, Concern.FINITE, "sigma0 is not finite", "Solution Summary")
    busy = np.zeros(len(block.photos.ids), dtype=bool)
    busy[block.plates.photo[solution.plates.triangulated]] = True
    placed = solution.points.status != PointStatus.NOT_DETERMINED
    for what, names, values, covariances, rows, section in (
        (
            "photo",
            block.photos.ids,
            np.hstack([solution.stations.position, solution.stations.attitude]),
            solution.stations.covariance,
            busy,
            _STATIONS,
        ),
        ("point", block.points.ids, solution.points.position, solution.points.covariance, placed, _POINTS),
    ):
        lost = np.flatnonzero(rows & ~np.isfinite(values).all(axis=1))
        if len(lost):
            text = f"{named(what, names[lost])}: no finite coordinates"
            yield Reason(Grade.REJECTED, Concern.FINITE, text, section)
        variances = np.diagonal(covariances, axis1=1, axis2=2)
        with np.errstate(invalid="ignore"):
            wild = ~(np.isfinite(variances) & (variances >= 0.0)).all(axis=1)
        unsure = np.flatnonzero(rows & wild & np.isfinite(values).all(axis=1))
        if len(unsure):
            text = f"{named(what, names[unsure])}: no finite sigmas"
            yield Reason(Grade.REJECTED, Concern.FINITE, text, section)


def stations(statistics: Quality) -> Iterator[Reason]:
    """Yield the cameras below their water or level ground, or looking up at it, where no card puts them so.

    Level ground alone looks from below as it does in a mirror: so do axes of plates or control that are exchanged.
    """
    solution, photos = statistics.solution, statistics.block.photos
    height = elevations(statistics.block, solution.stations.position)
    given_height = np.full(len(height), np.nan)
    given_attitude = np.full((len(height), 3), np.nan)
    if statistics.block.options.initial is not Initial.COMPUTE:
        given_height = elevations(statistics.block, photos.position)
        given_attitude = photos.attitude
    water = photos.tide if solution.water is None else solution.water.tide
    plates, used = statistics.block.plates, solution.plates.triangulated
    sees_water, highest = np.zeros(len(height), dtype=bool), np.full(len(statistics.block.points.ids), -np.inf)
    sees_water[plates.photo[statistics.block.points.bathymetric[plates.point] & used]] = True
    np.fmax.at(highest, plates.point[used], height[plates.photo[used]])
    ground, least = ground_heights(statistics), _LEVEL * flying_height(statistics)
    elevation = elevations(statistics.block, solution.points.position)[plates.point]
    with np.errstate(invalid="ignore"):
        flat = _medians(statistics, np.abs(elevation - ground[plates.photo])) < least
        # control that has relief is in no mirror, nor is a ceiling, which no camera sees from above
        from_above = _medians(statistics, (highest[plates.point] > elevation).astype(float)) > 0.5
        flat &= from_above | _is_level(statistics, least)
        drowned = sees_water & (height <= water)
        buried = flat & (height < ground) & ~(given_height < ground)
        upwards = flat & _looks_up(solution.stations.attitude) & ~_looks_up(given_attitude)
    for what, rows in (
        ("is below the water", drowned),
        ("is below the ground that it shows", buried),
        ("looks above the horizon", upwards),
    ):
        if rows.any():
            text = f"{named('photo', photos.ids[rows])}: the camera {what}"
            yield Reason(Grade.REJECTED, Concern.STATION, text, _STATIONS)


def far_points(statistics: Quality) -> Iterator[Reason]:
    """Yield the points farther from every camera that sees them than `FARTHEST` flying heights."""
    rays, height = ray_lengths(statistics), flying_height(statistics)
    plates, points = statistics.block.plates, statistics.block.points
    nearest = np.full(len(points.ids), np.inf)
    with np.errstate(invalid="ignore"):
        np.fmin.at(nearest, plates.point, rays)
        far = np.flatnonzero(np.isfinite(nearest) & (nearest > FARTHEST * height))
    if len(far):
        largest = float(nearest[far].max())
        away = f"{largest:.2g} m away from the cameras, which fly {height:.0f} m high"
        text = f"{named('point', points.ids[far])}: {away}"
        yield Reason(Grade.REJECTED, Concern.DISTANCE, text, _POINTS)


def index(statistics: Quality) -> Iterator[Reason]:
    """Yield an adjusted refractive index at the ends of its physical range, or outside."""
    water, given = statistics.solution.water, statistics.block.water
    if water is None or given is None or statistics.block.options.water_index is not Treatment.ADJUST:
        return
    low, high = index_range(given.liquid)
    if not low < water.index < high:
        text = f"the adjusted refractive index {water.index:.4f} is not between {low:g} and {high:g}"
        yield Reason(Grade.REJECTED, Concern.INDEX, text, "Water: Surface And Index")


def residuals(statistics: Quality) -> Iterator[Reason]:
    """Yield measurements in the solution whose residual is more than `PART_OF_FORMAT` of the plate."""
    block, residual = statistics.block, np.abs(statistics.solution.plates.residual)
    # where no format is given, the extent of what was measured
    extent = np.ptp(block.plates.xy, axis=0) if len(block.plates.xy) else np.full(2, np.inf)
    formats = np.where(np.isnan(block.cameras.format_size), extent, block.cameras.format_size)
    size = np.nanmin(formats, axis=1)[block.photos.camera[block.plates.photo]]
    with np.errstate(invalid="ignore"):
        rows = np.flatnonzero(
            statistics.solution.plates.triangulated & (residual.max(axis=1) > PART_OF_FORMAT * size)
        )
    if len(rows):
        plates = block.plates
        names = [
            f"{block.photos.ids[photo]} point {block.points.ids[point]}"
            for photo, point in zip(plates.photo[rows].tolist(), plates.point[rows].tolist(), strict=True)
        ]
        largest = float(residual[rows].max())
        text = f"{named('photo', names)}: residuals up to {largest:.1f} mm"
        yield Reason(Grade.REJECTED, Concern.FORMAT, text, "Plate Residuals")


def ray_lengths(statistics: Quality) -> FloatArray:
    """Return the distances (m,) m from camera to point of every measurement; NaN where one has no position."""
    block, solution = statistics.block, statistics.solution
    stations = rectangular(block, solution.stations.position)[block.plates.photo]
    points = rectangular(block, solution.points.position)[block.plates.point]
    with np.errstate(invalid="ignore", over="ignore"):
        return np.linalg.norm(points - stations, axis=1)


def flying_height(statistics: Quality) -> float:
    """Return the median distance (m) from the cameras to the points of the solution."""
    rays = ray_lengths(statistics)[statistics.solution.plates.triangulated]
    rays = rays[np.isfinite(rays)]
    return float(np.median(rays)) if len(rays) else float("nan")


def ground_heights(statistics: Quality) -> FloatArray:
    """Return the median height (n,) m of the points that each photo shows; NaN where it shows none."""
    block, solution = statistics.block, statistics.solution
    return _medians(statistics, elevations(block, solution.points.position)[block.plates.point])


def _medians(statistics: Quality, values: FloatArray) -> FloatArray:
    """Return the medians (n,) of values (m,) of the measurements of each photo; NaN where it has none."""
    photo = statistics.block.plates.photo
    known = statistics.solution.plates.triangulated & np.isfinite(values)
    photo, values = photo[known], values[known]
    values = values[np.lexsort((values, photo))]
    count = np.bincount(photo, minlength=len(statistics.block.photos.ids))
    first, some = np.cumsum(count) - count, count > 0
    low, high = ((first + middle // 2)[some] for middle in (count - 1, count))
    medians = np.full(len(count), np.nan)
    medians[some] = 0.5 * (values[low] + values[high])
    return medians


def _is_level(statistics: Quality, least: float) -> bool:
    """Return whether half of the heights of the control, if any, lie within `least` m about a level."""
    control = statistics.block.control
    height = elevations(statistics.block, control.position)[control.known[:, 2]]
    return not len(height) or bool(np.median(np.abs(height - np.median(height))) < least)


def _looks_up(attitude: FloatArray) -> BoolArray:
    """Return (n,) whether cameras of these attitudes look above the horizon: their axis is -(third row of M)."""
    return np.cos(attitude[:, 0]) * np.cos(attitude[:, 1]) < 0.0


def flags(statistics: Quality) -> Iterator[Reason]:
    """Yield that points contradict their flags, and that so many do that water and control may be of two datums."""
    if not statistics.solution.converged:
        return
    tests = statistics.flags
    below, above = tests.doubted_of(False), tests.doubted_of(True)
    if datum := _datum(statistics):
        yield Reason(Grade.REJECTED, Concern.DATUM, datum, FLAGS)
    for rows, without, side, flag in (
        (below, "not flagged as submerged (B)", "below the water of all", "with"),
        (above, "flagged as submerged (B)", "above the water of all", "without"),
    ):
        if len(rows):
            text = (
                f"{_who(statistics, rows)} {without}, but up to {tests.wrong_side[rows].max():.2f} m "
                f"({tests.sigmas[rows].max():.1f} sigmas) {side} their photos: {_heights(statistics, rows, flag)}"
            )
            yield Reason(Grade.DOUBTFUL, Concern.FLAGS, text, FLAGS)
    if (len(below) or len(above)) and not datum and (apart := _apart(statistics)):
        yield Reason(Grade.DOUBTFUL, Concern.DATUM, f"if the flags are right, {apart}", FLAGS)


def straight(statistics: Quality) -> Iterator[Reason]:
    """Yield that submerged points were adjusted as if there were no water."""
    block = statistics.block
    wet = block.points.bathymetric & (statistics.solution.points.status != PointStatus.NOT_DETERMINED)
    if (many := int(wet.sum())) and not refracts(block):
        text = (
            f"refraction NONE: {many} point{'s' * (many > 1)} flagged as submerged are adjusted as if there "
            "were no water; about a quarter of their depth is missing"
        )
        yield Reason(Grade.DOUBTFUL, Concern.REFRACTION, text, "Options")


def flag_notes(statistics: Quality) -> Iterator[str]:
    """Yield the points near the water whose flags their heights neither confirm nor contradict."""
    tests = statistics.flags
    rows = np.flatnonzero(tests.near & ~tests.flagged)
    if len(rows):
        who, less = _who(statistics, rows), f"by less than {tests.limit:.1f} sigmas"
        yield f"{who} not flagged as submerged, but below the water of some photos, or of all {less}"
    rows = np.flatnonzero(tests.near & tests.flagged)
    if len(rows):
        who = _who(statistics, rows)
        yield f"{who} flagged as submerged, but above the water of all photos by less than {tests.limit:.1f} sigmas"


def _datum(statistics: Quality) -> str:
    """Return the reason to reject heights of two datums; empty where they are not, or other flags end it."""
    tests = statistics.flags
    if not tests.is_of_the_whole(statistics.solution.other_flags):
        return ""
    counts = [
        f"{len(rows)} of {count_of(int((tests.flagged == flagged).sum()), 'point')} {what} the water"
        for flagged, what in ((True, "flagged as submerged are above"), (False, "without the flag are below"))
        if len(rows := tests.doubted_of(flagged))
    ]
    return (
        f"{', '.join(counts)}: {_apart(statistics) or 'no single offset between tides and control explains that'}"
    )


def _apart(statistics: Quality) -> str:
    """Return the offset in words; empty where there is none, or nothing bounds it."""
    least, most = statistics.flags.offset
    if not (np.isfinite(least) and np.isfinite(most)) or least > most:
        return ""
    sizes = sorted((abs(least), abs(most)))
    side = "low" if least > 0.0 else "high"
    return (
        f"tides and control may be {sizes[0]:.1f} to {sizes[1]:.1f} m apart in height, the tides too {side}: read "
        "the datum of both again"
    )


def _heights(statistics: Quality, rows: IntArray, flag: str) -> str:
    """Return both heights of points in words, and the squares of both adjustments where these differ."""
    tests, ids, texts = statistics.flags, statistics.block.points.ids, []
    for row in rows[:_NAMED].tolist():
        other = tests.other_height[row]
        name = f"{ids[tests.point[row]]} at " if len(rows) > 1 else "at "
        texts.append(
            f"{name}{tests.height[row]:.3f} m"
            + (f", {flag} the flag at {other:.3f} m" if np.isfinite(other) else "")
        )
    text, solution = "; ".join(texts), statistics.solution
    if solution.other_flags is not None and squares_choose(solution):
        squares = solution.sum_of_squares, solution.other_flags.sum_of_squares
        text += f"; v'Pv {squares[0]:.1f}, with the other flags {squares[1]:.1f}"
    return text


def _who(statistics: Quality, rows: IntArray) -> str:
    ids = statistics.block.points.ids[statistics.flags.point[rows]]
    return f"{named('point', ids)} {'is' if len(ids) == 1 else 'are'}"


@dataclass(frozen=True, kw_only=True, eq=False)
class FlagTests(Table):
    """t points with a height, its sigma and a tide, but for those that are dry for certain."""

    point: IntArray = per_row(link="points")  # (t,)
    flagged: BoolArray = per_row()  # (t,)
    height: FloatArray = per_row()  # (t,) m
    water: FloatArray = per_row()  # (t,) m, lowest over a point that is not flagged, highest over one that is
    mixed: BoolArray = per_row()  # (t,) not flagged, and a sigma or more below some of its water, not below all
    shore: BoolArray = per_row()  # (t,) of a group of equal elevations: on the water line
    straight: FloatArray = per_row()  # (t,) m, height where its rays meet without refraction
    sigma: FloatArray = per_row()  # (t,) m, of the height above the water
    other_height: FloatArray = per_row()  # (t,) m, when all in doubt have the other flag; NaN where not known
    limit: float  # sigmas

    @property
    def wrong_side(self) -> FloatArray:
        """(t,) m, on the wrong side of all its water: depth without the flag, height above the water with it."""
        return np.where(self.flagged, self.height - self.water, self.water - self.height)

    @property
    def sigmas(self) -> FloatArray:
        """(t,) sigmas on the wrong side of the water."""
        return self.wrong_side / self.sigma

    @cached_property
    def doubted(self) -> IntArray:
        """Rows of the points that contradict their flags, the worst first."""
        rows = np.flatnonzero(self.sigmas > self.limit)
        return rows[falling(self.sigmas[rows], 1)]

    @property
    def near(self) -> BoolArray:
        """(t,) True where a point, not on the shore, is a sigma or more on the wrong side, and not in doubt."""
        return ~self.shore & (self.mixed | ((self.sigmas > 1.0) & (self.sigmas <= self.limit)))

    def doubted_of(self, flagged: bool) -> IntArray:
        """Return the rows of the points that contradict their flags and have the flag, or do not."""
        return self.doubted[self.flagged[self.doubted] == flagged]

    def is_of_the_whole(self, other: OtherFlags | None) -> bool:
        """Return whether so many contradict their flags that water and heights may be of two datums.

        That half of those without it lie below the water is no such sign where flags were forgotten: where `other`
        ones are consistent.
        """
        flagged, unflagged = int(self.flagged.sum()), int((~self.flagged).sum())
        above, below = len(self.doubted_of(True)), len(self.doubted_of(False))
        forgotten = other is not None and other.consistent
        return (flagged >= FEW and 2 * above >= flagged) or (
            flagged > 0 and below > 0 and 2 * below >= unflagged and not forgotten
        )

    @property
    def offset(self) -> tuple[float, float]:
        """Between what and what (m) the water would have to stand higher for no point to contradict its flag.

        Of flagged points that is asked where their straight rays meet, above the water or below it as the point is.
        Infinite without any point on a side; the first is above the second where no one offset will do.
        """
        reach = self.limit * self.sigma
        flagged = self.flagged & np.isfinite(self.straight)
        least = (self.straight - self.water - reach)[flagged].max(initial=-np.inf)
        most = (self.height - self.water + reach)[~self.flagged].min(initial=np.inf)
        return float(least), float(most)


def flag_tests(solution: Solution, point_sigmas: FloatArray) -> FlagTests:
    """Return the flags of a solution held against its heights; of no point where nothing is refracted.

    `point_sigmas` (p, 3) m: those of the heights come last.
    """
    block, points, wet = solution.block, solution.points, solution.block.points.bathymetric
    height, other = elevations(block, points.position), np.full(len(wet), np.nan)
    if solution.other_flags is not None:
        other[solution.other_flags.point] = solution.other_flags.height
    sigma = np.hypot(point_sigmas[:, 2], points.water_sigma)
    tested = refracts(block) & ~block.points.dry & np.isfinite(height) & np.isfinite(points.water[:, 0])
    rows = np.flatnonzero(tested & np.isfinite(sigma))
    straight = height.copy()
    straight[solution.bathymetric.point] = elevations(block, solution.bathymetric.apparent)
    lowest, highest = points.water[rows].T
    return FlagTests(
        point=rows,
        flagged=wet[rows],
        height=height[rows],
        water=np.where(wet[rows], highest, lowest),
        mixed=~wet[rows] & (height[rows] + sigma[rows] < highest) & (height[rows] >= lowest),
        shore=np.isin(rows, block.equal_elevations.point),
        straight=straight[rows],
        sigma=np.maximum(sigma[rows], FINEST),
        other_height=other[rows],
        limit=flag_limit(len(rows)),
    )


def squares_choose(solution: Solution) -> bool:
    """Return whether the other flags make v'Pv larger or smaller by more than chance does."""
    other = solution.other_flags
    return other is not None and abs(other.sum_of_squares - solution.sum_of_squares) > NO_BETTER


def flag_limit(count: int) -> float:
    """Return how many sigmas on the wrong side of the water contradict a flag, where `count` points are tested."""
    return max(LEAST_LIMIT, test_limit(count))


def refracts(block: Block) -> bool:
    """Return whether the program of a block bends the rays of submerged points."""
    return block.options.program is not Program.IIA or block.options.refraction is not Refraction.NONE


def rectangular(block: Block, positions: FloatArray) -> FloatArray:
    """Return X, Y, Z (n, 3) m of positions (n, 3) in the job's system; rows with a NaN come back all NaN."""
    if block.options.system is not CoordinateSystem.GEOGRAPHIC:
        return positions
    return ellipsoid_by(block.ellipsoid, block.options.system).geocentric(positions)


def elevations(block: Block, positions: FloatArray) -> FloatArray:
    """Return the heights (n,) m of positions (n, 3) in the job's system; NaN where a position has a NaN."""
    if block.options.system is not CoordinateSystem.GEOCENTRIC:
        return positions[:, 2]
    return ellipsoid_by(block.ellipsoid, block.options.system).geographic(positions)[:, 2]


def metric_differences(block: Block, given: FloatArray, adjusted: FloatArray) -> FloatArray:
    """Return adjusted minus given positions (n, 3) of a job, as `musatpy.geometry.geodesy` does, m."""
    return geodesy.metric_differences(block.options.system, block.ellipsoid, given, adjusted)
