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
    findings: list[Finding] = field(default_factory=list)
    largest: dict[str, Finding] = field(default_factory=dict)

    def found(self, finding: Finding, *, passes: bool = False) -> None:
        """Take a difference, which a rule lets pass or not."""
        if passes:
            self.passed += 1
        else:
            self.findings.append(finding)
        if finding.difference is None:
            return
        known = self.largest.get(finding.unit)
        if finding.sigmas is not None and known is not None and known.sigmas is not None:
            larger = abs(finding.sigmas) > abs(known.sigmas)
        else:
            larger = self.is_larger(finding.unit, finding.difference)
        if larger:
            self.largest[finding.unit] = finding

    def is_larger(self, unit: str, difference: Decimal) -> bool:
        """Tell whether a difference is the largest so far."""
        known = self.largest.get(unit)
        return known is None or known.difference is None or abs(difference) > abs(known.difference)

    def summary(self) -> SectionSummary:
        """Return the numbers of the section."""
        return SectionSummary(
            title=self.title,
            rows=self.rows,
            different=len(self.findings),
            passed=self.passed,
            largest=tuple(self.largest.values()),
        )
