"""The fiducial transformation: measured marks to the camera's calibrated ones, and why a plate is refused.

A refusal is data: its reason, the marks that it concerns and the residuals that led to it. Marks out of place are
looked for before anything is fitted, by a similarity that leaves a correct plate's marks within a hundredth of
their span: affine and projective transformations of few marks would follow exchanged ones.

The fiducial transformation where only distances between marks are calibrated, not their coordinates.

Certificates of older cameras give the distances between opposite marks; the classical correction divides each
coordinate by the ratio of the measured to the calibrated distance along it (Wolf and Dewitt, Elements of
Photogrammetry, chapter 4). Here the scales come from all calibrated distances by least squares, as the metric G
of the readings, D^2 = d^T G d for a distance D between marks that are d apart in the readings:

    UNIFORM  G = m I               one scale           one distance needed
    AXES     G = diag(m, n)        a scale per rail    two distances in different directions
    AFFINE   G = [[m, k], [k, n]]  scales and shear    three

Centre and axes then come from two pairs of marks: the lines that join them meet in the origin (the fiducial
centre). On plates with side marks the first line is the x axis, from its first mark to its second; with corner
marks the lines are diagonals, the first from lower left to upper right, the second from lower right to upper
left, and the x axis halves the angle between them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from musatpy.arrays import FloatArray, InRows, IntArray, TextArray, rows_of
from musatpy.fortran import decimals_of
from musatpy.model.reduction import BY_HEIGHTS
from musatpy.reduction import planar
from musatpy.reduction.planar import Fit, PlanarKind, PlanarTransformation

# Film shrinks by a thousandth or two and scanners err by less; marks that are exchanged differ by whole sides.
_OUT_OF_PLACE = 0.01
_AS_GOOD = 3.0  # without a misplaced mark the others fit better than without a good one by more than this
_ONE_PLACE = 1e-20  # of the squares of their coordinates: rounding of marks in one place
_COMPLEX = np.array([1.0, 1.0j])


class Reason(StrEnum):
    """Why a plate is refused."""

    MISSING = "MISSING"  # too few marks measured
    DEGENERATE = "DEGENERATE"  # the marks do not determine the transformation: on a line, or in one place
    SWAPPED = "SWAPPED"  # under other names the marks would fit
    MIRRORED = "MIRRORED"  # seen from the other side the marks would fit
    MISPLACED = "MISPLACED"  # marks far from their places under any names
    LIMIT = "LIMIT"  # a residual is beyond the limit
    HEIGHTS = BY_HEIGHTS  # of camera and ground, do not allow the corrections asked for
    LOST = "LOST"  # points without a place that the calibration explains


@dataclass(frozen=True, kw_only=True)
class Exchange:
    """A naming under which the marks would fit: (name that was given, name that would fit) of those that change."""

    names: tuple[tuple[str, str], ...]
    mirrored: bool  # and the plate seen from the other side


@dataclass(frozen=True, kw_only=True, eq=False)
class Refusal:
    """Why a plate cannot be reduced."""

    reason: Reason
    message: str
    ids: tuple[str, ...] = ()  # the marks that it concerns
    exchanges: tuple[Exchange, ...] = ()  # what would explain it, fewest changed names first


@dataclass(frozen=True, kw_only=True, eq=False)
class FiducialSolution:
    """What came of the marks of one plate: q marks measured and calibrated.

    `residuals` (q, 2) mm are transformed minus calibrated, of the fit where there is one, else of the similarity
    that shows what is out of place; NaN where there is none.
    """

    ids: TextArray  # (q,)
    calibrated: FloatArray  # (q, 2) mm
    residuals: FloatArray  # (q, 2) mm
    fit: Fit | None
    refusal: Refusal | None
    missing: tuple[str, ...]  # calibrated marks that were not measured
    unknown: tuple[str, ...]  # measured marks that the camera does not have
    suspects: tuple[str, ...] = ()  # each the only mark without which the others keep the limit


@dataclass(frozen=True, kw_only=True)
class FiducialLimits:
    """What a plate must keep."""

    residual: float = float("inf")  # mm, of any coordinate of a mark
    marks: int | None = None  # least number of marks; None: those that the transformation needs

    def exceeded_by(self, residual: float) -> str:
        """Return in words that a residual (mm) is beyond the limit, both with the decimals that the limit needs."""
        decimals = decimals_of(self.residual, 4)
        return f"off by {residual:.{decimals}f} mm, more than {self.residual:.{decimals}f} mm"


@dataclass(frozen=True, kw_only=True, eq=False)
class Marks(InRows):
    """Marks with coordinates and sigmas, measured or calibrated."""

    ids: TextArray  # (q,)
    xy: FloatArray  # (q, 2)
    sigma: FloatArray  # (q, 2)


def transform(kind: PlanarKind, measured: Marks, calibrated: Marks, limits: FiducialLimits) -> FiducialSolution:
    """Return the least squares transformation of a plate to its calibrated marks, or why there is none.

    Marks are matched by id; sigmas of the calibrated ones are mm, of the measured ones in the unit of the readings.
    """
    rows = rows_of(calibrated.ids, measured.ids)
    known = rows >= 0
    marks, wanted = measured[known], calibrated[rows[known]]
    refusal, residuals = _screened(kind, marks, wanted, calibrated, limits)
    fit = None
    suspects: tuple[str, ...] = ()
    if refusal is None:
        fit = planar.fit(kind, marks.xy, wanted.xy, marks.sigma, wanted.sigma)
        refusal, suspects = _judged(kind, fit, marks, wanted, limits)
    return FiducialSolution(
        ids=marks.ids,
        calibrated=wanted.xy,
        residuals=residuals if fit is None else fit.residuals,
        fit=fit,
        refusal=refusal,
        missing=tuple(calibrated.ids[~np.isin(calibrated.ids, measured.ids)].tolist()),
        unknown=tuple(measured.ids[~known].tolist()),
        suspects=suspects,
    )


def _screened(
    kind: PlanarKind, marks: Marks, wanted: Marks, calibrated: Marks, limits: FiducialLimits
) -> tuple[Refusal | None, FloatArray]:
    """Return a refusal that needs no fit of `kind`, and the residuals of the similarity that shows it."""
    residuals = np.full((len(marks.ids), 2), np.nan)
    least = max(planar.MARKS_NEEDED[kind], limits.marks or 0)
    if len(marks.ids) < least:
        message = f"{len(marks.ids)} marks measured, {least} needed"
        return Refusal(reason=Reason.MISSING, message=message, ids=tuple(marks.ids.tolist())), residuals
    fitted = _similarity(marks.xy, wanted.xy)
    if fitted is None:
        return Refusal(reason=Reason.DEGENERATE, message="the marks lie in one place"), residuals
    bound = _OUT_OF_PLACE * float(np.hypot(*np.ptp(wanted.xy, axis=0)))
    if np.abs(fitted).max() <= bound:
        return None, fitted
    exchanges = _exchanges(marks, calibrated, bound)
    if exchanges:
        return _exchanged(exchanges), fitted
    return _misplaced(marks, wanted, fitted, bound), fitted


def _judged(
    kind: PlanarKind, fit: Fit | None, marks: Marks, wanted: Marks, limits: FiducialLimits
) -> tuple[Refusal | None, tuple[str, ...]]:
    """Return the refusal of a fit that fails or is worse than the limit, and the marks that may be at fault."""
    if fit is None:
        return Refusal(reason=Reason.DEGENERATE, message=f"the marks do not give {kind.lower()} parameters"), ()
    worst = np.abs(fit.residuals).max(axis=1)
    if worst.max() <= limits.residual:
        return None, ()
    suspects = []
    for row in range(len(marks.ids)):
        rest = np.delete(np.arange(len(marks.ids)), row)
        a, b = marks[rest], wanted[rest]
        again = planar.fit(kind, a.xy, b.xy, a.sigma, b.sigma)
        if again is not None and again.freedom and np.abs(again.residuals).max() <= limits.residual:
            suspects.append(str(marks.ids[row]))
    row = int(worst.argmax())
    message = f"mark {marks.ids[row]} is {limits.exceeded_by(worst[row])}"
    over = tuple(str(name) for name in marks.ids[worst > limits.residual])
    return Refusal(reason=Reason.LIMIT, message=message, ids=over), tuple(suspects)


def _similarity(measured: FloatArray, calibrated: FloatArray) -> FloatArray | None:
    """Return the residuals (q, 2) of the similarity from measured to calibrated marks; None of marks in one place.

    With z = u + i v and w = x + i y about their means, w = a z has a = sum(z* w) / sum(z* z), all marks weighing
    alike.
    """
    z, w = measured @ _COMPLEX, calibrated @ _COMPLEX
    z, w = z - z.mean(), w - w.mean()
    square = float(np.square(np.abs(z)).sum())
    if square <= _ONE_PLACE * float(np.square(np.abs(measured)).sum()):
        return None
    v = np.vdot(z, w) / square * z - w
    return np.stack([v.real, v.imag], axis=-1)


def _exchanged(exchanges: list[Exchange]) -> Refusal:
    """Return the refusal of marks that would fit under other names, or on a mirrored plate."""
    fewest = len(exchanges[0].names)
    if fewest:
        swapped = tuple(
            exchange
            for exchange in exchanges
            if len(exchange.names) == fewest and exchange.mirrored == exchanges[0].mirrored
        )
        names = dict.fromkeys(given for exchange in swapped for given, _ in exchange.names)
        message = "the marks fit with " + ", or with ".join(_words(exchange) for exchange in swapped)
        return Refusal(reason=Reason.SWAPPED, message=message, ids=tuple(names), exchanges=swapped)
    # of four marks in a square, opposite ones exchanged are the mirror image
    pairs = tuple(exchange for exchange in exchanges if not exchange.mirrored and len(exchange.names) == 2)
    message = "the marks fit a mirrored plate" + "".join(f", or with {_words(exchange)}" for exchange in pairs)
    return Refusal(reason=Reason.MIRRORED, message=message, exchanges=(exchanges[0], *pairs))


def _words(exchange: Exchange) -> str:
    if len(exchange.names) == 2 and exchange.names[0] == exchange.names[1][::-1]:
        text = f"marks {exchange.names[0][0]} and {exchange.names[0][1]} exchanged"
    else:
        text = ", ".join(f"{given} as {better}" for given, better in exchange.names)
    return f"{text} on a mirrored plate" if exchange.mirrored else text


def _misplaced(marks: Marks, wanted: Marks, residuals: FloatArray, bound: float) -> Refusal:
    """Return the refusal of marks that fit under no names: those that spoil the others, else all far off."""
    left = np.full(len(marks.ids), np.inf)  # largest residual of the others
    for row in range(len(marks.ids)):
        rest = np.delete(np.arange(len(marks.ids)), row)
        fitted = _similarity(marks.xy[rest], wanted.xy[rest]) if len(rest) > 2 else None
        if fitted is not None:
            left[row] = np.abs(fitted).max()
    off = (left <= bound) & (left <= _AS_GOOD * left.min())
    names = tuple(marks.ids[off if off.any() else np.abs(residuals).max(axis=1) > bound].tolist())
    message = f"under no other names the marks fit; out of place: {', '.join(names)}"
    return Refusal(reason=Reason.MISPLACED, message=message, ids=names)


def _exchanges(marks: Marks, calibrated: Marks, bound: float) -> list[Exchange]:
    """Return the namings of the marks that fit, fewest changed names first, unmirrored ones before mirrored."""
    kept: dict[tuple[bool, tuple[int, ...]], Exchange] = {}
    for mirrored in (False, True):
        xy = marks.xy * (np.array([1.0, -1.0]) if mirrored else 1.0)
        for names in _namings(xy, calibrated.xy):
            fitted = _similarity(xy, calibrated.xy[list(names)])
            if fitted is not None and np.abs(fitted).max() <= bound:
                better = calibrated.ids[list(names)].tolist()
                changed = tuple(pair for pair in zip(marks.ids.tolist(), better, strict=True) if pair[0] != pair[1])
                kept[mirrored, names] = Exchange(names=changed, mirrored=mirrored)
    return sorted(kept.values(), key=lambda exchange: (len(exchange.names), exchange.mirrored, exchange.names))


def _namings(xy: FloatArray, places: FloatArray) -> Iterator[tuple[int, ...]]:
    """Yield the ways to name the marks that two of them suggest: the pair furthest apart taken for every pair.

    A similarity through two marks places the others; each takes the nearest calibrated one.
    """
    gaps = np.linalg.norm(xy[:, None] - xy[None], axis=2)
    i, j = np.unravel_index(int(gaps.argmax()), gaps.shape)
    z, w = xy @ _COMPLEX, places @ _COMPLEX
    for k, m in itertools.permutations(range(len(places)), 2):
        if gaps[i, j] == 0.0:
            return
        turned = w[k] + (w[m] - w[k]) / (z[j] - z[i]) * (z - z[i])
        names = np.abs(turned[:, None] - w[None]).argmin(axis=1)
        if len(set(names.tolist())) == len(names):
            yield tuple(int(name) for name in names)


_STEPS = 50
_SETTLED = 1e-14
_SINGULAR = 1e-6  # least ratio of singular values: distances in nearly one direction give no second scale


class Scales(StrEnum):
    """What the distances determine."""

    UNIFORM = "UNIFORM"
    AXES = "AXES"
    AFFINE = "AFFINE"


_ELEMENTS = {
    Scales.UNIFORM: np.array([[[1.0, 0.0], [0.0, 1.0]]]),
    Scales.AXES: np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]]),
    Scales.AFFINE: np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 1.0], [1.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]]),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class DistanceFit:
    """The affine transformation to the fiducial system, and how well e distances agree with it."""

    plane: PlanarTransformation  # AFFINE
    residuals: FloatArray  # (e,) mm, scaled minus calibrated distance
    sigma0: float  # NaN without redundancy
    freedom: int


@dataclass(frozen=True, kw_only=True)
class Axes:
    """The two pairs of marks, as rows of the measured ones, whose lines meet in the origin."""

    first: tuple[int, int]
    second: tuple[int, int]
    corners: bool = False  # the lines are diagonals


def fit_distances(
    scales: Scales, marks: FloatArray, ends: IntArray, distance: FloatArray, sigma: FloatArray, axes: Axes
) -> DistanceFit | None:
    """Return the transformation of measured marks (q, 2) by e calibrated distances; None where they do not give it.

    `ends` (e, 2) are rows of the marks, `distance` (e,) and `sigma` (e,) are mm. A mirrored plate, or parallel
    lines of the axes, give none.
    """
    d = marks[ends[:, 1]] - marks[ends[:, 0]]
    m = _metric(scales, d, distance, sigma)
    if m is None:
        return None
    G = np.tensordot(m, _ELEMENTS[scales], axes=1)
    if not (G[0, 0] > 0.0 and np.linalg.det(G) > 0.0):
        return None
    plane = _placed(np.linalg.cholesky(G).T, marks, axes)
    if plane is None:
        return None
    v = _length(G, d) - distance
    freedom = len(distance) - len(m)
    return DistanceFit(
        plane=plane,
        residuals=v,
        sigma0=float(np.sqrt(np.square(v / sigma).sum() / freedom)) if freedom else float("nan"),
        freedom=freedom,
    )


def _length(G: FloatArray, d: FloatArray) -> FloatArray:
    return np.sqrt(np.einsum("ei,ij,ej->e", d, G, d))


def _metric(scales: Scales, d: FloatArray, distance: FloatArray, sigma: FloatArray) -> FloatArray | None:
    """Return the elements (k,) of G: m; m, n; or m, k, n. Gauss and Newton; dD/dm = d^T E d / (2 D)."""
    E = _ELEMENTS[scales]
    if len(distance) < len(E) or np.any(np.linalg.norm(d, axis=1) == 0.0):
        return None
    square = np.einsum("ei,kij,ej->ek", d, E, d)
    m = float((distance / np.linalg.norm(d, axis=1)).mean()) ** 2 * np.einsum("kii->k", E).clip(max=1.0)
    for _ in range(_STEPS):
        D = _length(np.tensordot(m, E, axes=1), d)
        A = square / (2.0 * D * sigma)[:, None]
        U, s, Vt = np.linalg.svd(A, full_matrices=False)
        if not np.all(np.isfinite(s)) or s[-1] < _SINGULAR * s[0]:
            return None
        step = (Vt.T / s) @ (U.T @ ((distance - D) / sigma))
        m = m + step
        if np.all(np.abs(step) <= _SETTLED * np.abs(m).max()):
            break
    return m


def _placed(A: FloatArray, marks: FloatArray, axes: Axes) -> PlanarTransformation | None:
    """Return the affine transformation with a linear part R A that puts centre and axes where the marks say."""
    xy = marks @ A.T
    a, b = xy[axes.first[0]], xy[axes.first[1]] - xy[axes.first[0]]
    c, e = xy[axes.second[0]], xy[axes.second[1]] - xy[axes.second[0]]
    area = b[0] * e[1] - b[1] * e[0]
    if area <= _SINGULAR * np.linalg.norm(b) * np.linalg.norm(e):  # parallel, or mirrored
        return None
    centre = a + b * ((c - a)[0] * e[1] - (c - a)[1] * e[0]) / area
    turn = math.atan2(b[1], b[0])
    if axes.corners:
        second = turn + math.atan2(area, b @ e)
        turn = 0.5 * (turn + second) - 0.5 * math.pi  # the diagonals stand on both sides of the y axis
    R = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    B, shift = R @ A, -R @ centre
    return PlanarTransformation(kind=PlanarKind.AFFINE, parameters=np.array([*B[0], *B[1], *shift]))
