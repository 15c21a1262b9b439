"""Findings gathered section by section, with the largest difference of each unit."""

from __future__ import annotations

from dataclasses import dataclass, field
from decimal import Decimal

from musatpy.reportdiff.findings import Finding, SectionSummary


@dataclass(eq=False)
class Tally:
    """What was found in one section so far."""

    title: str
    rows: int = 0
    passed: int = 0
    untold: int = 0  # fields of asterisks in both files
    findings: list[Finding] = field(default_factory=list)
    largest: dict[tuple[str, bool], Finding] = field(default_factory=dict)

    def found(self, finding: Finding, *, passes: bool = False) -> None:
        """Take a difference, which a rule lets pass or not."""
        if passes:
            self.passed += 1
        else:
            self.findings.append(finding)
        difference, unit, sigmas = finding.difference, finding.unit, finding.sigmas
        if difference is not None and self.is_larger(unit, difference, sigmas):
            self.largest[unit, sigmas is not None] = finding

    def is_larger(self, unit: str, difference: Decimal, sigmas: float | None = None) -> bool:
        """Tell whether a difference is the largest of its unit so far; in sigmas, where it is known in sigmas."""
        known = self.largest.get((unit, sigmas is not None))
        if known is None or known.difference is None:
            return True
        if sigmas is not None and known.sigmas is not None:
            return abs(sigmas) > abs(known.sigmas)
        return abs(difference) > abs(known.difference)

    def summary(self) -> SectionSummary:
        """Return the numbers of the section."""
        return SectionSummary(
            title=self.title,
            rows=self.rows,
            different=len(self.findings),
            passed=self.passed,
            largest=tuple(self.largest.values()),
        )
