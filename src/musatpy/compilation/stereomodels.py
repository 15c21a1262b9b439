"""A stereomodel: two photos of a run in axes of their own, as the plotter has them, and slips of its readings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.compilation.triangulation import AdjustedRun, of_block
from musatpy.compilation.true_points import Readings, true_points
from musatpy.errors import CompilationError
from musatpy.geometry import collinearity
from musatpy.geometry.collinearity import attitude_matrix, in_front
from musatpy.model.compilation import RECOVERABLE
from musatpy.reduction.readings_job import reduce

_PAIRS = 10  # of photos that are looked at, whether they are adjusted
_MISFIT = 6.0  # plate sigmas that half the y-parallaxes of adjusted photos are well below
_LEAST_BASE = 0.01  # of the flying height, across the vertical
_OFF = 0.2  # mm, by which an image may lie off the straight rays of its point: y-parallax of refraction is less
_HIGH = 0.5  # of the flying height, above and below the origin
_FEW, _MOST = 0.5, 0.9  # shares of sound readings that say that something is wrong, and what puts it right


@dataclass(frozen=True, kw_only=True, eq=False)
class Stereomodel:
    """Model axes: X along the base of photos left and right (rows of the run), Z up at the origin, metres.

    `origin` (3,) working, the middle of the footprint of the base on the water, or on the mean ground of a run
    without water. axes (3, 3): X, Y, Z of the model as rows in working axes.
    """

    run: AdjustedRun
    left: int
    right: int
    origin: FloatArray
    axes: FloatArray

    def model(self, working: FloatArray) -> FloatArray:
        """Return model coordinates (..., 3) of working ones."""
        return np.asarray((working - self.origin) @ self.axes.T)

    def working(self, model: FloatArray) -> FloatArray:
        """Return working coordinates (..., 3) of model ones."""
        return np.asarray(model @ self.axes + self.origin)

    @property
    def photos(self) -> tuple[int, int]:
        """Left and right."""
        return self.left, self.right

    @cached_property
    def stations(self) -> FloatArray:
        """(2, 3) in the model: B_1 and B_2 of ETL-0306, section 5."""
        positions = self.run.block.photos.position[list(self.photos)]
        return self.model(self.run.frame.working(positions))

    @cached_property
    def rotation(self) -> FloatArray:
        """(2, 3, 3) model axes to photo."""
        photos, frame = self.run.block.photos, self.run.frame
        rows = list(self.photos)
        axes = frame.axes(frame.working(photos.position[rows]))
        return np.asarray(attitude_matrix(photos.attitude[rows]) @ axes @ self.axes.T)

    @cached_property
    def tides(self) -> FloatArray:
        """(2,) m, heights of the water at the exposures."""
        return self.run.block.photos.tide[list(self.photos)]

    @property
    def index(self) -> float:
        """Refractive index of the water, 1 without any."""
        return self.run.block.water.index if self.run.block.water else 1.0

    @property
    def base(self) -> float:
        """Length of the base, m."""
        return float(np.linalg.norm(self.stations[1] - self.stations[0]))

    @property
    def height(self) -> float:
        """Mean height (m) of the stations over the origin."""
        return float(self.stations[:, 2].mean())

    @property
    def scale(self) -> float:
        """Scale number of the photographs at the origin, the mean of both."""
        return float(np.mean(self.stations[:, 2] / self.camera("focal_length"))) * 1e3

    def camera(self, name: str) -> FloatArray:
        """Return `focal_length`, `principal_point` or `format_size` of the cameras of both photos, (2, ...)."""
        block = self.run.block
        return np.asarray(getattr(block.cameras, name)[block.photos.camera[list(self.photos)]])

    def rays(self, xy: FloatArray) -> FloatArray:
        """Return the unit rays (k, 2, 3) in the model of plate coordinates (k, 2, 2) mm."""
        return collinearity.ray(xy, self.rotation, self.camera("focal_length"), self.camera("principal_point"))

    def images(self, targets: FloatArray) -> FloatArray:
        """Return plate coordinates (k, 2, 2) mm of targets (k, 2, 3) of each photo's ray in air, in the model."""
        focal_length, principal_point = self.camera("focal_length"), self.camera("principal_point")
        return collinearity.image(targets - self.stations, self.rotation, focal_length, principal_point)

    def half_way(self, xy: FloatArray) -> FloatArray:
        """Return points (k, 3) in the model half-way between the straight rays of readings (k, 2, 2) mm."""
        return collinearity.first_pair(np.broadcast_to(self.stations, (len(xy), 2, 3)), self.rays(xy))


