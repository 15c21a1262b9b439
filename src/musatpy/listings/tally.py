"""Findings gathered section by section, with the largest difference of each unit."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from musatpy.listings.findings import Finding, SectionSummary


@dataclass(eq=False)
class Tally:
    """What was found in one section so far."""

    title: str
    rows: int = 0
    passed: int = 0
    untold: int = 0  # fields of asterisks in both files
    findings: list[Finding] = field(default_factory=list)
    largest: dict[tuple[str, bool], Finding] = field(default_factory=dict)  # by unit, and whether in sigmas
    sizes: dict[tuple[str, bool], Any] = field(default_factory=dict)  # of these, a key has numbers of one type

    def found(self, finding: Finding, *, passes: bool = False) -> None:
        """Take a difference, which a rule lets pass or not."""
        if passes:
            self.passed += 1
        else:
            self.findings.append(finding)
        difference, sigmas = finding.difference, finding.sigmas
        if difference is None:
            return
        key = finding.unit, sigmas is not None
        size: Any = abs(difference) if sigmas is None else abs(sigmas)
        known = self.sizes.get(key)
        if known is None or size > known:
            self.largest[key] = finding
            self.sizes[key] = size

    def summary(self) -> SectionSummary:
        """Return the numbers of the section."""
        return SectionSummary(
            title=self.title,
            rows=self.rows,
            different=len(self.findings),
            passed=self.passed,
            largest=tuple(self.largest.values()),
        )
