"""STRIP: photos of a strip from nothing but their images, by triplets joined by similarity.

Okamoto and Mori (1974): every three photos on end are oriented with the plane of water a part of it, each triplet
is joined to the one before by their common points and stations and by the plane that all see, and the strip is put
to the control by one more similarity, for which a level plane of water counts as control.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.special import chdtrc, chdtri

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.similarity import Similarity, small
from musatpy.model.options import PlaneTreatment
from musatpy.orientation.twomedia.drift import Drift, drift_of
from musatpy.orientation.twomedia.joins import Join, JoinError, joined
from musatpy.orientation.twomedia.moved import moved_planes
from musatpy.orientation.twomedia.oriented import OrientationError, Verdict
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Plane, Sights
from musatpy.orientation.twomedia.strip_chain import Chain, chain_of
from musatpy.orientation.twomedia.strip_ground import Known, Placed, placed
from musatpy.orientation.twomedia.strip_triplets import triplets
from musatpy.orientation.twomedia.triplet_models import (
    PLANE,
    POINTS,
    TripletModel,
    orientation_in,
)

LEAST = 4  # photos of a strip
_PASSES = 12  # of triplets over a plane, or tides, that come from the strip
_SETTLED = 1e-8  # of an element, by which the last of them may change it
_ROUNDS = 6  # of the absolute orientation, with the chain in its axes
_THERE = 1e-9  # of its size, up to which the last of them may change it
_SIGNIFICANCE = 0.001  # of the tests of sigma0 and of a control point
_FEW = 0.25  # of the control points, up to which those that do not fit are wrong


@dataclass(frozen=True, kw_only=True, eq=False)
class Strip:
    """A strip of m photos and p points, oriented: on the ground with control, else in axes of its first triplet.

    models (m - 2) and the joins between them (m - 3); known and placed of the absolute orientation, None without
    control; control_points (o,) of its observations, -1 for planes; control_out (p,) those that do not fit.
    of_photo (m,) and of_point (p,) are the triplets that the answer takes them from, -1 for points that none has;
    row_point (p,) their rows there. passes of triplets, which `settled` or not.
    """

    sights: Sights
    plane: Plane
    models: list[TripletModel]
    joins: list[Join]
    drift: Drift
    known: Known | None
    placed: Placed | None
    control_points: IntArray
    control_out: BoolArray
    of_photo: IntArray
    of_point: IntArray
    row_point: IntArray
    passes: int
    settled: bool = True

    @property
    def moves(self) -> list[Similarity]:
        """The similarities of the triplets to the ground."""
        return self.drift.moves

    @property
    def redundancy(self) -> int:
        """Of all triplets."""
        return sum(model.oriented.redundancy for model in self.models)

    @property
    def sigma0(self) -> float:
        """Standard deviation of unit weight of the images, of all triplets."""
        squares = sum(float(model.oriented.adjusted.squares[0]) for model in self.models)
        return float(np.sqrt(squares / self._expected[:, 0].sum()))

    @property
    def fits(self) -> bool:
        """Whether sigma0 passes its test."""
        mean, freedom = self._expected[self._expected[:, 1] > 0.0].T
        total = float(mean.sum() ** 2 / np.sum(mean**2 / freedom))
        return bool(chdtrc(total, total * self.sigma0**2) > _SIGNIFICANCE)

    @property
    def _expected(self) -> FloatArray:
        """(m - 2, 2) squares of the triplets to be expected, and their degrees of freedom."""
        return np.array([model.oriented.expected for model in self.models])

    @property
    def outliers(self) -> BoolArray:
        """(p,) points that a triplet, a join or the control leaves out."""
        out = self.control_out.copy()
        for model in self.models:
            out[model.left_out] = True
        for join in self.joins:
            out[join.points[join.left_out]] = True
        return out

    def orientation(self) -> Orientation:
        """Return the photos as one orientation, over the mean plane of the triplets."""
        parts = [orientation_in(model.oriented, move) for model, move in zip(self.models, self.moves, strict=True)]
        slot = np.arange(len(self.sights.photos)) - self.of_photo
        attitude, station = (
            np.array(
                [getattr(parts[model], name)[0, photo] for model, photo in zip(self.of_photo, slot, strict=True)]
            )
            for name in ("attitude", "station")
        )
        plane = self.planes().mean(axis=0)
        return Orientation(
            attitude=attitude,
            station=station,
            slope=plane[:2],
            level=np.asarray(plane[2]),
            index=np.asarray(self.plane.index),
        )

    def planes(self) -> FloatArray:
        """Return the plane of water (m - 2, 3), slopes and level, of every triplet."""
        rows = np.array([PLANE])
        return np.concatenate(
            [model.moved(move, rows).value for model, move in zip(self.models, self.moves, strict=True)]
        )

    def plane_covariance(self) -> FloatArray:
        """Return the covariances (m - 2, 3, 3) of the planes."""
        rows = np.array([PLANE])
        return np.concatenate([self.drift.precision(number, rows) for number in range(len(self.models))])

    def photo_covariance(self) -> tuple[FloatArray, FloatArray]:
        """Return the covariances (m, 3, 3) of attitudes and of stations, for unit weight."""
        attitude, station = np.empty((2, len(self.of_photo), 3, 3))
        for photo, number in enumerate(self.of_photo.tolist()):
            row = 2 * (photo - number)
            attitude[photo], station[photo] = self.drift.precision(number, np.array([row, row + 1]))
        return attitude, station

    def points(self) -> FloatArray:
        """Return the points (p, 3), NaN for those that no triplet has."""
        return self._of_points(lambda number, rows: self.models[number].moved(self.moves[number], rows).value, (3,))

    def point_covariance(self) -> FloatArray:
        """Return the covariances (p, 3, 3) of the points."""
        return self._of_points(self.drift.precision, (3, 3))

    def _of_points(self, values: object, shape: tuple[int, ...]) -> FloatArray:
        result = np.full((len(self.of_point), *shape), np.nan)
        for number in range(len(self.models)):
            here = self.of_point == number
            if here.any():
                result[here] = values(number, self.row_point[here])  # type: ignore[operator]
        return result

    def verdict(self, limit: float) -> tuple[Verdict, float, int]:
        """Return whether the plane is determined by the triplet that does so least, its share and its number."""
        shares = [model.oriented.level_share for model in self.models]
        least = int(np.argmax(shares))
        verdict, share = self.models[least].oriented.verdict(limit)
        return verdict, share, least


def orient_strip(
    sights: Sights, plane: Plane, *, common_plane: bool = True, base: float = 1.0, equal: bool = False
) -> Strip:
    """Return the orientation of photos in the order of a strip, from no starting values.

    The plane is what is known of it on the ground: KNOWN it is held in every triplet, in the axes that the strip
    before gives it, until these settle; LEVEL its tilt counts as control, and so do priors. `base` is the first one
    of a strip without control. Raises `OrientationError`.
    """
    held = plane.treatment is PlaneTreatment.KNOWN
    tides = plane.rise is not None and bool(np.ptp(plane.rise) > 0.0)
    free = replace(plane, treatment=PlaneTreatment.ADJUST, slope=(0.0, 0.0), slope_sigma=None, level=None,
                   level_sigma=None, rise=None)  # fmt: skip
    strip = _oriented(sights, plane, [free] * (len(sights.photos) - 2), None, common_plane, base, equal)
    while held or tides:
        planes = [_plane_in(strip, number, plane, held) for number in range(len(strip.models))]
        after = _oriented(sights, plane, planes, strip, common_plane, base, equal)
        settled = _elements_change(strip, after) < _SETTLED
        strip = replace(after, settled=settled)
        if settled or after.passes == _PASSES:
            break
    return strip


def _plane_in(strip: Strip, number: int, plane: Plane, held: bool) -> Plane:
    """Return what a triplet knows of the water, in its own axes: the plane where it is held, and tides."""
    move = strip.moves[number]
    rise = None if plane.rise is None else plane.rise[number : number + 3] / move.scale
    if not held:
        return Plane(index=plane.index, rise=rise)
    value = moved_planes(move.inverse(), np.array([[*plane.slope, plane.level or 0.0]])).value[0]
    return Plane(
        treatment=PlaneTreatment.KNOWN,
        slope=(float(value[0]), float(value[1])),
        level=float(value[2]),
        rise=rise,
        index=plane.index,
    )


def _elements_change(before: Strip, after: Strip) -> float:
    """Return the largest change of an orientation of a triplet in its axes, of bases and rad."""
    return max(
        float(np.abs(new.oriented.at.vector - old.oriented.at.vector).max())
        for old, new in zip(before.models, after.models, strict=True)
    )


def _oriented(
    sights: Sights, plane: Plane, planes: list[Plane], before: Strip | None, common: bool, base: float, equal: bool
) -> Strip:
    """Return the strip whose triplets have these planes, started where the strip before has them."""
    models = list(triplets(sights, planes, before.models if before else None, equal))
    joins = []
    held = planes[0].treatment is PlaneTreatment.KNOWN
    for first, second in pairwise(models):
        try:
            joins.append(joined(first, second))
        except JoinError as error:
            names = ", ".join(sights.photos[first.first : first.first + 4])
            raise OrientationError(f"STRIP: the triplets of {names} cannot be joined: {error}") from error
    variance = np.square(sights.image_sigma).ravel()
    start = Similarity(scale=base, rotation=np.eye(3), shift=np.zeros(3)) if before is None else before.moves[0]
    of_point, row_point = _places(len(sights.points), models)
    ground = _Ground(
        models=models,
        joins=joins,
        variance=variance,
        common_plane=common and not held,
        held=np.array([*plane.slope, plane.level]) if held else None,
    )
    known, control_points = _known(sights, plane, models, of_point, row_point, held)
    out, put = np.zeros(len(sights.points), dtype=bool), None
    if known is None:
        drift = drift_of(ground.chain(start), variance, None)
    else:
        out[control_points[control_points >= 0]] = True
        known, control_points, put, drift = _without_false_control(ground, known, control_points, start)
        out[control_points[control_points >= 0]] = False
    number = len(sights.photos)
    return Strip(
        sights=sights,
        plane=plane,
        models=models,
        joins=joins,
        drift=drift,
        known=known,
        placed=put,
        control_points=control_points,
        control_out=out,
        of_photo=np.clip(np.arange(number) - 1, 0, number - 3),
        of_point=of_point,
        row_point=row_point,
        passes=1 if before is None else before.passes + 1,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Ground:
    """Triplets and joins, whose images have `variance` (2 n,), to be put to the ground over one plane or many."""

    models: list[TripletModel]
    joins: list[Join]
    variance: FloatArray
    common_plane: bool
    held: FloatArray | None

    def chain(self, start: Similarity) -> Chain:
        """Return the chain with its first triplet moved by `start`."""
        return chain_of(
            self.models, self.joins, start, self.variance, common_plane=self.common_plane, held=self.held
        )

    def placed(self, known: Known, start: Similarity) -> tuple[Placed, Drift]:
        """Return the absolute orientation from a start, in rounds with the chain in the axes of the last."""
        for _ in range(_ROUNDS):
            chain = self.chain(start)
            put = placed(known, chain)
            if put.change < _THERE:
                break
            if self.held is None:
                start = put.move.after(start)
            else:
                drift = drift_of(chain, self.variance, (known, put))
                change = np.asarray(np.linalg.solve(drift.by_first, put.move.change))
                start = small(change).after(start)
        return put, drift_of(chain, self.variance, (known, put))


def _without_false_control(
    ground: _Ground, known: Known, points: IntArray, start: Similarity
) -> tuple[Known, IntArray, Placed, Drift]:
    """Return the absolute orientation without the few control points that do not fit, or with all of them.

    Where many do not fit it is the strip that bends.
    """
    count = int((points >= 0).sum())
    whole = best = (known, points, *ground.placed(known, start))
    for _ in range(max(int(_FEW * count), 1) + 1):
        known, points, put, drift = best
        tests = control_tests(known, put, drift)
        worst = int(np.argmax(tests))
        if tests[worst] <= control_limit(count):
            return best
        kept = np.arange(len(tests)) != worst
        try:
            best = (known[kept], points[kept], *ground.placed(known[kept], drift.moves[0]))
        except OrientationError:
            break
    return whole


def control_limit(count: int) -> float:
    """Return the limit of the tests of `count` control points."""
    return float(chdtri(3, _SIGNIFICANCE / max(count, 1)))


def control_tests(known: Known, put: Placed, drift: Drift) -> FloatArray:
    """Return the squares (o,) of the residuals of control over their covariances, zero of planes."""
    squares = np.zeros(len(known.row))
    given = np.isfinite(known.target)
    for row in np.flatnonzero(~known.plane):
        number = int(known.model[row])
        rows = known.row[row : row + 1]
        by_change = drift.models[number].on_ground(drift.moves[number], rows).by_change[0]
        own = np.diag(np.where(given[row], known.variance[row], 0.0))
        mixed = by_change @ put.gain[row] @ own
        spread = drift.precision(number, rows)[0] + own - mixed - mixed.T
        r = put.residual[row, given[row]]
        part = spread[np.ix_(given[row], given[row])]
        squares[row] = r @ np.linalg.pinv(part, hermitian=True) @ r
    return squares


def _places(points: int, models: list[TripletModel]) -> tuple[IntArray, IntArray]:
    """Return the triplets (p,) that see points with the most rays, the first of them, and the rows there."""
    rays, of_point, row_point = np.zeros(points, dtype=int), np.full(points, -1), np.full(points, -1)
    for number, model in enumerate(models):
        count = (model.own >= 0).sum(axis=1) // 2
        better = count > rays[model.points]
        here = model.points[better]
        rays[here], of_point[here], row_point[here] = count[better], number, np.flatnonzero(better) + POINTS
    return of_point, row_point


def _known(
    sights: Sights,
    plane: Plane,
    models: list[TripletModel],
    of_point: IntArray,
    row_point: IntArray,
    held: bool,
) -> tuple[Known | None, IntArray]:
    """Return what is known of the ground, None without control, and the points (o,) of it, -1 for planes."""
    given = np.isfinite(sights.control)
    point = np.flatnonzero(given.any(axis=1) & (of_point >= 0))
    if not len(point):
        return None, np.zeros(0, dtype=int)
    tilt_known = plane.treatment is PlaneTreatment.LEVEL or plane.slope_sigma is not None
    level_known = plane.level is not None and plane.level_sigma is not None
    target = np.array([*plane.slope, plane.level if level_known and plane.level is not None else np.nan])
    target[:2] = np.where(tilt_known, target[:2], np.nan)
    planes = np.arange(0 if held else len(models))
    sigma = [plane.slope_sigma or 0.0] * 2 if plane.treatment is not PlaneTreatment.LEVEL else [0.0] * 2
    known = Known(
        model=np.append(of_point[point], planes),
        row=np.append(row_point[point], np.full(len(planes), PLANE)),
        target=np.concatenate([sights.control[point], np.broadcast_to(target, (len(planes), 3))]),
        variance=np.concatenate([np.square(sights.control_sigma[point]), np.zeros((len(planes), 3))]),
        shared=np.square(np.array([*sigma, plane.level_sigma or 0.0])),
    )
    return known, np.append(point, np.full(len(planes), -1))