def set_up(run: AdjustedRun, left: str, right: str) -> Stereomodel:
    """Return the stereomodel of two photos by their names.

    Raises `CompilationError` where the run has none of a name, where they share no point of it, and where the base
    is nearly zero or vertical.
    """
    rows = [run.photo(left), run.photo(right)]
    frame, photos = run.frame, run.block.photos
    stations = frame.working(photos.position[rows])
    level = frame.level(stations.mean(axis=0))
    tides = photos.tide[rows]
    if np.isfinite(tides).all():
        level[2] = tides.mean()
    else:  # the mean of the points of the run
        known = run.position[np.isfinite(run.position).all(axis=1)]
        level[2] = frame.height(frame.working(known)).mean() if len(known) else 0.0
    origin = frame.from_level(level)
    up = frame.axes(origin)[2]
    base = stations[1] - stations[0]
    along = base - up * (base @ up)
    height = float((stations.mean(axis=0) - origin) @ up)
    if np.linalg.norm(along) < _LEAST_BASE * abs(height):
        message = f"photos {left} and {right} have no base across the vertical: {np.linalg.norm(along):.2f} m"
        raise CompilationError.of(message)
    met, plates = np.sort(run.pairs.photo, axis=1), run.block.plates
    if len(met):
        share = bool((met == sorted(rows)).all(axis=1).any())
    elif len(plates.photo):  # a punched deck, whose points have no covariances
        share = bool(np.intersect1d(*(plates.point[plates.photo == row] for row in rows)).size)
    else:  # it has no points: photos that look down show no farther than their corners
        cameras = photos.camera[rows]
        half = 0.5 * np.linalg.norm(run.block.cameras.format_size[cameras], axis=1)
        reach = float(np.sum(half / run.block.cameras.focal_length[cameras])) * abs(height)
        if np.linalg.norm(along) > reach:
            message = f"photos {left} and {right} do not overlap: {np.linalg.norm(along):.0f} m of base"
            raise CompilationError.of(f"{message}, and they show {reach:.0f} m")
        share = True
    if not share:
        raise CompilationError.of(f"photos {left} and {right} share no point of the run")
    x = along / np.linalg.norm(along)
    return Stereomodel(run=run, left=rows[0], right=rows[1], origin=origin, axes=np.stack([x, np.cross(up, x), up]))


def faults_of_pair(run: AdjustedRun, left: str, right: str) -> list[tuple[str, str]]:
    """Return why two photos by their names make no model: `left` or `right`, and what is wrong with it."""
    names = run.block.photos.ids
    missing = [
        (side, f"the run has no photo {name}")
        for side, name in (("left", left), ("right", right))
        if not (names == name).any()
    ]
    if missing:
        return missing
    try:
        set_up(run, left, right)
    except CompilationError as error:
        return [("right", problem.message) for problem in error.problems]
    return []


def off_plate(model: Stereomodel, xy: FloatArray) -> BoolArray:
    """Return (k, 2) which plate coordinates (k, 2, 2) mm lie outside the formats of the cameras."""
    size = model.camera("format_size")
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(xy) > 0.5 * size).any(axis=-1))


def slip_of(stereo: Stereomodel, xy: FloatArray) -> str:
    """Return what would make points of the readings (k, 2, 2) mm of a model, where most make none; else nothing."""
    xy = xy[np.isfinite(xy).all(axis=(1, 2))]
    if not len(xy) or _sound(stereo, xy) >= _FEW:
        return ""
    ways = {
        "left and right were exchanged": xy[:, ::-1],
        "they were in micrometres (factor 0.001)": 1e-3 * xy,
        "they were in inches (factor 25.4)": 25.4 * xy,
        "they were in centimetres (factor 10)": 10.0 * xy,
        "x and y were exchanged": xy[..., ::-1],
        "the plates were turned by half a turn": -xy,
    }
    shares = {words: _sound(stereo, others) for words, others in ways.items()}
    best = max(shares, key=lambda words: shares[words])
    return best if shares[best] >= _MOST else ""


def _sound(stereo: Stereomodel, xy: FloatArray) -> float:
    """Return the share of readings that are of points on both plates, in front, and near the ground."""
    with np.errstate(all="ignore"):  # parallel rays meet nowhere
        point = stereo.half_way(xy)
        both = np.repeat(point[:, None], 2, axis=1)
        gap = np.abs(stereo.images(both) - xy).max(axis=(1, 2))
        seen = in_front(both - stereo.stations, stereo.rotation).all(axis=1)
        sound = seen & (gap < _OFF) & (np.abs(point[:, 2]) < _HIGH * stereo.height)
    return float(np.mean(sound & ~off_plate(stereo, xy).any(axis=1)))


def unadjusted(run: AdjustedRun) -> str:
    """Return what says that the stations of a deck are not those of its plates; empty where nothing does.

    A punched deck may have no plate measurements. Raises `DeckError` as `reduction.readings_job.reduce` where they
    are raw.
    """
    if run.block.raw:
        run = of_block(reduce(run.block)[0])
    last = len(run.block.photos.ids) - 2
    first = np.unique(np.linspace(0, max(last, 0), _PAIRS).astype(np.int64))[: max(last + 1, 0)]
    off = np.concatenate([np.zeros(0), *(np.abs(_y_parallaxes(run, left)) for left in first.tolist())])
    known = off[np.isfinite(off)]
    limit = max(RECOVERABLE, _MISFIT * run.block.options.plate_sigma)
    if not len(known) or np.median(known) <= limit:
        return ""
    half = f"half have y-parallaxes over {1e3 * np.median(known):.0f} um (expected: below {1e3 * limit:.0f} um)"
    return (
        f"its stations do not fit its plate measurements: of {len(known)} points that neighbouring photos share, "
        f"{half}. It is the deck of a run that is still to be adjusted: give the record of the run, NAME.json, or "
        "the deck that it punched, NAME.pun (--anyway compiles from it)"
    )


def _y_parallaxes(run: AdjustedRun, left: int) -> FloatArray:
    """Return the y-parallaxes (k,) mm of the points that a photo shares with the next one, NaN where unknown."""
    block, plates = run.block, run.block.plates
    one, other = (np.flatnonzero((plates.photo == photo) & plates.triangulated) for photo in (left, left + 1))
    common, here, there = np.intersect1d(plates.point[one], plates.point[other], return_indices=True)
    xy = plates.xy[np.stack([one[here], other[there]], axis=1)]
    submerged = block.points.bathymetric[common] & np.isfinite(block.photos.tide[[left, left + 1]]).all()
    readings = Readings.of(xy, submerged, block.options.plate_sigma)
    return true_points(run.without_errors, (left, left + 1), readings).y_parallax
