"""Sigmas in other words, and the correlations that are lost on the way because cards have sigmas only."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.errors import Problem, SystemsError

MOST = 0.1  # correlation: a weight is a hundredth too small where it is left out
_WORTH_SAYING = 0.005


@dataclass
class Findings:
    """What is wrong, and what is worth saying, gathered so that every reason is told at once."""

    refused: list[Problem] = field(default_factory=list)
    warnings: list[Problem] = field(default_factory=list)

    def refuse(self, rows: BoolArray, kind: str, ids: TextArray, why: str) -> None:
        """Refuse each of the (n,) rows by its kind and name, which is `found` in the problem."""
        for name in ids[rows]:
            self.refused.append(Problem(message=f"{kind} {name}: {why}", found=str(name)))

    def warn(self, message: str, found: str | None = None, field: str | None = None) -> None:
        """Say something that stops nothing, of the photo or point `found` or a `field` of the spec if of one."""
        self.warnings.append(Problem(message=message, severity="warning", found=found, field=field))

    def stop(self) -> None:
        """Raise `SystemsError` if anything was refused."""
        if self.refused:
            raise SystemsError(self.refused)


@dataclass(frozen=True, kw_only=True, eq=False)
class Owners:
    """Whose sigmas they are."""

    kind: str
    ids: TextArray  # (n,)
    what: str  # positions, attitudes


def propagated(
    sigma: FloatArray, partials: FloatArray, owners: Owners, plane_alone: bool, findings: Findings
) -> FloatArray:
    """Return the sigmas (n, 3) of what depends on uncorrelated values of these sigmas (n, 3) by partials (n, 3, 3).

    A sigma that is not a number stays none: the first two together, and all three unless `plane_alone`. What would
    be correlated by more than 0.1 is refused, because a job holds no correlations; less is left out, and said.
    """
    missing: BoolArray = np.asarray(np.isnan(sigma))
    some, all_three = np.any(missing, axis=1, keepdims=True), np.all(missing, axis=1, keepdims=True)
    torn = (some & ~all_three)[:, 0]
    if plane_alone:
        torn = missing[:, 0] != missing[:, 1]
    why = f"some of the sigmas of its {owners.what} are not given, and the others cannot be restated without them"
    findings.refuse(np.asarray(torn), owners.kind, owners.ids, why)
    variance = np.where(missing, 0.0, sigma) ** 2
    used = np.where(all_three[:, :, None], 0.0, partials)
    covariance = np.einsum("nij,nj,nkj->nik", used, variance, used)
    out = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    scale = out[:, :, None] * out[:, None, :]
    correlation = np.divide(covariance, scale, out=np.zeros_like(covariance), where=scale > 0.0)
    largest = np.abs(correlation - correlation * np.eye(3)).max(axis=(1, 2), initial=0.0)
    why = f"the sigmas of its {owners.what} would be correlated by more than {MOST}, which no job can hold"
    findings.refuse(np.asarray(largest > MOST), owners.kind, owners.ids, why)
    most = float(largest.max(initial=0.0))
    if _WORTH_SAYING < most <= MOST:
        findings.warn(f"correlations of up to {most:.3f} between the sigmas of {owners.what} are left out")
    gone = missing.copy()
    gone[:, :2] |= np.any(missing[:, :2], axis=1, keepdims=True)
    if not plane_alone:
        gone |= some
    return np.where(gone, np.nan, out)
