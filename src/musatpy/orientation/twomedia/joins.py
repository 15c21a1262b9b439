"""One triplet of a strip joined to the one before it: a similarity of the stations and points that both have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import MusatError
from musatpy.geometry.similarity import Similarity, fit, fit_robust
from musatpy.orientation.twomedia.strip_triplets import Triplet

FEWEST = 3  # common points of a join
_SIGNIFICANCE = 0.001  # of the test of a common point
_FLOOR = 1e-3  # of a sigma: what counts as an error at least


class JoinError(MusatError):
    """Two triplets that cannot be joined."""


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


def joined(before: Triplet, after: Triplet) -> Join:
    """Return the join of a triplet to the one before it. Raises `JoinError`.

    Points have the weights of their mean variances in both, stations that of a typical point. Points that the
    covariances of both do not explain are left out.
    """
    points, here, there = np.intersect1d(before.points, after.points, return_indices=True)
    if len(points) < FEWEST:
        raise JoinError(f"{len(points)} common points, {FEWEST} are needed")
    variance = np.trace(before.covariance[here], axis1=1, axis2=2) + np.trace(
        after.covariance[there], axis1=1, axis2=2
    )
    stations = before.oriented.at.station[1:], after.oriented.at.station[:2]
    weight = 1.0 / np.append([np.median(variance)] * 2, variance)
    x = np.concatenate([stations[1], after.place[there]])
    y = np.concatenate([stations[0], before.place[here]])
    move, _ = fit_robust(x, y, weight, _FLOOR)
    left_out = _contradicting(before.covariance[here], after.covariance[there], y[2:] - move.apply(x[2:]), move)
    kept = np.append([True, True], ~left_out)
    move = fit(x[kept], y[kept], weight[kept])
    residual = y - move.apply(x)
    nothing = Similarity(scale=1.0, rotation=np.eye(3), shift=np.zeros(3))
    return Join(
        move=move,
        points=points,
        left_out=left_out,
        residual=residual[2:],
        station=residual[:2],
        plane=before.plane(nothing) - after.plane(move),
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
    return np.asarray(left_out & (squares > np.sort(squares)[FEWEST - 1]))
