"""STRIP: photos of a strip from nothing but their images, by triplets joined by similarity: first values.

Okamoto and Mori (1974): every three photos on end are oriented with the plane of water a part of it, each triplet
is joined to the one before by their common points and stations, and the strip is put to the control by one more
similarity. What these values are worth, and which plane all photos see, is for an adjustment that starts from them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.special import chdtrc, chdtri

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix, skew
from musatpy.geometry.similarity import Similarity, by_change, fit, fit_robust, small
from musatpy.model.options import PlaneTreatment
from musatpy.orientation.absolute import levelling
from musatpy.orientation.twomedia.methods import TRIPLET, along_axes
from musatpy.orientation.twomedia.oriented import OrientationError, Oriented, PlaneVerdict, orient
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Sights, WaterPlane

MOTIONS = ("scale", "tilt about X", "tilt about Y", "heading", "X", "Y", "Z")
_FEWEST = 3  # common points of a join
_SIGNIFICANCE = 0.001  # of the tests of sigma0 and of a common point
_FLOOR = 1e-3  # of a sigma: what counts as an error of a common point at least
_STEPS = 20
_STILL = 1e-9  # of a change of the similarity to the ground, relative to the size of that
_FREE = 1e-9  # eigenvalue of the scaled normals up to which a motion is free
_FLAT = 0.05  # of the extent along, that across the control from which it fixes the tilts
_NOWHERE = Similarity(scale=1.0, rotation=np.eye(3), shift=np.zeros(3))


@dataclass(frozen=True, kw_only=True, eq=False)
class Triplet:
    """Three photos on end of a strip as a model in axes of its own.

    points (k,) are the rows in the strip of the points that it has, in their order, with their places (k, 3),
    covariances (k, 3, 3) for unit weight and rays (k,); left_out (o,) the rows of its outliers.
    """

    oriented: Oriented
    points: IntArray
    place: FloatArray
    covariance: FloatArray
    rays: IntArray
    left_out: IntArray

    def moved(self, move: Similarity) -> Orientation:
        """Return its photos (1,) and the water in other axes."""
        at = self.oriented.at
        normal = move.rotation @ np.append(-at.slope, 1.0)
        level = move.scale * at.level / normal[2] + normal / normal[2] @ move.shift
        return Orientation(
            attitude=attitude_from_matrix(move.turn(attitude_matrix(at.attitude)))[None],
            station=move.apply(at.station)[None],
            slope=-(normal / normal[2])[None, :2],
            level=np.atleast_1d(level),
            index=np.atleast_1d(at.index),
        )

    def plane(self, move: Similarity) -> FloatArray:
        """Return slopes and level (3,) of the water in other axes."""
        at = self.moved(move)
        return np.append(at.slope[0], at.level[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class Join:
    """The similarity `move` of a triplet to the axes of the one before, whose first base is the unit.

    points (k,) rows in the strip of what both have, left_out (k,) those that do not fit. Misclosures are those of
    the triplet before less this one: residual (k, 3) of the points, station (2, 3) of the photos that both have,
    plane (3,) of slopes and level of the water.
    """

    move: Similarity
    points: IntArray
    left_out: BoolArray
    residual: FloatArray
    station: FloatArray
    plane: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Strip:
    """A strip of m photos and p points as chained: on the ground with control, else in axes of its first triplet.

    triplets (m - 2) with their similarities `moves` to these axes, and the joins between them (m - 3). points
    (p, 3) are places by the triplets that see them with most rays, NaN for those that no triplet has.
    """

    sights: Sights
    plane: WaterPlane
    triplets: list[Triplet]
    joins: list[Join]
    moves: list[Similarity]
    points: FloatArray

    @property
    def redundancy(self) -> int:
        """Of all triplets."""
        return sum(triplet.oriented.redundancy for triplet in self.triplets)

    @property
    def sigma0(self) -> float:
        """Standard deviation of unit weight of the images, of all triplets."""
        squares = sum(float(triplet.oriented.adjusted.squares[0]) for triplet in self.triplets)
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
        return np.array([triplet.oriented.expected for triplet in self.triplets])

    @property
    def outliers(self) -> BoolArray:
        """(p,) points that a triplet or a join leaves out."""
        out = np.zeros(len(self.sights.points), dtype=bool)
        for triplet in self.triplets:
            out[triplet.left_out] = True
        for join in self.joins:
            out[join.points[join.left_out]] = True
        return out

    def orientation(self) -> Orientation:
        """Return the photos, each as the middle one of its triplet, over their mean plane.

        What is known of the plane, with or without sigma, replaces the mean: priors are about what is stated.
        """
        parts = [triplet.moved(move) for triplet, move in zip(self.triplets, self.moves, strict=True)]
        attitude, station = (
            np.concatenate(
                [getattr(parts[0], name)[0, :1], *(getattr(part, name)[0, 1:2] for part in parts),
                 getattr(parts[-1], name)[0, 2:]]
            )
            for name in ("attitude", "station")
        )  # fmt: skip
        slope, level = np.split(self.planes().mean(axis=0), [2])
        plane = self.plane
        if plane.treatment is not PlaneTreatment.ADJUST or plane.slope_sigma is not None:
            known = np.asarray(plane.slope)
            slope, level = known, level + station[:, :2].mean(axis=0) @ (slope - known)
        if plane.treatment is PlaneTreatment.KNOWN or plane.level_sigma is not None:
            level = np.array([plane.level])
        return Orientation(
            attitude=attitude, station=station, slope=slope, level=level[0], index=np.asarray(plane.index)
        )

    def planes(self) -> FloatArray:
        """Return the plane of water (m - 2, 3), slopes and level, of every triplet."""
        return np.array([triplet.plane(move) for triplet, move in zip(self.triplets, self.moves, strict=True)])

    @property
    def weakest(self) -> int:
        """The triplet that determines its plane of water least."""
        return int(np.argmax([triplet.oriented.level_share() for triplet in self.triplets]))

    def verdict(self, limit: float) -> tuple[PlaneVerdict, float]:
        """Return whether the weakest triplet determines the plane, and its share; a plane that is known is held."""
        if self.plane.treatment is PlaneTreatment.KNOWN:
            return PlaneVerdict.HELD, 0.0
        return self.triplets[self.weakest].oriented.verdict(limit)


def orient_strip(sights: Sights, plane: WaterPlane, *, base: float = 1.0, equal: bool = False) -> Strip:
    """Return the chain of the photos in the order of a strip, from no starting values.

    The plane is what is known of it on the ground, which counts as control where there is little. `base` is the
    first one of a strip without control. Raises `OrientationError`.
    """
    parts = list(triplets(sights, plane.index, equal))
    joins = [joined(first, second) for first, second in pairwise(parts)]
    moves = [Similarity(scale=base, rotation=np.eye(3), shift=np.zeros(3))]
    for join in joins:
        moves.append(moves[-1].after(join.move))
    most, points = np.zeros(len(sights.points), dtype=int), np.full((len(sights.points), 3), np.nan)
    for triplet, move in zip(parts, moves, strict=True):
        better = triplet.rays > most[triplet.points]
        rows = triplet.points[better]
        most[rows], points[rows] = triplet.rays[better], move.apply(triplet.place[better])
    known = np.flatnonzero(np.isfinite(sights.control).any(axis=1) & (most > 0))
    if len(known):
        move = _on_ground(points[known], sights.control[known], _water(parts, moves), plane)
        moves, points = [move.after(first) for first in moves], move.apply(points)
    return Strip(sights=sights, plane=plane, triplets=parts, joins=joins, moves=moves, points=points)


# --- triplets, each started from the one before it ---


def triplets(sights: Sights, index: float, equal: bool = False) -> Iterator[Triplet]:
    """Yield the triplets of a strip, whose images are sorted by their photos, over water of which nothing is known.

    Raises `OrientationError`.
    """
    begin = np.searchsorted(sights.photo, np.arange(len(sights.photos) + 1))
    near: Orientation | None = None
    for first in range(len(sights.photos) - 2):
        rows = np.arange(begin[first], begin[first + 3])
        count = np.bincount(sights.point[rows], minlength=len(sights.points))
        part, points = _three_photos(sights, rows[count[sights.point[rows]] >= 2], first)
        try:
            oriented = orient(part, TRIPLET, WaterPlane(index=index), equal=equal, near=near)
        except OrientationError as error:
            raise type(error)(f"STRIP: photos {', '.join(part.photos)}: {error}") from error
        place = oriented.points
        kept = np.flatnonzero((oriented.rays >= 2) & np.isfinite(place).all(axis=1))
        triplet = Triplet(
            oriented=oriented,
            points=points[kept],
            place=place[kept],
            covariance=oriented.point_covariance()[kept],
            rays=oriented.rays[kept],
            left_out=points[oriented.outliers],
        )
        near = _next(triplet)
        yield triplet


def _three_photos(sights: Sights, rows: IntArray, first: int) -> tuple[Sights, IntArray]:
    """Return images `rows` (n,) of three photos, without control, and the rows of their points in the strip."""
    points, point = np.unique(sights.point[rows], return_inverse=True)
    part = Sights(
        photos=sights.photos[first : first + 3],
        points=sights.points[points],
        photo=sights.photo[rows] - first,
        point=point,
        image=sights.image[rows],
        image_sigma=sights.image_sigma[rows],
        wet=sights.wet[points],
        control=np.full((len(points), 3), np.nan),
        control_sigma=np.zeros((len(points), 3)),
    )
    return part, points


def _next(before: Triplet) -> Orientation:
    """Return the start (1,) of a triplet by the one before it, whose flight goes on as it went."""
    at = before.oriented.at
    base = at.station[2] - at.station[1]
    length = float(np.linalg.norm(base))
    M = attitude_matrix(at.attitude[1])
    turn = along_axes(M @ base / length).T @ M
    three = before.moved(Similarity(scale=1.0 / length, rotation=turn, shift=-turn @ at.station[1] / length))
    new = 2.0 * three.station[:, 2] - three.station[:, 1]
    return replace(
        three,
        attitude=three.attitude[:, [1, 2, 2]],
        station=np.concatenate([three.station[:, 1:], new[:, None]], axis=1),
    )


# --- joins ---


def joined(before: Triplet, after: Triplet) -> Join:
    """Return the join of a triplet to the one before it. Raises `OrientationError`.

    Points have the weights of their mean variances in both, stations that of a typical point. Points that the
    covariances of both do not explain are left out.
    """
    points, here, there = np.intersect1d(before.points, after.points, return_indices=True)
    if len(points) < _FEWEST:
        names = ", ".join([*before.oriented.sights.photos, after.oriented.sights.photos[-1]])
        fault = f"{len(points)} common points, {_FEWEST} are needed"
        raise OrientationError(f"STRIP: the triplets of {names} cannot be joined: {fault}")
    covariances = before.covariance[here], after.covariance[there]
    variance = sum(np.trace(covariance, axis1=1, axis2=2) for covariance in covariances)
    weight = 1.0 / np.append([np.median(variance)] * 2, variance)
    x = np.concatenate([after.oriented.at.station[:2], after.place[there]])
    y = np.concatenate([before.oriented.at.station[1:], before.place[here]])
    move, _ = fit_robust(x, y, weight, _FLOOR)
    left_out = _contradicting(*covariances, y[2:] - move.apply(x[2:]), move)
    kept = np.append([True, True], ~left_out)
    move = fit(x[kept], y[kept], weight[kept])
    residual = y - move.apply(x)
    return Join(
        move=move,
        points=points,
        left_out=left_out,
        residual=residual[2:],
        station=residual[:2],
        plane=before.plane(_NOWHERE) - after.plane(move),
    )


def _contradicting(before: FloatArray, after: FloatArray, residual: FloatArray, move: Similarity) -> BoolArray:
    """Return which points (k,) have residuals (k, 3) beyond their covariances (k, 3, 3), or beyond those of most.

    Errors that both triplets share, by common images, make the covariances too large, never too small.
    """
    turn = move.scale * move.rotation
    spread = np.linalg.pinv(before + turn @ after @ turn.T, hermitian=True)
    squares = np.einsum("ki,kij,kj->k", residual, spread, residual)
    usual = max(1.0, float(np.median(squares)) / float(chdtri(3, 0.5)))
    left_out = squares > usual * chdtri(3, _SIGNIFICANCE / len(squares))
    return np.asarray(left_out & (squares > np.sort(squares)[_FEWEST - 1]))


# --- the ground: absolute orientation ---


def _water(parts: list[Triplet], moves: list[Similarity]) -> FloatArray:
    """Return points (k, 3) of the water, three under each triplet, in the axes of the strip."""
    square = np.array([[1.0, 0.0], [-0.5, 0.8], [-0.5, -0.8]])  # of bases, about the middle photo
    water = []
    for triplet, move in zip(parts, moves, strict=True):
        at = triplet.oriented.at
        place = at.station[1, :2] + square
        water.append(move.apply(np.column_stack([place, at.water_at(place[None])[0]])))
    return np.concatenate(water)


def _on_ground(place: FloatArray, known: FloatArray, water: FloatArray, plane: WaterPlane) -> Similarity:
    """Return the similarity of a strip to the ground.

    place (c, 3) in the axes of the strip and known (c, 3), NaN for what is not, of control; water (k, 3) points of
    the water in these axes, of which `plane` is known on the ground. All count alike; where control that is known
    in full fixes the strip nothing else is taken, and gross errors of it do not draw the strip. Raises
    `OrientationError` where a motion is left free.
    """
    full = np.isfinite(known).all(axis=1)
    if full.sum() >= 3:
        extent = np.linalg.svd(known[full] - known[full].mean(axis=0), compute_uv=False)
        if extent[1] > _FLAT * extent[0]:
            floor = 1e-6 * float(extent[0])
            return fit_robust(place[full], known[full], np.ones(full.sum()), floor)[0]
    given = np.isfinite(known)
    size = max(1.0, float(np.nanmax(np.abs(known))))
    move = _level_start(place, known, water)
    for _ in range(_STEPS):
        there = move.apply(place)
        of_water, misfit = _of_water(move.apply(water), plane)
        G = np.concatenate([by_change(there)[given], of_water])
        _require_rank(G.T @ G, there)
        change = np.linalg.lstsq(G, np.append((known - there)[given], misfit), rcond=None)[0]
        move = small(change).after(move)
        if np.abs(change).max() <= _STILL * size:
            break
    return move


def _of_water(water: FloatArray, plane: WaterPlane) -> tuple[FloatArray, FloatArray]:
    """Return by how much points of the water (k, 3) on the ground stand under its known plane, with partials.

    Partials (k, 7) by a change of the similarity, heights (k,): about their mean where the level is not known, and
    none where the tilt is not.
    """
    if plane.treatment is PlaneTreatment.ADJUST and plane.slope_sigma is None:
        return np.zeros((0, 7)), np.zeros(0)
    normal = np.append(-np.asarray(plane.slope), 1.0)
    partials, heights = normal @ by_change(water), water @ normal
    if plane.level is None or (plane.treatment is not PlaneTreatment.KNOWN and plane.level_sigma is None):
        return partials - partials.mean(axis=0), heights.mean() - heights
    return partials, plane.level - heights


def _require_rank(N: FloatArray, places: FloatArray) -> None:
    """Raise `OrientationError` where normals (7, 7) leave a motion free, named about the middle of places."""
    middle = places.mean(axis=0)
    centred = np.eye(7)
    centred[4:, 0], centred[4:, 1:4] = -middle, skew(middle)
    N = centred.T @ N @ centred
    diagonal = np.sqrt(np.diagonal(N))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    values, vectors = np.linalg.eigh(N / np.outer(scale, scale))
    free = [MOTIONS[int(np.argmax(np.abs(vectors[:, row])))] for row in np.flatnonzero(values < _FREE)]
    if free:
        raise OrientationError(
            f"STRIP: control and water leave {', '.join(dict.fromkeys(free))} of the strip free; three full "
            "control points off a line hold it, or two where the tilt of the water is known (LEVEL)"
        )


def _level_start(place: FloatArray, known: FloatArray, water: FloatArray) -> Similarity:
    """Return the similarity that makes the water level; the rest by X and Y, and by Z."""
    normal = np.linalg.svd(water - water.mean(axis=0))[2][2]
    upright = levelling(normal if normal[2] > 0.0 else -normal)
    there = place @ upright.T
    plan = np.flatnonzero(np.isfinite(known[:, :2]).all(axis=1))
    z, w = (part[plan] @ np.array([1.0, 1j]) for part in (there[:, :2], known[:, :2]))
    if len(z) < 2 or not np.ptp(np.abs(z - z[:1])) > 0.0:
        raise OrientationError("STRIP: two control points of known X and Y at least give it scale and heading")
    a = np.vdot(z - z.mean(), w - w.mean()) / np.vdot(z - z.mean(), z - z.mean())
    angle, scale = float(np.angle(a)), float(np.abs(a))
    heading = attitude_matrix([0.0, 0.0, -angle])
    heights = np.isfinite(known[:, 2])
    Z = float(np.mean(known[heights, 2] - scale * there[heights, 2])) if heights.any() else 0.0
    shift = w.mean() - a * z.mean()
    return Similarity(scale=scale, rotation=heading @ upright, shift=np.array([shift.real, shift.imag, Z]))
