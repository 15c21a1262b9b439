"""What an orientation can be found from, and what its geometry can determine of the water.

The orientation as adjusted is the truth. Random starts around it give the basins: the share of those that lead back
to it, to other solutions, or nowhere. Its design gives the precision of the plane of water, over the depth of the
same points under it and the share of them that stand dry.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.draws import Draws
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix, wrapped
from musatpy.orientation.twomedia.helmert import adjust, precision
from musatpy.orientation.twomedia.oriented import Oriented
from musatpy.orientation.twomedia.rays import WATER, Orientation, images_of
from musatpy.orientation.twomedia.sights import Sights
from musatpy.orientation.twomedia.solutions import start_errors

_STARTS = 25  # of each level: a hundred in all
_LEVELS = np.array([1.0, 2.0, 3.0, 4.0])  # multiples of the errors of starts
_DEPTHS = np.array([0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0])  # mean ones, of the height of the cameras
_DRY = np.array([0.0, 0.1, 0.3, 0.5])  # shares of the points
NOWHERE, SOLUTION = -1, 0  # outcomes of a start; others are numbers of other roots, from 1
_SAME = 1e-2  # of their sigmas, by which the unknowns of one solution may differ
_ROUNDING = 1e-9  # of their size
_LOWEST, _HIGHEST = 0.02, 0.25  # of the smaller of the height and three times the depth: dry points stand so high


@dataclass(frozen=True, kw_only=True, eq=False)
class Basins:
    """Where starts lead: s of them at each of l levels, errors of one sigma times `levels` (l,).

    errors (l, s, 6 m + 4) of the starts in rad, slopes, and heights of the cameras over the water, the level's over
    the middle of the points; 0 of what is held. outcomes (l, s): `NOWHERE`, `SOLUTION`, or the number of one of the
    other roots (r, 6 m + 4), whose weighted squares (r,) are 0 where they are exact.
    """

    levels: FloatArray
    errors: FloatArray
    outcomes: IntArray
    roots: FloatArray
    squares: FloatArray

    @property
    def shares(self) -> FloatArray:
        """(l, 3) of the starts that lead to the solution, to other roots and nowhere."""
        cases = (self.outcomes == SOLUTION, self.outcomes > SOLUTION, self.outcomes == NOWHERE)
        return np.stack([case.mean(axis=1) for case in cases], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class LevelPrecision:
    """Sigma (k, j) of the level of the water over the middle of the wet points, in heights of the cameras over it.

    For mean depths (k,), in the same heights, and shares (j,) of dry points; those of the geometry as it is are
    `depth`, `share` and `at_hand`. Of designs where a point does not show the sigma is NaN.
    """

    depths: FloatArray
    shares: FloatArray
    sigma: FloatArray
    depth: float
    share: float
    at_hand: float


@dataclass(frozen=True, kw_only=True, eq=False)
class OrientationStudy:
    """Basins of the solution, and the precision of the water, None where its plane is held or nothing is wet."""

    oriented: Oriented
    basins: Basins
    precision: LevelPrecision | None


def study(oriented: Oriented) -> OrientationStudy:
    """Return the study of the geometry of an orientation; of methods with control it is the control that is dry."""
    free = oriented.problem.unknown[-WATER:-1].any() and oriented.problem.wet.any()
    return OrientationStudy(
        oriented=oriented,
        basins=basins_of(oriented, _LEVELS, _STARTS),
        precision=precision_of(oriented, _DEPTHS, _DRY) if free else None,
    )


def basins_of(oriented: Oriented, levels: FloatArray, starts: int) -> Basins:
    """Return where random starts lead in images and control without errors, each of the levels (l,) at once."""
    truth, adjusted = oriented.at.vector, oriented.adjusted
    exact = replace(oriented.problem, image=adjusted.image[0], control=adjusted.control[0], centre=truth)
    scatter = Draws(1).normal("starts", len(levels), starts, len(truth))
    errors = levels[:, None, None] * scatter * start_errors(oriented.method.photos) * oriented.problem.unknown
    results = [adjust(exact, Orientation.of(truth + part)) for part in errors @ _units(oriented)]
    vectors = np.concatenate([_principal(result.at).vector for result in results])
    squares = np.concatenate([result.squares for result in results])
    left = np.concatenate([result.converged for result in results])
    outcomes, roots = np.full(len(left), NOWHERE), [_principal(oriented.at).vector]
    root_squares = [0.0]
    while True:
        same = left & _alike(vectors - roots[-1], oriented)
        outcomes[same] = len(roots) - 1
        left &= ~same
        if not left.any():
            break
        best = int(np.argmin(np.where(left, squares, np.inf)))
        roots.append(vectors[best])
        root_squares.append(float(squares[best]))
    return Basins(
        levels=levels,
        errors=errors,
        outcomes=outcomes.reshape(len(levels), starts),
        roots=np.array(roots)[1:],
        squares=np.array(root_squares[1:]),
    )


def _units(oriented: Oriented) -> FloatArray:
    """Return the matrix (6 m + 4, 6 m + 4) that takes errors of starts, as in `Basins`, to those of the vector."""
    units = np.diag(oriented.at.units)
    units[-WATER : -WATER + 2, -WATER + 2] = -np.nanmean(oriented.points[:, :2], axis=0)
    return units


def _principal(at: Orientation) -> Orientation:
    """Return orientations whose angles are those of their rotations."""
    return replace(at, attitude=attitude_from_matrix(attitude_matrix(at.attitude)))


def _alike(difference: FloatArray, oriented: Oriented) -> BoolArray:
    """Return which differences (..., 6 m + 4) of two solutions are none, against the sigmas of the unknowns."""
    angles = np.resize([True] * 3 + [False] * 3, difference.shape[-1])
    angles[-WATER:] = False
    turned = np.where(angles, wrapped(difference), difference)
    scale = np.maximum(np.abs(oriented.at.vector), 1.0)
    return np.asarray((np.abs(turned) <= _SAME * oriented.sigma + _ROUNDING * scale).all(axis=-1))


def precision_of(oriented: Oriented, depths: FloatArray, shares: FloatArray) -> LevelPrecision:
    """Return the precision of the water in designs of the same photos and horizontal positions of the points.

    Designs have mean depths (k,), in heights of the cameras over the water, and shares (j,) of dry points, as near
    as their number allows and not below the share at hand.
    """
    sights, height = oriented.sights, float(oriented.at.height)
    points = np.where(sights.is_control[:, None], oriented.adjusted.control[0], oriented.points)
    points[~np.isin(np.arange(len(points)), sights.point)] = np.nan  # outliers
    depth = oriented.at.water_at(points[None, :, :2])[0] - points[:, 2]
    wet = sights.wet & np.isfinite(depth)
    mean = float(depth[wet].mean()) / height
    choice = np.flatnonzero(np.isfinite(depth) & (sights.is_control | ~sights.is_control.any()))
    order = choice[sights.wet[choice]]
    order = order[np.argsort(Draws(1).uniform("dry", len(order)))]
    least = len(choice) - len(order)  # stand dry in every design
    counts = np.unique(np.clip(np.rint(shares * len(choice)).astype(int), least, max(least, len(choice) - 1)))
    sigmas = []
    for count in counts:
        dry = order[: count - least]
        below = depths[:, None] / mean * depth
        deepest = below[:, wet].max(axis=1, keepdims=True)
        below[:, ~sights.wet] = depth[~sights.wet]
        below[:, dry] = -np.minimum(height, 3.0 * deepest) * np.linspace(_LOWEST, _HIGHEST, len(dry))
        places = np.repeat(points[None], len(depths), axis=0)
        places[..., 2] += depth - below
        raised = sights.wet.copy()
        raised[dry] = False
        sigmas.append(_level_sigma(oriented, replace(sights, wet=raised), places))
    at_hand = _level_sigma(oriented, sights, points[None])[0]
    return LevelPrecision(
        depths=depths,
        shares=counts / len(choice),
        sigma=np.array(sigmas).T / height,
        depth=mean,
        share=least / len(choice),
        at_hand=float(at_hand) / height,
    )


def _level_sigma(oriented: Oriented, sights: Sights, places: FloatArray) -> FloatArray:
    """Return the sigmas (s,) of the level over the middle of the wet points, for points at `places` (s, p, 3).

    NaN where a point has no image; with the weights A Q A' and the priors of the orientation.
    """
    problem, at = oriented.problem, oriented.adjusted.at[np.zeros(len(places), dtype=int)]
    wet = sights.wet[problem.point]
    image = images_of(at, problem.photo, places[:, problem.point], wet, problem.rise)
    seen = np.isfinite(image).all(axis=-1) | ~np.isfinite(places[:, problem.point]).all(axis=-1)
    design = replace(problem, wet=wet, groups=oriented.method.groups(sights), approach=(), equal=False)
    covariance = precision(
        design, at, np.where(np.isfinite(image), image, problem.image), np.where(np.isfinite(places), places, 0.0)
    )
    middle = np.append(np.nanmean(places[0, sights.wet, :2], axis=0), 1.0)
    variance = np.einsum("sxy,x,y->s", covariance[:, -WATER:-1, -WATER:-1], middle, middle)
    return np.where(np.all(seen, axis=1), np.sqrt(np.maximum(variance, 0.0)), np.nan)
