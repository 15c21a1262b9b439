"""STRIP: photos of a strip from nothing but their images, by triplets joined by similarity: first values.

Okamoto and Mori (1974): every three photos on end are oriented with the plane of water a part of it, each triplet
is joined to the one before by their common points and stations, and the strip is put to the control by one more
similarity. What these values are worth, and which plane all photos see, is for an adjustment that starts from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import chdtrc

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.similarity import Similarity
from musatpy.model.options import PlaneTreatment
from musatpy.orientation.twomedia.joins import Join, JoinError, joined
from musatpy.orientation.twomedia.oriented import OrientationError, Verdict
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Plane, Sights
from musatpy.orientation.twomedia.strip_ground import placed
from musatpy.orientation.twomedia.strip_triplets import Triplet, triplets

_SIGNIFICANCE = 0.001  # of the test of sigma0


@dataclass(frozen=True, kw_only=True, eq=False)
class Strip:
    """A strip of m photos and p points as chained: on the ground with control, else in axes of its first triplet.

    triplets (m - 2) with their similarities `moves` to these axes, and the joins between them (m - 3). of_point
    (p,) are the triplets that points are taken from, those with most rays, -1 for points that none has.
    """

    sights: Sights
    plane: Plane
    triplets: list[Triplet]
    joins: list[Join]
    moves: list[Similarity]
    of_point: IntArray
    points: FloatArray  # (p, 3), NaN for those that no triplet has

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
            attitude=attitude,
            station=station,
            slope=slope,
            level=level[0],
            index=np.asarray(self.plane.index),
        )

    def planes(self) -> FloatArray:
        """Return the plane of water (m - 2, 3), slopes and level, of every triplet."""
        return np.array([triplet.plane(move) for triplet, move in zip(self.triplets, self.moves, strict=True)])

    @property
    def weakest(self) -> int:
        """The triplet that determines its plane of water least."""
        return int(np.argmax([triplet.oriented.level_share for triplet in self.triplets]))

    def verdict(self, limit: float) -> tuple[Verdict, float]:
        """Return whether the weakest triplet determines the plane, and its share; a plane that is known is held."""
        if self.plane.treatment is PlaneTreatment.KNOWN:
            return Verdict.HELD, 0.0
        return self.triplets[self.weakest].oriented.verdict(limit)


def orient_strip(sights: Sights, plane: Plane, *, base: float = 1.0, equal: bool = False) -> Strip:
    """Return the chain of the photos in the order of a strip, from no starting values.

    The plane is what is known of it on the ground, which counts as control where there is little. `base` is the
    first one of a strip without control. Raises `OrientationError`.
    """
    parts = list(triplets(sights, plane.index, equal))
    moves = [Similarity(scale=base, rotation=np.eye(3), shift=np.zeros(3))]
    joins = []
    for first, second in pairwise(parts):
        try:
            joins.append(joined(first, second))
        except JoinError as error:
            names = ", ".join(sights.photos[first.first : first.first + 4])
            raise OrientationError(f"STRIP: the triplets of {names} cannot be joined: {error}") from error
        moves.append(moves[-1].after(joins[-1].move))
    of_point, points = _points(len(sights.points), parts, moves)
    known = np.flatnonzero(np.isfinite(sights.control).any(axis=1) & (of_point >= 0))
    if len(known):
        move = placed(points[known], sights.control[known], _water(parts, moves), plane)
        moves, points = [move.after(first) for first in moves], move.apply(points)
    return Strip(
        sights=sights, plane=plane, triplets=parts, joins=joins, moves=moves, of_point=of_point, points=points
    )


def _points(number: int, parts: list[Triplet], moves: list[Similarity]) -> tuple[IntArray, FloatArray]:
    """Return the triplets (p,) that see points with the most rays, the first of them, and the places (p, 3)."""
    rays, of_point, place = np.zeros(number, dtype=int), np.full(number, -1), np.full((number, 3), np.nan)
    for row, (triplet, move) in enumerate(zip(parts, moves, strict=True)):
        better = triplet.rays > rays[triplet.points]
        here = triplet.points[better]
        rays[here], of_point[here], place[here] = triplet.rays[better], row, move.apply(triplet.place[better])
    return of_point, place


def _water(parts: list[Triplet], moves: list[Similarity]) -> FloatArray:
    """Return points (k, 3) of the water, three under each triplet, in the axes of the strip."""
    square = np.array([[1.0, 0.0], [-0.5, 0.8], [-0.5, -0.8]])  # of bases, about the middle photo
    water = []
    for triplet, move in zip(parts, moves, strict=True):
        at = triplet.oriented.at
        place = at.station[1, :2] + square
        water.append(move.apply(np.column_stack([place, at.water_at(place[None])[0]])))
    return np.concatenate(water)
