"""An interpolation of errors in height, as text."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from musatpy.reports.table import Column, Table
from musatpy.reports.text import text_of
from musatpy.sea.interpolation.correlation import Family
from musatpy.sea.interpolation.interpolate import Candidate, Interpolation, Verdict
from musatpy.sea.interpolation.prediction import Trend

FAMILIES: Table[tuple[Candidate, ...]] = Table(
    (
        Column("Function", "A11", lambda c: [one.family for one in c]),
        Column("Signal\nm", "F7.3", lambda c: [one.estimate.covariance.signal**0.5 for one in c]),
        Column("Noise\nm", "F7.3", lambda c: [one.estimate.covariance.noise**0.5 for one in c]),
        Column("Criterion", "F9.1", lambda c: [one.estimate.criterion for one in c]),
        Column("Left one out\nm", "F12.3", lambda c: [one.validation.rms for one in c]),
        Column("Over sigma", "F10.2", lambda c: [one.validation.standardised_rms for one in c]),
        Column("Parameters", "A50", lambda c: [one.estimate.covariance.correlation.in_words() for one in c]),
    )
)
COVARIANCES: Table[Interpolation] = Table(
    (
        Column("Distance\nm", "F9.1", lambda f: f.empirical.distance),
        Column("Pairs", "I8", lambda f: f.empirical.pairs),
        Column("Covariance\nm2", "F10.4", lambda f: f.empirical.covariance),
        Column("Fitted\nm2", "F10.4", lambda f: fitted(f)),
    )
)
_SAYS = {
    Verdict.HELPS: "the interpolation helps",
    Verdict.LITTLE: "the interpolation helps little",
    Verdict.NOT: "the interpolation does not help: leave the heights as they are",
}


def fitted(found: Interpolation) -> list[float]:
    """Return the covariance function used, m2, at the distances of the empirical one, mean of all directions."""
    covariance, table = found.best.estimate.covariance, found.empirical
    return [
        covariance_at(found, float(distance)) + (covariance.noise if row == 0 else 0.0)
        for row, distance in enumerate(table.distance)
    ]


def covariance_at(found: Interpolation, distance: float) -> float:
    """Return the mean over all directions of the covariance of the signal, m2, at a distance (m)."""
    covariance = found.best.estimate.covariance
    azimuth = np.arange(180) * np.pi / 180.0
    lag = distance * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    return float(covariance.signal * covariance.correlation(lag).mean())


def collocation_text(found: Interpolation, ids: Sequence[str], sources: tuple[str, str]) -> str:
    """Return the report of an interpolation; `ids` are those of the control points, sources the two files."""
    trend = "a plane" if found.options.trend == Trend.PLANE else "a constant"
    used = int(found.used.sum())
    lines = [
        "ERRORS IN HEIGHT INTERPOLATED BETWEEN CONTROL POINTS",
        "",
        f"Points {sources[0]}, control {sources[1]}",
        f"{len(ids)} control points, {used} used, {found.spacing:.1f} m apart (median); the trend is {trend}",
        "",
        "Covariance functions, best first, by Akaike's criterion of the restricted likelihood",
        "",
        *FAMILIES.text(found.candidates),
        "",
        f"Empirical covariances without trend, and the function used ({found.best.family}), mean of all directions",
        "",
        *COVARIANCES.text(found),
        "",
        *_validation(found),
        "",
        *_outliers(found, ids),
        "",
        f"Corrected is what lies within {found.reach:.1f} m of a control point used",
        *_cautions(found),
        verdict_line(found),
    ]
    return text_of(lines)


def verdict_line(found: Interpolation) -> str:
    """Return the verdict in a line."""
    change = f"RMS {found.before:.3f} m before, {found.grouped.rms:.3f} m at points left out"
    return f"Verdict: {_SAYS[found.verdict]} ({change})"


def _validation(found: Interpolation) -> list[str]:
    one, grouped = found.best.validation, found.grouped
    return [
        "Cross-validation (given minus predicted, noise of the control included)",
        "",
        f"Before any correction                                  {found.before:8.3f} m RMS",
        f"Each point left out, the covariance held               {one.rms:8.3f} m RMS, "
        f"{one.standardised_rms:.2f} over sigma",
        f"Groups left out, the covariance estimated without them {grouped.rms:8.3f} m RMS, "
        f"{grouped.standardised_rms:.2f} over sigma",
        f"Sigmas of corrected heights are those of prediction and noise times {found.factor:.2f}",
    ]


def _outliers(found: Interpolation, ids: Sequence[str]) -> list[str]:
    if not found.outliers:
        return [f"No outliers among the control points (beyond {found.critical:.2f} sigma)"]
    return [
        "Outliers among the control points, not used",
        *(
            f"    {ids[one.row]}: {one.error:.3f} m from what the others predict, {abs(one.error / one.sigma):.1f} "
            f"sigma where {found.critical:.2f} are allowed"
            for one in found.outliers
        ),
    ]


def _cautions(found: Interpolation) -> list[str]:
    lines = []
    wave = found.best.estimate.covariance.correlation.wave_length
    if found.best.family == Family.NONE:
        lines.append("note: no function of distance explains the errors: the trend alone is taken off")
    if wave is not None and found.spacing > wave / 2.0:
        lines.append(
            f"note: control {found.spacing:.1f} m apart is wider than half the wave of {wave:.1f} m: "
            "on a regular grid another wave would fit as well"
        )
    return lines
