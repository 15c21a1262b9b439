"""One triplet of a strip joined to the one before it: a similarity of the stations and points that both have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.special import chdtrc, chdtri

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import MusatError
from musatpy.geometry.similarity import Similarity, fit, small
from musatpy.orientation.twomedia.moved import Moved
from musatpy.orientation.twomedia.triplet_models import PLANE, POINTS, TripletModel, shared_covariance

FEWEST = 3  # common points of a join
_PLANE, _POINTS = 2, 3  # rows of a seam: two stations, the plane, then the points
_STEPS = 10
_STILL = 1e-10  # of a change of the similarity, in the axes of the triplet before
_SIGNIFICANCE = 0.001  # of the test of a common point


class JoinError(MusatError):
    """Two triplets that cannot be joined."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Join:
    """The similarity `move` of a triplet to the axes of the one before, in units of its first base.

    points (k,) rows in the strip of what both have, left_out (k,) those that do not fit; residual (k, 3), those of
    the triplet before less these. plane (3,) mismatch of slopes and level, before less this, with sigmas and the
    probability of a larger one; sigma0 of the residuals, with respect to what the images let expect. by_image (7, 2
    n) of a change of the similarity by errors of image coordinates, of the strip from `column` on, and `gain` (7, 3
    r) by the misfits of quantities rows_before (r,) and rows_after (r,).
    """

    move: Similarity
    points: IntArray
    left_out: BoolArray
    residual: FloatArray
    plane: FloatArray
    plane_sigma: FloatArray
    plane_probability: float
    sigma0: float
    column: int
    by_image: FloatArray
    rows_before: IntArray
    rows_after: IntArray
    gain: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class _Seam:
    """Two triplets, and the rows (r,) in both of the quantities that they share: stations, the plane, points."""

    before: TripletModel
    after: TripletModel
    rows_before: IntArray
    rows_after: IntArray
    points: IntArray

    def misfit(self, move: Similarity, kept: BoolArray) -> tuple[FloatArray, Moved]:
        """Return the quantities kept of the triplet before less those of this one (k, 3), and the latter, moved."""
        there = self.after.moved(move, self.rows_after[kept])
        return self.before.value[self.rows_before[kept]] - there.value, there

    def covariance(self, move: Similarity, kept: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return the covariance (3 k, 3 k) of misfits as of separate images, and what common ones take off it."""
        rows_before, rows_after = self.rows_before[kept], self.rows_after[kept]
        by_after = self.after.moved(move, rows_after).by_old
        alone = shared_covariance(self.after, rows_after, self.after, rows_after)
        mixed = _times(by_after, shared_covariance(self.after, rows_after, self.before, rows_before))
        before = shared_covariance(self.before, rows_before, self.before, rows_before)
        return before + _times(by_after, _times(by_after, alone).T), mixed + mixed.T


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """A similarity by k quantities, its gain (7, 3 k), the weights (3 k, 3 k) of residuals and what their sum is
    expected to be.

    The weights are W - W G (G' W G)^-1 G' W.
    """

    move: Similarity
    gain: FloatArray
    weight: FloatArray
    expected: float


def joined(before: TripletModel, after: TripletModel) -> Join:
    """Return the join of a triplet to the one before it.

    The quantities are weighted by their covariances in both, as if these had no images in common; what that costs
    is in the precision of the join. Points that do not fit are left out one by one. Raises `JoinError`.
    """
    seam = _seam(before, after)
    kept = np.ones(len(seam.rows_before), dtype=bool)
    kept[_PLANE] = False  # it is known much worse: the chain of all triplets has a use for it
    move = _start(seam)
    limit = float(chdtri(3, _SIGNIFICANCE / len(seam.points)))
    while True:
        fitted = _fitted(seam, kept, move)
        move, tests = fitted.move, _tests(seam, kept, fitted)
        if tests.max() <= limit or kept[_POINTS:].sum() <= FEWEST:
            return _described(seam, kept, fitted)
        kept[_POINTS + int(np.argmax(tests))] = False


def _seam(before: TripletModel, after: TripletModel) -> _Seam:
    points, in_before, in_after = np.intersect1d(before.points, after.points, return_indices=True)
    if len(points) < FEWEST:
        raise JoinError(f"{len(points)} common points, {FEWEST} are needed")
    stations = [2 * (photo - before.first) + 1 for photo in (after.first, after.first + 1)]
    return _Seam(
        before=before,
        after=after,
        rows_before=np.append([*stations, PLANE], in_before + POINTS),
        rows_after=np.append([1, 3, PLANE], in_after + POINTS),
        points=points,
    )


def _times(by: FloatArray, values: FloatArray) -> FloatArray:
    """Return what partials (k, 3, 3) make of values (3 k, c)."""
    return (by @ values.reshape(len(by), 3, -1)).reshape(values.shape)


def _start(seam: _Seam) -> Similarity:
    """Return the similarity of stations and points with equal weights: gross errors draw it, until the tests."""
    places = np.arange(len(seam.rows_before)) != _PLANE
    y, x = seam.before.value[seam.rows_before[places]], seam.after.value[seam.rows_after[places]]
    return fit(x, y, np.ones(len(x)))


def _fitted(seam: _Seam, kept: BoolArray, move: Similarity) -> _Fit:
    """Return the similarity of weighted least squares.

    The triplets hold their axes by their stations, of which one is without error in both: what a change of the
    similarity adds to the covariance makes it regular and changes nothing.
    """
    V, common = seam.covariance(move, kept)
    _, there = seam.misfit(move, kept)
    G = there.by_change.reshape(-1, 7)
    W = _inverse(V + (np.trace(V) / np.sum(np.square(G))) * G @ G.T)
    for _ in range(_STEPS):
        misfit, there = seam.misfit(move, kept)
        G = there.by_change.reshape(-1, 7)
        WG = W @ G
        gain = np.asarray(np.linalg.solve(G.T @ WG, WG.T))
        change = np.asarray(gain @ misfit.ravel())
        move = small(change).after(move)
        if np.abs(change).max() < _STILL:
            break
    weight = W - WG @ gain
    return _Fit(move=move, gain=gain, weight=weight, expected=float(np.sum(weight * (V - common))))


def _inverse(V: FloatArray) -> FloatArray:
    """Return the inverse of a positive definite matrix."""
    factor, fault = dpotrf(V)
    if fault:
        raise JoinError("the covariance of their common points is singular")
    half, _ = dpotri(factor)
    return np.triu(half) + np.triu(half, 1).T


def _tests(seam: _Seam, kept: BoolArray, fitted: _Fit) -> FloatArray:
    """Return the test values (p,) of the points, squares of three components; zero of those that are out.

    W r of a point over its covariance, as misfits of one triplet depend on each other (Baarda 1968).
    """
    misfit, _ = seam.misfit(fitted.move, kept)
    rows = np.arange(len(misfit))
    spread = fitted.weight.reshape(len(misfit), 3, len(misfit), 3)[rows, :, rows]
    weighted = (fitted.weight @ misfit.ravel()).reshape(-1, 3)
    squares = np.zeros(len(kept))
    squares[kept] = np.einsum("ki,kij,kj->k", weighted, np.linalg.pinv(spread, hermitian=True), weighted)
    return squares[_POINTS:]


def _described(seam: _Seam, kept: BoolArray, fitted: _Fit) -> Join:
    """Return the join with what errors of the images, of which both triplets share most, do to it."""
    misfit, there = seam.misfit(fitted.move, np.ones(len(kept), dtype=bool))
    E, variance = _errors(seam, there)
    by_image = fitted.gain @ E[kept].reshape(-1, len(variance))
    r = misfit[kept].ravel()
    of_plane = E[_PLANE] - there.by_change[_PLANE] @ by_image
    plane = (of_plane * variance) @ of_plane.T
    test = float(misfit[_PLANE] @ np.linalg.pinv(plane, hermitian=True) @ misfit[_PLANE])
    return Join(
        move=fitted.move,
        points=seam.points,
        left_out=~kept[_POINTS:],
        residual=misfit[_POINTS:],
        plane=misfit[_PLANE],
        plane_sigma=np.sqrt(np.diagonal(plane)),
        plane_probability=float(chdtrc(3, test)),
        sigma0=float(np.sqrt(r @ fitted.weight @ r / fitted.expected)),
        column=seam.before.column,
        by_image=by_image,
        rows_before=seam.rows_before[kept],
        rows_after=seam.rows_after[kept],
        gain=fitted.gain,
    )


def _errors(seam: _Seam, there: Moved) -> tuple[FloatArray, FloatArray]:
    """Return the partials (r, 3, 2 n) of all misfits by errors of the images of both triplets, with variances."""
    before, after = seam.before, seam.after
    first, second = (
        slice(part.columns.start - before.column, part.columns.stop - before.column) for part in (before, after)
    )
    size = max(first.stop, second.stop)
    E, variance = np.zeros((len(seam.rows_before), 3, size)), np.zeros(size)
    E[..., first] = before.influence(seam.rows_before)
    E[..., second] -= there.by_old @ after.influence(seam.rows_after)
    variance[first] = before.variance
    variance[second] = np.maximum(variance[second], after.variance)
    return E, variance
