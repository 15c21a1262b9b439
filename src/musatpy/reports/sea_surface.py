"""The report of a water surface estimated from points on it, and the table of points corrected through one."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model.tables import falling
from musatpy.reports.fields import Field, unrecorded
from musatpy.reports.pages import text_of
from musatpy.reports.table import Table
from musatpy.sea.stereo.corrected_points import REASONS, Corrected, Fault
from musatpy.sea.stereo.estimate import SurfaceFit
from musatpy.sea.stereo.fitted import height_sigma
from musatpy.sea.stereo.fourier import FourierSurface, Step
from musatpy.sea.stereo.grid import GridSurface, Mesh, cell_counts
from musatpy.sea.stereo.point_records import ReadPoints
from musatpy.units import DEGREE

CORRECTED = (
    "id,x,y,z,true_x,true_y,true_z,sigma_x,sigma_y,sigma_z,surface_sigma_z,parallax,reason"  # columns of the table
)
_CORRELATED = 0.5  # correlations below are not listed

STEPS: Table[tuple[Step, ...]] = Table(
    (
        unrecorded("Try", "I3", lambda steps: range(1, len(steps) + 1)),
        unrecorded("Length\nm", "F9.2", lambda steps: [step.length for step in steps]),
        unrecorded("Azimuth\ndeg", "F7.1", lambda steps: [step.azimuth / DEGREE for step in steps]),
        unrecorded("Power", "F6.3", lambda steps: [step.power for step in steps]),
        unrecorded("F", "F10.2", lambda steps: [step.ratio if step.is_tested else np.nan for step in steps]),
        unrecorded("Limit", "F6.2", lambda steps: [step.critical if step.is_tested else np.nan for step in steps]),
        unrecorded("Verdict", "A54", lambda steps: [step.reason or "taken" for step in steps]),
    )
)


def _described(heading: str, column: int, decimals: int, unit: float = 1.0) -> tuple[Field[FourierSurface], ...]:
    """Return a number that describes each wave, and its sigma."""
    return (
        unrecorded(heading, f"F9.{decimals}", lambda s: s.described[0][:, column] / unit),
        unrecorded("Sigma\n", f"F7.{decimals}", lambda s: s.described[1][:, column] / unit),
    )


WAVES: Table[FourierSurface] = Table(
    (
        unrecorded("Wave", "I4", lambda s: range(1, s.count + 1)),
        *_described("Amplitude\nm", 0, 4),
        *_described("Length\nm", 1, 3),
        *_described("Azimuth\ndeg", 2, 2, DEGREE),
        *_described("Phase\ndeg", 3, 2, DEGREE),
    )
)


def surface_text(fit: SurfaceFit, title: str, left: tuple[str, ...] = ()) -> str:
    """Return the report; `left` are lines about points that were not used from the start."""
    kind = "level and waves" if isinstance(fit.fitted, FourierSurface) else "heights on a grid"
    x, y = fit.fitted.origin
    count = len(fit.points.ids) + len(fit.impossible)
    lines = [
        title,
        "",
        f"Surface of the water as {kind}, from {count} points, {len(fit.rejected)} rejected",
        f"Axes about X {x:.0f}, Y {y:.0f} m; one point to {fit.spacing:.1f} m",
        "",
    ]
    lines += _fourier(fit, fit.fitted) if isinstance(fit.fitted, FourierSurface) else _grid(fit, fit.fitted)
    lines += ["", *_residuals(fit), "", *_rejected(fit), *(f"left out: {line}" for line in left)]
    lines += [f"note: {note}" for note in fit.notes]
    return text_of(lines)


def _fourier(fit: SurfaceFit, fitted: FourierSurface) -> list[str]:
    assert fit.waves is not None
    level, sigma = fitted.parameters[0], np.sqrt(fitted.covariance[0, 0])
    lines = [
        f"Search among waves of {fit.waves.shortest:.1f} to {fit.waves.longest:.1f} m, "
        f"{fit.waves.trials} that can be told apart",
        "Peaks of the spectrum of what is left; F: what the fit gains by the wave",
        "",
        *STEPS.text(fit.steps),
        "",
        f"Level {level:.4f} m, sigma {sigma:.4f}",
    ]
    if fitted.count:
        lines += ["", *WAVES.text(fitted), "", *_correlations(fitted)]
    return lines


def _correlations(fitted: FourierSurface) -> list[str]:
    names = ["level"]
    for wave in range(1, fitted.count + 1):
        names += [f"{name} {wave}" for name in ("cosine", "sine", "kx", "ky")]
    size = np.sqrt(np.diag(fitted.covariance))
    correlation = fitted.covariance / size[:, None] / size
    i, j = np.triu_indices(len(size), 1)
    large = np.flatnonzero(np.abs(correlation[i, j]) >= _CORRELATED)
    order = large[falling(np.abs(correlation[i, j][large]), 2)]  # as they are printed
    worst = float(np.abs(correlation[i, j]).max())
    lines = [f"Correlations of parameters: {worst:.2f} at most; of {_CORRELATED} and more:"]
    pairs = [f"    {names[i[at]]}, {names[j[at]]}: {correlation[i[at], j[at]]:.2f}" for at in order]
    return lines + (pairs or ["    none"])


def _grid(fit: SurfaceFit, fitted: GridSurface) -> list[str]:
    nodes = np.stack(np.meshgrid(fitted.x, fitted.y, indexing="ij"), axis=-1)
    inner = (nodes[:-1, :-1] + nodes[1:, 1:]) / 2.0
    sigma = height_sigma(fitted, inner)[fitted.known]
    gap = fitted.x[1] - fitted.x[0]
    cells, known = fitted.known.size, int(fitted.known.sum())
    kept = fit.points.position[fit.kept, :2] - fitted.origin
    filled = int((cell_counts(Mesh(x=fitted.x, y=fitted.y), kept) > 0).sum())
    return [
        f"{len(fitted.x)} by {len(fitted.y)} nodes {gap:.2f} m apart, bicubic between; "
        f"{fit.kept.sum() / cells:.2f} points to a cell",
        f"Cells: {cells}, of which {filled} have points; known {known}, those among such without any included",
        f"Curvature 0 with a sigma of {fitted.curvature:.5f} 1/m",
        f"Heights {fitted.surface.height.min():.3f} to {fitted.surface.height.max():.3f} m",
        f"Sigma of the height in the middle of known cells: {np.median(sigma):.4f} m by the median, "
        f"{sigma.max():.4f} at most",
    ]


def _residuals(fit: SurfaceFit) -> list[str]:
    residual = fit.misfits.residual[fit.kept]
    return [
        f"Residuals of {len(residual)} points: {fit.rms:.4f} m RMS, {np.abs(residual).max():.4f} at most, "
        f"mean {round(float(residual.mean()), 4) + 0.0:.4f}",
        f"Degrees of freedom {fit.freedom:.1f}, sigma0 {fit.sigma0:.4f}; sigmas of the surface are those of the "
        f"points times {fit.factor:.4f}",
        f"Least redundancy of a point {fit.misfits.redundancy[fit.kept].min():.3f}; "
        f"standardised residuals are divided by {fit.scale:.3f}",
    ]


def _rejected(fit: SurfaceFit) -> list[str]:
    if not fit.rejected:
        return ["No point rejected"]
    return ["Rejected", *(f"    {name}: {reason}" for name, reason in fit.rejected)]


def corrected_csv(read: ReadPoints, corrected: Corrected) -> str:
    """Return apparent and true points as their file has them, with sigmas (m), or the reason why there is none."""
    good = corrected.fault == Fault.NONE
    true = np.full(corrected.position.shape, np.nan)
    true[good] = read.coordinates(corrected.position[good])
    given, decimals = read.coordinates(read.points.position), read.decimals
    lines = [CORRECTED]
    for row, name in enumerate(read.points.ids):
        sigmas = [*corrected.sigma[row], corrected.surface_sigma[row], corrected.parallax[row]]
        texts = [*_decimal(true[row], decimals), *(f"{value:.4f}" for value in sigmas)]
        texts = texts if good[row] else [""] * len(texts)
        reason = REASONS[Fault(corrected.fault[row])]
        lines.append(",".join([name, *_decimal(given[row], decimals), *texts, reason]))
    return "\n".join(lines) + "\n"


def _decimal(place: FloatArray, decimals: tuple[int, int, int]) -> list[str]:
    return [f"{value:.{number}f}" for value, number in zip(place.tolist(), decimals, strict=True)]
