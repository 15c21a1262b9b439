"""An interpolation of errors in height, as text."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from musatpy.reports.fields import unrecorded
from musatpy.reports.pages import text_of
from musatpy.reports.table import Table
from musatpy.sea.interpolation.correlation import Family
from musatpy.sea.interpolation.interpolate import Candidate, Interpolation, Verdict
from musatpy.sea.interpolation.prediction import Trend

FAMILIES: Table[tuple[Candidate, ...]] = Table(
    (
        unrecorded("Function", "A11", lambda c: [candidate.family for candidate in c]),
        unrecorded("Signal\nm", "F7.3", lambda c: [candidate.estimate.covariance.signal**0.5 for candidate in c]),
        unrecorded("Noise\nm", "F7.3", lambda c: [candidate.estimate.covariance.noise**0.5 for candidate in c]),
        unrecorded("Criterion", "F9.1", lambda c: [candidate.estimate.criterion for candidate in c]),
        unrecorded("Left one out\nm", "F12.3", lambda c: [candidate.validation.rms for candidate in c]),
        unrecorded("Over sigma", "F10.2", lambda c: [candidate.validation.standardised_rms for candidate in c]),
        unrecorded(
            "Parameters", "A50", lambda c: [candidate.estimate.covariance.correlation.in_words() for candidate in c]
        ),
    )
)
COVARIANCES: Table[Interpolation] = Table(
    (
        unrecorded("Distance\nm", "F9.1", lambda f: f.empirical.distance),
        unrecorded("Pairs", "I8", lambda f: f.empirical.pairs),
        unrecorded("Covariance\nm2", "F10.4", lambda f: f.empirical.covariance),
        unrecorded("Fitted\nm2", "F10.4", lambda f: fitted(f)),
    )
)
_SAYS = {
    Verdict.HELPS: "the interpolation helps",
    Verdict.LITTLE: "the interpolation helps little",
    Verdict.NOT: "the interpolation does not help: leave the heights as they are",
}


def fitted(result: Interpolation) -> list[float]:
    """Return the covariance function used, m2, at the distances of the empirical one, mean of all directions."""
    covariance, table = result.best.estimate.covariance, result.empirical
    return [
        covariance_at(result, float(distance)) + (covariance.noise if row == 0 else 0.0)
        for row, distance in enumerate(table.distance)
    ]


def covariance_at(result: Interpolation, distance: float) -> float:
    """Return the mean over all directions of the covariance of the signal, m2, at a distance (m)."""
    covariance = result.best.estimate.covariance
    azimuth = np.arange(180) * np.pi / 180.0
    lag = distance * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    return float(covariance.signal * covariance.correlation(lag).mean())


def collocation_text(result: Interpolation, ids: Sequence[str], sources: tuple[str, str]) -> str:
    """Return the report of an interpolation; `ids` are those of the control points, sources the two files."""
    trend = "a plane" if result.options.trend == Trend.PLANE else "a constant"
    used = int(result.used.sum())
    lines = [
        "ERRORS IN HEIGHT INTERPOLATED BETWEEN CONTROL POINTS",
        "",
        f"Points {sources[0]}, control {sources[1]}",
        f"{len(ids)} control points, {used} used, {result.spacing:.1f} m apart (median); the trend is {trend}",
        "",
        "Covariance functions, best first, by Akaike's criterion of the restricted likelihood",
        "",
        *FAMILIES.text(result.candidates),
        "",
        f"Empirical covariances without trend, and the function used ({result.best.family}), "
        "mean of all directions",
        "",
        *COVARIANCES.text(result),
        "",
        *_validation(result),
        "",
        *_outliers(result, ids),
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


def _validation(result: Interpolation) -> list[str]:
    single, grouped = result.best.validation, result.grouped
    return [
        "Cross-validation (given minus predicted, noise of the control included)",
        "",
        f"Before any correction                                  {result.before:8.3f} m RMS",
        f"Each point left out, the covariance held               {single.rms:8.3f} m RMS, "
        f"{single.standardised_rms:.2f} over sigma",
        f"Groups left out, the covariance estimated without them {grouped.rms:8.3f} m RMS, "
        f"{grouped.standardised_rms:.2f} over sigma",
        f"Sigmas of corrected heights are those of prediction and noise times {result.factor:.2f}",
    ]


def _outliers(result: Interpolation, ids: Sequence[str]) -> list[str]:
    if not result.outliers:
        return [f"No outliers among the control points (beyond {result.critical:.2f} sigma)"]
    return [
        "Outliers among the control points, not used",
        *(
            f"    {ids[outlier.row]}: {outlier.error:.3f} m from what the others predict, "
            f"{abs(outlier.error / outlier.sigma):.1f} sigma where {result.critical:.2f} are allowed"
            for outlier in result.outliers
        ),
    ]


def _cautions(result: Interpolation) -> list[str]:
    lines = []
    wave = result.best.estimate.covariance.correlation.wave_length
    if result.best.family == Family.NONE:
        lines.append("note: no function of distance explains the errors: the trend alone is taken off")
    if wave is not None and result.spacing > wave / 2.0:
        lines.append(
            f"note: control {result.spacing:.1f} m apart is wider than half the wave of {wave:.1f} m: "
            "on a regular grid another wave would fit as well"
        )
    return lines
