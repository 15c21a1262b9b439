"""The reports of surfaces of water from points on them, of errors in height interpolated, of waves over a map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model.tables import falling
from musatpy.reports.pages import text_of
from musatpy.reports.table import Table, sheet
from musatpy.sea.experiment import WIDE, Trials, WaveStudy, flying_height
from musatpy.sea.interpolation.correlation import SignalKind
from musatpy.sea.interpolation.interpolate import Benefit, Interpolation
from musatpy.sea.interpolation.prediction import Trend
from musatpy.sea.stereo.estimate import SurfaceFit
from musatpy.sea.stereo.fourier import FourierSurface
from musatpy.sea.stereo.grid import GridSurface, Mesh, cell_counts
from musatpy.sea.stereo.surface_points import height_sigma
from musatpy.units import DEGREE

_CORRELATED = 0.5  # correlations below are not listed


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
    residual, shown = fit.misfits.residual[fit.kept], [f"    {name}: {reason}" for name, reason in fit.rejected]
    lines += [
        "",
        f"Residuals of {len(residual)} points: {fit.rms:.4f} m RMS, {np.abs(residual).max():.4f} at most, "
        f"mean {round(float(residual.mean()), 4) + 0.0:.4f}",
        f"Degrees of freedom {fit.freedom:.1f}, sigma0 {fit.sigma0:.4f}; sigmas of the surface are those of the "
        f"points times {fit.factor:.4f}",
        f"Least redundancy of a point {fit.misfits.redundancy[fit.kept].min():.3f}; "
        f"standardised residuals are divided by {fit.scale:.3f}",
        "",
        *(["Rejected", *shown] if shown else ["No point rejected"]),
        *(f"left out: {line}" for line in left),
        *(f"note: {note}" for note in fit.notes),
    ]
    return text_of(lines)


def _fourier(fit: SurfaceFit, fitted: FourierSurface) -> list[str]:
    assert fit.waves is not None
    level, sigma = fitted.parameters[0], np.sqrt(fitted.covariance[0, 0])
    lines = [
        f"Search among waves of {fit.waves.shortest:.1f} to {fit.waves.longest:.1f} m, "
        f"{fit.waves.trials} that can be told apart",
        "Peaks of the spectrum of what is left; F: what the fit gains by the wave",
        "",
        *sheet(
            ("Try", "I3", range(1, len(fit.steps) + 1)),
            ("Length\nm", "F9.2", [step.length for step in fit.steps]),
            ("Azimuth\ndeg", "F7.1", [step.azimuth / DEGREE for step in fit.steps]),
            ("Power", "F6.3", [step.power for step in fit.steps]),
            ("F", "F10.2", [step.ratio if step.is_tested else np.nan for step in fit.steps]),
            ("Limit", "F6.2", [step.critical if step.is_tested else np.nan for step in fit.steps]),
            ("Verdict", "A54", [step.reason or "taken" for step in fit.steps]),
        ).text(),
        "",
        f"Level {level:.4f} m, sigma {sigma:.4f}",
    ]
    if fitted.count:
        lines += ["", *_described(fitted).text(), "", *_correlations(fitted)]
    return lines


def _described(surface: FourierSurface) -> Table[Any]:
    """Return the numbers that describe each wave, with their sigmas."""
    stated = ("Amplitude\nm", 4, 1.0), ("Length\nm", 3, 1.0), ("Azimuth\ndeg", 2, DEGREE), ("Phase\ndeg", 2, DEGREE)
    columns: list[tuple[str, str, Any]] = [("Wave", "I4", range(1, surface.count + 1))]
    for (heading, decimals, unit), value, sigma in zip(stated, *(of.T for of in surface.described), strict=True):
        columns += [(heading, f"F9.{decimals}", value / unit), ("Sigma\n", f"F7.{decimals}", sigma / unit)]
    return sheet(*columns)


def _correlations(fitted: FourierSurface) -> list[str]:
    waves = [f"{name} {wave + 1}" for wave in range(fitted.count) for name in ("cosine", "sine", "kx", "ky")]
    names = ["level", *waves]
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


_SAYS = {
    Benefit.HELPS: "the interpolation helps",
    Benefit.LITTLE: "the interpolation helps little",
    Benefit.NOT: "the interpolation does not help: leave the heights as they are",
}


def _fitted(result: Interpolation) -> FloatArray:
    """Return the covariance function used, m2, at the distances of the empirical one, mean of all directions."""
    covariance, azimuth = result.best.estimate.covariance, np.arange(180) * np.pi / 180.0
    lag = result.empirical.distance[:, None, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    values = covariance.signal * covariance.correlation(lag).mean(axis=1)
    values[0] += covariance.noise
    return np.asarray(values)


def collocation_text(result: Interpolation, ids: Sequence[str], sources: tuple[str, str]) -> str:
    """Return the report of an interpolation; `ids` are those of the control points, sources the two files."""
    trend = "a plane" if result.options.trend == Trend.PLANE else "a constant"
    used, every = int(result.used.sum()), result.candidates
    single, grouped = result.best.validation, result.grouped
    outliers = [
        f"    {ids[outlier.row]}: {outlier.error:.3f} m from what the others predict, "
        f"{abs(outlier.error / outlier.sigma):.1f} sigma where {result.critical:.2f} are allowed"
        for outlier in result.outliers
    ]
    outliers = ["Outliers among the control points, not used", *outliers] if outliers else []
    lines = [
        "ERRORS IN HEIGHT INTERPOLATED BETWEEN CONTROL POINTS",
        "",
        f"Points {sources[0]}, control {sources[1]}",
        f"{len(ids)} control points, {used} used, {result.spacing:.1f} m apart (median); the trend is {trend}",
        "",
        "Covariance functions, best first, by Akaike's criterion of the restricted likelihood",
        "",
        *sheet(
            ("Function", "A11", [one.family for one in every]),
            ("Signal\nm", "F7.3", [one.estimate.covariance.signal**0.5 for one in every]),
            ("Noise\nm", "F7.3", [one.estimate.covariance.noise**0.5 for one in every]),
            ("Criterion", "F9.1", [one.estimate.criterion for one in every]),
            ("Left one out\nm", "F12.3", [one.validation.rms for one in every]),
            ("Over sigma", "F10.2", [one.validation.standardised_rms for one in every]),
            ("Parameters", "A50", [one.estimate.covariance.correlation.in_words() for one in every]),
        ).text(),
        "",
        f"Empirical covariances without trend, and the function used ({result.best.family}), "
        "mean of all directions",
        "",
        *sheet(
            ("Distance\nm", "F9.1", result.empirical.distance),
            ("Pairs", "I8", result.empirical.pairs),
            ("Covariance\nm2", "F10.4", result.empirical.covariance),
            ("Fitted\nm2", "F10.4", _fitted(result)),
        ).text(),
        "",
        "Cross-validation (given minus predicted, noise of the control included)",
        "",
        f"Before any correction                                  {result.before:8.3f} m RMS",
        f"Each point left out, the covariance held               {single.rms:8.3f} m RMS, "
        f"{single.standardised_rms:.2f} over sigma",
        f"Groups left out, the covariance estimated without them {grouped.rms:8.3f} m RMS, "
        f"{grouped.standardised_rms:.2f} over sigma",
        f"Sigmas of corrected heights are those of prediction and noise times {result.factor:.2f}",
        "",
        *(outliers or [f"No outliers among the control points (beyond {result.critical:.2f} sigma)"]),
        "",
        f"Corrected is what lies within {result.reach:.1f} m of a control point used",
        *_cautions(result),
        verdict_line(result),
    ]
    return text_of(lines)


def verdict_line(result: Interpolation) -> str:
    """Return the verdict in a line."""
    change = f"RMS {result.before:.3f} m before, {result.grouped.rms:.3f} m at points left out"
    return f"Verdict: {_SAYS[result.verdict]} ({change})"


def _cautions(result: Interpolation) -> Iterator[str]:
    wave = result.best.estimate.covariance.correlation.wave_length
    if result.best.family == SignalKind.NONE:
        yield "note: no function of distance explains the errors: the trend alone is taken off"
    if wave is not None and result.spacing > wave / 2.0:
        yield (
            f"note: control {result.spacing:.1f} m apart is wider than half the wave of {wave:.1f} m: "
            "on a regular grid another wave would fit as well"
        )


_COORDINATES = ("X", "Y", "Z")
_KEPT = ("kept", "exceeded")  # verdicts on the accuracy that was asked for
_BAR = 50  # characters of the longest bar of a histogram
POINTS = ("no", "x", "y", "z", "dx", "dy", "dz", "y_parallax", "refraction_points_left", "refraction_points_right")


def waves_text(study: WaveStudy) -> str:
    """Return the report of a wave experiment."""
    spec = study.spec
    left, right = (", ".join(f"{value:.1f}" for value in camera) for camera in spec.stereo.cameras)
    height = flying_height(spec)
    lines = [
        spec.title,
        "",
        f"Cameras at ({left}) and ({right}) m, {spec.stereo.interval:g} s apart, {height:.1f} m above the bottom",
        f"Water {spec.water.depth:g} m deep, index {spec.water.index:g}; {len(study.errors.points)} check points",
        "",
        *sheet(
            ("Wave", "I4", range(1, len(spec.wave) + 1)),
            ("Shape", "A10", [wave.shape for wave in spec.wave]),
            ("Period\ns", "F6.1", study.theory.period),
            ("Length\nm", "F7.1", study.length),
            ("Speed\nm/s", "F6.2", study.speed),
            ("Group\nm/s", "F6.2", study.theory.group_speed),
            ("Height\nm", "F6.2", study.theory.height),
            ("Breaks at\nm", "F9.2", study.theory.breaking_height),
            ("Towards\ndeg", "F7.1", [wave.azimuth for wave in spec.wave]),
            ("Crest\nm", "F7.1", [wave.crest for wave in spec.wave]),
        ).text(),
        *(
            f"note: wave {i + 1} is higher than a wave of its length can stand there"
            for i in np.flatnonzero(study.theory.breaks)
        ),
        "",
        "Errors of taking the water for level, mapped minus true",
        "",
        *sheet(
            ("Coordinate", "A10", _COORDINATES),
            ("Maximum\nm", "F8.3", study.spread.largest),
            ("at No.", "I6", study.spread.point + 1),
            ("Mean\nm", "F8.3", study.spread.mean),
            ("Sigma\nm", "F8.3", study.spread.sigma),
            ("Allowed\nm", "F8.3", study.spread.allowed),
            ("Verdict", "A8", np.where(study.spread.kept, *_KEPT)),
        ).text(),
        "",
        f"Allowed are 1/{spec.accuracy.plan:g} of the flying height in plan, 1/{spec.accuracy.height:g} in height",
        *_rays(study),
        *_histograms(study),
    ]
    for trials in study.studies:
        lines += ["", *_trials(trials)]
    return text_of(lines)


def points_csv(study: WaveStudy) -> str:
    """Return true places and errors (m) of every check point, comma separated: a map of the errors in numbers."""
    errors = study.errors
    numbers = np.column_stack([errors.points, errors.error, errors.parallax])
    rows = [
        ",".join([str(no), *(f"{value:.4f}" for value in row + 0.0), *map(str, count)])
        for no, (row, count) in enumerate(zip(numbers, errors.number, strict=True), start=1)
    ]
    return "\n".join([",".join(POINTS), *rows]) + "\n"


def _rays(study: WaveStudy) -> Iterator[str]:
    number, parallax = study.errors.number, study.errors.parallax
    several, missing = int((number > 1).sum()), int((~study.errors.complete).sum())
    rms, most = np.sqrt(np.mean(parallax**2)), np.abs(parallax).max()
    yield f"Y-parallax of the mapped points: {rms:.3f} m RMS, {most:.3f} m at most"
    yield f"Rays with several refraction points: {several} of {number.size}"
    if several:
        yield f"    at most {number.max()} points; the one of the least optical path counts"
    if study.wide:
        yield (
            f"note: {study.wide} rays are more than {WIDE / DEGREE:.0f} degrees from the vertical: "
            "points that are not in the overlap of two photographs"
        )
    if missing:
        yield f"note: of {missing} rays the search may have missed refraction points"


def _histograms(study: WaveStudy) -> list[str]:
    lines = []
    for name, edges, count in zip(_COORDINATES, study.histogram.edges, study.histogram.count, strict=True):
        lines += ["", f"Histogram of the errors in {name}: m, points", ""]
        middle = (edges[:-1] + edges[1:]) / 2.0
        for at, points in zip(middle, count, strict=True):
            bar = "*" * int(np.ceil(_BAR * points / count.max()))
            lines.append(f"{0.0 if abs(at) < 0.0005 else at:8.3f}  {points:5d}  {bar}".rstrip())
    return lines


def _trials(trials: Trials) -> list[str]:
    done = [(trial.value, trial.spread) for trial in trials.trials if trial.spread]
    largest = np.array([spread.largest for _, spread in done]).reshape(-1, 3)
    sigma = np.array([spread.sigma for _, spread in done]).reshape(-1, 3)
    table = sheet(
        (f"{trials.name}\n{trials.unit}", "F8.2", [value for value, _ in done]),
        ([f"Max {name}\nm" for name in _COORDINATES], "F8.3", largest),
        ([f"Sigma {name}\nm" for name in _COORDINATES], "F8.3", sigma),
        ("Verdict", "A8", np.where([spread.kept.all() for _, spread in done], *_KEPT)),
    )
    failed = [
        f"note: {trials.name.lower()} {t.value:g} {trials.unit}: {t.reason}" for t in trials.trials if t.reason
    ]
    return [f"{trials.name} varied", "", *table.text(), *failed]
