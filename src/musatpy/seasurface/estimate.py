"""From surface points to a surface: waves or grid, bad points rejected, covariance by what the residuals say."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from musatpy.seasurface import fourier, grid
from musatpy.seasurface.fourier import FourierSurface, Search, Step
from musatpy.seasurface.grid import GridSurface, Mesh
from musatpy.seasurface.snooping import CRITICAL, Misfits, Snooped, misfits, scale_of, snoop
from musatpy.seasurface.spectrum import Band, band, mean_spacing
from musatpy.seasurface.surface_points import SurfacePoints

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LEAST = 8  # points: fewer are no surface
_CHANCE = 3.0  # deviations of sigma0, which is about 1 within 1 / (2 freedom)^1/2
_GROSS = 4.0  # deviations of heights, by the median
_ROUNDS = 4  # of searching for waves and rejecting points


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceFit:
    """An estimated surface, and what the points say of it.

    fitted: the surface, its covariance that of the given sigmas times the square of `factor`, which is sigma0 but
    not less than one; snooped: which points it rests on; misfits: by the given sigmas; freedom: observations less
    parameters, of a grid less the trace of its hat matrix; limit: of standardised residuals times `scale`.
    """

    points: SurfacePoints
    fitted: FourierSurface | GridSurface
    snooped: Snooped
    misfits: Misfits
    sigma0: float
    freedom: float
    scale: float
    critical: float
    spacing: float
    steps: tuple[Step, ...] = ()
    waves: Band | None = None
    notes: tuple[str, ...] = ()

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
        """Why points are rejected, by their row."""
        residual, ratio = self.snooped.residual, self.snooped.ratio
        return {
            int(i): f"residual {residual[i]:.3f} m was {ratio[i]:.1f} times its sigma, allowed {self.critical:.2f}"
            for i in np.flatnonzero(~self.kept)
        }

    @property
    def rms(self) -> float:
        """Root mean square of the residuals (m) of the points that are kept."""
        return float(np.sqrt(np.mean(np.square(self.misfits.residual[self.kept]))))


def some(points: SurfacePoints, kept: BoolArray) -> SurfacePoints:
    """Return the points of a mask (n,)."""
    ids = tuple(name for name, keep in zip(points.ids, kept.tolist(), strict=True) if keep)
    return SurfacePoints(ids=ids, position=points.position[kept], covariance=points.covariance[kept])


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
    origin = _origin(points)
    waves = band(points.position[:, :2], shortest, longest)
    search = Search(waves=waves, most=most, risk=risk)
    judged = Snooped.everyone(len(points.ids))
    q, steps = fourier.find_waves(points, origin, search)
    for _ in range(_ROUNDS):
        before = judged.kept
        judged = snoop(points, partial(_fourier_of, points, origin, q), judged, critical)
        q, more = fourier.find_waves(some(points, judged.kept), origin, search, q)
        steps = [step for step in steps if step.is_taken] + more
        if not any(step.is_taken for step in more) and (judged.kept == before).all():
            break
    fitted = _fourier_of(points, origin, q, judged.kept)
    result = _judged(points, fitted, judged, int(judged.kept.sum()) - len(q), critical)
    scaled = replace(fitted, covariance=fitted.covariance * result.factor**2)
    notes = _fourier_notes(scaled, result) + _fit_notes(result)
    return replace(result, fitted=scaled, steps=tuple(steps), waves=waves, notes=notes)


def _fourier_of(points: SurfacePoints, origin: FloatArray, q: FloatArray, kept: BoolArray) -> FourierSurface:
    return fourier.estimate(some(points, kept), origin, q)


def _fourier_notes(fitted: FourierSurface, result: SurfaceFit) -> tuple[str, ...]:
    if not fitted.count:
        return ("no wave was found: the surface is its level",)
    extent = float(np.hypot(*np.ptp(result.points.position[:, :2], axis=0)))
    notes = []
    for number, (_, length, _, _) in enumerate(fitted.described[0], start=1):
        if length < 2.0 * result.spacing:
            notes.append(f"wave {number} is shorter than two mean spacings: an alias of another is possible")
        if length > extent / 2.0:
            notes.append(f"wave {number} is seen over less than two of its lengths: hard to tell from the level")
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
    origin = _origin(points)
    mesh = grid.mesh(points.position[:, :2] - origin, spacing, curvature)
    kept, judged = _not_gross(points.position[:, 2]), Snooped.everyone(len(points.ids))
    for _ in range(_ROUNDS):
        fitted = _grid_of(points, origin, mesh, kept)
        # while points are judged, the curvature stays: with it, a gross error would explain itself
        still = replace(mesh, curvature=fitted.curvature)
        judged = snoop(points, partial(_grid_of, points, origin, still), judged, critical)
        before, kept = kept, judged.kept
        if (kept == before).all():
            break
    fitted = _grid_of(points, origin, mesh, kept)
    found = misfits(points, fitted, kept)
    result = _judged(points, fitted, judged, float(found.redundancy[kept].sum()), critical)
    scaled = replace(fitted, normal=fitted.normal / result.factor**2)
    return replace(result, fitted=scaled, notes=_fit_notes(result))


def _not_gross(z: FloatArray) -> BoolArray:
    """Return which heights (n,) lie within some deviations of their median: a start for the curvature."""
    off = np.abs(z - np.median(z))
    return np.asarray(off <= _GROSS * max(1.4826 * float(np.median(off)), 1e-12))


def _fit_notes(result: SurfaceFit) -> tuple[str, ...]:
    if result.freedom <= 0.0 or result.sigma0 <= 1.0 + _CHANCE / np.sqrt(2.0 * result.freedom):
        return ()
    return ("sigma0 is larger than by chance: the sea has more than the model shows, or the sigmas are too small",)


def _grid_of(points: SurfacePoints, origin: FloatArray, mesh: Mesh, kept: BoolArray) -> GridSurface:
    return grid.estimate(some(points, kept), origin, mesh)


def _origin(points: SurfacePoints) -> FloatArray:
    """Return the middle of the points (2,), in whole metres."""
    if len(points.ids) < LEAST:
        raise ValueError(f"{len(points.ids)} surface points: at least {LEAST} are needed")
    if not (np.ptp(points.position[:, :2], axis=0) > 0.0).all():
        raise ValueError("the surface points lie in a line")
    return np.asarray(np.round(points.position[:, :2].mean(axis=0)))


def _judged(
    points: SurfacePoints, fitted: FourierSurface | GridSurface, judged: Snooped, freedom: float, critical: float
) -> SurfaceFit:
    kept = judged.kept
    found = misfits(points, fitted, kept)
    relief = fitted.surface.relief(points.position[:, :2] - fitted.origin)
    variance = points.height_variance(relief.gradient)
    total = float(np.sum(np.square(found.residual[kept]) / variance[kept]))
    return SurfaceFit(
        points=points,
        fitted=fitted,
        snooped=judged,
        misfits=found,
        sigma0=float(np.sqrt(total / freedom)) if freedom > 0.0 else 1.0,
        freedom=freedom,
        scale=scale_of(found, kept),
        critical=critical,
        spacing=mean_spacing(points.position[:, :2]),
    )
