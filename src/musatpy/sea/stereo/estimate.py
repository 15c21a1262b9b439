"""From surface points to a surface: waves or grid, bad points rejected, covariance by what the residuals say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.similarity import spread
from musatpy.sea.interpolation.estimation import spacing
from musatpy.sea.stereo import fourier, grid
from musatpy.sea.stereo.fourier import FourierSurface, WaveTrial
from musatpy.sea.stereo.grid import GridSurface, Mesh
from musatpy.sea.stereo.spectrum import Band, band, lattice, mean_spacing
from musatpy.sea.stereo.surface_points import CRITICAL, KeptPoints, Misfits, SurfacePoints, misfits, scale_of, snoop
from musatpy.units import DEGREE

LEAST = 8  # points: fewer are no surface
_CHANCE = 3.0  # deviations of sigma0, which is about 1 within 1 / (2 freedom)^1/2
_GROSS = 4.0  # deviations of heights, by the median
_CROWDED = 5.0  # mean spacing over that to the nearest point: about 2 at random places
_STEEPEST = np.tan(30.0 * DEGREE)  # of the highest wave: its crest is an angle of 120 degrees (Stokes 1880)
_ACROSS = 4.0  # from end to end of the points, over their median distance from their middle: 2.8 in a square
_SLIM = 1e-3  # width of points over their length: narrower is a line
_ROUNDS = 4  # of searching for waves and rejecting points


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceFit:
    """An estimated surface, and what the points say of it.

    fitted: the surface, its covariance that of the given sigmas times the square of `factor`, which is sigma0 but
    not less than one; snooped: which points it rests on; misfits: by the given sigmas; freedom: observations less
    parameters, of a grid less the trace of its hat matrix; limit: of standardised residuals times `scale`;
    impossible: why points are none on water, by their id: they are not among `points`.
    """

    points: SurfacePoints
    fitted: FourierSurface | GridSurface
    snooped: KeptPoints
    misfits: Misfits
    sigma0: float
    freedom: float
    scale: float
    critical: float
    spacing: float
    steps: tuple[WaveTrial, ...] = ()
    waves: Band | None = None
    notes: tuple[str, ...] = ()
    impossible: Mapping[str, str] = field(default_factory=dict)

    @property
    def kept(self) -> BoolArray:
        """(n,) which points the surface rests on."""
        return self.snooped.kept

    @property
    def factor(self) -> float:
        """By which sigmas of the surface are those of the points: sigma0, but not less than one."""
        return max(1.0, self.sigma0)

    @property
    def reasons(self) -> dict[int, str]:
        """Why points are rejected that may be on water, by their row."""
        residual, ratio = self.snooped.residual, self.snooped.ratio
        return {
            int(i): f"residual {residual[i]:.3f} m was {ratio[i]:.1f} times its sigma, allowed {self.critical:.2f}"
            for i in np.flatnonzero(~self.kept)
        }

    @property
    def rejected(self) -> tuple[tuple[str, str], ...]:
        """Id and reason of all points that the surface does not rest on."""
        return (*self.impossible.items(), *((self.points.ids[row], why) for row, why in self.reasons.items()))

    @property
    def rms(self) -> float:
        """Root mean square of the residuals (m) of the points that are kept."""
        return float(np.sqrt(np.mean(np.square(self.misfits.residual[self.kept]))))


def on_water(points: SurfacePoints) -> tuple[SurfacePoints, dict[str, str]]:
    """Return the points that a water surface can have, and why it cannot have the others, by their id.

    Even where it is as steep as it can be all the way, no water is further above or below the median height than
    the points go across; noise of the heights counts as well. What is estimated from sums loses its digits to a
    height of 1e9 m, and is not there to judge it.
    """
    if len(points.ids) < LEAST:
        return points, {}
    position = points.position
    off = position[:, 2] - np.median(position[:, 2])
    away = np.hypot(*(position[:, :2] - np.median(position[:, :2], axis=0)).T)
    sigma = np.sqrt(np.median(points.covariance[:, 2, 2]))
    limit = float(_STEEPEST * _ACROSS * np.median(away) + _GROSS * sigma)
    possible = np.abs(off) <= limit
    beyond = f"no water over these points goes beyond {limit:.1f} m"
    reasons = {
        points.ids[row]: f"{off[row]:.6g} m off the median height: {beyond}"
        for row in np.flatnonzero(~possible).tolist()
    }
    return (points.some(possible) if reasons else points), reasons


def fit_fourier(
    points: SurfacePoints,
    *,
    shortest: float | None = None,
    longest: float | None = None,
    most: int = 8,
    risk: float = fourier.RISK,
    critical: float = CRITICAL,
) -> SurfaceFit:
    """Return the waves that points on the water speak for: at most so many, of lengths (m) within bounds.

    Bounds by default: the mean spacing of the points, and the diagonal of the box around them. Raises
    `ValueError` where there are too few points, or nothing within the bounds.
    """
    points, impossible = on_water(points)
    origin = _origin(points)
    waves = band(points.position[:, :2], shortest, longest)
    judged = KeptPoints.everyone(len(points.ids))
    q, steps = fourier.find_waves(points, origin, waves, most, risk)

    def of(start: FloatArray, kept: BoolArray) -> FourierSurface:
        return fourier.estimate(points.some(kept), origin, start)

    for _ in range(_ROUNDS):
        before = judged.kept
        judged = snoop(points, partial(of, q), judged, critical)
        q, more = fourier.find_waves(points.some(judged.kept), origin, waves, most, risk, q)
        steps = [step for step in steps if step.is_taken] + more
        if not any(step.is_taken for step in more) and (judged.kept == before).all():
            break
    fitted = of(q, judged.kept)
    result = _judged(points, fitted, judged, int(judged.kept.sum()) - len(q), critical)
    scaled = replace(fitted, covariance=fitted.covariance * result.factor**2)
    notes = _fourier_notes(scaled, result) + _fit_notes(result)
    return replace(result, fitted=scaled, steps=tuple(steps), waves=waves, notes=notes, impossible=impossible)


def _fourier_notes(fitted: FourierSurface, result: SurfaceFit) -> tuple[str, ...]:
    """Return what is doubtful of waves, and which longest other one would look like each at places that repeat."""
    if not fitted.count:
        return ("no wave was found: the surface is its level",)
    place = result.points.position[:, :2]
    extent, repeats = float(np.hypot(*np.ptp(place, axis=0))), lattice(place)
    notes = []
    for number, (_, length, _, _) in enumerate(fitted.described[0], start=1):
        if length < 2.0 * result.spacing:
            notes.append(f"wave {number} is shorter than two mean spacings: an alias of another is possible")
        if length > extent / 2.0:
            notes.append(f"wave {number} is seen over less than two of its lengths: hard to tell from the level")
    vectors = fitted.parameters[1:].reshape(-1, fourier.PER_WAVE)[:, 2:]
    for number, vector in enumerate(vectors if len(repeats) else (), start=1):
        other = min(vector + repeats, key=lambda alias: float(np.linalg.norm(alias)))
        length, azimuth = 2.0 * np.pi / float(np.linalg.norm(other)), np.arctan2(other[1], other[0]) / DEGREE
        azimuth -= 180.0 * round(azimuth / 180.0)
        notes.append(
            f"the points are a regular grid: at them a wave of {length:.1f} m along {azimuth:.0f} deg "
            f"looks the same as wave {number}"
        )
    return tuple(notes)


def fit_grid(
    points: SurfacePoints,
    *,
    spacing: float | None = None,
    curvature: float | None = None,
    critical: float = CRITICAL,
) -> SurfaceFit:
    """Return the grid of heights through points on the water: spacing of the nodes (m), sigma of curvature (1/m).

    By default one point falls on a cell on the average, and the curvature is the likeliest. Raises `ValueError`
    where there are too few points or too many nodes.
    """
    points, impossible = on_water(points)
    origin = _origin(points)
    mesh = grid.mesh(points.position[:, :2] - origin, spacing, curvature)
    off = np.abs(points.position[:, 2] - np.median(points.position[:, 2]))
    # a start for the curvature: heights within some deviations of their median
    kept, judged = off <= _GROSS * spread(off, 1e-12), KeptPoints.everyone(len(points.ids))

    def of(nodes: Mesh, kept: BoolArray) -> GridSurface:
        return grid.estimate(points.some(kept), origin, nodes)

    for _ in range(_ROUNDS):
        # while points are judged, the curvature stays: with it, a gross error would explain itself
        still = replace(mesh, curvature=of(mesh, kept).curvature)
        judged = snoop(points, partial(of, still), judged, critical)
        before, kept = kept, judged.kept
        if (kept == before).all():
            break
    fitted = of(mesh, kept)
    misfit = misfits(points, fitted, kept)
    result = _judged(points, fitted, judged, float(misfit.redundancy[kept].sum()), critical)
    scaled = replace(fitted, normal=fitted.normal / result.factor**2)
    return replace(result, fitted=scaled, notes=_fit_notes(result), impossible=impossible)


def _fit_notes(result: SurfaceFit) -> tuple[str, ...]:
    notes, nearest = [], spacing(result.points.position[:, :2])
    if result.freedom > 0.0 and result.sigma0 > 1.0 + _CHANCE / np.sqrt(2.0 * result.freedom):
        notes.append(
            "sigma0 is larger than by chance: the sea has more than the model shows, or sigmas are too small"
        )
    if result.spacing > _CROWDED * nearest:
        notes.append(
            f"the points fill little of the box around them: {nearest:.1f} m to the nearest (median), one to "
            f"{result.spacing:.1f} m: is one of them far off?"
        )
    return tuple(notes)


def _origin(points: SurfacePoints) -> FloatArray:
    """Return the middle of the points (2,), in whole metres."""
    if len(points.ids) < LEAST:
        raise ValueError(f"{len(points.ids)} surface points: at least {LEAST} are needed")
    size = np.linalg.svd(points.position[:, :2] - points.position[:, :2].mean(axis=0), compute_uv=False)
    if not size[1] > _SLIM * size[0]:
        raise ValueError("the surface points lie in a line")
    return np.round(points.position[:, :2].mean(axis=0))


def _judged(
    points: SurfacePoints, fitted: FourierSurface | GridSurface, judged: KeptPoints, freedom: float, critical: float
) -> SurfaceFit:
    kept = judged.kept
    misfit = misfits(points, fitted, kept)
    relief = fitted.surface.relief(points.position[:, :2] - fitted.origin)
    variance = points.height_variance(relief.gradient)
    total = float(np.sum(np.square(misfit.residual[kept]) / variance[kept]))
    return SurfaceFit(
        points=points,
        fitted=fitted,
        snooped=judged,
        misfits=misfit,
        sigma0=float(np.sqrt(total / freedom)) if freedom > 0.0 else 1.0,
        freedom=freedom,
        scale=scale_of(misfit, kept),
        critical=critical,
        spacing=mean_spacing(points.position[:, :2]),
    )
